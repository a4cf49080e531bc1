//! The JSON form of a request: the same in a scene file, in an HTTP body and in a batch job.
//!
//! [`SceneFile`] is the written form, every part optional. [`SceneFile::resolve`] fills in defaults
//! for a volume and returns a [`Scene`] whose every value is in range. Errors name the key's path,
//! the value and the permitted values.

mod error;
mod labels;
mod lights;
mod overlays;
mod parts;
mod shading;
mod slice;
mod subject;
mod surfaces;
mod transfer;
mod whole;
mod written;

use std::sync::Arc;

use serde::Deserialize;

use self::labels::{ClipLabelsFile, LabelSettings, LabelsFile, resolve_labels};
use self::lights::{LightsFile, PathTraceFile, resolve_lights};
use self::overlays::OverlaysFile;
use self::parts::{ClipFile, DepthFile, default_mode, default_shading, expect_objects};
use self::shading::ShadingFile;
use self::slice::expect_one_view;
use self::surfaces::{SurfaceFile, resolve_surfaces};
use self::transfer::{TransferFile, Windows, resolve_transfer, usual_window_hu};
use self::whole::Whole;
use super::classification::Classification;
use super::cut::{CutChoice, CutFaces};
use super::detail::Detail;
use super::display_depth::ForViews;
use super::framing::FramingRule;
use super::illumination::Illumination;
use super::mode::{Mode, SlabBlend};
use super::quality::Quality;
use super::request::{DepthRule, RenderRequest};
use super::table_rule::TableRule;
use relief_annotation::ShownSets;
use relief_base::OutOfRange;
use relief_display::DisplaySettings;
use relief_volume::{Anatomy, CameraFile, Framing, Grid, Orbit};

pub(crate) use error::camera_out_of_range;
pub use error::{SceneError, SyntaxError};
pub use slice::{SliceFile, SlicePlane};
pub use subject::{Subject, SubjectContent, name_of, with_hash};
pub use written::{preset_json, shading_json, transfer_json};

/// A picture to render and how to show it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The request for the renderer.
    pub request: RenderRequest,
    /// The part of the volume that the camera was fitted to, where the scene had none.
    pub frame: FramingRule,
    /// For which anatomy the preset or window was chosen, where the scene had no transfer function.
    pub chosen: Option<Anatomy>,
    /// Layout and disparity of the frame.
    pub display: DisplaySettings,
    /// Time limit of the render, ms; without one the picture has its full quality. The caller
    /// reduces the request, since it has measured the speed of pictures.
    pub budget_ms: Option<f64>,
    /// The annotations to draw. The renderer has no annotations: the caller adds them to the
    /// request's overlays.
    pub annotations: ShownSets,
}

impl Scene {
    /// The same scene on another display, for which rule `views` chooses depths.
    #[must_use]
    pub fn with_display(mut self, display: DisplaySettings) -> Self {
        self.request.for_views = for_views(self.request.depth, &display);
        Self { display, ..self }
    }

    /// Refuses annotations: of those who have none to draw.
    ///
    /// # Errors
    /// When the scene wants any.
    pub fn expect_no_annotations(&self) -> Result<(), SceneError> {
        if self.annotations.is_nothing() {
            return Ok(());
        }
        let allowed = "false where no log of annotations is at hand: relief render and relief serve take one";
        Err(OutOfRange::new("annotations", "to be drawn", allowed).into())
    }

    /// Checks that the picture has the size that its layout needs: of those who write a frame in
    /// that layout.
    ///
    /// # Errors
    /// With both sizes when it has another.
    pub fn expect_size_of_layout(&self) -> Result<(), SceneError> {
        let found = self.request.size_px;
        if let Err(error) = self.display.layout.check_size(found) {
            let allowed = format!("a size of which layout {} can be made ({error})", self.display.layout);
            return Err(OutOfRange::new("size_px", format!("{} x {}", found[0], found[1]), allowed).into());
        }
        match self.display.encoder()?.render_size_px() {
            Some([width, height]) if found != [width, height] => {
                let layout = self.display.layout;
                let allowed =
                    format!("{width} x {height}, which layout {layout} needs (rgbd and color take any)");
                Err(OutOfRange::new("size_px", format!("{} x {}", found[0], found[1]), allowed).into())
            }
            _ => Ok(()),
        }
    }
}

/// A scene as written in JSON.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneFile {
    camera: Option<CameraFile>,
    frame: Option<FramingRule>,
    size_px: Option<[Whole; 2]>,
    budget_ms: Option<f64>,
    mode: Option<Mode>,
    slice: Option<SliceFile>,
    iso_hu: Option<f64>,
    surfaces: Option<Vec<SurfaceFile>>,
    transfer: Option<TransferFile>,
    classification: Option<Classification>,
    shading: Option<ShadingFile>,
    sample_distance_mm: Option<f64>,
    quality: Option<Quality>,
    depth: Option<DepthFile>,
    clip: Option<ClipFile>,
    cut: Option<CutChoice>,
    table: Option<TableRule>,
    labels: Option<LabelsFile>,
    background_rgb: Option<[f64; 3]>,
    overlays: OverlaysFile,
    annotations: ShownSets,
    lights: Option<LightsFile>,
    path_trace: Option<PathTraceFile>,
    display: DisplaySettings,
}

impl SceneFile {
    /// Reads the JSON form.
    ///
    /// # Errors
    /// When it is not JSON, has an unknown key, or a value of the wrong kind; with the key's path.
    pub fn parse(json: &[u8]) -> Result<Self, SceneError> {
        // Invalid JSON passes here: the reader reports its position.
        if let Ok(value) = serde_json::from_slice(json) {
            expect_objects(&value)?;
        }
        let mut reader = serde_json::Deserializer::from_slice(json);
        let scene = serde_path_to_error::deserialize(&mut reader).map_err(|error| SceneError::Syntax {
            path: error.path().to_string(),
            source: error.into_inner().into(),
        })?;
        reader.end().map_err(|error| SceneError::Syntax { path: ".".into(), source: error.into() })?;
        Ok(scene)
    }

    /// Reads the JSON form that is in memory as a value.
    ///
    /// # Errors
    /// When it has an unknown key, or a value of the wrong kind; with the key's path.
    pub fn from_value(json: &serde_json::Value) -> Result<Self, SceneError> {
        expect_objects(json)?;
        serde_path_to_error::deserialize(json).map_err(|error| SceneError::Syntax {
            path: error.path().to_string(),
            source: error.into_inner().into(),
        })
    }

    /// Replaces the transfer function by a preset of this name.
    #[must_use]
    pub fn with_preset(self, name: &str) -> Self {
        let shading = self.shading.and_then(ShadingFile::without_reflection);
        Self { transfer: Some(TransferFile::Preset(name.to_owned())), shading, ..self }
    }

    /// Replaces the transfer function and the light, and the mode where `look` has one; the rest of
    /// `look` is left.
    #[must_use]
    pub fn with_look_of(self, look: Self) -> Self {
        let Self { transfer, shading, mode, .. } = look;
        Self { transfer, shading, mode: mode.or(self.mode), ..self }
    }

    /// Replaces how samples become a colour.
    #[must_use]
    pub fn with_mode(self, mode: Mode) -> Self {
        // Surfaces that were written for isosurfaces mean nothing in another mode.
        let (iso_hu, surfaces) = match mode {
            Mode::Isosurface => (self.iso_hu, self.surfaces),
            _ => (None, None),
        };
        Self { mode: Some(mode), iso_hu, surfaces, ..self }
    }

    /// Makes this a scene of one opaque isosurface, at this value in HU.
    #[must_use]
    pub fn with_iso_hu(self, hu: f64) -> Self {
        Self { mode: Some(Mode::Isosurface), iso_hu: Some(hu), surfaces: None, ..self }
    }

    /// Switches on an overlay by its name, one of
    /// [`Overlays::SWITCHES`](super::Overlays::SWITCHES).
    ///
    /// # Errors
    /// When no preset has this name.
    pub fn with_overlay(mut self, name: &str) -> Result<Self, OutOfRange> {
        self.overlays.switch_on(name)?;
        Ok(self)
    }

    /// Cuts these segments away, or keeps only these, each by its label or its name, and tints all
    /// by this share. An empty list or `None` keeps the scene's value.
    #[must_use]
    pub fn with_labels(mut self, cut: &[String], keep: &[String], tint: Option<f64>) -> Self {
        if let Some(labels) = ClipLabelsFile::of(cut, keep) {
            self.clip.get_or_insert_default().labels = Some(labels);
        }
        if let Some(tint) = tint {
            self.labels.get_or_insert_default().set_tint(tint);
        }
        self
    }

    /// Whether the scene is that of a slice.
    #[must_use]
    pub fn is_slice(&self) -> bool {
        matches!(self.mode, Some(Mode::Slice(_)))
    }

    /// The slice, for changes; converts the scene to a slice scene if necessary.
    pub fn slice_mut(&mut self) -> &mut SliceFile {
        self.mode = Some(Mode::Slice(SlabBlend::default()));
        self.slice.get_or_insert_default()
    }

    /// Shows values by a window, in HU.
    #[must_use]
    pub fn with_window(self, center_hu: f64, width_hu: f64) -> Self {
        Self { transfer: Some(TransferFile::window(center_hu, width_hu)), ..self }
    }

    /// Replaces the depth rule, with its usual fraction.
    #[must_use]
    pub fn with_depth_rule(self, rule: DepthRule) -> Self {
        Self { depth: Some(DepthFile::of_rule(rule)), ..self }
    }

    /// Replaces the number of passes of mode path-traced.
    #[must_use]
    pub fn with_passes(self, passes: u32) -> Self {
        let path_trace = self.path_trace.unwrap_or_default().with_passes(passes);
        Self { path_trace: Some(path_trace), ..self }
    }

    /// Replaces the number of scatterings and the removal of noise, in mode path-traced.
    #[must_use]
    pub fn with_light(self, scatterings: Option<u32>, denoise: Option<bool>) -> Self {
        let path_trace = self.path_trace.unwrap_or_default().with_light(scatterings, denoise);
        Self { path_trace: Some(path_trace), ..self }
    }

    /// Replaces how closely the picture is sampled.
    #[must_use]
    pub fn with_quality(self, quality: Quality) -> Self {
        Self { quality: Some(quality), ..self }
    }

    /// Replaces the values that a sample represents.
    #[must_use]
    pub fn with_classification(self, classification: Classification) -> Self {
        Self { classification: Some(classification), ..self }
    }

    /// Replaces how cut faces look.
    #[must_use]
    pub fn with_cut(self, cut: CutChoice) -> Self {
        Self { cut: Some(cut), ..self }
    }

    /// Replaces the size of the picture.
    #[must_use]
    pub fn with_size(self, size_px: [u32; 2]) -> Self {
        Self { size_px: Some(size_px.map(Whole)), ..self }
    }

    /// Replaces the budget of time, ms.
    #[must_use]
    pub fn with_budget_ms(self, budget_ms: f64) -> Self {
        Self { budget_ms: Some(budget_ms), ..self }
    }

    /// Replaces the annotations that are drawn.
    #[must_use]
    pub fn with_annotations(self, annotations: ShownSets) -> Self {
        Self { annotations, ..self }
    }

    /// The annotations that are drawn.
    #[must_use]
    pub fn annotations(&self) -> &ShownSets {
        &self.annotations
    }

    /// The size that the file gives.
    #[must_use]
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.size_px.map(|sides| sides.map(|side| side.0))
    }

    /// Leaves the size to the layout.
    #[must_use]
    pub fn with_size_of_layout(self) -> Self {
        Self { size_px: None, ..self }
    }

    /// Replaces the display settings.
    #[must_use]
    pub fn with_display(self, display: DisplaySettings) -> Self {
        Self { display, ..self }
    }

    /// How the picture is to be shown.
    #[must_use]
    pub fn display(&self) -> &DisplaySettings {
        &self.display
    }

    /// Whether the file says where the eye is.
    #[must_use]
    pub fn has_camera(&self) -> bool {
        self.camera.is_some()
    }

    /// Replaces whether the table is shown.
    #[must_use]
    pub fn with_table(self, table: TableRule) -> Self {
        Self { table: Some(table), ..self }
    }

    /// Replaces the fit of the camera.
    #[must_use]
    pub fn with_frame(self, frame: FramingRule) -> Self {
        Self { frame: Some(frame), ..self }
    }

    /// The complete scene for a volume on `grid`: as [`SceneFile::resolve_for`], with the camera
    /// fitted to the bounding sphere and without a label map.
    ///
    /// # Errors
    /// As [`SceneFile::resolve_for`].
    pub fn resolve(self, grid: &Grid, orbit: &Orbit) -> Result<Scene, SceneError> {
        self.resolve_for(&Subject::of_grid(grid), orbit)
    }

    /// The size that was written, or that of the layout.
    fn picture_size_px(&self) -> Result<[u32; 2], SceneError> {
        let size_of_layout = self.display.encoder()?.render_size_px();
        let written = self.size_px.map(|sides| sides.map(|side| side.0));
        Ok(written.or(size_of_layout).unwrap_or([960, 540]))
    }

    /// The complete scene for a volume: parts that were not written get their defaults, and a camera
    /// that was not written becomes `orbit` around what is visible of the volume. A size that was not
    /// written is the layout's. Where the scene says nothing of labels, segments are tinted in the
    /// modes that show them.
    ///
    /// # Errors
    /// The first value out of range, with the key's path, the value and the allowed range.
    pub fn resolve_for(self, subject: &Subject<'_>, orbit: &Orbit) -> Result<Scene, SceneError> {
        let Subject { grid, content, labels: map, name: _ } = *subject;
        self.display.validate()?;
        parts::expect_no_cursor(&self.display)?;
        expect_budget(self.budget_ms)?;
        let size_px = self.picture_size_px()?;
        let is_slice = self.is_slice();
        let slice = expect_one_view(is_slice, self.slice, self.camera.is_some(), orbit)?;
        let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
        let around = |framing: &Framing| orbit.camera(framing.center(), framing.radius_mm(orbit, aspect));
        let has_own_view = slice.is_some() || self.camera.is_some();
        let frame = framing_rule(self.frame, has_own_view)?;
        let camera = match (slice, self.camera) {
            (Some(slice), _) => slice.camera(grid, size_px)?,
            (None, Some(camera)) => camera.resolve().map_err(SceneError::from)?,
            (None, None) => {
                orbit.validate()?;
                around(&Framing::of_grid(grid)).map_err(SceneError::from)?
            }
        };
        let windows = if is_slice { Windows::Opaque } else { Windows::Translucent };
        let chooses = self.transfer.is_none() && (is_slice || has_look(self.mode));
        let chosen = if chooses { content.anatomy() } else { None };
        let (transfer, preset) = resolve_transfer(self.transfer, windows, chosen, grid.unit_mm())?;
        let mode = slice.map_or_else(
            || self.mode.unwrap_or_else(|| default_mode(preset)),
            |slice| Mode::Slice(slice.blend),
        );
        let mut clip = self.clip.unwrap_or_default();
        let written = LabelSettings { labels: self.labels, clip: clip.labels.take() };
        let classification = self.classification.unwrap_or_default();
        let mut request = RenderRequest {
            camera,
            size_px,
            reduced_px: None,
            mode,
            labels: resolve_labels(written, map, mode, classification, &transfer)?,
            surfaces: resolve_surfaces(mode, self.iso_hu, self.surfaces, &transfer)?,
            transfer,
            classification,
            illumination: self.shading.as_ref().map_or_else(Illumination::default, ShadingFile::illumination),
            shading: self.shading.unwrap_or_default().resolve(default_shading(preset)),
            sample_distance_mm: 1.0,
            detail: Detail::Full,
            slab_mm: slice.map_or(0.0, |slice| slice.slab_mm),
            letters: slice.is_some_and(|slice| slice.letters),
            depth: self.depth.unwrap_or_else(|| DepthFile::usual(&self.display, mode, &camera)).resolve()?,
            for_views: None,
            needs_depth: true,
            clip: clip.resolve()?,
            cut: self.cut.map_or(CutFaces::Lit, |cut| cut.resolve(usual_window_hu(content.anatomy()))),
            table: self.table.unwrap_or_default(),
            blocks: None,
            background_rgb: self.background_rgb.unwrap_or([0.0; 3]),
            overlays: Arc::new(self.overlays.resolve(|| subject.caption())?),
            lights: resolve_lights(self.lights, mode)?,
            path_trace: self.path_trace.unwrap_or_default().resolve(grid.unit_mm()),
        };
        request.sample_distance_mm = Quality::resolve(self.quality, self.sample_distance_mm, &request, grid)?;
        if let Some(framing) = (!has_own_view).then(|| subject.framing(frame, &request)).flatten() {
            request.camera = around(&framing).map_err(SceneError::from)?;
        }
        request.for_views = for_views(request.depth, &self.display);
        request.validate_on(grid)?;
        expect_background(&request, &self.display)?;
        let Self { display, budget_ms, annotations, .. } = self;
        Ok(Scene { request, frame, chosen, display, budget_ms, annotations })
    }
}

/// The fit of the camera; refuses one where there is nothing to fit.
fn framing_rule(written: Option<FramingRule>, has_own_view: bool) -> Result<FramingRule, OutOfRange> {
    match written.filter(|_| has_own_view) {
        Some(frame) => {
            let allowed = "left out where the scene has a camera or is a slice";
            Err(OutOfRange::new("frame", format_args!("{:?}", frame.name()), allowed))
        }
        None => Ok(written.unwrap_or_default()),
    }
}

/// The display of rule `views`.
fn for_views(depth: DepthRule, display: &DisplaySettings) -> Option<ForViews> {
    (depth == DepthRule::Views).then(|| ForViews::new(display))
}

/// Whether presets are made for a mode: in the others a transfer function gives windows or colours.
fn has_look(mode: Option<Mode>) -> bool {
    matches!(mode, None | Some(Mode::Composite | Mode::PathTraced))
}

/// Rejects a budget outside the permitted range.
fn expect_budget(budget_ms: Option<f64>) -> Result<(), OutOfRange> {
    let range = RenderRequest::BUDGET_MS;
    match budget_ms.filter(|ms| !range.contains(ms)) {
        Some(ms) => {
            let allowed = format!("{} to {} ms", range.start(), range.end());
            Err(OutOfRange::new("budget_ms", ms, allowed))
        }
        None => Ok(()),
    }
}

/// Refuses a layout with a background where the request gives none.
fn expect_background(request: &RenderRequest, display: &DisplaySettings) -> Result<(), OutOfRange> {
    let layout = display.layout;
    if !layout.needs_background() || request.has_background() {
        return Ok(());
    }
    if request.depth.has_back_layer() || request.depth == DepthRule::Views {
        let allowed = format!("composite, which layout {layout} needs");
        return Err(OutOfRange::new("mode", format!("{:?}", request.mode).to_lowercase(), allowed));
    }
    let allowed = format!("two-layer or views, since layout {layout} needs a back layer");
    Err(OutOfRange::new("depth.rule", request.depth.name(), allowed))
}

#[cfg(test)]
mod tests;
