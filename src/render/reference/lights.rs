//! Light of a visible sample; twin of `shaders/lib/lights.wgsl`. Patient axes, patient mm.

use glam::DVec3;

use super::classify::shade;
use super::illumination::CellsOfLight;
use crate::light::{InPatient, Light};
use crate::request::RenderRequest;
use relief_base::Point;
use relief_volume::Volume;

/// The light of a request.
pub(super) struct Lights<'a> {
    volume: &'a Volume,
    request: &'a RenderRequest,
    cells: CellsOfLight<'a>,
}

impl<'a> Lights<'a> {
    pub(super) fn new(volume: &'a Volume, request: &'a RenderRequest) -> Self {
        Self { volume, request, cells: CellsOfLight::new(volume, request) }
    }

    /// Whether samples without reflection need a gradient all the same.
    pub(super) fn is_occluded(&self) -> bool {
        self.request.illumination.occlusion.strength > 0.0
    }

    /// The colour of a sample at voxel index `p`, seen along `direction`.
    pub(super) fn lit(&self, rgb: DVec3, gradient: DVec3, direction: DVec3, p: DVec3) -> DVec3 {
        let shading = &self.request.shading;
        let is_surface = gradient.length_squared() >= 1e-12;
        let slope = if is_surface { gradient.normalize() } else { DVec3::ZERO };
        let normal = if slope.dot(direction) > 0.0 { -slope } else { slope };
        let position = self.cells.position(p, normal);
        let open = self.openness(position);
        if self.request.lights.is_empty() || !shading.needs_gradient() {
            return open * shade(shading, rgb, gradient, direction);
        }
        let mut sum = rgb * shading.ambient * open;
        if is_surface {
            let casts_shadows = self.request.casts_shadows();
            let shadows = if casts_shadows { self.request.illumination.shadows } else { 0.0 };
            let shares = if casts_shadows { self.cells.shadows_at(position) } else { [1.0; 4] };
            for (light, share) in self.request.lights.iter().zip(shares) {
                sum += (1.0 - shadows * (1.0 - share)) * self.placed(light, rgb, normal, direction, p);
            }
        }
        sum
    }

    fn openness(&self, position: DVec3) -> f64 {
        if !self.is_occluded() {
            return 1.0;
        }
        let open = self.cells.openness_at(position);
        1.0 - self.request.illumination.occlusion.strength * (1.0 - (2.0 * open).min(1.0))
    }

    fn placed(&self, light: &Light, rgb: DVec3, normal: DVec3, direction: DVec3, p: DVec3) -> DVec3 {
        let shading = &self.request.shading;
        let toward = match light.in_patient(&self.request.camera) {
            InPatient::Direction(direction) => direction.xyz,
            InPatient::Position(at) => {
                let place = self.volume.grid().patient_from_voxel() * Point::from_xyz(p);
                (at - place).xyz.normalize_or_zero()
            }
        };
        let facing = normal.dot(toward).min(1.0);
        if facing <= 0.0 {
            return DVec3::ZERO;
        }
        let across = normal.dot((toward - direction).normalize_or_zero()).clamp(0.0, 1.0);
        let given = rgb * shading.diffuse * facing + shading.specular * across.powf(shading.shininess);
        given * DVec3::from(light.rgb) * light.intensity
    }
}
