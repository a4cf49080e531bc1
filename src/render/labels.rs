//! Segment-wise looks of a request: a label map, and for each of its segments transfer function,
//! visibility and tint.
//!
//! Samples look segments up in `shaders/lib/labels.wgsl` and its twin. Modes that add values or
//! look for surfaces have no segments: an isosurface at the edge of a segment would alternate
//! between its two sides. Space: voxel index of the volume, whose grid the map shares.

use std::sync::Arc;

use super::mode::Mode;
use relief_base::OutOfRange;
use relief_volume::{Grid, LabelMap, TransferFunction};

/// How one segment is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Whether it is visible; a hidden segment is transparent.
    pub visible: bool,
    /// Which transfer function: 0 for the request's own, else the one before this place in
    /// [`Labels::transfers`].
    pub transfer: usize,
    /// The colour that it is tinted with, display-referred sRGB, 0..1.
    pub tint_rgb: [f64; 3],
    /// The share of its colour that gives way to the tint, 0..1.
    pub tint: f64,
}

impl Look {
    /// As if there were no segment.
    pub const PLAIN: Self = Self { visible: true, transfer: 0, tint_rgb: [0.0; 3], tint: 0.0 };
}

/// The form of the edge between segments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Edges {
    /// Where the trilinear weight of one segment's voxels passes that of another's: as smooth as
    /// the volume.
    #[default]
    Smooth,
    /// Around whole voxels.
    Voxels,
}

impl Edges {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Smooth, Self::Voxels];

    /// The name in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Voxels => "voxels",
        }
    }
}

/// A label map and how its segments are shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Labels {
    /// On the volume's grid; see [`LabelMap::resampled`].
    pub map: Arc<LabelMap>,
    /// First that of voxels without a segment, then those of the map's segments in their order.
    pub looks: Vec<Look>,
    /// Transfer functions beside the request's own; none with opacity by gradient.
    pub transfers: Vec<TransferFunction>,
    /// The form of edges between segments.
    pub edges: Edges,
}

impl Labels {
    /// Most segments that a map may have to be shown: looks and transfer functions share a table.
    pub const MOST_SEGMENTS: usize = 512;

    /// Most transfer functions beside the request's own.
    pub const MOST_TRANSFERS: usize = 15;

    /// Whether a mode can show segments.
    #[must_use]
    pub const fn are_shown_by(mode: Mode) -> bool {
        matches!(mode, Mode::Composite | Mode::Mip | Mode::Minip | Mode::Slice(_))
    }

    /// Whether the picture is the one without them.
    #[must_use]
    pub fn are_plain(&self) -> bool {
        let is_plain = |look: &Look| look.visible && look.transfer == 0 && look.tint == 0.0;
        self.looks.iter().all(is_plain)
    }

    /// Bytes that a request holds for them, the map left out: that is shared.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        let points: usize = self.transfers.iter().map(|transfer| size_of_val(transfer.points())).sum();
        size_of_val(self.looks.as_slice()) + points
    }

    pub(super) fn validate_on(&self, grid: &Grid) -> Result<(), OutOfRange> {
        if self.map.grid() == grid {
            return Ok(());
        }
        let found = format!("a map of {:?} voxels on a grid of its own", self.map.grid().dims());
        Err(OutOfRange::new("labels", found, "a map on the volume's grid"))
    }
}
