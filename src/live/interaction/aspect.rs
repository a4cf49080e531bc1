//! The part of a view that an undo restores: camera, preset and clip plane.

use std::ops::RangeInclusive;

use glam::DQuat;

use super::stage::{Home, Stage};
use relief_base::{Patient, Point, Vector, View};
use relief_volume::{CameraError, Orbit, Projection};

/// The widest that a camera sees, degrees.
const WIDEST_DEG: f64 = 170.0;

/// The state that an undo restores.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Aspect {
    pub(super) look_at: Point<Patient>,
    /// Turns view axes into patient axes; of unit length.
    pub(super) patient_from_view: DQuat,
    pub(super) zoom: f64,
    pub(super) vertical_fov_deg: f64,
    pub(super) preset: Option<String>,
    /// Depth of the clip plane behind the front of the bounding sphere, mm; 0 cuts nothing.
    pub(super) cut_mm: f64,
}

impl Aspect {
    pub(super) fn home(stage: &Stage) -> Self {
        let Home { orbit, preset } = &stage.home;
        Self {
            look_at: stage.home_center,
            patient_from_view: orientation_of(orbit.azimuth_deg, orbit.elevation_deg),
            zoom: orbit.zoom.clamp(*ZOOMS.start(), *ZOOMS.end()),
            vertical_fov_deg: orbit.vertical_fov_deg,
            preset: preset.clone(),
            cut_mm: 0.0,
        }
    }

    /// Distance of the eye from the focal point, and projection: those of an orbit.
    pub(super) fn lens(&self, stage: &Stage) -> Result<(f64, Projection), CameraError> {
        let [width, height] = stage.size_px.map(f64::from);
        // An orbit fits a sphere to the picture's height; a narrow picture has to stand back for it.
        let zoom = self.zoom * (width / height / stage.narrowest_aspect).min(1.0);
        let half_angle = (self.vertical_fov_deg / 2.0).to_radians();
        let least = half_angle.tan() / (WIDEST_DEG / 2.0 - 1e-6).to_radians().tan();
        let zoom = zoom.clamp(Orbit::ZOOMS.start().max(least), *Orbit::ZOOMS.end());
        let orbit =
            Orbit { azimuth_deg: 0.0, elevation_deg: 0.0, zoom, vertical_fov_deg: self.vertical_fov_deg };
        let camera = orbit.camera(stage.home_center, stage.home_radius_mm)?;
        Ok((camera.distance_mm(), camera.projection()))
    }

    /// The picture's height at the focal point's depth, mm.
    pub(super) fn height_mm(&self, stage: &Stage) -> Result<f64, CameraError> {
        let (distance_mm, projection) = self.lens(stage)?;
        Ok(match projection {
            Projection::Perspective { vertical_fov } => 2.0 * distance_mm * (vertical_fov / 2.0).tan(),
            Projection::Orthographic { height_mm } => height_mm,
        })
    }

    /// The place of a patient point along view axes, the focal point being 0, mm.
    pub(super) fn in_view(&self, point: Point<Patient>) -> Vector<View> {
        Vector::from_xyz(self.patient_from_view.inverse() * (point - self.look_at).xyz)
    }

    /// The patient point at this place along view axes.
    pub(super) fn in_patient(&self, place: Vector<View>) -> Point<Patient> {
        self.look_at + Vector::from_xyz(self.patient_from_view * place.xyz)
    }
}

/// Zooms of a view: those of the page.
pub(super) const ZOOMS: RangeInclusive<f64> = 0.2..=40.0;

/// `patient_from_view` of an orbit's angles.
pub(super) fn orientation_of(azimuth_deg: f64, elevation_deg: f64) -> DQuat {
    DQuat::from_rotation_z(azimuth_deg.to_radians())
        * DQuat::from_rotation_x((90.0 - elevation_deg).to_radians())
}
