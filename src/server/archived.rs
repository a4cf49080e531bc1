//! A search over archives: the trait by which the server reaches an archive, the table of the series
//! that searches found, and the state of loading each. `archives` has the routes.

use std::collections::{HashMap, VecDeque};
use std::error::Error;
use std::sync::Arc;

use axum::http::StatusCode;
use data_encoding::HEXLOWER;
use parking_lot::Mutex;
use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::sync::Semaphore;

use super::problem::Problem;
use relief_session::{Engine, LoadedVolume, MemoryFull, VolumeReader, on_blocking_thread};

/// Series that keys are kept for; the oldest keys go first.
const MOST_KEYS: usize = 10_000;
/// Series that may wait to be loaded.
const MOST_WAITING: usize = 32;
/// Most searches at a time, for each archive, so that a slow archive does not block the others.
const SEARCHES: usize = 4;
/// Results that are being stored at a time.
const STORES: usize = 4;

/// Why an archive was not searched, or a series of it not loaded.
type Failure = Box<dyn Error + Send + Sync>;

/// Searches archives, retrieves their series, and stores results in them. All methods block. Clients
/// see the messages of errors, so no message may have UIDs, patients or paths.
pub trait SeriesArchives: Send + Sync {
    /// The names of the archives, in the order of the operator.
    fn names(&self) -> &[String];

    /// The series of an archive that match a query, CT alone.
    ///
    /// # Errors
    /// When the archive does not answer or refuses.
    fn search(&self, archive: usize, query: &SeriesQuery) -> Result<Vec<ArchivedSeries>, Failure>;

    /// Retrieves and reads a series; the reader reads its voxels again.
    ///
    /// # Errors
    /// When it cannot be retrieved, cannot be read, or there is no room for it.
    fn load(
        &self,
        archive: usize,
        series: &ArchivedSeries,
        steps: &LoadSteps<'_>,
    ) -> Result<(LoadedVolume, VolumeReader), Failure>;

    /// Whether clients may store results in the archives.
    fn take_results(&self) -> bool;

    /// Stores a DICOM object in an archive, unless the archive has it.
    ///
    /// # Errors
    /// When the archive does not answer, or does not store objects.
    fn store(&self, archive: usize, object: Vec<u8>) -> Result<StoredResult, Failure>;
}

/// The outcome of storing an object in an archive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredResult {
    /// It was stored.
    Stored,
    /// The archive had it.
    AlreadyThere,
    /// The archive did not store it.
    Refused {
        /// Failure Reason (0008,1197), PS3.18 table I.2-2; absent if it gives none.
        reason: Option<u16>,
    },
}

/// The callbacks of loading a series.
#[derive(Clone)]
pub struct LoadSteps<'a> {
    /// Gets the number of files that have arrived, and the number of all files.
    pub progress: Arc<dyn Fn(usize, usize) + Send + Sync>,
    /// Makes room for this many bytes of voxels.
    pub make_room: &'a dyn Fn(u64) -> Result<(), MemoryFull>,
}

/// The attributes that a series must have. Values are DICOM's: `*` and `?` stand for any letters, and a
/// date may be a range. An absent attribute matches every series.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SeriesQuery {
    /// Id of the patient.
    pub patient_id: Option<String>,
    /// Name of the patient, `FAMILY^GIVEN`.
    pub patient_name: Option<String>,
    /// Accession number.
    pub accession_number: Option<String>,
    /// Date of the study, `YYYYMMDD`, or a range of dates, `YYYYMMDD-YYYYMMDD`.
    pub study_date: Option<String>,
    /// Description of the series.
    pub description: Option<String>,
}

impl SeriesQuery {
    /// DICOM's keywords with the wanted values, without empty ones.
    pub fn attributes(&self) -> impl Iterator<Item = (&str, &str)> {
        let all = [
            ("PatientID", &self.patient_id),
            ("PatientName", &self.patient_name),
            ("AccessionNumber", &self.accession_number),
            ("StudyDate", &self.study_date),
            ("SeriesDescription", &self.description),
        ];
        let given = all.into_iter().filter_map(|(keyword, value)| Some((keyword, value.as_deref()?.trim())));
        given.filter(|(_, value)| !value.is_empty())
    }
}

/// A series of an archive. Its texts come from the archive and may name the patient.
#[derive(Clone, Debug)]
pub struct ArchivedSeries {
    /// UID of its study.
    pub study_uid: String,
    /// Its UID.
    pub series_uid: String,
    /// Date of the study, YYYYMMDD; empty if unknown.
    pub study_date: String,
    /// Body part, as the scanner calls it.
    pub body_part: String,
    /// Number of its instances, if the archive knows it.
    pub instances: Option<u64>,
    /// Description of the series.
    pub description: String,
    /// Id of the patient.
    pub patient_id: String,
    /// Name of the patient.
    pub patient_name: String,
}

/// The archives of a server, and the series that searches found in them.
pub(super) struct Archives {
    pub(super) source: Box<dyn SeriesArchives>,
    /// One for each archive, in the order of their names.
    pub(super) searches: Vec<Arc<Semaphore>>,
    pub(super) stores: Arc<Semaphore>,
    /// One series is loaded at a time.
    turn: Arc<Semaphore>,
    /// Makes keys that tell nothing about UIDs.
    secret: [u8; 32],
    found: Mutex<Found>,
}

#[derive(Default)]
struct Found {
    series: HashMap<String, Known>,
    /// Keys, the oldest first.
    order: VecDeque<String>,
}

#[derive(Clone)]
struct Known {
    archive: usize,
    series: ArchivedSeries,
    load: Option<Load>,
}

/// The state of loading a series.
#[derive(Clone, Debug)]
pub(super) enum Load {
    Waiting,
    Retrieving { done: usize, files: usize },
    Ready { volume: String },
    Failed { reason: String },
}

impl Archives {
    /// # Errors
    /// When the system has no random numbers.
    pub(super) fn new(source: Box<dyn SeriesArchives>) -> Result<Self, getrandom::Error> {
        let mut secret = [0; 32];
        getrandom::fill(&mut secret)?;
        let searches = source.names().iter().map(|_| Arc::new(Semaphore::new(SEARCHES))).collect();
        let [stores, turn] = [STORES, 1].map(|count| Arc::new(Semaphore::new(count)));
        Ok(Self { source, searches, stores, turn, secret, found: Mutex::default() })
    }

    pub(super) fn index(&self, name: &str) -> Result<usize, Problem> {
        let known = self.source.names().iter().position(|known| known == name);
        known.ok_or_else(|| {
            Problem::new(StatusCode::NOT_FOUND, "no-archive", "there is no archive of this name")
        })
    }

    fn key(&self, archive: usize, series: &ArchivedSeries) -> String {
        let mut hash = Sha256::new();
        hash.update(self.secret);
        for part in [&archive.to_string(), &series.study_uid, &series.series_uid] {
            hash.update(part.as_bytes());
            hash.update([0]);
        }
        HEXLOWER.encode(&hash.finalize()[..16])
    }

    /// Keeps a found series, and returns its key and the state of its loading.
    pub(super) fn keep(&self, archive: usize, series: ArchivedSeries) -> (String, Option<Load>) {
        let key = self.key(archive, &series);
        let mut found = self.found.lock();
        if let Some(known) = found.series.get(&key) {
            return (key, known.load.clone());
        }
        while found.series.len() >= MOST_KEYS {
            let Some(oldest) = found.order.pop_front() else { break };
            found.series.remove(&oldest);
        }
        found.order.push_back(key.clone());
        found.series.insert(key.clone(), Known { archive, series, load: None });
        (key, None)
    }

    pub(super) fn state(&self, key: &str) -> Option<Load> {
        self.found.lock().series.get(key).and_then(|known| known.load.clone())
    }

    fn set(&self, key: &str, load: Load) {
        if let Some(known) = self.found.lock().series.get_mut(key) {
            known.load = Some(load);
        }
    }

    /// Marks a series as waiting; `None` if it is waiting, being loaded or loaded already.
    pub(super) fn begin(
        &self,
        archive: usize,
        key: &str,
        engine: &Engine,
    ) -> Result<Option<ArchivedSeries>, Problem> {
        let mut found = self.found.lock();
        let is_waiting = |known: &Known| matches!(known.load, Some(Load::Waiting | Load::Retrieving { .. }));
        let waiting = found.series.values().filter(|known| is_waiting(known)).count();
        let known =
            found.series.get_mut(key).filter(|known| known.archive == archive).ok_or_else(no_series)?;
        match &known.load {
            Some(Load::Waiting | Load::Retrieving { .. }) => return Ok(None),
            Some(Load::Ready { volume }) if engine.volumes.find(volume).is_ok() => return Ok(None),
            _ if waiting >= MOST_WAITING => {
                return Err(Problem::unavailable("busy", "other series are being loaded; try again soon"));
            }
            _ => known.load = Some(Load::Waiting),
        }
        Ok(Some(known.series.clone()))
    }

    /// Retrieves, reads and adds a series; returns the id of its volume.
    fn load(
        self: &Arc<Self>,
        archive: usize,
        key: &str,
        series: &ArchivedSeries,
        engine: &Engine,
    ) -> Result<String, Failure> {
        let (archives, own) = (Arc::clone(self), key.to_owned());
        let progress = Arc::new(move |done, files| archives.set(&own, Load::Retrieving { done, files }));
        let make_room = |bytes| engine.volumes.make_room(bytes);
        let steps = LoadSteps { progress, make_room: &make_room };
        let (loaded, reader) = self.source.load(archive, series, &steps)?;
        Ok(engine.volumes.add_requested(loaded, reader)?.id.clone())
    }
}

impl Load {
    pub(super) fn describe(&self) -> Value {
        match self {
            Self::Waiting => json!({ "state": "waiting" }),
            // All files are there: they are being read.
            Self::Retrieving { done, files } if done == files => {
                json!({ "state": "reading", "files": files })
            }
            Self::Retrieving { done, files } => {
                json!({ "state": "retrieving", "done": done, "files": files })
            }
            Self::Ready { volume } => json!({ "state": "ready", "volume": volume }),
            Self::Failed { reason } => json!({ "state": "failed", "reason": reason }),
        }
    }
}

/// Loads a series in its turn, and keeps the outcome.
pub(super) async fn run(
    archives: Arc<Archives>,
    engine: Arc<Engine>,
    archive: usize,
    key: String,
    series: ArchivedSeries,
) {
    let Ok(turn) = Arc::clone(&archives.turn).acquire_owned().await else { return };
    let job = {
        let (archives, key) = (Arc::clone(&archives), key.clone());
        move || archives.load(archive, &key, &series, &engine)
    };
    let outcome = match on_blocking_thread(turn, "loading a series of an archive", job).await {
        Ok(Ok(volume)) => Load::Ready { volume },
        Ok(Err(error)) => Load::Failed { reason: error.to_string() },
        Err(error) => Load::Failed { reason: error.to_string() },
    };
    if let Load::Failed { reason } = &outcome {
        tracing::warn!("cannot load a series of an archive: {reason}");
    }
    archives.set(&key, outcome);
}

pub(super) fn no_series() -> Problem {
    let detail = "there is no series with this key, or it is not being loaded; search again";
    Problem::new(StatusCode::NOT_FOUND, "no-series", detail)
}
