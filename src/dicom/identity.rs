//! Which study and series a volume came from, for routing by UID and for nothing else.
//!
//! UIDs lead to a patient for whoever has the archive, so they are kept out of logs, metrics and messages: `Debug` shows
//! none.

use super::series::SeriesEntry;

/// Study and Series Instance UID of a volume.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct SeriesIdentity {
    study_uid: String,
    series_uid: String,
}

impl SeriesIdentity {
    /// The identity with these UIDs; empty ones are those of files that have none.
    #[must_use]
    pub fn new(study_uid: impl Into<String>, series_uid: impl Into<String>) -> Self {
        Self { study_uid: study_uid.into(), series_uid: series_uid.into() }
    }

    /// Whether these are its UIDs. Nothing matches what has no UID.
    #[must_use]
    pub fn is(&self, study_uid: &str, series_uid: &str) -> bool {
        let known = !self.study_uid.is_empty() && !self.series_uid.is_empty();
        known && self.study_uid == study_uid && self.series_uid == series_uid
    }
}

impl std::fmt::Debug for SeriesIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SeriesIdentity(withheld)")
    }
}

impl SeriesEntry {
    /// Its study and series, without the number that tells several stacks of one series apart.
    #[must_use]
    pub fn identity(&self) -> SeriesIdentity {
        let file = &self.frames[0].file;
        SeriesIdentity::new(file.study_uid.as_str(), file.series_uid.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identity_is_matched_by_both_uids_and_shows_none() {
        let identity = SeriesIdentity::new("1.2.3", "1.2.3.4");
        assert!(identity.is("1.2.3", "1.2.3.4"));
        assert!(!identity.is("1.2.3", "1.2.3.5") && !identity.is("1.2.4", "1.2.3.4"));
        assert!(!SeriesIdentity::default().is("", ""), "files without UIDs are not all the same");
        assert!(!format!("{identity:?}").contains("1.2.3"));
    }
}
