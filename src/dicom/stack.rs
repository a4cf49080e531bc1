//! The stack of a series: order along the normal, and whether it is a regular grid.
//!
//! Slices are ordered and placed by ImagePositionPatient and ImageOrientationPatient only. The
//! normal is row x column; "height" is the position along it, "shift" the position along row and
//! column, both relative to the first slice, mm. GantryDetectorTilt is not read: it is optional and
//! often stale, while positions show the shear itself.

use std::collections::HashSet;

use glam::{DVec2, DVec3};

use super::error::Error;
use super::header::FrameHeader;
use super::warnings::{Warning, WarningCode};

/// Positions are written rounded: to this, mm, or to a tenth of a pixel where pixels are smaller
/// than 0.1 mm.
const ROUNDING_MM: f64 = 0.01;
const ROUNDING_PIXELS: f64 = 0.1;
/// Deviations from an even grid below the rounding, or below 2 % of the spacing, are noise.
const EVEN_TOLERANCE: f64 = 0.02;
/// In-plane shifts below this fraction of a pixel over the whole stack are noise.
const SHIFT_TOLERANCE_PIXELS: f64 = 0.1;

/// The geometry of an ordered stack of at least one slice.
#[derive(Clone, Debug)]
pub(super) struct Stack {
    /// Centre of the first voxel of the first slice, patient mm.
    pub(super) origin: DVec3,
    /// Unit vectors along rows, along columns and along the normal.
    pub(super) axes: [DVec3; 3],
    /// Distance between columns and between rows, mm.
    pub(super) spacing_mm: [f64; 2],
    /// Distance of each slice from the first along the normal, ascending, mm.
    pub(super) heights_mm: Vec<f64>,
    /// Shift of each slice against the first along row and column, mm.
    pub(super) shifts_mm: Vec<DVec2>,
}

/// How a stack deviates from a regular grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Deviation {
    /// Angle between the step from slice to slice and the normal, degrees; `None` when not sheared.
    pub(super) tilt_deg: Option<f64>,
    /// Largest distance of a slice from an even grid along the normal, mm; `None` when even.
    pub(super) uneven_mm: Option<f64>,
}

/// Slices nearer than this to each other along the normal are at the same position, mm.
pub(super) fn rounding_mm(spacing_mm: [f64; 2]) -> f64 {
    let [x, y] = spacing_mm;
    ROUNDING_MM.min(ROUNDING_PIXELS * x.min(y))
}

/// Indices of slices whose position an earlier one (along the normal) has, with the index of that
/// one.
pub(super) fn duplicates(frames: &[FrameHeader]) -> Vec<(usize, usize)> {
    let order = order(frames);
    let normal = normal(&frames[0]);
    let height = |index: usize| frames[index].position.dot(normal);
    let same_position_mm = rounding_mm(frames[0].spacing_mm);
    let mut duplicates = Vec::new();
    let mut kept = order[0];
    for &index in &order[1..] {
        if height(index) - height(kept) < same_position_mm {
            duplicates.push((index, kept));
        } else {
            kept = index;
        }
    }
    duplicates
}

/// Whether this number of repeated positions means several images of one region, not single copies.
pub(super) fn are_many(duplicates: usize, slices: usize) -> bool {
    duplicates * 4 > slices
}

/// Orders slices along the normal and leaves out those whose position is taken.
///
/// # Errors
/// When too many positions repeat, because the slices are several images of one region.
pub(super) fn arrange(frames: &[FrameHeader]) -> Result<(Vec<FrameHeader>, Vec<Warning>), Error> {
    let duplicates = duplicates(frames);
    if are_many(duplicates.len(), frames.len())
        && let Some(&(index, kept)) = duplicates.first()
    {
        let (first, second) = (frames[kept].to_string(), frames[index].to_string());
        return Err(Error::Ambiguous { duplicates: duplicates.len(), slices: frames.len(), first, second });
    }
    let warnings =
        duplicates.iter().map(|&(index, kept)| duplicate_warning(&frames[index], &frames[kept])).collect();
    let left_out: HashSet<usize> = duplicates.into_iter().map(|(index, _)| index).collect();
    let kept = order(frames).into_iter().filter(|index| !left_out.contains(index));
    Ok((kept.map(|index| frames[index].clone()).collect(), warnings))
}

fn duplicate_warning(left_out: &FrameHeader, kept: &FrameHeader) -> Warning {
    let message = format!(
        "{left_out}: ImagePositionPatient (0020,0032): found {}, where {kept} lies already; expected one slice per \
         position; left out",
        left_out.position
    );
    Warning::new(WarningCode::DuplicatePosition, message)
}

/// Indices in ascending order along the normal; files of equal position in the order they were
/// found.
fn order(frames: &[FrameHeader]) -> Vec<usize> {
    let normal = normal(&frames[0]);
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|&a, &b| frames[a].position.dot(normal).total_cmp(&frames[b].position.dot(normal)));
    order
}

pub(super) fn normal(frame: &FrameHeader) -> DVec3 {
    frame.row.cross(frame.column)
}

impl Stack {
    /// The geometry of slices that [`arrange`] has ordered.
    pub(super) fn new(frames: &[FrameHeader]) -> Self {
        let first = &frames[0];
        let axes = [first.row, first.column, normal(first)];
        let steps = frames.iter().map(|frame| frame.position - first.position);
        let heights_mm = steps.clone().map(|step| step.dot(axes[2])).collect();
        let shifts_mm = steps.map(|step| DVec2::new(step.dot(axes[0]), step.dot(axes[1]))).collect();
        Self { origin: first.position, axes, spacing_mm: first.spacing_mm, heights_mm, shifts_mm }
    }

    /// Slices in the stack.
    pub(super) fn len(&self) -> usize {
        self.heights_mm.len()
    }

    /// Distance from the first to the last slice along the normal, mm.
    pub(super) fn extent_mm(&self) -> f64 {
        self.heights_mm.last().copied().unwrap_or(0.0)
    }

    /// Mean distance between neighbouring slices along the normal, mm; 0 for a single slice.
    pub(super) fn mean_gap_mm(&self) -> f64 {
        self.extent_mm() / (self.len() as f64 - 1.0).max(1.0)
    }

    /// Median distance between neighbouring slices along the normal, mm; 0 for a single slice.
    pub(super) fn median_gap_mm(&self) -> f64 {
        let mut gaps: Vec<f64> = self.heights_mm.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_by(f64::total_cmp);
        gaps.get(gaps.len() / 2).copied().unwrap_or(0.0)
    }

    /// The deviation that keeps the stack from being a regular grid.
    pub(super) fn deviation(&self) -> Deviation {
        let gap = self.mean_gap_mm();
        let grid = (0..self.len()).map(|k| k as f64 * gap);
        let uneven =
            self.heights_mm.iter().zip(grid).map(|(height, even)| (height - even).abs()).fold(0.0, f64::max);
        let pixel = DVec2::from(self.spacing_mm);
        let shifted =
            self.shifts_mm.iter().map(|shift| (*shift / pixel).abs().max_element()).fold(0.0, f64::max);
        let noise = rounding_mm(self.spacing_mm).max(gap * EVEN_TOLERANCE);
        Deviation {
            tilt_deg: (shifted > SHIFT_TOLERANCE_PIXELS).then(|| self.tilt_deg()),
            uneven_mm: (uneven > noise).then_some(uneven),
        }
    }

    /// Angle between the line from the first to the last slice and the normal.
    fn tilt_deg(&self) -> f64 {
        let shift = self.shifts_mm.last().map_or(0.0, |shift| shift.length());
        shift.atan2(self.extent_mm()).to_degrees()
    }
}

impl Deviation {
    /// Whether voxels can stay as they are.
    pub(super) fn is_none(self) -> bool {
        self == Self { tilt_deg: None, uneven_mm: None }
    }

    /// Warnings for the user after resampling to slices `spacing_mm` apart.
    pub(super) fn warnings(self, spacing_mm: f64) -> Vec<Warning> {
        let tilt = self.tilt_deg.map(|angle| {
            let message = format!(
                "the stack is sheared: steps from slice to slice are {angle:.2}° off the slice normal (gantry tilt); \
                 resampled to an orthogonal grid along the slice normal"
            );
            Warning::new(WarningCode::GantryTilt, message)
        });
        let uneven = self.uneven_mm.map(|mm| {
            let message = format!(
                "slices are unevenly spaced or missing: positions are up to {mm:.3} mm off an even grid; resampled on \
                 the true positions to slices {spacing_mm:.4} mm apart"
            );
            Warning::new(WarningCode::UnevenSpacing, message)
        });
        tilt.into_iter().chain(uneven).collect()
    }
}
