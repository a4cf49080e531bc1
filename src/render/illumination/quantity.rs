//! Quantities of light in cells: their storage and their dependencies.

use std::sync::Arc;

use super::cells::Cells;
use super::settings::Occlusion;
use crate::classification::Classification;
use crate::labels::Labels;
use crate::light::InPatient;
use crate::mode::Mode;
use crate::request::{Clip, RenderRequest};
use crate::scene::camera_out_of_range;
use crate::surface::Surface;
use relief_base::{OutOfRange, Vector};
use relief_volume::{Camera, ContentHash, Grid, Projection, TransferFunction};

/// The texels of cells on a GPU: every adapter can write and filter them. Drivers in software
/// interpolate 8-bit texels by weights of 8 bits, which showed in pictures.
pub(super) const TEXELS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// The quantity that is computed for each cell.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LightQuantity {
    /// The share of each light that reaches it: where the light is, and the angle that it fills in
    /// radians.
    Shadows(Vec<(InPatient, f64)>),
    /// The share of directions that is open within this radius.
    Openness { radius_mm: f64 },
}

/// All that a filling depends on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FillingKey {
    pub(crate) volume: ContentHash,
    mode: Mode,
    /// Rays that take paths for samples look up cells that others do not.
    classification: Classification,
    transfer: TransferFunction,
    labels: Option<Arc<Labels>>,
    surfaces: Vec<Surface>,
    clip: Clip,
    pub(super) quantity: LightQuantity,
}

impl LightQuantity {
    /// The quantities that the rays of a request read: shadows, openness.
    pub(crate) fn of(request: &RenderRequest) -> [Option<Self>; 2] {
        let lights = || request.lights.iter().map(|light| (light.in_patient(&request.camera), light.size));
        let Occlusion { strength, radius_mm } = request.illumination.occlusion;
        [
            request.casts_shadows().then(|| Self::Shadows(lights().collect())),
            (request.has_own_light() && strength > 0.0).then_some(Self::Openness { radius_mm }),
        ]
    }

    /// The request with the distance between this quantity's samples, and a camera that depends only
    /// on the volume: cells must not depend on the first view.
    pub(crate) fn steady_request(
        &self,
        request: &RenderRequest,
        grid: &Grid,
        cells: &Cells,
    ) -> Result<RenderRequest, OutOfRange> {
        let sample_distance_mm = match *self {
            Self::Shadows(_) => cells.shadow_step_mm(),
            Self::Openness { radius_mm } => cells.openness_step_mm(radius_mm),
        };
        let radius_mm = grid.bounding_radius_mm();
        let eye = grid.center() + Vector::new(0.0, -2.0 * radius_mm, 0.0);
        let projection = Projection::Orthographic { height_mm: (2.0 * radius_mm).clamp(1e-3, 1e6) };
        let camera = Camera::new(eye, grid.center(), Vector::new(0.0, 0.0, 1.0), projection)
            .map_err(|error| camera_out_of_range(&error))?;
        Ok(RenderRequest { camera, sample_distance_mm, ..request.clone() })
    }
}

impl FillingKey {
    /// The key of a quantity in a volume under a request.
    pub(crate) fn new(volume: ContentHash, request: &RenderRequest, quantity: LightQuantity) -> Self {
        Self {
            volume,
            mode: request.mode,
            classification: request.classification,
            transfer: request.transfer.clone(),
            labels: request.labels.clone(),
            surfaces: request.surfaces.clone(),
            clip: request.clip.clone(),
            quantity,
        }
    }
}
