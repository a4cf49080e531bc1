//! How an item was placed: the method, the device in the hand, and the camera.

use relief_base::OutOfRange;
use serde::{Deserialize, Serialize};

use super::check::{finite, line};

/// How an item came to its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// The method.
    pub method: Method,
    /// The device that placed it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<Device>,
    /// The camera of the picture in which it was placed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraRecord>,
    /// The distance by which snapping moved it, mm along patient axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub snapped_mm: Option<[f64; 3]>,
}

/// The ways to a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// A pixel of a picture, at its depth.
    Pick,
    /// The tip of a tracked device in free space.
    Tip,
    /// A pixel of a slice.
    Slice,
    /// Computed from other items or from voxels.
    Computed,
    /// A file.
    Import,
    /// Numbers.
    Typed,
}

/// A device at the moment of placing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// Kind of the device: `wiimote`, `mouse`, `touch`, ...
    pub kind: String,
    /// The position of a tracked device: `beacon_from_sensor`, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    /// Its orientation: a unit quaternion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_xyzw: Option<[f64; 4]>,
}

/// The camera of a picture, as a scene has it. Patient LPS mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRecord {
    /// The place of the eye.
    pub eye_mm: [f64; 3],
    /// Focal point of the camera.
    pub look_at_mm: [f64; 3],
    /// Up direction of the camera.
    pub up: [f64; 3],
    /// Full vertical field of view of a perspective camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical_fov_deg: Option<f64>,
    /// Height of a parallel camera's picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<f64>,
}

impl Placement {
    pub(super) fn validate(&self) -> Result<(), OutOfRange> {
        if let Some(device) = &self.device {
            line("placement.device.kind", &device.kind, 1)?;
            finite("placement.device.position_mm", device.position_mm.iter().flatten())?;
            finite("placement.device.orientation_xyzw", device.orientation_xyzw.iter().flatten())?;
        }
        if let Some(camera) = &self.camera {
            finite("placement.camera.eye_mm", &camera.eye_mm)?;
            finite("placement.camera.look_at_mm", &camera.look_at_mm)?;
            finite("placement.camera.up", &camera.up)?;
            finite("placement.camera.vertical_fov_deg", &camera.vertical_fov_deg)?;
            finite("placement.camera.height_mm", &camera.height_mm)?;
        }
        finite("placement.snapped_mm", self.snapped_mm.iter().flatten())
    }
}
