//! Retrieves a series of an archive into a copy.
//!
//! A copy is identified by the UIDs of its instances: instances never change, and a series to which
//! some were added is another copy. What an interrupted retrieval left is completed.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use data_encoding::HEXLOWER;
use rayon::prelude::*;
use relief_archive::{Archive, ArchiveAddress, FoundSeries, OutgoingObject, Retrieved, StoreOutcome};
use relief_base::sha256_of_file;
use sha2::{Digest, Sha256};

use super::shelf::{Draft, WantedCopy};
use super::state::of_this_machine;
use super::{Copies, Local};
use crate::output_file::OutputFile;

/// The modality of the series that are loaded where the address does not say.
const MODALITY: &str = "CT";

impl Copies {
    /// The series that match an address, as an archive lists them.
    ///
    /// # Errors
    /// When the archive does not answer, refuses, or is not one.
    pub fn found_in_archive(&self, address: &ArchiveAddress) -> std::io::Result<Vec<FoundSeries>> {
        Ok(self.archive(address)?.series(address)?)
    }

    /// Stores an object in an archive, unless the archive has it.
    ///
    /// # Errors
    /// When the archive does not answer, or does not store objects.
    pub fn store_in_archive(
        &self,
        address: &ArchiveAddress,
        object: &OutgoingObject,
    ) -> std::io::Result<StoreOutcome> {
        Ok(self.archive(address)?.store(object)?)
    }

    /// The addresses of the CT series that match an address, or of the modality that its query has.
    pub(super) fn places_in_archive(&self, address: &ArchiveAddress) -> std::io::Result<Vec<PathBuf>> {
        if address.series().is_some() {
            return Ok(vec![PathBuf::from(address.to_string())]);
        }
        let is_any = address.query().iter().any(|(name, _)| is_modality(name));
        let found = self.found_in_archive(address)?;
        let wanted = found.iter().filter(|series| is_any || series.modality == MODALITY);
        let places = wanted.map(|series| {
            let place = address.of_series(&series.study_uid, &series.series_uid).map_err(Error::other)?;
            Ok(PathBuf::from(place.to_string()))
        });
        let places: Vec<PathBuf> = places.collect::<std::io::Result<_>>()?;
        if places.is_empty() {
            let reason = match found.len() {
                0 => "no series of the archive match".to_owned(),
                other => format!(
                    "{other} series of the archive match, and none is CT; ?Modality=... in the address wants another"
                ),
            };
            return Err(Error::new(ErrorKind::NotFound, reason));
        }
        Ok(places)
    }

    /// The copy of the one series that an address has.
    pub(super) fn retrieve(&self, address: &ArchiveAddress) -> std::io::Result<Local> {
        let archive = self.archive(address)?;
        let address = self.only_series(address)?;
        let (Some(study), Some(series)) = (address.study(), address.series()) else {
            return Err(Error::new(ErrorKind::InvalidInput, "the address names no series"));
        };
        let listed = archive.listed(study, series)?.of_patient(self.patient_id.0.as_deref());
        let name = name_of(&address, &listed);
        let files = listed.instances().len();
        // The lock is released before the transfer, so that other calls do not wait for it.
        let shelf = self.state.lock().shelf(self.options.folder.as_deref()).map_err(of_this_machine)?;
        let fetch = |draft: &Draft<'_>| {
            let progress = |done: usize| self.options.progress.report(done, files);
            archive.retrieve(&listed, draft.folder(), &|bytes| draft.reserve(bytes), &progress)?;
            (0..files).into_par_iter().map(|number| described(draft.folder(), number)).collect()
        };
        let allowed = self.options.bytes;
        let wanted = WantedCopy { name: &name, files, allowed, resumes: true };
        let (path, held) = shelf.find_or_add(&wanted, fetch)?;
        Ok(Local { path, held: Some(Arc::new(held)), isolated: self.options.isolated.clone() })
    }

    /// The address itself if it names a series, or that of the only match.
    fn only_series(&self, address: &ArchiveAddress) -> std::io::Result<ArchiveAddress> {
        let places = self.places_in_archive(address)?;
        match &*places {
            [one] => {
                let text = one.to_str().unwrap_or_default();
                text.parse().map_err(|error| Error::new(ErrorKind::InvalidInput, error))
            }
            several => {
                let reason = format!(
                    "{} series of the archive match; `relief inspect ADDRESS` lists them, and each with an address of its own",
                    several.len()
                );
                Err(Error::new(ErrorKind::InvalidInput, reason))
            }
        }
    }

    fn archive(&self, address: &ArchiveAddress) -> std::io::Result<Arc<Archive>> {
        let mut state = self.state.lock();
        if let Some(known) = state.archives.get(address.base()) {
            return Ok(Arc::clone(known));
        }
        let opened = Arc::new(Archive::open(address, &self.options.archives)?);
        state.archives.insert(address.base().to_owned(), Arc::clone(&opened));
        Ok(opened)
    }
}

/// By keyword or tag.
fn is_modality(name: &str) -> bool {
    name.eq_ignore_ascii_case("Modality") || name == "00080060"
}

fn described(folder: &Path, number: usize) -> std::io::Result<OutputFile> {
    let file = Retrieved::file_name(number);
    let path = folder.join(&file);
    let bytes = std::fs::metadata(&path)?.len();
    Ok(OutputFile { sha256: sha256_of_file(&path)?, bytes, file })
}

fn name_of(address: &ArchiveAddress, listed: &Retrieved) -> String {
    let mut hasher = Sha256::new();
    hasher.update(format!("{address}\n{}", listed.instances().join("\n")));
    HEXLOWER.encode(&hasher.finalize())
}
