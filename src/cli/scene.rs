//! What is to be rendered, from a scene file and options: shared by render and bench.

use std::path::PathBuf;

use anyhow::{Context, bail};

use crate::camera::Orbit;
use crate::display::Layout;
use crate::render::SceneFile;
use crate::transfer::PRESETS;

/// A scene file, and options that go before what it says.
#[derive(Debug, clap::Args)]
pub(super) struct SceneArguments {
    /// Scene as JSON: camera, transfer function, size, display; every part may be left out
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Preset of colours and light: bone, skin, lung, vessels, soft-tissue
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    preset: Option<String>,
    /// Layout of the frame: wowvx, wowvx-full-height, wowvx-4k, rgbd, color, depth16
    #[arg(long, value_name = "NAME")]
    layout: Option<Layout>,
    /// Size of the picture (in 2D-plus-depth layouts, of each half); the layout decides when left out
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Where from, about the long axis: 0 the front, 90 the patient's left, 180 the back
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    azimuth_deg: f64,
    /// How far from above: 90 is from the head, -90 from the feet
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    elevation_deg: f64,
    /// 1 fits the whole volume; larger is closer
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    zoom: f64,
    /// Full vertical field of view at zoom 1; 0 is a parallel projection
    #[arg(long, value_name = "DEG", default_value_t = 22.0)]
    fov_deg: f64,
}

fn parse_preset(name: &str) -> Result<String, String> {
    if PRESETS.iter().any(|preset| preset.name == name) {
        return Ok(name.to_owned());
    }
    let lines: Vec<String> = PRESETS.iter().map(|p| format!("  {:<12} {}", p.name, p.purpose)).collect();
    Err(format!("no preset has this name; there are\n{}", lines.join("\n")))
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parsed.ok_or_else(|| "a size is WIDTHxHEIGHT in pixels, such as 960x540".to_owned())
}

impl SceneArguments {
    /// The scene file, or an empty scene, with the options applied and the size that its layout needs.
    pub(super) fn read(&self) -> anyhow::Result<SceneFile> {
        let mut scene = match &self.scene {
            Some(path) => {
                let json = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
                SceneFile::parse(&json).with_context(|| format!("{} is not a scene", path.display()))?
            }
            None => SceneFile::default(),
        };
        if scene.has_camera() && self.orbit() != Orbit::default() {
            bail!(
                "the scene file has a camera; leave --azimuth-deg, --elevation-deg, --zoom and --fov-deg out"
            );
        }
        if let Some(name) = &self.preset {
            scene = scene.with_preset(name);
        }
        if let Some(layout) = self.layout {
            let display = scene.display().clone();
            scene = scene.with_display(crate::display::DisplaySettings { layout, ..display });
        }
        let needed = scene.display().encoder()?.render_size_px();
        match (self.size, needed) {
            (Some(size), Some(needed)) if size != needed => bail!(
                "--size is {}x{}, layout {} of this display needs {}x{}",
                size[0],
                size[1],
                scene.display().layout,
                needed[0],
                needed[1]
            ),
            (Some(size), _) | (None, Some(size)) => Ok(scene.with_size(size)),
            (None, None) => Ok(scene),
        }
    }

    /// The view that applies when the scene file has no camera.
    pub(super) fn orbit(&self) -> Orbit {
        Orbit {
            azimuth_deg: self.azimuth_deg,
            elevation_deg: self.elevation_deg,
            zoom: self.zoom,
            vertical_fov_deg: self.fov_deg,
        }
    }
}
