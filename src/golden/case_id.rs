//! The identity of a golden case: suite and name.

use std::fmt;
/// Suite and name of a case: `camera/front`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(into = "String")]
pub struct CaseId {
    pub(super) suite: String,
    pub(super) name: String,
}

impl CaseId {
    /// The suite.
    #[must_use]
    pub fn suite(&self) -> &str {
        &self.suite
    }

    /// The name within the suite.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether `wanted` is this case's name or its suite's.
    pub(super) fn answers_to(&self, wanted: &str) -> bool {
        let wanted = wanted.trim_end_matches('/');
        match wanted.split_once('/') {
            Some((suite, name)) => self.suite == suite && self.name == name,
            None => self.suite == wanted,
        }
    }
}

impl fmt::Display for CaseId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.suite, self.name)
    }
}
