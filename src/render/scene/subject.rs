//! The subject of a scene: a volume's grid, the properties of its values, and its label map.
//!
//! Spaces: voxel index and patient mm; values in HU.

use std::sync::Arc;

use super::super::framing::{FramingRule, framing};
use super::super::request::RenderRequest;
use relief_volume::{Anatomy, ContentHash, Framing, Grid, LabelMap, Occupancy, Volume};

/// The volume that a scene is resolved for.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The grid of the volume.
    pub grid: &'a Grid,
    /// The properties of its values.
    pub content: SubjectContent<'a>,
    /// A label map on the grid.
    pub labels: Option<&'a Arc<LabelMap>>,
    /// The name that a caption shows; `None` for one that the volume gives.
    pub name: Option<&'a str>,
}

/// The source of a volume's occupancy and anatomy. The table is left out.
#[derive(Clone, Copy, Debug)]
pub enum SubjectContent<'a> {
    /// Neither is available: a camera that was not written is fitted to the bounding sphere, as for
    /// [`FramingRule::Volume`], and a transfer function that was not written is the first preset, or a
    /// usual window.
    Unknown,
    /// A volume: both are computed when a scene needs them.
    Volume(&'a Volume),
    /// Results of an earlier computation. The voxels need not be in memory.
    Known {
        /// The distribution of values in the volume; `None` fits cameras as for
        /// [`SubjectContent::Unknown`].
        occupancy: Option<&'a Occupancy>,
        /// [`framing_of_tissue`](super::super::framing::framing_of_tissue).
        tissue: &'a Framing,
        /// The part of a body that it shows: it chooses the preset, or the window of a slice.
        anatomy: Anatomy,
    },
}

impl<'a> Subject<'a> {
    /// A volume, and its label map where it has one.
    #[must_use]
    pub fn of(volume: &'a Volume, labels: Option<&'a Arc<LabelMap>>) -> Self {
        Self { grid: volume.grid(), content: SubjectContent::Volume(volume), labels, name: None }
    }

    /// A grid without knowledge of its values.
    #[must_use]
    pub fn of_grid(grid: &'a Grid) -> Self {
        Self { grid, content: SubjectContent::Unknown, labels: None, name: None }
    }

    /// The line that identifies the volume in a picture.
    pub(super) fn caption(&self) -> String {
        match (self.name, self.content) {
            (Some(name), _) => name.to_owned(),
            (None, SubjectContent::Volume(volume)) => identity_of(volume),
            (None, _) => size_of(self.grid),
        }
    }

    /// The points that a camera is fitted to; `None` for the bounding sphere.
    pub(super) fn framing(&self, rule: FramingRule, request: &RenderRequest) -> Option<Arc<Framing>> {
        if rule == FramingRule::Volume {
            return None;
        }
        Some(framing(rule, self.content.occupancy()?, self.content.tissue(), request, self.grid))
    }
}

impl<'a> SubjectContent<'a> {
    /// The distribution of values in the volume.
    pub(in super::super) fn occupancy(self) -> Option<&'a Occupancy> {
        match self {
            Self::Unknown => None,
            Self::Volume(volume) => Some(volume.without_table().occupancy()),
            Self::Known { occupancy, .. } => occupancy,
        }
    }

    /// The framing of the tissue, if it was computed before.
    fn tissue(self) -> Option<&'a Framing> {
        match self {
            Self::Known { tissue, .. } => Some(tissue),
            Self::Unknown | Self::Volume(_) => None,
        }
    }

    /// The part of a body that the volume shows.
    pub(super) fn anatomy(self) -> Option<Anatomy> {
        match self {
            Self::Unknown => None,
            Self::Volume(volume) => Some(volume.without_table().anatomy()),
            Self::Known { anatomy, .. } => Some(anatomy),
        }
    }
}

/// The line that identifies a volume without a name of its own: the part of a body that it shows, its
/// size, and the beginning of its content hash.
fn identity_of(volume: &Volume) -> String {
    let name = name_of(volume.without_table().anatomy(), volume.grid());
    with_hash(&name, volume.content_hash())
}

/// The name of a volume by the part of a body that it shows, and its size.
#[must_use]
pub fn name_of(anatomy: Anatomy, grid: &Grid) -> String {
    let mut part = anatomy.part.name().to_owned();
    part[..1].make_ascii_uppercase();
    let medium = if anatomy.has_contrast { " with contrast medium" } else { "" };
    let quantity = anatomy.quantity();
    let unit = if quantity.is_hu() { String::new() } else { format!(" ({})", quantity.unit()) };
    format!("{part}{medium}{unit}, {}", size_of(grid))
}

/// A name, and the beginning of the content hash of its volume, which no other volume has.
#[must_use]
pub fn with_hash(name: &str, hash: ContentHash) -> String {
    format!("{name}, {}", &hash.short()[..8])
}

fn size_of(grid: &Grid) -> String {
    let [nx, ny, nz] = grid.dims();
    format!("{nx} × {ny} × {nz}")
}
