//! Errors of a scene: each has the key's path in the JSON, the value and the permitted values.

use relief_base::OutOfRange;
use relief_volume::{CameraError, GradientOpacity, TransferError, TransferFunction};

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
    Range(#[from] OutOfRange),
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

impl From<CameraError> for SceneError {
    fn from(error: CameraError) -> Self {
        camera_out_of_range(&error).into()
    }
}

/// The invalid key of a camera.
pub(crate) fn camera_out_of_range(error: &CameraError) -> OutOfRange {
    let coordinates = "-1000000 to 1000000 mm";
    match error {
        CameraError::Coordinate { what: "up", found } => OutOfRange::new("camera.up", found, coordinates),
        CameraError::Coordinate { what, found } => {
            OutOfRange::new(format!("camera.{what}_mm"), found, coordinates)
        }
        CameraError::NoDirection(mm) => {
            OutOfRange::new("camera.look_at_mm", format!("{mm} mm from eye_mm"), "at least 0.001 mm")
        }
        CameraError::NoUp(up) => {
            OutOfRange::new("camera.up", format!("{up:?}"), "any direction across the viewing direction")
        }
        CameraError::FieldOfView(degrees) => {
            OutOfRange::new("camera.projection.perspective.vertical_fov_deg", degrees, "0.1 to 170")
        }
        CameraError::Parallel => {
            OutOfRange::new("camera.projection", "orthographic", "a perspective, which has an eye")
        }
        CameraError::Height(mm) => {
            OutOfRange::new("camera.projection.orthographic.height_mm", mm, "0.001 to 1000000")
        }
        CameraError::LensShift(shift) => {
            let allowed = "-10 to 10 each way in a perspective, 0 in a parallel projection";
            OutOfRange::new("camera.lens_shift", format!("{shift:?}"), allowed)
        }
    }
}

/// The invalid key of a transfer function.
pub(super) fn transfer_out_of_range(error: TransferError) -> OutOfRange {
    match error {
        TransferError::Count(count) => {
            let allowed = format!("1 to {} points", TransferFunction::MAX_POINTS);
            OutOfRange::new("transfer.points", format!("{count} points"), allowed)
        }
        TransferError::Order { index, found, previous } => {
            let allowed = format!("more than {previous}, that of the point before");
            OutOfRange::new(format!("transfer.points[{index}].hu"), found, allowed)
        }
        TransferError::Value { index, what: "HU", found, allowed } => {
            OutOfRange::new(format!("transfer.points[{index}].hu"), found, allowed)
        }
        TransferError::Value { index, found, allowed, .. } => {
            OutOfRange::new(format!("transfer.points[{index}].rgba"), found, allowed)
        }
        TransferError::GradientCount(count) => {
            let allowed = format!("1 to {} points", GradientOpacity::MAX_POINTS);
            OutOfRange::new("transfer.gradient_opacity.points", format!("{count} points"), allowed)
        }
        TransferError::Gradient { index, what, found, allowed } => {
            OutOfRange::new(format!("transfer.gradient_opacity.points[{index}].{what}"), found, allowed)
        }
        TransferError::Unit(mm) => OutOfRange::new("transfer.opacity_unit_mm", mm, "0.000001 to 1000000"),
        TransferError::Window { what, found, allowed } => {
            OutOfRange::new(format!("transfer.window.{what}"), found, allowed)
        }
    }
}
