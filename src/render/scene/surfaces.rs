//! Isosurfaces as written in JSON: one value, or a list with colours and opacities, or nothing. HU.

use serde::Deserialize;

use crate::mode::Mode;
use crate::surface::{Surface, usual_hu};
use relief_base::OutOfRange;
use relief_volume::TransferFunction;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SurfaceFile {
    hu: f64,
    rgb: Option<[f64; 3]>,
    opacity: Option<f64>,
}

/// The surfaces of a request: those written, or an opaque one at `iso_hu`, or an opaque one where
/// the transfer function reaches half of its largest opacity. Colours that were not written are the
/// transfer function's.
///
/// # Errors
/// When surfaces are written for another mode, or in both ways.
pub(super) fn resolve_surfaces(
    mode: Mode,
    iso_hu: Option<f64>,
    surfaces: Option<Vec<SurfaceFile>>,
    transfer: &TransferFunction,
) -> Result<Vec<Surface>, OutOfRange> {
    match (mode, iso_hu, surfaces) {
        (Mode::Isosurface, Some(hu), None) => {
            if hu.abs() > Surface::MOST_HU {
                let allowed = format!("-{most} to {most}", most = Surface::MOST_HU);
                return Err(OutOfRange::new("iso_hu", hu, allowed));
            }
            Ok(vec![Surface::opaque(hu, transfer)])
        }
        (Mode::Isosurface, None, Some(files)) => {
            Ok(files.into_iter().map(|file| file.resolve(transfer)).collect())
        }
        (Mode::Isosurface, None, None) => {
            let hu = usual_hu(transfer).clamp(-Surface::MOST_HU, Surface::MOST_HU);
            Ok(vec![Surface::opaque(hu, transfer)])
        }
        (Mode::Isosurface, Some(hu), Some(_)) => {
            Err(OutOfRange::new("iso_hu", hu, "either iso_hu or surfaces"))
        }
        (_, Some(hu), _) => Err(OutOfRange::new("iso_hu", hu, "only with mode isosurface")),
        (_, None, Some(files)) => {
            let found = format!("{} surfaces", files.len());
            Err(OutOfRange::new("surfaces", found, "only with mode isosurface"))
        }
        (_, None, None) => Ok(Vec::new()),
    }
}

impl SurfaceFile {
    fn resolve(self, transfer: &TransferFunction) -> Surface {
        let usual = Surface::opaque(self.hu, transfer);
        let Self { hu, rgb, opacity } = self;
        Surface { hu, rgb: rgb.unwrap_or(usual.rgb), opacity: opacity.unwrap_or(usual.opacity) }
    }
}
