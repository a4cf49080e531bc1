//! Warnings: anomalies of a series, and how each was handled.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

/// A message for the user of a volume.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable name for programs.
    pub code: WarningCode,
    /// For people: the anomaly, its place and extent, and its treatment.
    pub message: String,
}

/// The kinds of warnings; their names in JSON are stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WarningCode {
    /// Slices are sheared against their normal; the volume was resampled.
    GantryTilt,
    /// Gaps between slices differ; the volume was resampled.
    UnevenSpacing,
    /// A slice lies where another one does; it was left out.
    DuplicatePosition,
    /// Slices of one stack differ in derivation, kernel, energy or thickness, or passes overlap in it.
    MixedSlices,
    /// The same image was found twice; one was left out.
    DuplicateFile,
    /// A file could not be used.
    BadFile,
    /// The transfer of the series has not ended or was interrupted; slices may be missing.
    Interrupted,
    /// There is only one slice; its thickness had to stand in for a spacing.
    SingleSlice,
    /// Slope and intercept are absent; stored values were taken as HU.
    MissingRescale,
    /// The values are not in HU; they were not converted.
    OtherValues,
    /// Values beyond 16 bits were clipped.
    ClippedValues,
    /// The file does not declare its encoding; it was guessed.
    GuessedEncoding,
    /// The images were compressed with loss.
    LossyCompression,
}

impl WarningCode {
    /// The anomaly in one sentence, without names of files and values: other people may read it.
    #[must_use]
    pub fn summary(self) -> &'static str {
        match self {
            Self::GantryTilt => "The slices are tilted; the volume was resampled.",
            Self::UnevenSpacing => "The distances between slices differ; the volume was resampled.",
            Self::DuplicatePosition => "Several slices have one position; one of them is shown.",
            Self::MixedSlices => {
                "The slices differ in derivation, kernel, energy or thickness, or passes overlap."
            }
            Self::DuplicateFile => "An image was there twice; one copy is shown.",
            Self::BadFile => "A file could not be used; the series may be incomplete.",
            Self::Interrupted => {
                "The transfer of the series has not ended or was interrupted; slices may be missing."
            }
            Self::SingleSlice => "There is only one slice.",
            Self::MissingRescale => "The files have no rescale values; stored values are taken as HU.",
            Self::OtherValues => "The values are not in HU.",
            Self::ClippedValues => "Values beyond 16 bits are clipped.",
            Self::GuessedEncoding => "A file does not declare its encoding; it was guessed.",
            Self::LossyCompression => "The images were compressed with loss.",
        }
    }
}

impl WarningCode {
    /// The summaries of these warnings, each once, as one text.
    #[must_use]
    pub fn summaries(warnings: &[Self]) -> String {
        let kinds: BTreeSet<Self> = warnings.iter().copied().collect();
        kinds.into_iter().map(Self::summary).collect::<Vec<_>>().join(" ")
    }
}

impl Warning {
    pub(super) fn new(code: WarningCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}
