//! One line of the report: a mark, the subject, the finding and the advice.

use serde::Serialize;

/// How serious a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Mark {
    Ok,
    Warn,
    Missing,
    Failed,
}

/// One line of the report.
#[derive(Debug, Serialize)]
pub(super) struct Finding {
    pub(super) mark: Mark,
    pub(super) what: &'static str,
    pub(super) found: String,
    /// The remedy, step by step; empty when all is well.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) advice: Vec<String>,
}

impl Finding {
    pub(super) fn new(mark: Mark, what: &'static str, found: String) -> Self {
        Self { mark, what, found, advice: Vec::new() }
    }

    pub(super) fn advise(self, advice: impl IntoIterator<Item: Into<String>>) -> Self {
        Self { advice: advice.into_iter().map(Into::into).collect(), ..self }
    }
}
