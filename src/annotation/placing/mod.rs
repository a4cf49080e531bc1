//! Snapping: a picked or pointed place is moved to the surface, edge or extremum that was meant.
//!
//! What it is: [`snap_point`], from the voxels only and deterministic. What it is not: input
//! devices or rendering. Space: patient LPS, mm; values in HU.
//!
//! | to | with a ray | without |
//! |---|---|---|
//! | surface, boundary | its nearest crossing along the ray | its nearest point |
//! | gradient | the steepest edge along the ray | the nearest point of the steepest edge around |
//! | minimum, maximum | the nearest local one around | the same |
//!
//! A surface is that of the trilinear field, as isosurfaces are rendered. Edges and extremes are
//! those of the field smoothed by a Gaussian about a voxel wide: noise alone has a local maximum
//! every few voxels, and the trilinear field has them at voxel centres only. Smoothing moves
//! neither a flat edge nor the middle of a symmetric object. An edge of radius R moves by about
//! σ²/R (0.01 mm for 1 mm voxels and 80 mm).

mod climb;
mod edge;
mod error;
mod extremum;
mod feature;
mod field;
mod lattice;
mod level;
mod search;
mod surface;

pub use error::SnapError;
pub use feature::SnapFeature;
use field::Field;
use search::Search;

use relief_base::{OutOfRange, Patient, Point, Vector};
use relief_volume::Volume;

impl SnapFeature {
    /// The names of targets, in the order of the enumeration.
    pub const NAMES: [&str; 5] = ["surface", "boundary", "gradient", "minimum", "maximum"];

    /// The feature of a name; `hu` is the level of a surface.
    ///
    /// # Errors
    /// When no feature has this name, a surface has no level, or another feature has one.
    pub fn from_name(name: &str, hu: Option<f64>) -> Result<Self, SnapError> {
        let refuse = |name: &str, found: &str, allowed: &str| {
            let found: String = found.chars().take(60).collect();
            Err(OutOfRange::new(name, found, allowed).into())
        };
        match (name, hu) {
            ("surface", Some(hu)) => Ok(Self::Surface { hu }),
            ("boundary", None) => Ok(Self::Boundary),
            ("gradient", None) => Ok(Self::Gradient),
            ("minimum", None) => Ok(Self::Minimum),
            ("maximum", None) => Ok(Self::Maximum),
            ("surface", None) => refuse("hu", "missing", "the level of the surface, HU, or to boundary"),
            (known, Some(_)) if Self::NAMES.contains(&known) => {
                refuse("hu", "there", "nothing beside another target than surface")
            }
            _ => refuse("to", &format!("{name:?}"), &Self::NAMES.join(", ")),
        }
    }

    /// The name of this target.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Surface { .. } => Self::NAMES[0],
            Self::Boundary => Self::NAMES[1],
            Self::Gradient => Self::NAMES[2],
            Self::Minimum => Self::NAMES[3],
            Self::Maximum => Self::NAMES[4],
        }
    }
}

/// How a place is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snap {
    /// To what.
    pub to: SnapFeature,
    /// By at most so much, mm: [`Snap::RADII_MM`].
    pub radius_mm: f64,
}

impl Snap {
    /// Allowed radii, mm.
    pub const RADII_MM: std::ops::RangeInclusive<f64> = 0.1..=20.0;
    /// Levels of a surface, HU.
    pub const LEVELS_HU: std::ops::RangeInclusive<f64> = -32768.0..=32767.0;
    /// The default radius, mm.
    pub const DEFAULT_RADIUS_MM: f64 = 3.0;
}

/// A place that was moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snapped {
    /// Its new place.
    pub at: Point<Patient>,
    /// From its old place to its new one.
    pub shift: Vector<Patient>,
    /// The value there (trilinear), HU.
    pub hu: f64,
    /// The magnitude of the smoothed gradient there, HU per mm.
    pub gradient_hu_per_mm: f64,
}

/// The trilinear value at a place, HU; `None` outside the volume.
#[must_use]
pub fn value_at(volume: &Volume, at: Point<Patient>) -> Option<f64> {
    Field::new(volume).value(at.xyz)
}

/// The feature near `at`, with sub-voxel accuracy. `ray` is the viewing direction, of any positive
/// length; the module's table explains its effect. Both directions of it count.
///
/// # Errors
/// When a value is out of range, or nothing of the kind is within the radius, or all of it is
/// outside the volume.
pub fn snap_point(
    volume: &Volume,
    at: Point<Patient>,
    ray: Option<Vector<Patient>>,
    snap: &Snap,
) -> Result<Snapped, SnapError> {
    let Snap { to, radius_mm } = *snap;
    if !at.xyz.is_finite() {
        return Err(OutOfRange::new("at_mm", at.xyz, "finite numbers, mm").into());
    }
    if !Snap::RADII_MM.contains(&radius_mm) {
        let allowed = format!("{} to {} mm", Snap::RADII_MM.start(), Snap::RADII_MM.end());
        return Err(OutOfRange::new("radius_mm", radius_mm, allowed).into());
    }
    let along = match ray {
        None => None,
        Some(ray) => Some(
            ray.normalized()
                .ok_or_else(|| OutOfRange::new("ray", ray.xyz, "a direction with some length"))?,
        ),
    };
    let search = Search { at: at.xyz, ray: along.map(|ray| ray.xyz), radius_mm };
    let field = Field::new(volume);
    let found = match to {
        SnapFeature::Surface { hu } => {
            if !Snap::LEVELS_HU.contains(&hu) {
                let allowed = format!("{} to {} HU", Snap::LEVELS_HU.start(), Snap::LEVELS_HU.end());
                return Err(OutOfRange::new("hu", hu, allowed).into());
            }
            surface::find(&field, &search, hu)?
        }
        SnapFeature::Boundary => match level::around(&field, &search)? {
            Some(hu) => surface::find(&field, &search, hu)?,
            None => None,
        },
        SnapFeature::Gradient => edge::find(&field, &search)?,
        SnapFeature::Minimum => extremum::find(&field, &search, -1.0)?,
        SnapFeature::Maximum => extremum::find(&field, &search, 1.0)?,
    };
    let settled = found.and_then(|place| Some((place, field.value(place)?)));
    let Some((place, hu)) = settled else {
        return Err(SnapError::NotFound { feature: to, radius_mm });
    };
    let place_to = Point::from_xyz(place);
    let gradient_hu_per_mm = field.smooth(place).gradient.length();
    Ok(Snapped { at: place_to, shift: place_to - at, hu, gradient_hu_per_mm })
}
