//! A complete, immutable order for one picture: everything that the renderer needs beside the
//! volume.
//!
//! Values here are valid by construction of their parts plus [`RenderRequest::validate`]; the JSON
//! form with its defaults and error paths is in `scene`.

use std::sync::Arc;

use super::classification::{self, Classification};
pub(crate) use super::depth_rule::DepthRule;
use super::illumination::Illumination;
use super::labels::Labels;
use super::light::Light;
use super::mode::Mode;
use super::overlay::Overlays;
use super::pathtrace::PathTrace;
use super::surface::{self, Surface};
use crate::request_error::RequestError;
use relief_base::{Patient, Point, Vector};
use relief_volume::{Camera, Grid, Projection, TransferFunction};

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
    pub const RADIUS_MM: std::ops::RangeInclusive<f64> = 0.01..=10_000.0;
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
    /// Where the eye is and how it projects.
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
    /// Which values a sample of mode composite stands for.
    pub classification: Classification,
    /// The surfaces of mode isosurface, values rising; none in other modes.
    pub surfaces: Vec<Surface>,
    /// Light.
    pub shading: Shading,
    /// Distance between samples along a ray, mm.
    pub sample_distance_mm: f64,
    /// Thickness of a slice's slab, half of it on each side of the plane, mm; 0 is a plane, and the
    /// only value for other modes.
    pub slab_mm: f64,
    /// Whether a slice's picture has the patient directions at its edges burnt in.
    pub letters: bool,
    /// Which depth a ray has.
    pub depth: DepthRule,
    /// Which part is shown.
    pub clip: Clip,
    /// How the segments of a label map are shown; `None` where all of the volume is shown alike.
    /// Shared, as it may be large.
    pub labels: Option<Arc<Labels>>,
    /// Display-referred sRGB, 0..1, behind everything.
    pub background_rgb: [f64; 3],
    /// The overlays of the picture, in the same depth. Shared, since they may be large.
    pub overlays: Arc<Overlays>,
    /// At most [`Light::MAX`], for modes composite, isosurface and path-traced. Without any the
    /// first two have the headlight.
    pub lights: Vec<Light>,
    /// Shadows of the lights and occlusion by surroundings, for modes composite and isosurface.
    pub illumination: Illumination,
    /// What mode path-traced takes beside.
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

    /// Checks every range that the parts' own constructors do not.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), RequestError> {
        let within = |path: &str, value: f64, low: f64, high: f64| {
            let inside = (low..=high).contains(&value);
            inside.then_some(()).ok_or_else(|| RequestError::new(path, &value, &format!("{low} to {high}")))
        };
        for side in self.size_px {
            within("size_px", f64::from(side), 1.0, f64::from(Self::MAX_SIDE_PX))?;
        }
        let pixels = self.size_px.into_iter().map(u64::from).product::<u64>();
        if pixels > Self::MAX_PIXELS {
            let [width, height] = self.size_px;
            let allowed = format!("at most {} pixels", Self::MAX_PIXELS);
            return Err(RequestError::new("size_px", &format!("{width} x {height}"), &allowed));
        }
        if let Some(reduced) = self.reduced_px {
            for (side, most) in reduced.into_iter().zip(self.size_px) {
                within("reduced_px", f64::from(side), 1.0, f64::from(most))?;
            }
        }
        within("sample_distance_mm", self.sample_distance_mm, 0.01, 100.0)?;
        for (path, value) in [
            ("shading.ambient", self.shading.ambient),
            ("shading.diffuse", self.shading.diffuse),
            ("shading.specular", self.shading.specular),
        ] {
            within(path, value, 0.0, 1.0)?;
        }
        within("shading.shininess", self.shading.shininess, 1.0, 1000.0)?;
        for channel in self.background_rgb {
            within("background_rgb", channel, 0.0, 1.0)?;
        }
        if let Some(fraction) = self.depth.fraction() {
            within("depth.fraction", fraction, 0.001, 1.0)?;
        }
        if let Mode::Slice(_) = self.mode {
            within("slice.slab_mm", self.slab_mm, 0.0, Self::MAX_SLAB_MM)?;
            if let Projection::Perspective { .. } = self.camera.projection() {
                return Err(RequestError::new(
                    "camera.projection",
                    &"perspective",
                    "orthographic in mode slice",
                ));
            }
        }
        surface::validate(self.mode, &self.surfaces)?;
        classification::validate(self)?;
        let is_point_rule = matches!(self.depth, DepthRule::FirstHit | DepthRule::Threshold { .. });
        if self.mode == Mode::Isosurface && !is_point_rule {
            let allowed = "threshold or first-hit in mode isosurface";
            return Err(RequestError::new("depth.rule", &self.depth.name(), allowed));
        }
        if self.transfer.gradient_opacity().is_some() && self.mode != Mode::Composite {
            let allowed = "nothing beside other modes than composite";
            return Err(RequestError::new("transfer.gradient_opacity", &"there", allowed));
        }
        if let Some(labels) = &self.labels {
            labels.validate(self)?;
        }
        self.path_trace.validate(pixels)?;
        self.validate_lights()?;
        self.validate_clip()?;
        self.overlays.validate()
    }

    /// [`RenderRequest::validate`], and that the work on a volume of this grid is within
    /// [`RenderRequest::MAX_SAMPLES`].
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate_on(&self, grid: &Grid) -> Result<(), RequestError> {
        self.validate()?;
        if let Some(labels) = &self.labels {
            labels.validate_on(grid)?;
        }
        let pixels = f64::from(self.size_px[0]) * f64::from(self.size_px[1]);
        let longest_ray_mm = self.longest_ray_mm(grid);
        let least_mm = pixels * longest_ray_mm / Self::MAX_SAMPLES;
        if self.sample_distance_mm < least_mm {
            let allowed = format!("at least {least_mm:.3} mm for a picture of this size");
            return Err(RequestError::new("sample_distance_mm", &self.sample_distance_mm, &allowed));
        }
        Ok(())
    }

    fn longest_ray_mm(&self, grid: &Grid) -> f64 {
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

    fn validate_lights(&self) -> Result<(), RequestError> {
        if self.lights.len() > Light::MAX {
            let found = format!("{} lights", self.lights.len());
            return Err(RequestError::new("lights", &found, &format!("at most {}", Light::MAX)));
        }
        let is_lit = matches!(self.mode, Mode::Composite | Mode::Isosurface | Mode::PathTraced);
        if !is_lit && !self.lights.is_empty() {
            let found = format!("{} lights", self.lights.len());
            let allowed = "none in this mode: composite, isosurface and path-traced have placed lights";
            return Err(RequestError::new("lights", &found, allowed));
        }
        self.illumination.validate(&self.lights)?;
        (0..).zip(&self.lights).try_for_each(|(index, light)| light.validate(index))
    }

    fn validate_clip(&self) -> Result<(), RequestError> {
        let count = self.clip.planes.len();
        if count > Clip::MAX_PLANES {
            return Err(RequestError::new(
                "clip.planes",
                &format!("{count} planes"),
                "at most 6 beside the box",
            ));
        }
        if let Some(ClipSphere { center, radius_mm }) = self.clip.sphere {
            if center.xyz.abs().max_element() > 1e6 || !center.xyz.is_finite() {
                let allowed = "within 1000000 mm";
                let found = format!("{:?}", center.xyz.to_array());
                return Err(RequestError::new("clip.sphere.center_mm", &found, allowed));
            }
            if !ClipSphere::RADIUS_MM.contains(&radius_mm) {
                let (low, high) = (ClipSphere::RADIUS_MM.start(), ClipSphere::RADIUS_MM.end());
                let allowed = format!("{low} to {high} mm");
                return Err(RequestError::new("clip.sphere.radius_mm", &radius_mm, &allowed));
            }
        }
        let usable = |plane: &ClipPlane| {
            plane.point.xyz.abs().max_element() <= 1e6 && plane.normal.normalized().is_some()
        };
        match self.clip.planes.iter().find(|plane| !usable(plane)) {
            Some(ClipPlane { point, normal }) => {
                let found = format!("point {:?}, normal {:?}", point.xyz.to_array(), normal.xyz.to_array());
                let allowed = "a point within 1000000 mm and a normal of finite length above zero";
                Err(RequestError::new("clip.planes", &found, allowed))
            }
            None => Ok(()),
        }
    }
}
