//! Warnings: anomalies of a series, and how each was handled.

use serde::Serialize;

/// A message for the user of a volume.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable name for programs.
    pub code: WarningCode,
    /// For people: the anomaly, its place and extent, and its treatment.
    pub message: String,
}

/// The kinds of warnings; their names in JSON are stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
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

impl Warning {
    pub(super) fn new(code: WarningCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}
