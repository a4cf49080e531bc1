//! `relief serve --archive`: series that clients find in DICOM archives and load, and results that they
//! store there.

use std::path::PathBuf;
use std::sync::Arc;

use relief_archive::{ArchiveAddress, StoreOutcome};
use relief_batch::CopyProgress;
use relief_server::{ArchivedSeries, LoadError, LoadSteps, SeriesArchives, SeriesQuery, StoredResult};
use relief_session::{LoadedVolume, VolumeReader};

use crate::send::outgoing;
use crate::serve::load::{SeriesLoader, SeriesLocation};

/// The modality of the series that are found.
const MODALITY: &str = "CT";

/// An archive that clients may search, by the name that the pages show.
#[derive(Clone, Debug)]
pub(crate) struct NamedArchive {
    name: String,
    address: ArchiveAddress,
}

/// Why a text does not name an archive.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NamedArchiveError {
    /// It has no name.
    #[error("write NAME=dicomweb+https://HOST/ROOT")]
    Form,
    /// The name cannot be part of a path.
    #[error("the name of an archive has 1 to 40 letters, digits, hyphens and underscores")]
    Name,
    /// The address is invalid.
    #[error(transparent)]
    Address(#[from] relief_archive::AddressError),
    /// It is the address of a part of the archive.
    #[error("give the address of the whole archive, without studies and without a query")]
    Part,
}

impl std::str::FromStr for NamedArchive {
    type Err = NamedArchiveError;

    fn from_str(text: &str) -> Result<Self, NamedArchiveError> {
        let (name, address) = text.split_once('=').ok_or(NamedArchiveError::Form)?;
        let is_letter = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
        if !(1..=40).contains(&name.len()) || !name.chars().all(is_letter) {
            return Err(NamedArchiveError::Name);
        }
        let address: ArchiveAddress = address.parse()?;
        if address.study().is_some() || !address.query().is_empty() {
            return Err(NamedArchiveError::Part);
        }
        Ok(Self { name: name.to_owned(), address })
    }
}

/// The archives of `--archive`, and how their series are read.
pub(crate) struct SearchedArchives {
    names: Vec<String>,
    addresses: Vec<ArchiveAddress>,
    loader: Arc<SeriesLoader>,
    take_results: bool,
}

impl SearchedArchives {
    /// # Errors
    /// When two archives have one name.
    pub(crate) fn new(
        archives: &[NamedArchive],
        loader: Arc<SeriesLoader>,
        take_results: bool,
    ) -> anyhow::Result<Self> {
        let names: Vec<String> = archives.iter().map(|archive| archive.name.clone()).collect();
        if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            anyhow::bail!("two archives have the name {} (--archive)", twice.1);
        }
        let addresses = archives.iter().map(|archive| archive.address.clone()).collect();
        Ok(Self { names, addresses, loader, take_results })
    }
}

impl SeriesArchives for SearchedArchives {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn search(&self, archive: usize, query: &SeriesQuery) -> Result<Vec<ArchivedSeries>, LoadError> {
        let attributes = query.attributes().chain([("Modality", MODALITY)]);
        let address = self.addresses[archive].matching(attributes);
        let found = self.loader.copies.found_in_archive(&address)?;
        // An archive may ignore attributes that it does not know.
        let found = found.into_iter().filter(|series| series.modality == MODALITY);
        Ok(found
            .map(|series| ArchivedSeries {
                study_uid: series.study_uid,
                series_uid: series.series_uid,
                study_date: series.study_date,
                body_part: series.body_part,
                instances: series.instances,
                description: series.description,
                patient_id: series.patient_id,
                patient_name: series.patient_name,
            })
            .collect())
    }

    fn load(
        &self,
        archive: usize,
        series: &ArchivedSeries,
        steps: &LoadSteps<'_>,
    ) -> Result<(LoadedVolume, VolumeReader), LoadError> {
        let archive = &self.addresses[archive];
        let address = archive.of_series(&series.study_uid, &series.series_uid)?;
        let place = SeriesLocation::of_archive(PathBuf::from(address.to_string()), archive);
        let progress = Arc::clone(&steps.progress);
        let copies =
            self.loader.copies.with_progress(CopyProgress::new(move |done, files| progress(done, files)));
        let copies = copies.of_patient(&series.patient_id);
        let local = copies.local(place.path())?;
        let listed = self.loader.reader(&place).list(local.path(), &self.loader.options).map_err(public)?;
        let [options] = &*listed else {
            return Err(format!("the archive sent {} series for one UID", listed.len()).into());
        };
        self.loader.read(&place, &local, options, steps.make_room).map_err(public)
    }

    fn take_results(&self) -> bool {
        self.take_results
    }

    fn store(&self, archive: usize, object: Vec<u8>) -> Result<StoredResult, LoadError> {
        let outgoing = outgoing(object)?;
        let outcome = self.loader.copies.store_in_archive(&self.addresses[archive], &outgoing)?;
        Ok(match outcome {
            StoreOutcome::Stored => StoredResult::Stored,
            StoreOutcome::AlreadyThere => StoredResult::AlreadyThere,
            StoreOutcome::Refused { reason } => StoredResult::Refused { reason },
        })
    }
}

/// The name of a series in messages. Its files lie in a folder of this machine.
const SUBJECT: &str = "the series";

/// An error without names of files.
fn public(error: anyhow::Error) -> LoadError {
    match error.downcast::<relief_dicom::Error>() {
        Ok(error) => error.without_names(SUBJECT).into(),
        Err(error) => format!("{error:#}").into(),
    }
}
