//! A series that can be loaded. [`grouping`](super::grouping) has the rule for what it holds.

use super::error::Reasons;
use super::header::FrameHeader;
use super::warnings::Warning;
use relief_base::Budget;

/// A CT series that can be loaded: its slices and their headers. `Debug` shows no UIDs.
#[derive(Clone)]
pub struct SeriesEntry {
    uid: String,
    pub(super) frames: Vec<FrameHeader>,
    /// How its slices differ from others of its SeriesInstanceUID; names no patient.
    differs: Vec<String>,
    pub(super) warnings: Vec<Warning>,
    /// The resources that reading its files may still take.
    pub(super) budget: Budget,
}

impl std::fmt::Debug for SeriesEntry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SeriesEntry").field("slices", &self.frames.len()).finish_non_exhaustive()
    }
}

impl SeriesEntry {
    pub(super) fn new(
        uid: String,
        frames: Vec<FrameHeader>,
        differs: Vec<String>,
        warnings: Vec<Warning>,
        budget: &Budget,
    ) -> Self {
        Self { uid, frames, differs, warnings, budget: budget.clone() }
    }

    /// SeriesInstanceUID (0020,000E), followed by `#1`, `#2`, ... where it names several stacks.
    /// May be empty.
    #[must_use]
    pub fn uid(&self) -> &str {
        &self.uid
    }

    /// Modality (0008,0060).
    #[must_use]
    pub fn modality(&self) -> &str {
        &self.frames[0].file.modality
    }

    /// Transfer syntax UID of the slices; several are separated by a comma.
    #[must_use]
    pub fn transfer_syntax(&self) -> String {
        let mut syntaxes: Vec<&str> =
            self.frames.iter().map(|frame| frame.file.syntax.uid.as_str()).collect();
        syntaxes.sort_unstable();
        syntaxes.dedup();
        syntaxes.join(",")
    }

    /// The type of the values (RescaleType), such as MGML, where it is not HU.
    #[must_use]
    pub fn other_values(&self) -> Option<&str> {
        self.frames.iter().find_map(|frame| frame.file.other_values.as_deref())
    }

    /// Columns, rows and slices, as found.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        let layout = &self.frames[0].file.layout;
        [layout.columns as usize, layout.rows as usize, self.frames.len()]
    }

    /// Bytes of a volume of these slices, as their headers have it; for compressed slices that is a
    /// claim.
    #[must_use]
    pub fn voxel_bytes(&self) -> u64 {
        let voxel = size_of::<i16>() as u64;
        self.dims().iter().fold(voxel, |bytes, &n| bytes.saturating_mul(n as u64))
    }

    /// Distance between columns and between rows, mm.
    #[must_use]
    pub fn pixel_spacing_mm(&self) -> [f64; 2] {
        self.frames[0].spacing_mm
    }

    /// SliceThickness (0018,0050) of the first slice, or else SpacingBetweenSlices (0018,0088), mm.
    #[must_use]
    pub fn thickness_mm(&self) -> Option<f64> {
        self.frames[0].thickness_mm
    }

    /// What distinguishes its slices from others of the same SeriesInstanceUID, as "patient 2" or
    /// `ConvolutionKernel (0018,1210) "B70s"`; empty if there are no others. Names no patient.
    #[must_use]
    pub fn differs(&self) -> &[String] {
        &self.differs
    }

    /// One line for a list to choose from.
    #[must_use]
    pub fn summary(&self) -> String {
        let [columns, rows, slices] = self.dims();
        let [dx, dy] = self.pixel_spacing_mm();
        let uid = if self.uid.is_empty() { "\"\" (empty UID)" } else { &self.uid };
        let differs = self.differs.iter().map(|differs| format!("  {differs}")).collect::<String>();
        format!(
            "{uid}  {}  {columns} x {rows} x {slices}  pixels of {dx:.3} x {dy:.3} mm{differs}",
            self.modality()
        )
    }
}

/// The lines that list series in a message.
pub(super) fn listing(series: &[SeriesEntry]) -> Reasons {
    Reasons::plain(series.iter().map(SeriesEntry::summary))
}
