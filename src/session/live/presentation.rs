//! The content of a view, except for its camera: volume, scene, preset, display settings, size.
//!
//! A [`Presentation`] is complete and valid: a change returns a new one, or an error that leaves
//! the old one in place. The scene is stored as a JSON merge patch (RFC 7396) on an empty request,
//! so that a later patch can remove keys.

use std::sync::Arc;

use serde_json::{Map, Value};

use super::LiveError;
use super::effect::HeldPoint;
use crate::Drawables;
use crate::live::ghost::Ghost;
use crate::volumes::VolumeEntry;
use relief_annotation::{ShownSets, Snap, SnapFeature};
use relief_base::OutOfRange;
use relief_display::DisplaySettings;
use relief_live::{Home, LiveLayout, Play, Quality, Settings, SnapTo, Stage, ViewState};
use relief_render::{
    Clip, ClipPlane, FramingRule, Landmark, Line, Mode, OverlayItem, Overlays, Radius, RenderRequest, Scene,
    SceneError, SceneFile, depth_limits, length_words,
};
use relief_volume::{Camera, Orbit, PRESETS, preset};

/// Most pixels of a live frame. It bounds the memory of frames that wait.
const MAX_PIXELS: u64 = 1 << 23;
/// Colour of the preview of snapping.
const GHOST_RGB: [f64; 3] = [0.25, 0.95, 1.0];
const GHOST_WIDTH_PX: f64 = 2.0;
/// Keys of a scene that live sessions set elsewhere, and where.
const ELSEWHERE: [(&str, &str); 5] = [
    ("camera", "a pose with a camera, or intents"),
    ("size_px", "size_px beside scene"),
    ("display", "display beside scene"),
    ("budget_ms", "quality beside scene"),
    ("annotations", "annotations beside scene"),
];

/// The content of a view, except for its camera.
#[derive(Clone, Debug)]
pub struct Presentation {
    pub(super) entry: Arc<VolumeEntry>,
    pub(super) stage: Stage,
    pub(super) quality: Quality,
    /// Phases of the volume's series that are shown per second, one after the other.
    pub(super) play: Option<f64>,
    /// `None` when the scene has its own transfer function.
    pub(super) preset: Option<String>,
    patch: Map<String, Value>,
    display: DisplaySettings,
    size_px: Option<[u32; 2]>,
    /// The sets of annotations that are drawn, as `shown_to` may see them.
    pub(super) shown: ShownSets,
    pub(super) shown_to: Option<String>,
    drawables: Drawables,
    /// How landmarks snap when they are placed.
    pub(super) snap: Option<Snap>,
    /// The resolved scene with a default camera.
    base: Arc<Scene>,
}

impl Presentation {
    /// The presentation of a volume with these settings.
    ///
    /// # Errors
    /// When a setting is invalid.
    pub fn new(
        entry: Arc<VolumeEntry>,
        settings: &Settings,
        author: Option<&str>,
    ) -> Result<Self, LiveError> {
        let preset = entry.suited_preset();
        let (patch, display) = (Map::new(), DisplaySettings::default());
        let base = resolve(&entry, &patch, &display, None, preset.as_deref())?;
        let stage = stage_of(&entry, &base)?;
        let quality = Quality::Auto;
        let (shown, shown_to, drawables) = (ShownSets::Nothing, None, Drawables::default());
        let size_px = None;
        let plain = Self {
            entry,
            stage,
            quality,
            play: None,
            preset,
            patch,
            display,
            size_px,
            shown,
            shown_to,
            drawables,
            snap: None,
            base,
        };
        plain.with(settings, None, author)
    }

    /// The presentation with these changes.
    ///
    /// # Errors
    /// When a setting is invalid.
    pub(super) fn with(
        &self,
        settings: &Settings,
        entry: Option<Arc<VolumeEntry>>,
        author: Option<&str>,
    ) -> Result<Self, LiveError> {
        let mut next = self.clone();
        if let Some(shown) = &settings.annotations {
            next.shown = shown.clone();
            next.shown_to = author.map(str::to_owned);
            next.drawables = Drawables::default();
        }
        match &settings.snap {
            None => {}
            Some(SnapTo::Nothing) => next.snap = None,
            Some(SnapTo::Target(wanted)) => {
                let radius_mm = wanted.radius_mm.unwrap_or(Snap::DEFAULT_RADIUS_MM);
                if !Snap::RADII_MM.contains(&radius_mm) {
                    let allowed = format!("{} to {}", Snap::RADII_MM.start(), Snap::RADII_MM.end());
                    return Err(OutOfRange::new("snap.radius_mm", radius_mm, allowed).into());
                }
                next.snap = Some(Snap { to: SnapFeature::from_name(&wanted.to, wanted.hu)?, radius_mm });
            }
        }
        if let Some(entry) = entry {
            next.take_volume(entry);
        }
        next.take_play(settings.play)?;
        if settings.preset.is_some() {
            drop_reflection(&mut next.patch); // that of this message stays
        }
        if let Some(patch) = &settings.scene {
            for (key, instead) in ELSEWHERE {
                if patch.contains_key(key) {
                    return Err(LiveError::SceneKey { key, instead });
                }
            }
            merge(&mut next.patch, patch);
            match patch.get("transfer") {
                Some(Value::Null) => next.preset = next.entry.suited_preset(),
                Some(_) => next.preset = None,
                None => {}
            }
        }
        if let Some(display) = &settings.display {
            if LiveLayout::of(display.layout) == LiveLayout::None {
                let known = LiveLayout::all().filter(|layout| *layout != LiveLayout::None);
                let known: Vec<_> = known.map(LiveLayout::name).collect();
                return Err(OutOfRange::new("display.layout", display.layout, known.join(", ")).into());
            }
            // The size depends on the layout.
            if display.layout != next.display.layout {
                next.size_px = None;
            }
            next.display = display.clone();
        }
        next.size_px = settings.size_px.or(next.size_px);
        next.quality = settings.quality.unwrap_or(next.quality);
        if let Some(name) = &settings.preset {
            expect_preset(name)?;
            next.preset = Some(name.clone());
            next.patch.remove("transfer");
        }
        next.resolved()
    }

    fn take_play(&mut self, play: Option<Play>) -> Result<(), OutOfRange> {
        self.play = match play {
            Some(Play::Phases { per_s }) => Some(per_s),
            Some(Play::Stopped) => None,
            // Another series does not play by itself.
            None => self.play.filter(|_| self.entry.phase().is_some()),
        };
        if self.play.is_none() || self.entry.phase().is_some() {
            return Ok(());
        }
        let allowed = "false: the volume is no phase of a series";
        Err(OutOfRange::new("settings.play", "phases", allowed))
    }

    fn take_volume(&mut self, entry: Arc<VolumeEntry>) {
        if entry.id != self.entry.id {
            self.drawables = Drawables::default();
        }
        // A preset that the user did not choose follows the volume.
        let is_own = self.patch.contains_key("transfer");
        if !is_own && self.preset == self.entry.suited_preset() {
            self.preset = entry.suited_preset();
        }
        self.entry = entry;
    }

    /// The presentation with another phase of its series.
    ///
    /// # Errors
    /// When the scene is invalid for it.
    pub(super) fn with_phase(&self, phase: Arc<VolumeEntry>) -> Result<Self, LiveError> {
        let mut next = self.clone();
        next.take_volume(phase);
        next.resolved()
    }

    /// The presentation with this preset.
    ///
    /// # Errors
    /// When no preset has this name, or it conflicts with the rest of the scene.
    pub(super) fn with_preset(&self, preset: Option<&str>) -> Result<Self, LiveError> {
        let mut next = self.clone();
        next.preset = preset.map(str::to_owned);
        if preset.is_some() {
            next.patch.remove("transfer");
            drop_reflection(&mut next.patch);
        }
        next.resolved()
    }

    fn resolved(self) -> Result<Self, LiveError> {
        let base = resolve(&self.entry, &self.patch, &self.display, self.size_px, self.preset.as_deref())?;
        let stage = stage_of(&self.entry, &base)?;
        Ok(Self { base, stage, ..self })
    }

    pub(super) fn display(&self) -> &DisplaySettings {
        &self.display
    }

    /// Whether the scene has overlays besides a caption, or annotations are drawn: a caption follows the
    /// size of the picture.
    pub(super) fn has_overlays(&self) -> bool {
        !self.base.request.overlays.are_a_caption() || !self.drawables.is_empty()
    }

    /// Replaces the annotations that are drawn.
    pub(super) fn set_drawables(&mut self, drawables: Drawables) {
        self.drawables = drawables;
    }

    /// Whether the view shows a slice.
    pub(super) fn is_slice(&self) -> bool {
        matches!(self.base.request.mode, Mode::Slice(_))
    }

    /// The camera of the frame: that of the slice, one that was sent, or that of the view's state.
    ///
    /// # Errors
    /// When the state is invalid on this stage.
    pub(super) fn seen_through(&self, state: &ViewState, sent: Option<Camera>) -> Result<Camera, LiveError> {
        let own = || state.camera(&self.stage).map_err(LiveError::Camera);
        self.is_slice().then_some(self.base.request.camera).or(sent).map_or_else(own, Ok)
    }

    /// The request for a frame at full size.
    ///
    /// # Errors
    /// When camera and scene conflict.
    pub(super) fn request(
        &self,
        state: &ViewState,
        camera: Option<Camera>,
        held: Option<&HeldPoint>,
        ghost: Option<Ghost>,
    ) -> Result<RenderRequest, LiveError> {
        let mut request = self.base.request.clone();
        if !matches!(request.mode, Mode::Slice(_)) {
            let own = || state.camera(&self.stage).map_err(SceneError::from);
            request.camera = camera.map_or_else(own, Ok)?;
            if let Some(cut) = state.cut_plane(&self.stage)
                && request.clip.planes.len() < Clip::MAX_PLANES
            {
                request.clip.planes.push(ClipPlane { point: cut.point, normal: cut.normal });
            }
        }
        if let Some(mark) = state.cursor_mark(&self.stage) {
            let mut overlays = Overlays::clone(&request.overlays);
            let (radius, rgb) = (Radius::Px(mark.radius_px), mark.rgb);
            if let Some(HeldPoint { name, offset, .. }) = held {
                let (at, label) = (mark.at + *offset, Some(name.as_str().into()));
                overlays.items.push(OverlayItem::Landmark(Landmark { at, radius, rgb, label }));
            }
            overlays.items.push(OverlayItem::Landmark(Landmark { at: mark.at, radius, rgb, label: None }));
            overlays.items.extend(ghost.into_iter().flat_map(|ghost| ghost_marks(ghost, radius)));
            request.overlays = Arc::new(overlays);
        }
        self.drawables.draw(&mut request, &self.display, &self.entry.grid);
        request.validate_on(&self.entry.grid)?;
        self.display.limits(depth_limits(&request.camera, &self.entry.grid))?;
        Ok(request)
    }
}

/// The preview of snapping: a line from the cursor to a ball, which is labelled with the distance.
fn ghost_marks(Ghost { from, at }: Ghost, radius: Radius) -> [OverlayItem; 2] {
    let label = Some(length_words(from.distance(at)).into());
    [
        OverlayItem::Line(Line { ends: [from, at], width_px: GHOST_WIDTH_PX, rgb: GHOST_RGB }),
        OverlayItem::Landmark(Landmark { at, radius, rgb: GHOST_RGB, label }),
    ]
}

/// The request for a smaller frame. Overlays shrink with it.
pub(super) fn shrunk(mut request: RenderRequest, size_px: [u32; 2]) -> RenderRequest {
    let share = f64::from(size_px[1]) / f64::from(request.size_px[1]);
    request.size_px = size_px;
    request.reduced_px = None;
    if !request.overlays.items.is_empty() {
        let mut overlays = Overlays::clone(&request.overlays);
        for item in &mut overlays.items {
            match item {
                OverlayItem::Landmark(Landmark { radius: Radius::Px(px), .. })
                | OverlayItem::Line(Line { width_px: px, .. }) => *px = (*px * share).max(1.0),
                _ => {}
            }
        }
        request.overlays = Arc::new(overlays);
    }
    request
}

/// Refuses an unknown preset by the key that named it.
fn expect_preset(name: &str) -> Result<(), OutOfRange> {
    if preset(name).is_some() {
        return Ok(());
    }
    let names: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
    Err(OutOfRange::new("settings.preset", format!("{name:?}"), names.join(", ")))
}

fn resolve(
    entry: &VolumeEntry,
    patch: &Map<String, Value>,
    display: &DisplaySettings,
    size_px: Option<[u32; 2]>,
    preset: Option<&str>,
) -> Result<Arc<Scene>, LiveError> {
    let mut patch = patch.clone();
    if let Some(name) = preset {
        patch.insert("transfer".to_owned(), name.into());
    }
    let mut file = SceneFile::from_value(&Value::Object(patch))?;
    // The cursor moves with every frame.
    file = file.with_display(display.with_cursor(None));
    file = size_px.map_or(file.clone(), |size_px| file.with_size(size_px));
    // The camera is the view's own, so this one is not fitted.
    let scene = file.resolve_for(&entry.subject_without_fit(), &Orbit::default())?;
    scene.expect_size_of_layout()?;
    let pixels = scene.request.size_px.into_iter().map(u64::from).product::<u64>();
    if pixels > MAX_PIXELS {
        let [width, height] = scene.request.size_px;
        let allowed = format!("at most {MAX_PIXELS} pixels in a live session");
        return Err(OutOfRange::new("size_px", format!("{width} x {height}"), allowed).into());
    }
    Ok(Arc::new(scene))
}

fn stage_of(entry: &VolumeEntry, base: &Scene) -> Result<Stage, LiveError> {
    let presets = PRESETS.iter().map(|preset| preset.name.to_owned()).collect();
    let home = Home { orbit: Home::ORBIT, preset: entry.suited_preset() };
    let radius_mm = entry.framing.radius_mm(&Home::ORBIT, 1.0);
    let stage = Stage::of_grid(&entry.grid, base.request.size_px, presets, home)?;
    Ok(match base.frame {
        FramingRule::Volume => stage,
        // Not the visible part: the view would move with every preset.
        FramingRule::Visible | FramingRule::Tissue => {
            stage.framed(entry.framing.center(), radius_mm, entry.framing.narrowest_aspect())
        }
    })
}

/// Removes how surfaces reflect light, which a preset brings along; shadows and occlusion stay.
fn drop_reflection(patch: &mut Map<String, Value>) {
    if let Some(Value::Object(shading)) = patch.get_mut("shading") {
        shading.retain(|key, _| matches!(key.as_str(), "shadows" | "occlusion"));
    }
}

/// Applies a JSON merge patch (RFC 7396).
fn merge(target: &mut Map<String, Value>, patch: &Map<String, Value>) {
    for (key, value) in patch {
        match value {
            Value::Null => {
                target.remove(key);
            }
            Value::Object(inner) => {
                let known = target.entry(key).or_insert_with(|| Map::new().into());
                if !known.is_object() {
                    *known = Map::new().into();
                }
                if let Value::Object(known) = known {
                    merge(known, inner);
                }
            }
            other => {
                target.insert(key.clone(), other.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::{LoadedVolume, Volumes};
    use relief_render::Shading;
    use relief_volume::{PhantomKind, PhantomRecipe};

    /// The examples of RFC 7396, appendix A, whose target is an object.
    #[test]
    fn patches_merge_as_the_standard_says() {
        for (target, patch, result) in [
            (json!({"a":"b"}), json!({"a":"c"}), json!({"a":"c"})),
            (json!({"a":"b"}), json!({"b":"c"}), json!({"a":"b","b":"c"})),
            (json!({"a":"b"}), json!({"a":null}), json!({})),
            (json!({"a":"b","b":"c"}), json!({"a":null}), json!({"b":"c"})),
            (json!({"a":["b"]}), json!({"a":"c"}), json!({"a":"c"})),
            (json!({"a":"c"}), json!({"a":["b"]}), json!({"a":["b"]})),
            (json!({"a":{"b":"c"}}), json!({"a":{"b":"d","c":null}}), json!({"a":{"b":"d"}})),
            (json!({"a":[{"b":"c"}]}), json!({"a":[1]}), json!({"a":[1]})),
            (json!({}), json!({"a":{"bb":{"ccc":null}}}), json!({"a":{"bb":{}}})),
        ] {
            let (Value::Object(mut merged), Value::Object(patch)) = (target, patch) else {
                panic!("objects")
            };
            merge(&mut merged, &patch);
            assert_eq!(Value::Object(merged), result);
        }
    }

    #[test]
    fn light_set_after_a_preset_counts_until_the_next_preset() {
        let volume = PhantomRecipe::new(PhantomKind::Head).with_size(16).unwrap().make().volume;
        let loaded =
            LoadedVolume { volume, warnings: Vec::new(), identity: None, reference: None, labels: None };
        let volumes = Volumes::within(u64::MAX);
        volumes.add_own(loaded, None).unwrap();
        let settings = |json: Value| serde_json::from_value::<Settings>(json).unwrap();
        let after = |before: &Presentation, json| before.with(&settings(json), None, None).unwrap();
        let shading = |shown: &Presentation| shown.base.request.shading;

        let skin = settings(json!({ "preset": "skin" }));
        let skin = Presentation::new(volumes.first().unwrap(), &skin, None).unwrap();
        let light = json!({ "shading": { "ambient": 0.9, "diffuse": 0.1 } });
        let lit = after(&skin, json!({ "scene": light }));
        let expected = Shading { ambient: 0.9, diffuse: 0.1, ..shading(&skin) };
        assert!(expected != shading(&skin));
        assert_eq!((shading(&lit), lit.preset.as_deref()), (expected, Some("skin")));
        assert_eq!(shading(&after(&lit, json!({ "preset": "skin" }))), shading(&skin));
        assert_eq!(shading(&lit.with_preset(Some("skin")).unwrap()), shading(&skin));
        assert_eq!(shading(&after(&skin, json!({ "preset": "skin", "scene": light }))), expected);
    }
}
