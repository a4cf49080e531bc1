//! Placed lights: their place and its space, size, brightness and colour.
//!
//! A light of intensity 1 makes a white surface that faces it white, at whatever distance. `View`
//! lights move with the camera, `Patient` lights stay with the patient. Lengths mm, angles in
//! radians.

use relief_base::{OutOfRange, Patient, Point, Vector, View};
use relief_volume::Camera;

/// The place of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// Endlessly far away, in this direction from everything; moves with the camera.
    ViewDirection(Vector<View>),
    /// At this place, which moves with the camera.
    ViewPosition(Point<View>),
    /// Endlessly far away, in this direction from everything.
    PatientDirection(Vector<Patient>),
    /// At this place.
    PatientPosition(Point<Patient>),
}

/// One light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Its place.
    pub placement: Placement,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
    /// 0..100; 1 makes a white surface that faces it white.
    pub intensity: f64,
    /// The angle that its disc fills, radians, 0 to half a turn: larger ones cast softer shadows.
    pub size: f64,
}

/// A placement in patient space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InPatient {
    /// Unit length.
    Direction(Vector<Patient>),
    Position(Point<Patient>),
}

/// A placement in view space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InView {
    /// Unit length.
    Direction(glam::DVec3),
    Position(glam::DVec3),
}

impl Light {
    /// Most lights of a request.
    pub const MAX: usize = 4;

    /// Checks ranges; messages contain `index`.
    pub(super) fn validate(&self, index: usize) -> Result<(), OutOfRange> {
        let refuse = |key: &str, found: String, allowed: &str| {
            Err(OutOfRange::new(format!("lights[{index}].{key}"), found, allowed))
        };
        let (key, xyz) = match self.placement {
            Placement::ViewDirection(Vector { xyz, .. })
            | Placement::PatientDirection(Vector { xyz, .. }) => ("direction", xyz),
            Placement::ViewPosition(Point { xyz, .. }) | Placement::PatientPosition(Point { xyz, .. }) => {
                ("position_mm", xyz)
            }
        };
        if key == "direction" && xyz.try_normalize().is_none() {
            return refuse(key, format!("{:?}", xyz.to_array()), "a direction of finite length above zero");
        }
        if key == "position_mm" && !xyz.to_array().iter().all(|mm| (-1e6..=1e6).contains(mm)) {
            return refuse(key, format!("{:?}", xyz.to_array()), "-1000000 to 1000000 mm each");
        }
        if let Some(channel) = self.rgb.iter().find(|channel| !(0.0..=1.0).contains(*channel)) {
            return refuse("rgb", channel.to_string(), "0 to 1");
        }
        if !(0.0..=100.0).contains(&self.intensity) {
            return refuse("intensity", self.intensity.to_string(), "0 to 100");
        }
        let degrees = self.size.to_degrees();
        if !(0.0..=180.0 + 1e-9).contains(&degrees) {
            return refuse("size_deg", degrees.to_string(), "0 to 180");
        }
        Ok(())
    }

    /// Its position or direction for this camera.
    pub(super) fn in_view(&self, camera: &Camera) -> InView {
        match self.placement {
            Placement::ViewDirection(direction) => InView::Direction(direction.xyz.normalize_or_zero()),
            Placement::ViewPosition(position) => InView::Position(position.xyz),
            Placement::PatientDirection(direction) => {
                InView::Direction((camera.view_from_patient() * direction).xyz.normalize_or_zero())
            }
            Placement::PatientPosition(position) => {
                InView::Position((camera.view_from_patient() * position).xyz)
            }
        }
    }

    /// Its place in the patient for this camera.
    pub(super) fn in_patient(&self, camera: &Camera) -> InPatient {
        let unit = |direction: Vector<Patient>| {
            InPatient::Direction(Vector::from_xyz(direction.xyz.normalize_or_zero()))
        };
        match self.placement {
            Placement::ViewDirection(direction) => unit(camera.patient_from_view() * direction),
            Placement::ViewPosition(position) => InPatient::Position(camera.patient_from_view() * position),
            Placement::PatientDirection(direction) => unit(direction),
            Placement::PatientPosition(position) => InPatient::Position(position),
        }
    }
}
