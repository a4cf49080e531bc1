//! How closely a picture is sampled where its scene names no distance between samples.

use super::mode::Mode;
use super::request::RenderRequest;
use relief_base::OutOfRange;
use relief_volume::Grid;

/// The purpose of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// Looked at: four samples a voxel. The rings that samples leave on surfaces have a fifth of the
    /// energy, for 1.4 to 1.6 times the time.
    #[default]
    Still,
    /// Passing: two samples a voxel.
    Moving,
}

impl Quality {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Still, Self::Moving];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Moving => "moving",
        }
    }

    /// The quality of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|quality| quality.name() == name)
    }

    /// The distance between samples of a request where its scene names none, mm. Only mode composite
    /// has rings; a picture with too many samples has the distance of moving ones.
    #[must_use]
    pub fn sample_distance_mm(self, request: &RenderRequest, grid: &Grid) -> f64 {
        let finest_mm = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let least_mm = request.least_sample_distance_mm(grid);
        let of = |samples: f64| (finest_mm / samples).max(least_mm);
        let is_close = self == Self::Still && request.mode == Mode::Composite;
        let close_mm = finest_mm / 4.0;
        if is_close && close_mm >= least_mm { close_mm } else { of(2.0) }
    }

    /// The distance between samples of a request, mm, from the quality or the distance of its scene.
    ///
    /// # Errors
    /// When the scene has both, or a quality in a mode that has none.
    pub(crate) fn resolve(
        written: Option<Self>,
        distance_mm: Option<f64>,
        request: &RenderRequest,
        grid: &Grid,
    ) -> Result<f64, OutOfRange> {
        let refuse = |quality: Self, allowed: &str| {
            Err(OutOfRange::new("quality", format_args!("{:?}", quality.name()), allowed))
        };
        match (written, distance_mm) {
            (Some(quality), Some(_)) => refuse(quality, "left out where the scene has sample_distance_mm"),
            (Some(quality), None) if request.mode != Mode::Composite => {
                refuse(quality, "left out in other modes than composite")
            }
            (None, Some(distance_mm)) => Ok(distance_mm),
            (written, None) => Ok(written.unwrap_or_default().sample_distance_mm(request, grid)),
        }
    }
}
