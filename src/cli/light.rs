//! Options of light: placed lights by name, shadows and occlusion.

use relief_render::{Lighting, SceneFile};

/// Options of light; they override the scene file.
#[derive(Debug, clap::Args)]
pub(super) struct LightArguments {
    /// Lights of modes composite, isosurface and path-traced: headlight, studio, side, above
    #[arg(long, value_name = "NAME", value_parser = parse_lights)]
    lights: Option<String>,
    /// Strength of the shadows of placed lights, 0 to 1; needs --lights, or lights in the
    /// scene file
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    shadows: Option<f64>,
    /// Strength of ambient occlusion, 0 to 1: enclosed places receive less light
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    occlusion: Option<f64>,
    /// Distance up to which surroundings take light away, with --occlusion
    #[arg(long, value_name = "MM", requires = "occlusion", allow_negative_numbers = true)]
    occlusion_radius_mm: Option<f64>,
}

fn parse_lights(name: &str) -> Result<String, String> {
    if Lighting::named(name).is_some() {
        return Ok(name.to_owned());
    }
    let lines = Lighting::ALL.map(|lighting| format!("  {:<10} {}", lighting.name, lighting.purpose));
    Err(format!("lights are\n{}", lines.join("\n")))
}

impl LightArguments {
    pub(super) fn apply(&self, mut scene: SceneFile) -> SceneFile {
        if let Some(name) = &self.lights {
            scene = scene.with_lighting(name);
        }
        let Self { shadows, occlusion, occlusion_radius_mm, .. } = *self;
        if shadows.is_some() || occlusion.is_some() {
            scene = scene.with_illumination(shadows, occlusion, occlusion_radius_mm);
        }
        scene
    }
}
