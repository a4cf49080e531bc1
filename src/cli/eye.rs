//! `relief render --eye-mm`: the picture that an eye sees through the display, as through a window;
//! and the file that describes the display.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::slice::parse_triple;
use crate::views::screen;
use relief_display::DisplaySettings;
use relief_render::{Mode, RenderRequest, RenderedFrame, Scene};
use relief_tracking::DisplayGeometry;
use relief_volume::CameraFile;

/// Largest file of a display's geometry, bytes.
const MAX_GEOMETRY_BYTES: u64 = 64 << 10;

#[derive(Debug, clap::Args)]
pub(crate) struct EyeArguments {
    /// Render for an eye at this place: mm from the middle of the screen, right, up and towards the
    /// viewer. The display is a window; --screen-plane chooses the depth of its plane
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple, allow_hyphen_values = true, conflicts_with = "views")]
    eye_mm: Option<[f64; 3]>,
    /// Size of the display, JSON with width_mm; a 42-inch display where left out
    #[arg(long, value_name = "FILE.json", requires = "eye_mm")]
    display_geometry: Option<PathBuf>,
}

/// The display of a file; a 42-inch display where no file is named.
pub(crate) fn geometry(path: Option<&Path>) -> anyhow::Result<DisplayGeometry> {
    let Some(path) = path else { return Ok(DisplayGeometry::default()) };
    read_geometry(path).with_context(|| format!("cannot use {}", path.display()))
}

fn read_geometry(path: &Path) -> anyhow::Result<DisplayGeometry> {
    if std::fs::metadata(path)?.len() > MAX_GEOMETRY_BYTES {
        bail!("the file is larger than {MAX_GEOMETRY_BYTES} bytes");
    }
    let geometry: DisplayGeometry = serde_json::from_slice(&std::fs::read(path)?)?;
    geometry.validate()?;
    Ok(geometry)
}

/// An eye and the display that it looks through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewingEye {
    eye_mm: [f64; 3],
    width_mm: f64,
}

impl EyeArguments {
    /// The eye, if one is given.
    pub(crate) fn read(&self) -> anyhow::Result<Option<ViewingEye>> {
        let Some(eye_mm) = self.eye_mm else { return Ok(None) };
        let width_mm = geometry(self.display_geometry.as_deref())?.width_mm;
        Ok(Some(ViewingEye { eye_mm, width_mm }))
    }
}

impl ViewingEye {
    /// Refuses scenes without a depth that an eye could look into, before rendering.
    pub(crate) fn check(scene: &Scene) -> anyhow::Result<()> {
        if matches!(scene.request.mode, Mode::Slice(_)) {
            bail!("a slice is flat and looks the same from everywhere: leave --eye-mm out");
        }
        Ok(())
    }

    /// The scene for the eye; `frame` is the picture of its own camera. Depth limits stay on the
    /// same planes of the patient.
    pub(crate) fn scene(&self, scene: &Scene, frame: &RenderedFrame) -> anyhow::Result<Scene> {
        let (limits, size_px) = (frame.limits_for(&scene.display)?, frame.size_px);
        let screen_mm = screen(scene, &frame.camera, limits)?.converging_mm;
        let camera = frame
            .camera
            .seen_through_screen(size_px, screen_mm, self.width_mm, self.eye_mm)
            .context("the eye sees nothing through the screen")?;
        let farther_mm = camera.distance_mm() - screen_mm;
        let [near_mm, far_mm] = [limits.near_mm, limits.far_mm].map(|mm| Some(mm + farther_mm));
        let display = DisplaySettings { near_mm, far_mm, screen_plane: None, ..scene.display.clone() };
        let request = RenderRequest { camera, ..scene.request.clone() };
        Ok(Scene { request, ..scene.clone() }.with_display(display))
    }

    /// The eye and its camera, for the report.
    pub(crate) fn report(&self, scene: &Scene) -> serde_json::Value {
        let camera = &scene.request.camera;
        serde_json::json!({
            "eye_mm": self.eye_mm,
            "width_mm": self.width_mm,
            "screen_mm": camera.distance_mm(),
            "camera": CameraFile::from(camera),
        })
    }
}
