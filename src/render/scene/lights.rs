//! Placed lights and the path tracer's settings as written in JSON, and their resolved forms.

use serde::de::value::SeqAccessDeserializer;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::whole::Whole;
use crate::light::{Light, Placement};
use crate::lighting::Lighting;
use crate::mode::Mode;
use crate::pathtrace::PathTrace;
use relief_base::{OutOfRange, Point, Vector};

/// A set's name, or each light.
#[derive(Clone, Debug)]
pub(super) enum LightsFile {
    Named(String),
    Placed(Vec<LightFile>),
}

impl LightsFile {
    pub(super) fn named(name: &str) -> Self {
        Self::Named(name.to_owned())
    }
}

/// By hand, since serde's untagged enums forget where in the lights a mistake is.
impl<'de> Deserialize<'de> for LightsFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrLights;
        impl<'de> Visitor<'de> for NameOrLights {
            type Value = LightsFile;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "an array of lights or one of {}", Lighting::names())
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<LightsFile, E> {
                Ok(LightsFile::named(name))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<LightsFile, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(items)).map(LightsFile::Placed)
            }
        }
        deserializer.deserialize_any(NameOrLights)
    }
}

/// One light: `{"direction": [..]}` or `{"position_mm": [..]}`, the rest may be left out.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightFile {
    direction: Option<[f64; 3]>,
    position_mm: Option<[f64; 3]>,
    #[serde(default)]
    space: SpaceFile,
    rgb: Option<[f64; 3]>,
    intensity: Option<f64>,
    size_deg: Option<f64>,
}

/// Whether a light goes with the camera or stays with the patient.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum SpaceFile {
    #[default]
    View,
    Patient,
}

/// Settings of mode `path-traced`, each optional.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PathTraceFile {
    passes: Option<Whole>,
    seed: Option<Whole>,
    density: Option<f64>,
    environment: Option<f64>,
    exposure: Option<f64>,
    anisotropy: Option<f64>,
    surface: Option<f64>,
    surface_hu_per_mm: Option<f64>,
    scatterings: Option<Whole>,
    denoise: Option<bool>,
}

/// The lights of a request; where none are written, those that are usual for its mode.
pub(super) fn resolve_lights(file: Option<LightsFile>, mode: Mode) -> Result<Vec<Light>, OutOfRange> {
    match file {
        Some(LightsFile::Named(name)) => {
            let shown: String = name.chars().take(40).collect();
            let unknown = || OutOfRange::new("lights", shown, Lighting::names());
            Ok(Lighting::named(&name).ok_or_else(unknown)?.lights(mode))
        }
        Some(LightsFile::Placed(lights)) => {
            (0..).zip(lights).map(|(index, light)| light.resolve(index)).collect()
        }
        None if mode == Mode::PathTraced => Ok(PathTrace::default_lights()),
        None => Ok(Vec::new()),
    }
}

impl LightFile {
    fn resolve(self, index: usize) -> Result<Light, OutOfRange> {
        let placement = match (self.direction, self.position_mm, self.space) {
            (Some(d), None, SpaceFile::View) => Placement::ViewDirection(Vector::from_xyz(d.into())),
            (Some(d), None, SpaceFile::Patient) => Placement::PatientDirection(Vector::from_xyz(d.into())),
            (None, Some(p), SpaceFile::View) => Placement::ViewPosition(Point::from_xyz(p.into())),
            (None, Some(p), SpaceFile::Patient) => Placement::PatientPosition(Point::from_xyz(p.into())),
            _ => {
                let allowed = "either a direction (towards the light) or a position_mm";
                return Err(OutOfRange::new(format!("lights[{index}]"), "neither or both", allowed));
            }
        };
        Ok(Light {
            placement,
            rgb: self.rgb.unwrap_or([1.0; 3]),
            intensity: self.intensity.unwrap_or(1.0),
            size: self.size_deg.unwrap_or(0.0).to_radians(),
        })
    }
}

impl PathTraceFile {
    pub(super) fn with_passes(self, passes: u32) -> Self {
        Self { passes: Some(Whole(passes)), ..self }
    }

    pub(super) fn with_light(self, scatterings: Option<u32>, denoise: Option<bool>) -> Self {
        let scatterings = scatterings.map(Whole).or(self.scatterings);
        Self { scatterings, denoise: denoise.or(self.denoise), ..self }
    }

    /// `unit_mm` is the unit of the volume: see [`relief_volume::Grid::unit_mm`].
    pub(super) fn resolve(self, unit_mm: f64) -> PathTrace {
        let usual = PathTrace::default();
        PathTrace {
            passes: self.passes.map_or(usual.passes, |passes| passes.0),
            seed: self.seed.map_or(usual.seed, |seed| seed.0),
            density: self.density.unwrap_or(usual.density),
            environment: self.environment.unwrap_or(usual.environment),
            exposure: self.exposure.unwrap_or(usual.exposure),
            anisotropy: self.anisotropy.unwrap_or(usual.anisotropy),
            surface: self.surface.unwrap_or(usual.surface),
            surface_hu_per_mm: self.surface_hu_per_mm.unwrap_or(usual.surface_hu_per_mm / unit_mm),
            scatterings: self.scatterings.map_or(usual.scatterings, |count| count.0),
            denoise: self.denoise.unwrap_or(usual.denoise),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::SceneFile;
    use relief_volume::{Grid, Orbit};

    #[test]
    fn lights_and_paths_that_are_wrong_are_named_with_path_value_and_range() {
        let grid = Grid::axis_aligned([10, 10, 10], [1.0; 3], [0.0; 3]).unwrap();
        for (json, parts) in [
            (r#"{"path_trace":{"passes":0}}"#, &["path_trace.passes is 0", "1 to 16384"][..]),
            (r#"{"path_trace":{"pases":1}}"#, &["path_trace.pases", "unknown field"]),
            (r#"{"path_trace":{"seed":65536}}"#, &["path_trace.seed is 65536", "0 to 65535"]),
            (r#"{"path_trace":{"scatterings":0}}"#, &["path_trace.scatterings is 0", "1 to 64"]),
            (r#"{"path_trace":{"denoise":1}}"#, &["path_trace.denoise", "integer `1`", "a boolean"]),
            (
                r#"{"mode":"path-traced","size_px":[4096,4096],"path_trace":{"passes":5,"scatterings":8}}"#,
                &["path_trace.passes is 5", "at most 4 for a picture of this size with 8 scatterings"],
            ),
            (r#"{"path_trace":[1]}"#, &["path_trace: found an array"]),
            (
                r#"{"mode":"path-traced","size_px":[4096,4096],"path_trace":{"passes":33}}"#,
                &["path_trace.passes is 33", "at most 32 for a picture of this size"],
            ),
            (
                r#"{"mode":"path-traced","lights":[{"direction":[0,0,0]}]}"#,
                &["lights[0].direction is [0.0, 0.0, 0.0]", "above zero"],
            ),
            (
                r#"{"mode":"path-traced","lights":[{"direction":[0,0,1]},{}]}"#,
                &["lights[1] is neither or both", "position_mm"],
            ),
            (
                r#"{"mode":"path-traced","lights":[{"position_mm":[0,0,1],"intensity":101}]}"#,
                &["lights[0].intensity is 101", "0 to 100"],
            ),
            (
                r#"{"mode":"mip","lights":[{"direction":[0,0,1]}]}"#,
                &["lights is 1 lights", "none in this mode", "isosurface"],
            ),
            (r#"{"lights":"disco"}"#, &["lights is disco", "headlight, studio"]),
            (r#"{"lights":7}"#, &["lights", "integer `7`", "an array of lights or one of headlight"]),
            (r#"{"lights":[{"direction":[0,0,1],"color":1}]}"#, &["lights[0].color", "unknown field"]),
        ] {
            let parsed = SceneFile::parse(json.as_bytes());
            let refused = parsed.and_then(|scene| scene.resolve(&grid, &Orbit::default()));
            let message = refused.expect_err("a refusal").to_string();
            for part in parts {
                assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
            }
        }
    }
}
