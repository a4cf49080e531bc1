//! Parts of a request in their JSON form, for a scene file or an HTTP body.
//!
//! `parts` is the reader; it reads the output of this module as an equal value.

use serde_json::{Value, json};

use super::parts::default_shading;
use crate::request::Shading;
use relief_volume::{Preset, TransferFunction};

/// The value of `transfer`.
#[must_use]
pub fn transfer_json(transfer: &TransferFunction) -> Value {
    let points: Vec<Value> =
        transfer.points().iter().map(|point| json!({ "hu": point.hu, "rgba": point.rgba })).collect();
    let mut written = json!({ "points": points, "opacity_unit_mm": transfer.opacity_unit_mm() });
    if let Some(opacity) = transfer.gradient_opacity() {
        let point = |&[hu_per_mm, opacity]: &[f64; 2]| json!({ "hu_per_mm": hu_per_mm, "opacity": opacity });
        written["gradient_opacity"] =
            json!({ "points": opacity.points().iter().map(point).collect::<Vec<_>>() });
    }
    written
}

/// The value of `shading`.
#[must_use]
pub fn shading_json(shading: &Shading) -> Value {
    let Shading { ambient, diffuse, specular, shininess } = shading;
    json!({ "ambient": ambient, "diffuse": diffuse, "specular": specular, "shininess": shininess })
}

/// A preset with all its settings: `mode`, `transfer` and `shading` are those of a request
/// that says the same.
#[must_use]
pub fn preset_json(preset: &Preset) -> Value {
    json!({
        "name": preset.name,
        "purpose": preset.purpose,
        "group": preset.group.name(),
        "mode": preset.mode.name(),
        "transfer": transfer_json(&preset.transfer()),
        "shading": shading_json(&default_shading(Some(preset))),
    })
}

#[cfg(test)]
mod tests {
    use super::super::SceneFile;
    use super::*;
    use relief_volume::{Grid, Orbit, PRESETS};

    #[test]
    fn a_preset_written_out_renders_as_its_name_does() {
        let grid = Grid::axis_aligned([10; 3], [1.0; 3], [0.0; 3]).unwrap();
        let resolved = |json: Value| {
            let file = SceneFile::parse(json.to_string().as_bytes()).unwrap();
            file.resolve(&grid, &Orbit::default()).unwrap().request
        };
        for preset in PRESETS {
            let mut written = preset_json(preset);
            for key in ["name", "purpose", "group"] {
                assert!(written.as_object_mut().unwrap().remove(key).is_some_and(|text| text.is_string()));
            }
            assert_eq!(resolved(written), resolved(json!({ "transfer": preset.name })), "{}", preset.name);
        }
    }
}
