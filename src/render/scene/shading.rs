//! Reflection of samples, shadows and occlusion by surroundings, as written in JSON.

use serde::Deserialize;

use super::SceneFile;
use super::lights::LightsFile;
use crate::illumination::{Illumination, Occlusion};
use crate::request::Shading;

/// `shading`, each key optional: those of reflection are the preset's where they are left out.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ShadingFile {
    ambient: Option<f64>,
    diffuse: Option<f64>,
    specular: Option<f64>,
    shininess: Option<f64>,
    shadows: Option<f64>,
    occlusion: Option<OcclusionFile>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct OcclusionFile {
    strength: Option<f64>,
    radius_mm: Option<f64>,
}

impl SceneFile {
    /// Replaces the lights by those of this name, one of [`Lighting::ALL`](crate::Lighting::ALL).
    #[must_use]
    pub fn with_lighting(self, name: &str) -> Self {
        Self { lights: Some(LightsFile::named(name)), ..self }
    }

    /// Replaces how much of shadows and of occlusion shows, and how far that reaches (mm), where
    /// there is something.
    #[must_use]
    pub fn with_illumination(
        self,
        shadows: Option<f64>,
        occlusion: Option<f64>,
        radius_mm: Option<f64>,
    ) -> Self {
        let shading = self.shading.unwrap_or_default().with_illumination(shadows, occlusion, radius_mm);
        Self { shading: Some(shading), ..self }
    }
}

impl ShadingFile {
    /// `usual` has the values of omitted keys.
    pub(super) fn resolve(self, usual: Shading) -> Shading {
        Shading {
            ambient: self.ambient.unwrap_or(usual.ambient),
            diffuse: self.diffuse.unwrap_or(usual.diffuse),
            specular: self.specular.unwrap_or(usual.specular),
            shininess: self.shininess.unwrap_or(usual.shininess),
        }
    }

    pub(super) fn illumination(&self) -> Illumination {
        let usual = Occlusion::default();
        // Occlusion settings without a strength have a visible one.
        let occlusion = self.occlusion.as_ref().map_or(usual, |occlusion| Occlusion {
            strength: occlusion.strength.unwrap_or(1.0),
            radius_mm: occlusion.radius_mm.unwrap_or(usual.radius_mm),
        });
        Illumination { shadows: self.shadows.unwrap_or(0.0), occlusion }
    }

    /// The part that stays when a preset brings its own reflection: shadows and occlusion.
    pub(super) fn without_reflection(self) -> Option<Self> {
        let Self { shadows, occlusion, .. } = self;
        let is_something = shadows.is_some() || occlusion.is_some();
        is_something.then(|| Self { shadows, occlusion, ..Self::default() })
    }

    pub(super) fn with_illumination(
        self,
        shadows: Option<f64>,
        strength: Option<f64>,
        radius_mm: Option<f64>,
    ) -> Self {
        let written = self.occlusion.unwrap_or_default();
        let occlusion = OcclusionFile {
            strength: strength.or(written.strength),
            radius_mm: radius_mm.or(written.radius_mm),
        };
        let is_something = occlusion.strength.is_some() || occlusion.radius_mm.is_some();
        Self { shadows: shadows.or(self.shadows), occlusion: is_something.then_some(occlusion), ..self }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Illumination, Occlusion, RenderRequest, SceneFile, Shading};
    use relief_volume::{Grid, Orbit};

    fn resolved(json: &str) -> Result<RenderRequest, String> {
        let grid = Grid::axis_aligned([10; 3], [1.0; 3], [0.0; 3]).unwrap();
        let scene =
            SceneFile::parse(json.as_bytes()).and_then(|scene| scene.resolve(&grid, &Orbit::default()));
        scene.map(|scene| scene.request).map_err(|error| error.to_string())
    }

    #[test]
    fn keys_that_are_left_out_are_those_of_the_preset() {
        let preset = resolved(r#"{"transfer":"skin"}"#).unwrap().shading;
        let json = r#"{"transfer":"skin","shading":{"specular":0.9,"occlusion":{"radius_mm":7}}}"#;
        let request = resolved(json).unwrap();
        assert_eq!(request.shading, Shading { specular: 0.9, ..preset });
        let occlusion = Occlusion { strength: 1.0, radius_mm: 7.0 };
        assert_eq!(request.illumination, Illumination { shadows: 0.0, occlusion });
        let plain = resolved(r#"{"shading":{"ambient":0.3,"diffuse":0.5}}"#).unwrap();
        assert_eq!(plain.illumination, Illumination::default());
    }

    #[test]
    fn a_preset_brings_its_reflection_and_leaves_shadows() {
        let grid = Grid::axis_aligned([10; 3], [1.0; 3], [0.0; 3]).unwrap();
        let json = br#"{"lights":"studio","shading":{"ambient":0.9,"diffuse":0.1,"shadows":0.7}}"#;
        let scene = SceneFile::parse(json).unwrap().with_preset("skin");
        let request = scene.with_illumination(None, Some(0.25), None);
        let request = request.resolve(&grid, &Orbit::default()).unwrap().request;
        assert_eq!(request.shading, resolved(r#"{"transfer":"skin"}"#).unwrap().shading);
        assert_eq!(request.illumination.shadows, 0.7);
        assert_eq!(request.illumination.occlusion, Occlusion { strength: 0.25, ..Occlusion::default() });
    }

    #[test]
    fn shadows_and_occlusion_that_are_wrong_are_named_with_path_value_and_range() {
        for (json, parts) in [
            (r#"{"shading":{"shadows":1}}"#, &["shading.shadows is 1", "0 without lights"][..]),
            (r#"{"lights":"studio","shading":{"shadows":1.5}}"#, &["shading.shadows is 1.5", "0 to 1"]),
            (r#"{"lights":"headlight","shading":{"shadows":0.5}}"#, &["shading.shadows", "without lights"]),
            (r#"{"shading":{"occlusion":{"strength":-1}}}"#, &["shading.occlusion.strength is -1", "0 to 1"]),
            (
                r#"{"shading":{"occlusion":{"radius_mm":0.1}}}"#,
                &["shading.occlusion.radius_mm is 0.1", "0.5 to 500"],
            ),
            (r#"{"shading":{"occlusion":{"radius":1}}}"#, &["shading.occlusion.radius", "unknown field"]),
            (r#"{"shading":{"occlusion":[1,2]}}"#, &["shading.occlusion: found an array"]),
        ] {
            let message = resolved(json).expect_err("a refusal");
            for part in parts {
                assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
            }
        }
    }
}
