//! A camera in the words of a request, as the header `Relief-Camera` and picks carry it.

use serde_json::{Value, json};

use relief_base::DepthLimits;
use relief_volume::{Camera, Projection};

/// The camera in a request's own words, with the size and the depth limits: the header
/// `Relief-Camera`.
pub(super) fn camera_json(camera: &Camera, size_px: [u32; 2], limits: DepthLimits) -> Value {
    let projection = match camera.projection() {
        Projection::Perspective { vertical_fov } => {
            json!({ "perspective": { "vertical_fov_deg": vertical_fov.to_degrees() } })
        }
        Projection::Orthographic { height_mm } => json!({ "orthographic": { "height_mm": height_mm } }),
    };
    let mut written = json!({
        "camera": {
            "eye_mm": camera.eye().xyz.to_array(),
            "look_at_mm": camera.look_at().xyz.to_array(),
            "up": camera.up().xyz.to_array(),
            "projection": projection,
        },
        "size_px": size_px,
        "edges": camera.edge_labels(),
        "near_mm": limits.near_mm,
        "far_mm": limits.far_mm,
    });
    if camera.lens_shift() != [0.0; 2] {
        written["camera"]["lens_shift"] = json!(camera.lens_shift());
    }
    written
}
