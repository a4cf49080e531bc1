//! Errors of batches: before rendering, and job by job.

use std::path::PathBuf;

use relief_base::OutOfRange;
use relief_dicom::FormatError;
use relief_render::SceneError;
use relief_session::ContentError;
use relief_store::StoreError;
use serde::{Deserialize, Serialize};

use super::isolation::IsolationError;
use super::names::NAMES;
use super::product::Product;
use super::query::UnmetCondition;

/// Why a manifest could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// A line is no job.
    #[error("line {line} is not a valid job: {source}")]
    Line {
        /// From 1.
        line: usize,
        /// Why it is invalid.
        source: JobError,
    },
    /// A job says another key than its content has: it was edited by hand.
    #[error(
        "line {line}: the key is {found}, but what the job says has the key {expected}; \
         plan again instead of editing jobs"
    )]
    Key {
        /// From 1.
        line: usize,
        /// The key written.
        found: String,
        /// The key of its content.
        expected: String,
    },
    /// Two jobs would write the same files.
    #[error("lines {first} and {second} would both write {name}")]
    Twice {
        /// From 1.
        first: usize,
        /// From 1.
        second: usize,
        /// Series and view.
        name: String,
    },
}

/// Why a line of a manifest is not a job.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The line cannot be read.
    #[error(transparent)]
    Unreadable(#[from] std::io::Error),
    /// The line is longer than any job.
    #[error("longer than {0} bytes")]
    TooLong(u64),
    /// The line is not JSON, or has an unknown key or a value of the wrong kind.
    #[error("{path}: {source}")]
    Json {
        /// Path of the key.
        path: String,
        /// The error of the JSON parser.
        source: serde_json::Error,
    },
    /// A name could not be part of a file's name.
    #[error("{key} is {found:?}, allowed: {NAMES}")]
    Name {
        /// The key.
        key: &'static str,
        /// The name.
        found: String,
    },
    /// A hash has another form.
    #[error("{0} is no SHA-256 in 64 hexadecimal digits")]
    Hash(&'static str),
    /// Nothing would be written.
    #[error("products is empty, allowed: {}", Product::names())]
    NoProducts,
    /// A product draws annotations that the job does not have.
    #[error("a product draws annotations, and the job has none")]
    NoAnnotations,
}

/// Why a row of a table of series is invalid.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file cannot be read, or is not CSV.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// A column without a meaning.
    #[error("unknown column {found:?}, allowed: {}", allowed.join(", "))]
    UnknownColumn {
        /// Its heading.
        found: String,
        /// The columns of such a table.
        allowed: &'static [&'static str],
    },
    /// The column of the series is missing.
    #[error("there is no column path")]
    NoPathColumn,
    /// A row without a series.
    #[error("path is empty")]
    NoPath,
    /// Two rows have one name.
    #[error("name {name:?} is that of line {first}, too")]
    RepeatedName {
        /// The name.
        name: String,
        /// The line that had it first, from 1.
        first: u64,
    },
    /// A name could not be part of a file's name.
    #[error("name is {0:?}, allowed: {NAMES}")]
    Name(String),
}

/// Why nothing was planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The file to look for cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// Folder or table.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The table of series is invalid.
    #[error("{}, line {line}: {source}", path.display())]
    Table {
        /// The table.
        path: PathBuf,
        /// From 1.
        line: u64,
        /// Why it is invalid.
        source: TableError,
    },
    /// The log of annotations gives nothing.
    #[error("--annotations cannot be read: {0}")]
    Annotations(#[from] AnnotationsError),
    /// The annotations cannot be written beside the manifest.
    #[error("cannot write into {}: {source}", path.display())]
    Unwritable {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// There are series, and none of them has a view.
    #[error("no view of any series can be rendered{}", last.as_ref().map(|reason| format!(": {reason}")).unwrap_or_default())]
    NoViews {
        /// Why the last series has none.
        last: Option<SkipReason>,
    },
    /// A view set is invalid.
    #[error(transparent)]
    Views(#[from] ViewsError),
    /// There is no series under the root.
    #[error("no CT series under {}{}", path.display(), listed(skipped))]
    NoSeries {
        /// The root.
        path: PathBuf,
        /// The unusable files, with reasons.
        skipped: Vec<(PathBuf, SkipReason)>,
    },
}

/// Why the log of annotations gives nothing.
#[derive(Debug, thiserror::Error)]
pub enum AnnotationsError {
    /// The runtime of the database cannot be started.
    #[error(transparent)]
    System(#[from] std::io::Error),
    /// The log cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A set is named that the log does not have.
    #[error("there is no set {name:?}")]
    NoSet {
        /// The name.
        name: String,
    },
}

/// Why a view set is refused.
#[derive(Debug, thiserror::Error)]
pub enum ViewsError {
    /// Two views would write the same files.
    #[error("two views are called {name:?}")]
    Twice {
        /// The name.
        name: String,
    },
    /// A turntable with an impossible number of views.
    #[error("{set}:{found}: allowed: {set}:1 to {set}:{most}")]
    Turns {
        /// The name of the set.
        set: &'static str,
        /// The number as written.
        found: String,
        /// The largest number.
        most: u32,
    },
    /// Neither the name of a view set nor a readable file.
    #[error("{}: {source}; view sets are turntable:N, time:N, sides, planes, landmarks, cameras, and files", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The file is no JSON.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The error of the parser.
        source: serde_json::Error,
    },
    /// The file is no list of views.
    #[error("{}: allowed: a JSON array of {{\"name\", \"scene\"}}", path.display())]
    NoList {
        /// The file.
        path: PathBuf,
    },
    /// A view of the file is invalid.
    #[error("{}: view {index}: {source}", path.display())]
    View {
        /// The file.
        path: PathBuf,
        /// From 0.
        index: usize,
        /// Why it is invalid.
        source: ViewError,
    },
}

/// Why a view of a file is invalid.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// It is not an object.
    #[error("allowed: an object")]
    NoObject,
    /// A key that views do not have.
    #[error("unknown key {key:?}, allowed: name, group, scene, azimuth_deg, elevation_deg")]
    UnknownKey {
        /// The key.
        key: String,
    },
    /// A value that is not allowed.
    #[error(transparent)]
    Value(#[from] OutOfRange),
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Angles beside a camera or a slice.
    #[error("azimuth_deg and elevation_deg are for scenes without a camera or a slice")]
    Angles,
}

/// Why a series has no jobs.
#[derive(Debug, thiserror::Error)]
pub enum SkipReason {
    /// View set `time` was planned, and the series has no phases.
    #[error("it has no phases, and view set time needs them")]
    NoPhases,
    /// A file of voxels cannot be used.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The slices cannot be used.
    #[error(transparent)]
    Series(#[from] relief_dicom::Error),
    /// The system does not let it be read.
    #[error(transparent)]
    Unreadable(#[from] std::io::Error),
    /// The label map of the series cannot be read.
    #[error("its label map {} cannot be read: {source}", path.display())]
    Labels {
        /// The label map.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The child process that reads a series of a bucket refuses it, or failed.
    #[error(transparent)]
    Isolated(#[from] IsolationError),
    /// A file or folder without CT slices.
    #[error("no CT series")]
    NoSeries,
    /// A table names one series, and the path has several.
    #[error("{count} series found; choose one with series_uid")]
    SeveralSeries {
        /// Their number.
        count: usize,
    },
    /// Another path has the same files.
    #[error("the same files are already in the plan")]
    Repeated,
    /// `--where` does not select it.
    #[error(transparent)]
    Unmet(#[from] UnmetCondition),
    /// A view set of annotations, and the series has none.
    #[error("the log has no annotation of this series to look at")]
    NoAnnotations,
    /// An annotation's region or mesh cannot be drawn.
    #[error("an annotation cannot be drawn: {0}")]
    Content(#[from] ContentError),
    /// The region or mesh of an annotation cannot be read from the log.
    #[error("an annotation cannot be read: {0}")]
    Log(#[from] StoreError),
}

/// The first of those that were skipped, a line each.
fn listed(skipped: &[(PathBuf, SkipReason)]) -> String {
    const MOST: usize = 3;
    let lines = skipped.iter().take(MOST).map(|(path, reason)| format!("\n  {}: {reason}", path.display()));
    let more = skipped.len().saturating_sub(MOST);
    let rest = if more > 0 { format!("\n  and {more} more") } else { String::new() };
    lines.collect::<String>() + &rest
}

/// Whether trying again may help.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FailureKind {
    /// It will fail the same way: the series or the scene is at fault.
    Permanent,
    /// The machine was: a full disk, too little memory, a lost adapter.
    Retryable,
}

/// A job that was not done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Its key.
    pub job: String,
    /// Series and view.
    pub name: String,
    /// Whether trying again may help.
    pub kind: FailureKind,
    /// Why.
    pub reason: String,
}

/// Why a series was not loaded. The reason names no file: reports are read by others.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub(super) struct SeriesError {
    pub(super) kind: FailureKind,
    pub(super) reason: String,
}

impl SeriesError {
    pub(super) fn new(kind: FailureKind, reason: impl std::fmt::Display) -> Self {
        Self { kind, reason: reason.to_string() }
    }

    pub(super) fn permanent(reason: impl std::fmt::Display) -> Self {
        Self::new(FailureKind::Permanent, reason)
    }

    pub(super) fn retryable(reason: impl std::fmt::Display) -> Self {
        Self::new(FailureKind::Retryable, reason)
    }
}
