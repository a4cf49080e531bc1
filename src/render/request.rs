//! A complete, immutable order for one picture: everything that the renderer needs beside the
//! volume.
//!
//! Values here are valid by construction of their parts plus [`RenderRequest::validate`]; the JSON
//! form with its defaults and error paths is in `scene`.

use std::sync::Arc;

use super::chosen::ChosenBlocks;
use super::classification::Classification;
use super::cut::CutFaces;
pub(crate) use super::depth_rule::DepthRule;
use super::detail::Detail;
use super::display_depth::ForViews;
use super::illumination::Illumination;
use super::labels::Labels;
use super::light::Light;
use super::mode::Mode;
use super::overlay::Overlays;
use super::pathtrace::PathTrace;
use super::surface::Surface;
use super::table_rule::TableRule;
use relief_base::{Patient, Point, Vector};
use relief_volume::{Camera, Grid, Table, TransferFunction, Volume};

/// Headlight shading at the eye, two-sided: `ambient + diffuse |n·v| + specular |n·v|^shininess`.
///
/// With the light at the eye the reflected and the half vector are both along `v`, so the highlight
/// is a power of the same cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// Share of light from everywhere, 0..1.
    pub ambient: f64,
    /// Share of light reflected evenly, 0..1.
    pub diffuse: f64,
    /// Share of light reflected as a highlight, 0..1.
    pub specular: f64,
    /// Exponent of the highlight, 1..1000.
    pub shininess: f64,
}

impl Shading {
    /// Colours as the transfer function has them.
    pub const NONE: Self = Self { ambient: 1.0, diffuse: 0.0, specular: 0.0, shininess: 1.0 };

    /// Whether a sample's gradient matters.
    #[must_use]
    pub fn needs_gradient(&self) -> bool {
        self.diffuse > 0.0 || self.specular > 0.0
    }
}

/// A half-space: the side that `normal` points to is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipPlane {
    /// A point of the plane.
    pub point: Point<Patient>,
    /// Points to the side that is kept; any length above zero.
    pub normal: Vector<Patient>,
}

/// A sphere whose inside is not shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipSphere {
    /// Its centre.
    pub center: Point<Patient>,
    /// Its radius, mm; see [`ClipSphere::RADIUS_MM`].
    pub radius_mm: f64,
}

impl ClipSphere {
    /// Radii that a sphere may have, mm.
    pub const RADIUS_MM: std::ops::RangeInclusive<f64> = 0.000_001..=10_000.0;
}

/// The visible part of the volume: the intersection of all half-spaces, minus the inside of the
/// sphere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// At most [`Clip::MAX_PLANES`]; the six faces of a clip box count among them.
    pub planes: Vec<ClipPlane>,
    /// The part that is cut away, such as the surroundings of a cursor. Neither this nor planes
    /// require any rebuild.
    pub sphere: Option<ClipSphere>,
}

impl Clip {
    /// Six planes of a box and six free ones.
    pub const MAX_PLANES: usize = 12;

    /// Adds the six faces of a box in patient space.
    pub fn add_box(&mut self, min: Point<Patient>, max: Point<Patient>) {
        for axis in glam::DMat3::IDENTITY.to_cols_array_2d() {
            let normal = Vector::from_xyz(axis.into());
            self.planes.push(ClipPlane { point: min, normal });
            self.planes.push(ClipPlane { point: max, normal: -normal });
        }
    }
}

/// One picture of one volume.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderRequest {
    /// The eye and its projection.
    pub camera: Camera,
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// Fewer pixels, for which rays are cast in place of `size_px`; the picture is enlarged to that
    /// before overlays and letters are drawn. For pictures under a budget of time.
    pub reduced_px: Option<[u32; 2]>,
    /// How samples become a colour.
    pub mode: Mode,
    /// Colour and opacity of values.
    pub transfer: TransferFunction,
    /// The values that a sample of mode composite represents.
    pub classification: Classification,
    /// The surfaces of mode isosurface, values rising; none in other modes.
    pub surfaces: Vec<Surface>,
    /// Light.
    pub shading: Shading,
    /// Distance between samples along a ray, mm.
    pub sample_distance_mm: f64,
    /// The voxels that rays are cast through.
    pub detail: Detail,
    /// Thickness of a slice's slab, half of it on each side of the plane, mm; 0 is a plane, and the
    /// only value for other modes.
    pub slab_mm: f64,
    /// Whether a slice's picture has the patient directions at its edges burnt in.
    pub letters: bool,
    /// The rule of depth.
    pub depth: DepthRule,
    /// The display for which rule `views` chooses depths; `None` under other rules.
    pub for_views: Option<ForViews>,
    /// Whether the depths of the picture are used. Where they are not, the processor's ray caster
    /// does not search for depths between samples: in mode composite they are those of the first
    /// visible samples, but under rule `two-layer`. Colours are the same.
    pub needs_depth: bool,
    /// The part that is shown.
    pub clip: Clip,
    /// How cut faces look.
    pub cut: CutFaces,
    /// Whether the table is shown.
    pub table: TableRule,
    /// How the segments of a label map are shown; `None` where all of the volume is shown alike.
    /// Shared, as it may be large.
    pub labels: Option<Arc<Labels>>,
    /// The blocks of pixels that are cast; `None` for all. Only the processor's ray caster leaves
    /// blocks out, and only in pictures of full size without overlays and letters;
    /// [`super::RenderedFrame::is_partial`] says whether it did.
    pub blocks: Option<Arc<ChosenBlocks>>,
    /// Display-referred sRGB, 0..1, behind everything.
    pub background_rgb: [f64; 3],
    /// The overlays of the picture, in the same depth. Shared, since they may be large.
    pub overlays: Arc<Overlays>,
    /// At most [`Light::MAX`], for modes composite, isosurface and path-traced. Without any the
    /// first two have the headlight.
    pub lights: Vec<Light>,
    /// Shadows of the lights and occlusion by surroundings, for modes composite and isosurface.
    pub illumination: Illumination,
    /// The settings of mode path-traced.
    pub path_trace: PathTrace,
}

impl RenderRequest {
    /// Largest width or height of a picture.
    pub const MAX_SIDE_PX: u32 = 8192;
    /// Most pixels of a picture.
    pub const MAX_PIXELS: u64 = 1 << 24;
    /// Most samples that the rays of a picture may take: minutes of a software adapter.
    pub const MAX_SAMPLES: f64 = 4e10;

    /// Budgets of time that a picture may have, ms.
    pub const BUDGET_MS: std::ops::RangeInclusive<f64> = 1.0..=60_000.0;

    /// Thickest slab of a slice, mm.
    pub const MAX_SLAB_MM: f64 = 1000.0;

    pub(super) fn longest_ray_mm(&self, grid: &Grid) -> f64 {
        let across_mm = 2.0 * grid.bounding_radius_mm();
        match self.mode {
            Mode::Slice(_) => self.slab_mm.min(across_mm),
            _ => across_mm,
        }
    }

    /// Most samples that a ray may take in a volume of this grid, gradients and depth refinement
    /// left out.
    #[must_use]
    pub fn samples_of_ray(&self, grid: &Grid) -> f64 {
        self.longest_ray_mm(grid) / self.sample_distance_mm
    }

    /// Whether the picture has a second layer behind the first: rule `two-layer`, in the mode that
    /// has depth rules.
    #[must_use]
    pub fn has_back_layer(&self) -> bool {
        matches!(self.mode, Mode::Composite | Mode::PathTraced) && self.depth.has_back_layer()
    }

    /// Whether depths follow the rule.
    pub(super) fn applies_depth_rule(&self) -> bool {
        self.needs_depth || self.has_back_layer()
    }

    /// Whether rays are lit by more than the headlight: by placed lights, or with occlusion.
    #[must_use]
    pub fn has_own_light(&self) -> bool {
        let has_light = matches!(self.mode, Mode::Composite | Mode::Isosurface);
        has_light && (!self.lights.is_empty() || self.illumination.occlusion.strength > 0.0)
    }

    /// Whether rays look up shadows of placed lights.
    #[must_use]
    pub fn casts_shadows(&self) -> bool {
        self.has_own_light()
            && self.shading.needs_gradient()
            && self.illumination.shadows > 0.0
            && !self.lights.is_empty()
    }
}

impl RenderRequest {
    /// The request of another camera, for a view whose depth is not displayed.
    #[must_use]
    pub fn seen_by(&self, camera: Camera) -> Self {
        Self { camera, for_views: None, ..self.clone() }
    }

    /// The request whose rule `views` casts no views beside the picture.
    #[must_use]
    pub fn without_views_beside(mut self) -> Self {
        if let Some(for_views) = &mut self.for_views {
            for_views.casts_views = false;
        }
        self
    }

    /// Whether rule `views` casts two views beside the picture. It does in mode composite, for a whole
    /// picture of full size.
    #[must_use]
    pub fn casts_views_beside(&self) -> bool {
        let for_views = self.display_of_depth().filter(|for_views| for_views.casts_views);
        for_views.is_some() && self.mode == Mode::Composite && self.reduced_px.is_none()
    }

    /// Whether the picture will have a background layer: under rules `two-layer` and `views`.
    pub(super) fn has_background(&self) -> bool {
        self.has_back_layer() || self.display_of_depth().is_some()
    }

    /// The request of the picture's rays, where rule `views` follows them.
    pub(super) fn of_rays(&self) -> Self {
        Self { depth: self.depth.of_rays(), for_views: None, ..self.clone() }
    }

    /// The display that depth is made for, where the picture has such a depth.
    pub(super) fn display_of_depth(&self) -> Option<&ForViews> {
        let has_one = self.depth == DepthRule::Views && self.needs_depth && self.blocks.is_none();
        let has_rule = matches!(self.mode, Mode::Composite | Mode::PathTraced);
        self.for_views.as_ref().filter(|_| has_one && has_rule)
    }
}

impl RenderRequest {
    /// The table that a slice marks: pictures do not show it.
    pub(super) fn marked_table<'a>(&self, volume: &'a Volume) -> Option<&'a Table> {
        let marks = matches!((self.mode, self.table), (Mode::Slice(_), TableRule::Remove));
        marks.then(|| volume.table()).flatten().map(AsRef::as_ref)
    }

    /// The volume that a picture shows.
    pub(super) fn shown<'a>(&self, volume: &'a Volume) -> &'a Volume {
        match (self.mode, self.table) {
            (Mode::Slice(_), _) | (_, TableRule::Keep) => volume,
            (_, TableRule::Remove) => volume.without_table(),
        }
    }
}
