//! Grouping of slices into series: the slices that may be stacked into one volume.
//!
//! Slices belong together when they share SeriesInstanceUID, SOP class, matrix size, orientation
//! and pixel spacing. One UID may have several such groups (a reformat in another orientation,
//! several phases at the same positions). Each group is then a series of its own, with `#1`, `#2`
//! appended to the UID.

use std::collections::{BTreeMap, HashMap, HashSet};

use glam::DVec3;

use super::error::Reasons;
use super::header::FrameHeader;
use super::stack;
use super::warnings::{Warning, WarningCode};
use relief_base::Budget;

/// The largest difference of unit vectors in one series: they are written with at least four digits.
const DIRECTION_TOLERANCE: f64 = 1e-3;
/// The largest difference of pixel spacings in one series, as a fraction.
const SPACING_TOLERANCE: f64 = 1e-3;

/// A CT series that can be loaded: its slices and their headers. `Debug` shows no UIDs.
#[derive(Clone)]
pub struct SeriesEntry {
    uid: String,
    pub(super) frames: Vec<FrameHeader>,
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

    /// One line for a list to choose from.
    #[must_use]
    pub fn summary(&self) -> String {
        let [columns, rows, slices] = self.dims();
        let [dx, dy] = self.pixel_spacing_mm();
        let uid = if self.uid.is_empty() { "\"\" (empty UID)" } else { &self.uid };
        format!("{uid}  {}  {columns} x {rows} x {slices}  pixels of {dx:.3} x {dy:.3} mm", self.modality())
    }
}

/// The lines that list series in a message.
pub(super) fn listing(series: &[SeriesEntry]) -> Reasons {
    Reasons::plain(series.iter().map(SeriesEntry::summary))
}

/// Groups slices into series, in a stable order: by UID, then by size, most slices first.
pub(super) fn group(frames: Vec<FrameHeader>, budget: &Budget) -> Vec<SeriesEntry> {
    let mut by_uid: BTreeMap<String, Vec<FrameHeader>> = BTreeMap::new();
    for frame in frames {
        by_uid.entry(frame.file.series_uid.clone()).or_default().push(frame);
    }
    by_uid.into_iter().flat_map(|(uid, frames)| split(&uid, frames, budget)).collect()
}

fn split(uid: &str, frames: Vec<FrameHeader>, budget: &Budget) -> Vec<SeriesEntry> {
    let (frames, warnings) = without_copies(frames);
    let mut stacks: Vec<_> = by_shape(frames).into_iter().flat_map(by_acquisition).collect();
    stacks.sort_by_key(|frames| std::cmp::Reverse(frames.len()));
    let several = stacks.len() > 1;
    let name = |index: usize| if several { format!("{uid}#{}", index + 1) } else { uid.to_owned() };
    let entry = |(index, frames)| SeriesEntry {
        uid: name(index),
        frames,
        warnings: warnings.clone(),
        budget: budget.clone(),
    };
    stacks.into_iter().enumerate().map(entry).collect()
}

/// Leaves out files that hold an image found already, as folders with backups have them: the same
/// SOP Instance UID at the same position (some anonymisers give all slices one UID).
fn without_copies(frames: Vec<FrameHeader>) -> (Vec<FrameHeader>, Vec<Warning>) {
    let mut seen = HashSet::new();
    let mut copies = Vec::new();
    let mut kept = Vec::with_capacity(frames.len());
    for frame in frames {
        let instance = frame.file.instance_uid.clone();
        let position = frame.position.to_array().map(f64::to_bits);
        if instance.is_empty() || seen.insert((instance, frame.index, position)) {
            kept.push(frame);
        } else {
            copies.push(frame.to_string());
        }
    }
    let message = |first: &String| {
        format!(
            "{} image(s) found twice (same SOPInstanceUID (0008,0018)); left out, first: {first}",
            copies.len()
        )
    };
    let warnings = copies.first().map(|first| Warning::new(WarningCode::DuplicateFile, message(first)));
    (kept, warnings.into_iter().collect())
}

/// Separates slices that cannot share a grid.
fn by_shape(frames: Vec<FrameHeader>) -> Vec<Vec<FrameHeader>> {
    let mut groups: Vec<Vec<FrameHeader>> = Vec::new();
    // Comparing each slice with the first of each group of its size stays fast with thousands of
    // odd files.
    let mut candidates: HashMap<(u32, u32, String), Vec<usize>> = HashMap::new();
    for frame in frames {
        let layout = &frame.file.layout;
        let key = (layout.rows, layout.columns, frame.file.sop_class.clone());
        let of_size = candidates.entry(key).or_default();
        match of_size.iter().find(|&&group| same_shape(&groups[group][0], &frame)) {
            Some(&group) => groups[group].push(frame),
            None => {
                of_size.push(groups.len());
                groups.push(vec![frame]);
            }
        }
    }
    groups
}

fn same_shape(a: &FrameHeader, b: &FrameHeader) -> bool {
    let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() < DIRECTION_TOLERANCE;
    let spacing = (0..2).all(|axis| {
        let (a, b) = (a.spacing_mm[axis], b.spacing_mm[axis]);
        (a - b).abs() < a.max(b) * SPACING_TOLERANCE
    });
    spacing && near(a.row, b.row) && near(a.column, b.column)
}

/// Separates phases: where positions repeat and AcquisitionNumber distinguishes the repetitions,
/// each is a series.
fn by_acquisition(frames: Vec<FrameHeader>) -> Vec<Vec<FrameHeader>> {
    if stack::duplicates(&frames).is_empty() {
        return vec![frames];
    }
    let mut phases: BTreeMap<String, Vec<FrameHeader>> = BTreeMap::new();
    for frame in &frames {
        phases.entry(frame.file.acquisition.clone()).or_default().push(frame.clone());
    }
    let apart = phases.len() > 1 && phases.values().all(|phase| stack::duplicates(phase).is_empty());
    if apart { phases.into_values().collect() } else { vec![frames] }
}
