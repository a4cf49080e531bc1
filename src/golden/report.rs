//! The result of a check.

use serde::Serialize;

use crate::Case;
use crate::Comparison;
use crate::Raster;
use crate::Tolerance;
use crate::case_id::CaseId;
use crate::compare;
use crate::raster::Aspect;
use relief_render::AdapterDescription;
/// The result of a check.
#[derive(Clone, Debug, Serialize)]
pub struct CheckReport {
    /// The adapter that rendered.
    pub adapter: AdapterDescription,
    /// Every selected case.
    pub cases: Vec<CaseReport>,
}

/// The result of one case.
#[derive(Clone, Debug, Serialize)]
pub struct CaseReport {
    /// Suite and name.
    pub case: CaseId,
    /// In a word.
    pub verdict: Verdict,
    /// The purpose of the case; empty when the case cannot be read.
    pub purpose: String,
    /// The tolerance of its pictures; `None` when it cannot be read.
    pub tolerance: Option<Tolerance>,
    /// The compared pictures.
    pub aspects: Vec<AspectReport>,
    /// Everything that is wrong, in words; empty unless the case failed.
    pub problems: Vec<String>,
    /// The command that makes the present pictures the expected ones.
    pub bless: String,
}

/// The result of one picture of a case.
#[derive(Clone, Debug, Serialize)]
pub struct AspectReport {
    /// The picture.
    pub aspect: Aspect,
    /// The measured difference; `None` when the golden is missing or cannot be read.
    pub comparison: Option<Comparison>,
}

/// A case in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Not one bit differs.
    Identical,
    /// Something differs, by less than the tolerance.
    Within,
    /// It differs by more, or could not be compared.
    Failed,
}

impl CheckReport {
    /// Whether there was something to compare and all of it is as expected.
    #[must_use]
    pub fn passed(&self) -> bool {
        !self.cases.is_empty() && self.failures().next().is_none()
    }

    /// The cases that are not as expected.
    pub fn failures(&self) -> impl Iterator<Item = &CaseReport> {
        self.cases.iter().filter(|case| case.verdict == Verdict::Failed)
    }
}

impl CaseReport {
    /// A case without a blessed picture.
    pub(super) fn failed(id: &CaseId, bless: String) -> Self {
        Self {
            case: id.clone(),
            verdict: Verdict::Failed,
            purpose: String::new(),
            tolerance: None,
            aspects: Vec::new(),
            problems: Vec::new(),
            bless,
        }
    }

    /// Compares one picture with its golden.
    pub(super) fn add(&mut self, case: &Case, aspect: Aspect, actual: Raster) -> Pair {
        let file = aspect.file_name();
        let expected = match case.expected(aspect) {
            Ok(Some(expected)) => Ok(expected),
            Ok(None) => Err(format!("{file} is missing: nobody has approved this picture yet")),
            Err(error) => Err(error.to_string()),
        };
        let expected = expected.map_err(|problem| self.problems.push(problem)).ok();
        let compared = expected.as_ref().map(|expected| compare(expected, &actual, &case.tolerance()));
        for mismatch in compared.iter().flat_map(|comparison| &comparison.mismatches) {
            self.problems.push(format!("{file}: {mismatch}"));
        }
        self.aspects.push(AspectReport { aspect, comparison: compared });
        Pair { aspect, expected, actual }
    }

    /// The verdict on a case without problems.
    pub(super) fn success(&self) -> Verdict {
        let identical =
            |report: &AspectReport| report.comparison.as_ref().is_some_and(Comparison::is_identical);
        if self.aspects.iter().all(identical) { Verdict::Identical } else { Verdict::Within }
    }
}

/// The rendered picture and the golden one.
pub(super) struct Pair {
    pub(super) aspect: Aspect,
    pub(super) expected: Option<Raster>,
    pub(super) actual: Raster,
}
