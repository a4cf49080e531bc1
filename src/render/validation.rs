//! The ranges that a request's values must keep to, and the combinations that have no meaning.
//!
//! The parts' own constructors check the rest.

use crate::classification::Classification;
use crate::cut::CutFaces;
use crate::depth_rule::DepthRule;
use crate::labels::{Labels, Look};
use crate::light::Light;
use crate::mode::Mode;
use crate::request::{Clip, ClipPlane, ClipSphere, RenderRequest};
use crate::surface;
use relief_base::OutOfRange;
use relief_volume::{Grid, Projection};

impl RenderRequest {
    /// Checks every range that the parts' own constructors do not.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let within = |path: &str, value: f64, low: f64, high: f64| {
            let inside = (low..=high).contains(&value);
            inside.then_some(()).ok_or_else(|| OutOfRange::new(path, value, format!("{low} to {high}")))
        };
        for side in self.size_px {
            within("size_px", f64::from(side), 1.0, f64::from(Self::MAX_SIDE_PX))?;
        }
        let pixels = self.size_px.into_iter().map(u64::from).product::<u64>();
        if pixels > Self::MAX_PIXELS {
            let [width, height] = self.size_px;
            let allowed = format!("at most {} pixels", Self::MAX_PIXELS);
            return Err(OutOfRange::new("size_px", format!("{width} x {height}"), allowed));
        }
        if let Some(reduced) = self.reduced_px {
            for (side, most) in reduced.into_iter().zip(self.size_px) {
                within("reduced_px", f64::from(side), 1.0, f64::from(most))?;
            }
        }
        within("sample_distance_mm", self.sample_distance_mm, 0.000_001, 100.0)?;
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
                return Err(OutOfRange::new(
                    "camera.projection",
                    "perspective",
                    "orthographic in mode slice",
                ));
            }
        }
        surface::validate(self.mode, &self.surfaces)?;
        validate_classification(self)?;
        validate_cut(self)?;
        let is_point_rule = matches!(self.depth.of_rays(), DepthRule::FirstHit | DepthRule::Threshold { .. });
        if self.mode == Mode::Isosurface && !is_point_rule {
            let allowed = "threshold or first-hit in mode isosurface";
            return Err(OutOfRange::new("depth.rule", self.depth.name(), allowed));
        }
        if self.transfer.gradient_opacity().is_some() && self.mode != Mode::Composite {
            let allowed = "nothing beside other modes than composite";
            return Err(OutOfRange::new("transfer.gradient_opacity", "there", allowed));
        }
        if let Some(labels) = &self.labels {
            validate_labels(labels, self)?;
        }
        // Its passes cost nothing in other modes.
        self.path_trace.validate((self.mode == Mode::PathTraced).then_some(pixels))?;
        self.validate_lights()?;
        self.validate_clip()?;
        self.overlays.validate()
    }

    /// [`RenderRequest::validate`], and that the work on a volume of this grid is within
    /// [`RenderRequest::MAX_SAMPLES`].
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate_on(&self, grid: &Grid) -> Result<(), OutOfRange> {
        self.validate()?;
        if let Some(labels) = &self.labels {
            labels.validate_on(grid)?;
        }
        let least_mm = self.least_sample_distance_mm(grid);
        if self.sample_distance_mm < least_mm {
            let allowed = format!("at least {least_mm:.3} mm for a picture of this size");
            return Err(OutOfRange::new("sample_distance_mm", self.sample_distance_mm, allowed));
        }
        Ok(())
    }

    /// The distance between samples below which a picture of this size has too many, mm.
    pub(crate) fn least_sample_distance_mm(&self, grid: &Grid) -> f64 {
        let pixels = f64::from(self.size_px[0]) * f64::from(self.size_px[1]);
        pixels * self.longest_ray_mm(grid) / Self::MAX_SAMPLES
    }

    fn validate_lights(&self) -> Result<(), OutOfRange> {
        if self.lights.len() > Light::MAX {
            let found = format!("{} lights", self.lights.len());
            return Err(OutOfRange::new("lights", found, format!("at most {}", Light::MAX)));
        }
        let is_lit = matches!(self.mode, Mode::Composite | Mode::Isosurface | Mode::PathTraced);
        if !is_lit && !self.lights.is_empty() {
            let found = format!("{} lights", self.lights.len());
            let allowed = "none in this mode: composite, isosurface and path-traced have placed lights";
            return Err(OutOfRange::new("lights", found, allowed));
        }
        self.illumination.validate(&self.lights)?;
        (0..).zip(&self.lights).try_for_each(|(index, light)| light.validate(index))
    }

    fn validate_clip(&self) -> Result<(), OutOfRange> {
        let count = self.clip.planes.len();
        if count > Clip::MAX_PLANES {
            return Err(OutOfRange::new(
                "clip.planes",
                format!("{count} planes"),
                "at most 6 beside the box",
            ));
        }
        if let Some(ClipSphere { center, radius_mm }) = self.clip.sphere {
            if center.xyz.abs().max_element() > 1e6 || !center.xyz.is_finite() {
                let allowed = "within 1000000 mm";
                let found = format!("{:?}", center.xyz.to_array());
                return Err(OutOfRange::new("clip.sphere.center_mm", found, allowed));
            }
            if !ClipSphere::RADIUS_MM.contains(&radius_mm) {
                let (low, high) = (ClipSphere::RADIUS_MM.start(), ClipSphere::RADIUS_MM.end());
                let allowed = format!("{low} to {high} mm");
                return Err(OutOfRange::new("clip.sphere.radius_mm", radius_mm, allowed));
            }
        }
        let usable = |plane: &ClipPlane| {
            plane.point.xyz.abs().max_element() <= 1e6 && plane.normal.normalized().is_some()
        };
        match self.clip.planes.iter().find(|plane| !usable(plane)) {
            Some(ClipPlane { point, normal }) => {
                let found = format!("point {:?}, normal {:?}", point.xyz.to_array(), normal.xyz.to_array());
                let allowed = "a point within 1000000 mm and a normal of finite length above zero";
                Err(OutOfRange::new("clip.planes", found, allowed))
            }
            None => Ok(()),
        }
    }
}

/// Refuses what pre-integration has no meaning for.
/// Slices are painted in mode composite only, in a window of a usable width.
fn validate_cut(request: &RenderRequest) -> Result<(), OutOfRange> {
    let CutFaces::Slice { window_hu: [center_hu, width_hu] } = request.cut else { return Ok(()) };
    if request.mode != Mode::Composite {
        return Err(OutOfRange::new("cut", request.cut.name(), "lit in other modes than composite"));
    }
    let (low, high) = (CutFaces::WIDTHS_HU.start(), CutFaces::WIDTHS_HU.end());
    if !CutFaces::WIDTHS_HU.contains(&width_hu) {
        return Err(OutOfRange::new(
            "cut.slice.window_hu",
            width_hu,
            format!("a width of {low} to {high} HU"),
        ));
    }
    if center_hu.is_finite() && center_hu.abs() <= *high {
        return Ok(());
    }
    Err(OutOfRange::new("cut.slice.window_hu", center_hu, format!("a centre within {high} HU of 0")))
}

fn validate_classification(request: &RenderRequest) -> Result<(), OutOfRange> {
    if request.classification == Classification::Sampled {
        return Ok(());
    }
    let refuse =
        |allowed: &str| Err(OutOfRange::new("classification", Classification::PreIntegrated.name(), allowed));
    if request.mode != Mode::Composite {
        return refuse("sampled in other modes than composite");
    }
    if request.transfer.gradient_opacity().is_some() {
        return refuse("sampled with opacity by gradient");
    }
    if request.labels.is_some() {
        return refuse("sampled in a scene with labels");
    }
    if request.depth.needs_samples() {
        let rules = DepthRule::TABLE.iter().filter(|entry| entry.needs_samples).map(|entry| entry.name);
        return refuse(&format!("sampled with depth rules {}", rules.collect::<Vec<_>>().join(", ")));
    }
    Ok(())
}

fn validate_labels(labels: &Labels, request: &RenderRequest) -> Result<(), OutOfRange> {
    let refuse = |found: String, allowed: &str| Err(OutOfRange::new("labels", found, allowed));
    if !Labels::are_shown_by(request.mode) {
        let modes = Mode::ALL.into_iter().filter(|mode| Labels::are_shown_by(*mode)).map(Mode::name);
        let allowed = format!("nothing beside other modes than {}", modes.collect::<Vec<_>>().join(", "));
        return refuse("there".to_owned(), &allowed);
    }
    let segments = labels.map.segments().len();
    if segments > Labels::MOST_SEGMENTS {
        return refuse(format!("a map of {segments} segments"), "maps of at most 512 segments");
    }
    if labels.looks.len() != segments + 1 {
        return refuse(format!("{} looks", labels.looks.len()), &format!("{}", segments + 1));
    }
    if labels.transfers.len() > Labels::MOST_TRANSFERS {
        let found = format!("{} transfer functions", labels.transfers.len());
        return refuse(found, "at most 15 different ones beside the scene's own");
    }
    let own = std::iter::once(&request.transfer);
    if own.chain(&labels.transfers).any(|transfer| transfer.gradient_opacity().is_some()) {
        let allowed = "nothing in a scene with labels";
        return Err(OutOfRange::new("transfer.gradient_opacity", "there", allowed));
    }
    let in_range = |look: &Look| {
        look.transfer <= labels.transfers.len()
            && look.tint_rgb.iter().chain([&look.tint]).all(|share| (0.0..=1.0).contains(share))
    };
    match labels.looks.iter().find(|look| !in_range(look)) {
        Some(look) => refuse(format!("{look:?}"), "tints of 0 to 1 and a transfer function that is there"),
        None => Ok(()),
    }
}
