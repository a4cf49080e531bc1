//! The visible part of a volume, for cameras that are fitted to it.
//!
//! Spaces: patient mm. It is an estimate from coarse cells (see [`Occupancy`]): what hides what, and
//! opacity by gradient, do not count.

use std::sync::Arc;

use serde::Deserialize;

use super::labels::Labels;
use super::mode::Mode;
use super::request::{Clip, RenderRequest};
use relief_base::{Patient, Point, Voxel};
use relief_volume::{Framing, Grid, LabelMap, Occupancy, Orbit};

/// The part of a volume that a camera is fitted to where a scene has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FramingRule {
    /// The part that the transfer function, clips and segments show.
    #[default]
    Visible,
    /// All tissue, whatever the transfer function shows of it: as live views, whose transfer function
    /// changes.
    Tissue,
    /// The bounding sphere of the volume.
    Volume,
}

impl FramingRule {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Visible, Self::Tissue, Self::Volume];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Visible => "visible",
            Self::Tissue => "tissue",
            Self::Volume => "volume",
        }
    }

    /// The rule of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rule| rule.name() == name)
    }
}

/// A value is visible if a path of this length through it, in units of the volume, ...
const PATH_UNITS: f64 = 10.0;
/// ... has at least this opacity.
const OPACITY: f64 = 0.1;
/// Lowest value of tissue, HU: fat and skin are above, lungs and foam below.
const TISSUE_HU: i16 = -300;
/// Groups of cells that are smaller than this share of the largest one do not count.
const SPECK: f64 = 0.02;
/// Voxels of a cell along each axis whose segment is looked up.
const LOOKUPS: usize = 2;

/// The framing of a request's picture of a volume: the bounding sphere where nothing is visible.
pub(crate) fn framing(
    rule: FramingRule,
    occupancy: &Occupancy,
    tissue: Option<&Framing>,
    request: &RenderRequest,
    grid: &Grid,
) -> Arc<Framing> {
    let found = match rule {
        FramingRule::Volume => None,
        FramingRule::Tissue => {
            let tissue = tissue.cloned();
            Some(Arc::new(tissue.unwrap_or_else(|| framing_of_tissue(occupancy, grid))))
        }
        FramingRule::Visible if cuts_nothing(&request.clip) && hiding_labels(request).is_none() => {
            occupancy.framing(grid, SPECK, |low, high| is_visible(request, grid, low, high))
        }
        FramingRule::Visible => Framing::of_points(&visible_points(occupancy, grid, request)).map(Arc::new),
    };
    found.unwrap_or_else(|| Arc::new(Framing::of_grid(grid)))
}

fn cuts_nothing(clip: &Clip) -> bool {
    clip.planes.is_empty() && clip.sphere.is_none()
}

/// The labels of a request that hides some of them.
fn hiding_labels(request: &RenderRequest) -> Option<&Labels> {
    request.labels.as_deref().filter(|labels| labels.looks.iter().any(|look| !look.visible))
}

/// The sphere by which all tissue fills pictures of [`TISSUE_VIEW`] in 16:9; the bounding sphere of a
/// volume without tissue.
#[must_use]
pub fn framing_of_tissue(occupancy: &Occupancy, grid: &Grid) -> Framing {
    let cells = occupancy.cells(|_, high| high >= TISSUE_HU).without_specks(SPECK);
    match Framing::of_points(&cells.points(grid)) {
        Some(body) => Framing::sphere_of(&body, &TISSUE_VIEW, TISSUE_ASPECT),
        None => Framing::of_grid(grid),
    }
}

/// The view to which tissue is fitted: that with which live views begin.
pub const TISSUE_VIEW: Orbit =
    Orbit { azimuth_deg: 20.0, elevation_deg: 10.0, zoom: 1.0, vertical_fov_deg: 22.0 };
/// Width by height of the pictures to which tissue is fitted.
const TISSUE_ASPECT: f64 = 16.0 / 9.0;

pub(crate) fn visible_points(
    occupancy: &Occupancy,
    grid: &Grid,
    request: &RenderRequest,
) -> Vec<Point<Patient>> {
    let cells = occupancy.cells(|low, high| is_visible(request, grid, low, high));
    let labels = hiding_labels(request);
    let is_shown = |[first, end]: [[usize; 3]; 2]| {
        let middle: [f64; 3] = std::array::from_fn(|axis| (first[axis] + end[axis]) as f64 / 2.0 - 0.5);
        let [i, j, k] = middle;
        keeps(&request.clip, grid.patient_from_voxel() * Point::<Voxel>::new(i, j, k))
            && labels.is_none_or(|labels| shows_any(labels, first, end))
    };
    cells.kept(grid, is_shown).without_specks(SPECK).points(grid)
}

/// Whether a request shows a value from `low` to `high` HU.
pub(crate) fn is_visible(request: &RenderRequest, grid: &Grid, low: i16, high: i16) -> bool {
    let transfer = &request.transfer;
    match request.mode {
        Mode::Composite | Mode::PathTraced => {
            let inside = transfer.points().iter().map(|point| point.hu);
            let inside = inside.filter(|hu| (f64::from(low)..=f64::from(high)).contains(hu));
            let mut values = inside.chain([low, high].map(f64::from));
            let path_mm = PATH_UNITS * grid.unit_mm();
            values.any(|hu| transfer.opacity_over(hu, path_mm) >= OPACITY)
        }
        Mode::Isosurface => request.surfaces.iter().any(|surface| surface.hu <= f64::from(high)),
        // Projections show tissue of any value, bright or dark.
        _ => high >= TISSUE_HU,
    }
}

fn keeps(clip: &Clip, point: Point<Patient>) -> bool {
    let is_before = |plane: &super::request::ClipPlane| (point - plane.point).dot(plane.normal) >= 0.0;
    clip.planes.iter().all(is_before)
        && clip.sphere.is_none_or(|sphere| point.distance(sphere.center) >= sphere.radius_mm)
}

/// Whether a segment that is shown, or tissue without a segment that is, lies in a box of voxels.
fn shows_any(labels: &Labels, first: [usize; 3], end: [usize; 3]) -> bool {
    let along = |axis: usize| (first[axis]..end[axis]).step_by(LOOKUPS);
    along(2)
        .any(|k| along(1).any(|j| along(0).any(|i| labels.looks[place_at(&labels.map, [i, j, k])].visible)))
}

fn place_at(map: &LabelMap, [i, j, k]: [usize; 3]) -> usize {
    let [nx, ny, _] = map.grid().dims();
    map.places().at(i + nx * (j + ny * k))
}
