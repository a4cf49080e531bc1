//! A camera in JSON, as requests, live poses and answers write it.

use serde::{Deserialize, Serialize};

use super::{Camera, CameraError, Orbit, Projection};
use relief_base::{Point, Vector};

/// A camera as written: patient mm, and degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    /// The place of the eye.
    pub eye_mm: [f64; 3],
    /// The point in the middle of the picture.
    pub look_at_mm: [f64; 3],
    /// The direction that is up in the picture; towards the head by default.
    #[serde(default = "head_up")]
    pub up: [f64; 3],
    /// How view space becomes a picture; perspective with a vertical field of view of 22 degrees by
    /// default.
    #[serde(default)]
    pub projection: ProjectionFile,
    /// The place of the focal point in the picture; see [`Camera::with_lens_shift`].
    #[serde(default, skip_serializing_if = "is_centred")]
    pub lens_shift: [f64; 2],
}

/// A projection as written.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum ProjectionFile {
    /// Rays from the eye.
    Perspective {
        /// Full vertical field of view, degrees.
        vertical_fov_deg: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// Height of the picture, mm.
        height_mm: f64,
    },
}

impl Default for ProjectionFile {
    fn default() -> Self {
        Self::Perspective { vertical_fov_deg: Orbit::default().vertical_fov_deg }
    }
}

/// Upwards in a picture where nothing else is written.
#[must_use]
pub fn head_up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn is_centred(lens_shift: &[f64; 2]) -> bool {
    *lens_shift == [0.0; 2]
}

impl From<&Camera> for CameraFile {
    fn from(camera: &Camera) -> Self {
        let projection = match camera.projection() {
            Projection::Perspective { vertical_fov } => {
                ProjectionFile::Perspective { vertical_fov_deg: vertical_fov.to_degrees() }
            }
            Projection::Orthographic { height_mm } => ProjectionFile::Orthographic { height_mm },
        };
        Self {
            eye_mm: camera.eye().xyz.to_array(),
            look_at_mm: camera.look_at().xyz.to_array(),
            up: camera.up().xyz.to_array(),
            projection,
            lens_shift: camera.lens_shift(),
        }
    }
}

impl CameraFile {
    /// The camera that is written.
    ///
    /// # Errors
    /// See [`Camera::new`] and [`Camera::with_lens_shift`].
    pub fn resolve(&self) -> Result<Camera, CameraError> {
        let projection = match self.projection {
            ProjectionFile::Perspective { vertical_fov_deg } => {
                Projection::Perspective { vertical_fov: vertical_fov_deg.to_radians() }
            }
            ProjectionFile::Orthographic { height_mm } => Projection::Orthographic { height_mm },
        };
        let (eye, look_at) = (self.eye_mm.into(), self.look_at_mm.into());
        let up = Vector::from_xyz(self.up.into());
        let camera = Camera::new(Point::from_xyz(eye), Point::from_xyz(look_at), up, projection)?;
        camera.with_lens_shift(self.lens_shift)
    }
}
