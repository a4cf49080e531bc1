//! Errors of a scene: each has the key's path in the JSON, the value and the permitted values.

use crate::request_error::RequestError;
use relief_display::SettingsError;
use relief_volume::{CameraError, GradientOpacity, OrbitError, TransferError, TransferFunction};

/// Why a scene was refused.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Not JSON, an unknown key, or a value of the wrong kind.
    #[error("{path}: {source}")]
    Syntax {
        /// Key path; `.` for the whole.
        path: String,
        /// Why the JSON does not describe a scene.
        source: SyntaxError,
    },
    /// A value out of range.
    #[error(transparent)]
    Range(#[from] RequestError),
}

/// Why the JSON of a scene is invalid.
#[derive(Debug, thiserror::Error)]
pub enum SyntaxError {
    /// The parser's error, with line and column.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// serde reads an array as an object whose keys have an order; a scene has none.
    #[error("found an array, expected an object")]
    Array,
}

impl From<SettingsError> for SceneError {
    fn from(SettingsError { path, value, allowed }: SettingsError) -> Self {
        RequestError { path: path.to_owned(), found: value, allowed }.into()
    }
}

impl From<OrbitError> for SceneError {
    fn from(OrbitError { what, found, allowed }: OrbitError) -> Self {
        RequestError { path: what.to_owned(), found: found.to_string(), allowed }.into()
    }
}

impl From<CameraError> for RequestError {
    fn from(error: CameraError) -> Self {
        let coordinates = "-1000000 to 1000000 mm";
        match &error {
            CameraError::Coordinate { what: "up", found } => Self::new("camera.up", found, coordinates),
            CameraError::Coordinate { what, found } => {
                Self::new(&format!("camera.{what}_mm"), found, coordinates)
            }
            CameraError::NoDirection(mm) => {
                Self::new("camera.look_at_mm", &format!("{mm} mm from eye_mm"), "at least 0.001 mm")
            }
            CameraError::NoUp(up) => {
                Self::new("camera.up", &format!("{up:?}"), "any direction across the viewing direction")
            }
            CameraError::FieldOfView(degrees) => {
                Self::new("camera.projection.perspective.vertical_fov_deg", degrees, "0.1 to 170")
            }
            CameraError::Parallel => {
                Self::new("camera.projection", &"orthographic", "a perspective, which has an eye")
            }
            CameraError::Height(mm) => {
                Self::new("camera.projection.orthographic.height_mm", mm, "0.001 to 1000000")
            }
            CameraError::LensShift(shift) => {
                let allowed = "-10 to 10 each way in a perspective, 0 in a parallel projection";
                Self::new("camera.lens_shift", &format!("{shift:?}"), allowed)
            }
        }
    }
}

impl From<TransferError> for RequestError {
    fn from(error: TransferError) -> Self {
        match &error {
            TransferError::Count(count) => {
                let allowed = format!("1 to {} points", TransferFunction::MAX_POINTS);
                Self::new("transfer.points", &format!("{count} points"), &allowed)
            }
            TransferError::Order { index, found, previous } => {
                let allowed = format!("more than {previous}, that of the point before");
                Self::new(&format!("transfer.points[{index}].hu"), found, &allowed)
            }
            TransferError::Value { index, what: "HU", found, allowed } => {
                Self::new(&format!("transfer.points[{index}].hu"), found, allowed)
            }
            TransferError::Value { index, found, allowed, .. } => {
                Self::new(&format!("transfer.points[{index}].rgba"), found, allowed)
            }
            TransferError::GradientCount(count) => {
                let allowed = format!("1 to {} points", GradientOpacity::MAX_POINTS);
                Self::new("transfer.gradient_opacity.points", &format!("{count} points"), &allowed)
            }
            TransferError::Gradient { index, what, found, allowed } => {
                Self::new(&format!("transfer.gradient_opacity.points[{index}].{what}"), found, allowed)
            }
            TransferError::Unit(mm) => Self::new("transfer.opacity_unit_mm", mm, "0.001 to 1000"),
            TransferError::Window { what, found, allowed } => {
                Self::new(&format!("transfer.window.{what}"), found, allowed)
            }
        }
    }
}
