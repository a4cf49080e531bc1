//! The common content of both formats' headers.

use super::error::FormatError;
use super::limits::FormatLimits;
use super::values::Voxel;

use relief_volume::Grid;

/// A stored number times `slope`, plus `intercept`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    pub(super) slope: f64,
    pub(super) intercept: f64,
}

impl Scale {
    pub(super) const NONE: Self = Self { slope: 1.0, intercept: 0.0 };
}

/// The places and the form of voxels.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) grid: Grid,
    /// Values in each voxel, one after the other; 1 but for segmentations that overlap.
    pub(super) layers: usize,
    pub(super) voxel: Voxel,
    pub(super) scale: Scale,
}

/// A header's description of a segment.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedSegment {
    pub(super) label: u16,
    pub(super) layer: usize,
    pub(super) name: Option<String>,
    pub(super) rgb: Option<[f64; 3]>,
}

/// A header with its description of segments.
#[derive(Clone, Debug)]
pub(super) struct Described {
    pub(super) header: Header,
    pub(super) segments: Vec<NamedSegment>,
}

impl Header {
    pub(super) fn check(&self, limits: FormatLimits) -> Result<(), FormatError> {
        let needed = (self.grid.voxel_count() as u64).saturating_mul(self.layers as u64);
        let allowed = limits.voxels;
        if needed > allowed { Err(FormatError::TooLarge { needed, allowed }) } else { Ok(()) }
    }
}
