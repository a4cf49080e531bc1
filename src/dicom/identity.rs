//! The study, series and frame of reference of a volume, for routing by UID, for matching
//! annotations, and for nothing else.
//!
//! UIDs identify a patient to anyone with access to the archive, so they are kept out of logs,
//! metrics and messages: `Debug` shows none of them.

use super::series::{Phase, SeriesEntry};

/// Study and Series Instance UID of a volume, and its Frame of Reference UID.
#[derive(Clone, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SeriesIdentity {
    study_uid: String,
    series_uid: String,
    frame_of_reference_uid: String,
    /// Its phase, and the number of the region whose phases these are.
    #[serde(default)]
    phase: Option<(Phase, usize)>,
}

impl SeriesIdentity {
    /// The identity with these UIDs; empty ones are those of files that have none.
    #[must_use]
    pub fn new(study_uid: impl Into<String>, series_uid: impl Into<String>) -> Self {
        let [study_uid, series_uid] = [study_uid.into(), series_uid.into()];
        Self { study_uid, series_uid, ..Self::default() }
    }

    /// The same with a Frame of Reference UID; an empty one stands for none.
    #[must_use]
    pub fn within_frame_of_reference(self, uid: impl Into<String>) -> Self {
        Self { frame_of_reference_uid: uid.into(), ..self }
    }

    /// The same as a phase of the region with this number.
    #[must_use]
    pub fn in_phase(self, phase: Phase, region: usize) -> Self {
        Self { phase: Some((phase, region)), ..self }
    }

    /// Which phase of its series it is, where that shows one region several times.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.phase.map(|(phase, _)| phase)
    }

    /// Whether both are phases of one region. A series without UIDs has no others.
    #[must_use]
    pub fn is_of_same_region(&self, other: &Self) -> bool {
        let region = |of: &Self| of.phase.map(|(phase, region)| (phase.count, region));
        region(self).is_some()
            && region(self) == region(other)
            && self.frame_of_reference_uid == other.frame_of_reference_uid
            && self.is(&other.study_uid, &other.series_uid)
    }

    /// Frame of Reference UID (0020,0052): the coordinate system of the volume's positions. `None`
    /// where files have none. Not for messages.
    #[must_use]
    pub fn frame_of_reference(&self) -> Option<&str> {
        Some(self.frame_of_reference_uid.as_str()).filter(|uid| !uid.is_empty())
    }

    /// Whether these are its UIDs. A series without UIDs matches nothing.
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
    /// Its study and series, without the number that distinguishes several stacks of one series.
    #[must_use]
    pub fn identity(&self) -> SeriesIdentity {
        let file = &self.frames[0].file;
        let identity = SeriesIdentity::new(file.study_uid.as_str(), file.series_uid.as_str())
            .within_frame_of_reference(self.frame_of_reference().unwrap_or_default());
        match self.phase() {
            Some(phase) => identity.in_phase(phase, self.region()),
            None => identity,
        }
    }

    /// Frame of Reference UID (0020,0052), where all slices have the same one. Not for messages.
    #[must_use]
    pub fn frame_of_reference(&self) -> Option<&str> {
        let uid = self.frames[0].file.frame_of_reference_uid.as_str();
        let is_shared = self.frames.iter().all(|frame| frame.file.frame_of_reference_uid == uid);
        (is_shared && !uid.is_empty()).then_some(uid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Invariant: DICOMweb requests find volumes by UID, and no log, metric or answer contains one;
    /// viewpoints follow the standard, and the reported module reproduces the picture.
    #[test]
    fn an_identity_is_matched_by_both_uids_and_shows_none() {
        let identity = SeriesIdentity::new("1.2.3", "1.2.3.4");
        assert!(identity.is("1.2.3", "1.2.3.4"));
        assert!(!identity.is("1.2.3", "1.2.3.5") && !identity.is("1.2.4", "1.2.3.4"));
        assert!(!SeriesIdentity::default().is("", ""), "files without UIDs are not all the same");
        let phase = |number| {
            let phase = Phase { number, count: 2 };
            SeriesIdentity::new("1.2.3", "1.2.3.4").in_phase(phase, 1)
        };
        assert!(phase(1).is_of_same_region(&phase(2)) && !phase(1).is_of_same_region(&identity));
        let elsewhere = SeriesIdentity::new("1.2.3", "1.2.3.4").in_phase(Phase { number: 2, count: 2 }, 2);
        assert!(!phase(1).is_of_same_region(&elsewhere), "another region");
        let nameless = SeriesIdentity::default().in_phase(Phase { number: 1, count: 2 }, 1);
        assert!(!nameless.is_of_same_region(&nameless), "files without UIDs are not all the same");
        let identity = identity.within_frame_of_reference("1.2.9");
        assert_eq!(identity.frame_of_reference(), Some("1.2.9"));
        assert_eq!(SeriesIdentity::default().frame_of_reference(), None);
        let shown = format!("{identity:?}");
        assert!(!shown.contains("1.2.3") && !shown.contains("1.2.9"));
    }
}
