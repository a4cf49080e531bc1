//! A picture that is to be cast, as the rays of a width look it up.
//!
//! A [`Job`] is the same for every width. A [`Scene`] holds its numbers in lanes, and has the
//! functions of the modules beside it: one `impl` block each.

use relief_lanes::{Lanes, Triple};
use relief_volume::{DistanceMap, Volume};

use super::super::classification::Classification;
use super::super::limits::depth_limits;
use super::super::request::RenderRequest;
use super::super::skipping::EmptySpaceSkipping;
use super::super::slices::SlabSamples;
use super::super::surface::Surface;
use super::super::uniform::brightness_range;
use super::color::{Colors, GradientOpacity};
use super::field::Field;
use super::light_cells::LightCells;
use super::lights::Lights;
use super::passage::Integrals;
use super::prepared::Looks;
use super::ray::View;
use super::segments::Segments;
use super::walk::Bricks;

/// Opacity at which a ray ends.
pub(super) const OPAQUE: f64 = 1.0 - 1.0 / 512.0;
/// A ray that changes no byte of the picture hits nothing.
pub(super) const VISIBLE: f64 = 0.5 / 255.0;

/// A picture that is to be cast.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) volume: &'a Volume,
    pub(super) request: &'a RenderRequest,
    pub(super) looks: &'a Looks,
    /// Empty space; three more bytes lie behind its distances.
    pub(super) map: &'a DistanceMap,
    /// The light in the volume, where the request looks it up.
    pub(super) cells: &'a LightCells,
    pub(super) skipping: EmptySpaceSkipping,
}

/// Everything about a picture that rays look up.
pub(super) struct Scene<'a, L: Lanes> {
    pub(super) lanes: L,
    pub(super) request: &'a RenderRequest,
    pub(super) view: View<L>,
    pub(super) field: Field<'a, L>,
    pub(super) bricks: Bricks<'a, L>,
    pub(super) colors: Colors<'a, L>,
    pub(super) gradient_opacity: Option<GradientOpacity<'a, L>>,
    pub(super) segments: Option<Segments<'a, L>>,
    pub(super) integrals: Option<Integrals<'a, L>>,
    pub(super) lights: Lights<'a, L>,
    pub(super) surfaces: Vec<SurfaceInLanes<L>>,
    /// The volume's smallest value, and the range of its values, HU.
    pub(super) brightness: [L::Real; 2],
    /// The share of a ray's opacity at which its depth lies, by the rules that have one.
    pub(super) depth_fraction: L::Real,
    pub(super) is_cut: bool,
    /// The samples of a slab, and the distance of its plane along every ray, mm.
    pub(super) slab: SlabSamples,
    pub(super) plane_t: f64,
}

/// The result of rays.
pub(super) struct Hit<L: Lanes> {
    /// Premultiplied.
    pub(super) color: Triple<L::Real>,
    pub(super) opacity: L::Real,
    /// Rays that have a depth.
    pub(super) hits: L::Mask,
    /// Distance along the rays, mm.
    pub(super) t: L::Real,
}

/// A surface of a request.
#[derive(Clone, Copy)]
pub(super) struct SurfaceInLanes<L: Lanes> {
    pub(super) level: L::Real,
    pub(super) rgb: Triple<L::Real>,
    pub(super) opacity: L::Real,
}

impl<L: Lanes> SurfaceInLanes<L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, surface: &Surface) -> Self {
        Self {
            level: lanes.splat(surface.level_hu()),
            rgb: Triple(surface.rgb.map(|channel| lanes.splat(channel))),
            opacity: lanes.splat(surface.opacity),
        }
    }
}

impl<'a> Job<'a> {
    #[inline(always)]
    pub(super) fn scene<L: Lanes>(self, lanes: L) -> Scene<'a, L> {
        let Self { volume, request, looks, map, cells, skipping } = self;
        let skips = skipping == EmptySpaceSkipping::On && looks.paths_end_in_neighbours;
        let has_paths = request.classification == Classification::PreIntegrated;
        let tables = &looks.tables;
        let (lowest, span) = brightness_range(volume);
        Scene {
            lanes,
            request,
            view: View::new(lanes, request, volume.grid()),
            field: Field::new(lanes, volume),
            bricks: Bricks::new(lanes, map, skips, has_paths),
            colors: Colors::new(lanes, tables, &looks.opacities),
            gradient_opacity: tables.own.gradient.as_ref().map(|table| GradientOpacity::new(lanes, table)),
            segments: request
                .labels
                .as_deref()
                .map(|labels| Segments::new(lanes, labels, &looks.entries, tables)),
            integrals: tables.own.integral.as_ref().map(|integral| Integrals::new(lanes, tables, integral)),
            lights: Lights::new(lanes, request, volume.grid(), cells),
            surfaces: request.surfaces.iter().map(|surface| SurfaceInLanes::new(lanes, surface)).collect(),
            brightness: [lanes.splat(lowest), lanes.splat(span)],
            depth_fraction: lanes.splat(request.depth.of_rays().fraction().unwrap_or(0.0)),
            is_cut: request.clip.sphere.is_some(),
            slab: SlabSamples::of(request),
            plane_t: request.camera.distance_mm() - depth_limits(&request.camera, volume.grid()).near_mm,
        }
    }
}

impl<L: Lanes> Scene<'_, L> {
    /// A number in every lane.
    #[inline(always)]
    pub(super) fn number(&self, x: f64) -> L::Real {
        self.lanes.splat(x)
    }

    /// No lane.
    #[inline(always)]
    pub(super) fn none(&self) -> L::Mask {
        self.lanes.first(0)
    }

    /// Rays that hit nothing.
    #[inline(always)]
    pub(super) fn miss(&self) -> Hit<L> {
        let zero = self.number(0.0);
        Hit { color: Triple::of(zero), opacity: zero, hits: self.none(), t: zero }
    }

    /// Whether samples are classified by their values alone, and lit by the headlight.
    #[inline(always)]
    pub(super) fn is_plain(&self) -> bool {
        self.gradient_opacity.is_none()
            && self.segments.is_none()
            && self.integrals.is_none()
            && !self.lights.are_placed()
    }
}
