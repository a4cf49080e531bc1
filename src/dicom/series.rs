//! A series that can be loaded. [`grouping`](super::grouping) has the rule for what it holds.

use serde::{Deserialize, Serialize};

use super::distinctions::Distinction;
use super::error::{Error, Reasons};
use super::header::FrameHeader;
use super::warnings::Warning;
use relief_base::Budget;

/// A phase of a series that shows one region several times: 4D CT, a heart, perfusion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Phase {
    /// From 1, in the order of the attribute that distinguishes the phases, or else of time.
    pub number: usize,
    /// Phases of the series.
    pub count: usize,
}

impl std::fmt::Display for Phase {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "phase {} of {}", self.number, self.count)
    }
}

/// A CT series that can be loaded: its slices and their headers. `Debug` shows no UIDs.
#[derive(Clone)]
pub struct SeriesEntry {
    uid: String,
    pub(super) frames: Vec<FrameHeader>,
    /// How its slices differ from others of its SeriesInstanceUID; names no patient.
    differs: Vec<String>,
    phase: Option<Phase>,
    /// Which region of its SeriesInstanceUID it shows, where several have phases.
    region: usize,
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
        Self { uid, frames, differs, phase: None, region: 0, warnings, budget: budget.clone() }
    }

    pub(super) fn in_phase(self, phase: Option<Phase>, region: usize) -> Self {
        Self { phase, region, ..self }
    }

    pub(super) fn region(&self) -> usize {
        self.region
    }

    /// Which phase of its SeriesInstanceUID it is, where that has several.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.phase
    }

    /// Whether a text names it: its UID, or its SeriesInstanceUID without the number behind it.
    fn is_named(&self, uid: &str) -> bool {
        self.uid == uid || self.uid.rsplit_once('#').is_some_and(|(own, _)| own == uid)
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

    /// The type of the values (RescaleType), such as HU or MGML.
    #[must_use]
    pub fn value_type(&self) -> &str {
        self.frames[0].distinctions.get(Distinction::Quantity)
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
        let phase = self.phase.map(|phase| phase.to_string());
        let differs =
            phase.iter().chain(&self.differs).map(|differs| format!("  {differs}")).collect::<String>();
        format!(
            "{uid}  {}  {columns} x {rows} x {slices}  pixels of {dx:.3} x {dy:.3} mm{differs}",
            self.modality()
        )
    }
}

/// The series whose phase has this number, from 1; of `uid`, where several have phases.
///
/// # Errors
/// When no series has this phase, or several have.
pub(super) fn of_phase<'a>(
    series: &'a [SeriesEntry],
    uid: Option<&str>,
    number: usize,
) -> Result<&'a SeriesEntry, Error> {
    let is_wanted = |entry: &&SeriesEntry| {
        entry.phase.is_some_and(|phase| phase.number == number) && uid.is_none_or(|uid| entry.is_named(uid))
    };
    let found: Vec<&SeriesEntry> = series.iter().filter(is_wanted).collect();
    match found.as_slice() {
        [only] => Ok(only),
        [] => Err(Error::NoPhase { number, listing: listing(series) }),
        several => Err(Error::SeveralSeries { count: several.len(), listing: listing(series) }),
    }
}

/// The phases of one region, in their order: where the series, or those that `uid` names, are
/// nothing else.
pub(super) fn phases<'a>(series: &'a [SeriesEntry], uid: Option<&str>) -> Option<Vec<&'a SeriesEntry>> {
    let mut named: Vec<_> = series.iter().filter(|entry| uid.is_none_or(|uid| entry.is_named(uid))).collect();
    let first = named.first()?.identity();
    let number = |entry: &SeriesEntry| entry.phase.map(|phase| phase.number);
    let is_phase =
        |entry: &&SeriesEntry| number(entry).is_some() && first.is_of_same_region(&entry.identity());
    if named.len() < 2 || !named.iter().all(is_phase) {
        return None;
    }
    named.sort_by_key(|entry| number(entry));
    Some(named)
}

/// The lines that list series in a message.
pub(super) fn listing(series: &[SeriesEntry]) -> Reasons {
    Reasons::plain(series.iter().map(SeriesEntry::summary))
}
