//! Discovery: the CT series of a path, from headers only.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use super::attributes::quoted;
use super::batches;
use super::distinctions::{Distinction, HU};
use super::error::{Defect, Error, Reasons};
use super::grouping;
use super::header::{self, FrameHeader, Rejection};
use super::series::{self, SeriesEntry};
use super::source::{self, FileSource};
use super::warnings::{Warning, WarningCode};
use crate::progress::Progress;
use crate::progress::Stage;
use relief_base::Budget;

/// The treatment of defective files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strictness {
    /// Leave them out, with a warning.
    #[default]
    Lenient,
    /// Fail.
    Strict,
}

/// A file that gives no slices, and why.
#[derive(Clone, Debug, Serialize)]
pub struct Skipped {
    /// The file, as a path or as `ZIP:ENTRY`.
    pub file: String,
    /// Why it is not used.
    pub reason: String,
    /// Its fault; `None` for sound objects of another kind, and for sidecar files (JSON, tables,
    /// label maps), which phantoms and other tools put beside slices and which are no sign of
    /// damage.
    #[serde(skip)]
    pub defect: Option<Defect>,
}

/// Name of the file that marks a folder whose transfer was interrupted.
pub const INTERRUPTED: &str = "INTERRUPTED";

/// The series under a path.
#[derive(Debug)]
pub struct Discovery {
    path: PathBuf,
    files: usize,
    /// All CT series, in a stable order.
    pub series: Vec<SeriesEntry>,
    /// Files that belong to none.
    pub skipped: Vec<Skipped>,
}

/// Finds the CT series in a folder (with all folders below), a file, a DICOMDIR or a zip.
///
/// Reads headers only, in parallel. Files that are not CT images are listed in
/// [`Discovery::skipped`].
///
/// # Errors
/// When the path cannot be read, or, under [`Strictness::Strict`], when any file is defective.
pub fn discover(
    path: &Path,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Discovery, Error> {
    discover_within(&Budget::default(), path, strictness, progress)
}

/// As [`discover`], within a budget. The series that it finds share the budget when they are
/// loaded.
///
/// # Errors
/// As [`discover`], and when the budget is spent or the reading was cancelled.
pub fn discover_within(
    budget: &Budget,
    path: &Path,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Discovery, Error> {
    let files = source::collect(path, budget)?;
    let step = Progress::counter(Stage::Headers, files.len(), progress);
    let read = |file| {
        let outcome = budget.check().map_err(Defect::from).map_err(Rejection::from);
        let outcome = outcome.and_then(|()| header::read(file, budget));
        step();
        outcome
    };
    let batches = batches::of(files.iter().collect(), |file: &&FileSource| file.memory_bytes()).into_iter();
    let outcomes: Vec<_> =
        batches.flat_map(|files| files.into_par_iter().map(read).collect::<Vec<_>>()).collect();
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    for (file, outcome) in files.iter().zip(outcomes) {
        match outcome {
            Ok(of_file) => frames.extend(of_file),
            Err(Rejection::Defective(Defect::Budget(error))) => return Err(error.into()),
            Err(rejection) => skipped.push(Skipped::new(file.to_string(), rejection)),
        }
    }
    let mut discovery = Discovery { path: path.to_owned(), files: files.len(), series: Vec::new(), skipped };
    discovery.check(strictness)?;
    discovery.series = grouping::group(frames, budget);
    Ok(discovery)
}

impl Skipped {
    fn new(file: String, rejection: Rejection) -> Self {
        match rejection {
            _ if file.rsplit(['/', '\\']).next() == Some(INTERRUPTED) => {
                let defect = Defect::Interrupted;
                Self { file, reason: defect.to_string(), defect: Some(defect) }
            }
            Rejection::Unwanted(reason) => Self { file, reason: shortened(reason.to_string()), defect: None },
            Rejection::Defective(defect) => {
                let is_sidecar =
                    [".csv", ".json", ".nrrd", ".nii", ".nii.gz"].iter().any(|ending| file.ends_with(ending));
                let is_sidecar = is_sidecar && matches!(defect, Defect::NotDicom { .. });
                let reason = shortened(defect.to_string());
                Self { file, reason, defect: (!is_sidecar).then_some(defect) }
            }
        }
    }

    fn parts(&self) -> (String, String) {
        (self.file.clone(), self.reason.clone())
    }
}

/// As much of a reason as a list shows: values of a file stand in it.
fn shortened(reason: String) -> String {
    const MOST: usize = 400;
    match reason.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &reason[..end]),
        None => reason,
    }
}

impl Discovery {
    fn check(&self, strictness: Strictness) -> Result<(), Error> {
        let defective: Vec<(String, String)> = self.defective().map(Skipped::parts).collect();
        match strictness {
            Strictness::Strict if !defective.is_empty() => {
                Err(Error::Strict { count: defective.len(), reasons: Reasons::about(defective) })
            }
            _ => Ok(()),
        }
    }

    /// Files that something is wrong with.
    pub fn defective(&self) -> impl Iterator<Item = &Skipped> {
        self.skipped.iter().filter(|skipped| skipped.defect.is_some())
    }

    /// A warning for each defective file.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let warning = |Skipped { file, reason, defect }: &Skipped| match defect {
            Some(Defect::Interrupted) => Warning::new(WarningCode::Interrupted, reason.clone()),
            _ => Warning::new(WarningCode::BadFile, format!("{file}: {reason}")),
        };
        self.defective().map(warning).collect()
    }

    /// The series with this UID, or the only one.
    ///
    /// # Errors
    /// When there is no series, when there are several and no UID is given, or when no
    /// series has the UID; the messages list the existing ones.
    pub fn select(&self, uid: Option<&str>) -> Result<&SeriesEntry, Error> {
        let listing = || series::listing(&self.series);
        match (self.series.as_slice(), uid) {
            ([], _) => {
                let reasons = Reasons::about(self.skipped.iter().map(Skipped::parts));
                Err(Error::NoSeries { path: self.path.clone(), files: self.files, reasons })
            }
            (series, Some(uid)) => series
                .iter()
                .find(|entry| entry.uid() == uid)
                .ok_or_else(|| Error::UnknownSeries { uid: uid.to_owned(), listing: listing() }),
            ([only], None) => Ok(only),
            (several, None) => Err(Error::SeveralSeries { count: several.len(), listing: listing() }),
        }
    }

    /// The phases of one region, in their order, where the series, or those that `uid` names, are
    /// nothing else.
    #[must_use]
    pub fn phases(&self, uid: Option<&str>) -> Option<Vec<&SeriesEntry>> {
        series::phases(&self.series, uid)
    }

    /// The series with this number among its phases (see [`SeriesEntry::phase`]); `uid` chooses where
    /// several series have phases.
    ///
    /// # Errors
    /// When there is no series, when none has this phase, or when several have.
    pub fn select_phase(&self, uid: Option<&str>, number: usize) -> Result<&SeriesEntry, Error> {
        if self.series.is_empty() {
            return self.select(uid);
        }
        series::of_phase(&self.series, uid, number)
    }
}

/// The warnings that follow from headers only.
pub(super) fn header_warnings(frames: &[FrameHeader]) -> Vec<Warning> {
    let warn = |code, applies: fn(&FrameHeader) -> bool, what: &str| {
        let mut concerned = frames.iter().filter(|frame| applies(frame));
        let first = concerned.next()?;
        let count = concerned.count() + 1;
        Some(Warning::new(code, format!("{count} slice(s): {what}; first: {first}")))
    };
    let rescale = warn(
        WarningCode::MissingRescale,
        |frame| frame.file.missing_rescale,
        "RescaleSlope (0028,1053) and RescaleIntercept (0028,1052): found nothing, expected two numbers; stored values \
         were taken as HU",
    );
    let guessed = warn(
        WarningCode::GuessedEncoding,
        |frame| frame.file.syntax.guessed,
        "TransferSyntaxUID (0002,0010): found nothing, expected a UID; the encoding was guessed from the first element",
    );
    let lossy = warn(
        WarningCode::LossyCompression,
        |frame| frame.file.lossy,
        "LossyImageCompression (0028,2110): found 01; HU are those of the compressed images",
    );
    let quantity = |frame: &FrameHeader| frame.distinctions.get(Distinction::Quantity) != HU;
    let values = frames.iter().find(|frame| quantity(frame)).map(|frame| {
        let rounded = if frame.rescale.is_whole() {
            "not converted".to_owned()
        } else {
            format!("rounded to whole numbers, from steps of {}", frame.rescale.slope)
        };
        let message = format!(
            "RescaleType (0028,1054): found {}, expected HU; the values were {rounded}, and presets and windows in HU do \
             not suit them; first: {frame}",
            quoted(frame.distinctions.get(Distinction::Quantity))
        );
        Warning::new(WarningCode::OtherValues, message)
    });
    [rescale, values, guessed, lossy].into_iter().flatten().collect()
}
