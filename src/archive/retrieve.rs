//! Retrieval by WADO-RS: the instances of a series, several at a time, as files.
//!
//! Each instance is a request of its own. An instance whose connection breaks is requested again,
//! and those that a folder already has are not: a retrieval that was interrupted goes on.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use futures_util::{StreamExt, TryStreamExt, stream};
use relief_dicom::{ObjectIdentity, read_identity_of_file};
use reqwest::header::CONTENT_TYPE;

use crate::client::Archive;
use crate::error::ArchiveError;
use crate::part::PartReader;

/// Instances that are retrieved at a time.
const AT_ONCE: usize = 6;
/// Time that is added to the time for an instance's bytes at the lowest mean rate.
const PATIENCE: Duration = Duration::from_secs(30);
/// Lowest mean rate of an instance, bytes per second.
const SLOWEST_BYTES_PER_S: u64 = 8 << 10;
/// Bytes that are gathered before they are written.
const WRITTEN_AT_ONCE: usize = 256 << 10;
/// As stored, whatever the transfer syntax.
const STORED: &str = "multipart/related; type=\"application/dicom\"; transfer-syntax=*";
/// The mark of DICOM files, behind a preamble of 128 bytes.
const MARK: &[u8] = b"DICM";
/// Ending of files that are not whole yet.
const PARTIAL: &str = "partial";

/// The instances of one series in an archive, in the order of their UIDs.
#[derive(Clone)]
pub struct Retrieved {
    study: String,
    series: String,
    instances: Vec<String>,
    /// The id of the patient, if it is known.
    patient_id: Option<String>,
}

impl Retrieved {
    /// The UIDs of the instances, which identify their state: an instance never changes.
    #[must_use]
    pub fn instances(&self) -> &[String] {
        &self.instances
    }

    /// The same instances, with the id of their patient. Instances of another patient are refused.
    #[must_use]
    pub fn of_patient(self, id: Option<&str>) -> Self {
        let id = id.map(str::trim).filter(|id| !id.is_empty());
        Self { patient_id: id.map(str::to_owned), ..self }
    }

    /// The first property in which an object differs from the requested instance.
    fn difference(&self, number: usize, found: &ObjectIdentity) -> Option<&'static str> {
        // Archives send ids in UTF-8, files have character sets of their own: only ASCII is the same in both.
        let is_comparable = |id: &str| !id.is_empty() && id.is_ascii();
        let is_other_patient = self.patient_id.as_deref().is_some_and(|wanted| {
            is_comparable(wanted) && is_comparable(&found.patient_id) && found.patient_id != wanted
        });
        let differences = [
            (is_other_patient, "patient"),
            (found.study != self.study, "study"),
            (found.series != self.series, "series"),
            (found.sop_instance != self.instances[number], "instance"),
        ];
        differences.into_iter().find_map(|(differs, what)| differs.then_some(what))
    }

    /// The name of the file of an instance within the folder of a retrieval. Names of files show
    /// no UIDs.
    #[must_use]
    pub fn file_name(number: usize) -> String {
        format!("{number:06}.dcm")
    }
}

/// UIDs are not shown.
impl std::fmt::Debug for Retrieved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Retrieved").field("instances", &self.instances.len()).finish_non_exhaustive()
    }
}

impl Archive {
    /// Lists the instances of a series.
    ///
    /// # Errors
    /// When the archive does not answer, refuses, or has no such series.
    pub fn listed(&self, study: &str, series: &str) -> Result<Retrieved, ArchiveError> {
        let instances = self.instances(study, series)?;
        Ok(Retrieved { study: study.to_owned(), series: series.to_owned(), instances, patient_id: None })
    }

    /// Retrieves the instances that a folder does not have yet. `reserve` is given the bytes of all
    /// of them so far, and may refuse; `progress` the number of whole ones.
    ///
    /// # Errors
    /// When the archive does not answer, sends anything but the DICOM files of these instances, or no longer has
    /// one of them; or when `reserve` refuses or a file cannot be written. Whole instances stay in
    /// the folder.
    pub fn retrieve(
        &self,
        wanted: &Retrieved,
        folder: &Path,
        reserve: &(dyn Fn(u64) -> std::io::Result<()> + Sync),
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<(), ArchiveError> {
        let (bytes, done) = (AtomicU64::new(0), AtomicU64::new(0));
        let one = async |number: usize| {
            let path = folder.join(Retrieved::file_name(number));
            if let Ok(found) = std::fs::metadata(&path) {
                reserve(bytes.fetch_add(found.len(), Ordering::Relaxed) + found.len())?;
            } else {
                let grow = |more: u64| reserve(bytes.fetch_add(more, Ordering::Relaxed) + more);
                let shrink = |less: u64| {
                    bytes.fetch_sub(less, Ordering::Relaxed);
                };
                self.tried(async || self.instance(wanted, number, &path, &grow, &shrink).await).await?;
            }
            progress(done.fetch_add(1, Ordering::Relaxed) as usize + 1);
            Ok::<_, ArchiveError>(())
        };
        let numbers = stream::iter(0..wanted.instances.len());
        self.runtime.block_on(numbers.map(one).buffer_unordered(AT_ONCE).try_collect::<()>())
    }

    async fn instance(
        &self,
        wanted: &Retrieved,
        number: usize,
        path: &Path,
        grow: &(dyn Fn(u64) -> std::io::Result<()> + Sync),
        shrink: &(dyn Fn(u64) + Sync),
    ) -> Result<(), ArchiveError> {
        let mut written = 0;
        let partial: PathBuf = path.with_extension(PARTIAL);
        let outcome = self.instance_into(wanted, number, &partial, grow, &mut written).await;
        let outcome = outcome.and_then(|()| self.expect_wanted(wanted, number, &partial));
        if outcome.is_err() {
            shrink(written);
            let _ = std::fs::remove_file(&partial);
            return outcome;
        }
        Ok(std::fs::rename(&partial, path)?)
    }

    /// Checks that a file is the requested instance. Otherwise another patient's volume would appear under
    /// this patient's name.
    fn expect_wanted(&self, wanted: &Retrieved, number: usize, file: &Path) -> Result<(), ArchiveError> {
        let identity = read_identity_of_file(file);
        let identity = identity.map_err(|_| self.answer("a damaged file", "a DICOM file"))?;
        match wanted.difference(number, &identity) {
            Some(what) => Err(ArchiveError::Other { archive: self.base.clone(), what }),
            None => Ok(()),
        }
    }

    async fn instance_into(
        &self,
        wanted: &Retrieved,
        number: usize,
        partial: &Path,
        grow: &(dyn Fn(u64) -> std::io::Result<()> + Sync),
        written: &mut u64,
    ) -> Result<(), ArchiveError> {
        let Retrieved { study, series, instances, .. } = wanted;
        let path = format!("/studies/{study}/series/{series}/instances/{}", instances[number]);
        let mut response = self.get(&path, &[], STORED, "instance").await?;
        let mut part = self.part(&response)?;
        // Writing waits in place: nothing else runs on this client's threads.
        let mut file = BufWriter::with_capacity(WRITTEN_AT_ONCE, File::create(partial)?);
        let (mut beginning, since) = (Vec::new(), Instant::now());
        while let Some(chunk) = self.chunk(&mut response).await? {
            let allowed = PATIENCE + Duration::from_secs(*written / SLOWEST_BYTES_PER_S);
            if since.elapsed() > allowed {
                return Err(self.too_slow(allowed));
            }
            let bytes = match &mut part {
                Some(part) => part.push(&chunk).map_err(|_| self.answer("a damaged answer", "one part"))?,
                None => chunk.to_vec(),
            };
            if beginning.len() < 128 + MARK.len() {
                beginning.extend(bytes.iter().take(128 + MARK.len() - beginning.len()));
            }
            grow(bytes.len() as u64)?;
            *written += bytes.len() as u64;
            file.write_all(&bytes)?;
        }
        file.flush()?;
        let is_whole = part.as_ref().is_none_or(PartReader::is_done);
        if !is_whole || beginning.get(128..) != Some(MARK) {
            return Err(self.answer("something else", "a DICOM file"));
        }
        Ok(())
    }

    /// How an answer is split; some archives send a single file as it is.
    fn part(&self, response: &reqwest::Response) -> Result<Option<PartReader>, ArchiveError> {
        let kind =
            response.headers().get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
        if kind.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/dicom")) {
            return Ok(None);
        }
        PartReader::of(kind).map(Some).map_err(|_| self.answer("another media type", "multipart/related"))
    }
}
