//! The eyes of a viewer in front of a display.
//!
//! Space: the screen. The origin is its centre, x to the right and y up for the viewer, z towards
//! the viewer, mm.

use serde::{Deserialize, Serialize};

use super::error::{MessageError, MessageFault};

/// Farthest coordinate of an eye, mm.
const FARTHEST_MM: f64 = 20_000.0;
/// Smallest distance of an eye from the screen, mm.
const NEAREST_MM: f64 = 50.0;

/// The eyes of the viewer of a display. A server passes them on to every client of the view; they
/// move no camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Eyes {
    /// When they were measured, ns of the sender's clock.
    #[serde(default)]
    pub t_ns: u64,
    /// The left eye: x, y, z in the space of the screen, mm.
    pub left_mm: [f64; 3],
    /// The right eye.
    pub right_mm: [f64; 3],
}

impl Eyes {
    /// Refuses eyes behind the screen or too far from it.
    ///
    /// # Errors
    /// The key, and the allowed values.
    pub fn validate(&self) -> Result<(), MessageError> {
        for (path, eye) in [("left_mm", self.left_mm), ("right_mm", self.right_mm)] {
            let is_near = eye.iter().all(|mm| mm.abs() <= FARTHEST_MM);
            if !is_near || eye[2] < NEAREST_MM {
                let (farthest_mm, nearest_mm) = (FARTHEST_MM, NEAREST_MM);
                let fault = MessageFault::Eye { found_mm: eye, farthest_mm, nearest_mm };
                return Err(MessageError::new(path, fault));
            }
        }
        Ok(())
    }
}
