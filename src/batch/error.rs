//! Errors of batches: before rendering, and job by job.

use std::path::PathBuf;

use relief_dicom::FormatError;
use relief_session::ContentError;
use relief_store::StoreError;
use serde::{Deserialize, Serialize};

use super::query::UnmetCondition;

/// Why a manifest could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// A line is no job.
    #[error("line {line} is not a valid job: {reason}")]
    Line {
        /// From 1.
        line: usize,
        /// Why it is invalid.
        reason: String,
    },
    /// A job says another key than its content has: it was edited by hand.
    #[error(
        "line {line}: the key is {found}, but what the job says has the key {expected}; \
         plan anew instead of editing jobs"
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

/// Why nothing was planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// What to look for is not there.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// Folder or table.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The table of series is invalid.
    #[error("{}, line {line}: {reason}", path.display())]
    Table {
        /// The table.
        path: PathBuf,
        /// From 1.
        line: u64,
        /// Why it is invalid.
        reason: String,
    },
    /// The log of annotations gives nothing.
    #[error("--annotations cannot be read: {0}")]
    Annotations(String),
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
    #[error("{0}")]
    Views(String),
    /// There is no series under the root.
    #[error("no CT series under {}{}", path.display(), listed(skipped))]
    NoSeries {
        /// The root.
        path: PathBuf,
        /// The unusable files, with reasons.
        skipped: Vec<(PathBuf, SkipReason)>,
    },
}

/// Why a series has no jobs.
#[derive(Debug, thiserror::Error)]
pub enum SkipReason {
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
    /// A file or folder without CT slices.
    #[error("no CT series")]
    NoSeries,
    /// A table names one series, and the path has several.
    #[error("{count} series found; choose one with series_uid")]
    SeveralSeries {
        /// How many.
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
