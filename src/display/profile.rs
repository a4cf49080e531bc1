//! Display profiles: the frame sizes of a 2D-plus-depth display, and its curve D(Z).
//!
//! Sizes and the four constants of `D(Z) = M (1 - vz / (Z - Zd + vz)) + C`. The places of pixels
//! are in `layout`.
//!
//! Z is [`ScaledDepth`] (0 at the near limit, 1 at the far limit), D is [`Disparity`] (255 nearest,
//! 0 farthest). Zd is the display plane, vz the viewing distance in units of the depth range. The
//! pole of the curve, the viewer, is at Z = Zd - vz, in front of the near limit; arguments outside
//! their range are clamped to it.

use relief_base::{Disparity, ScaledDepth};

/// The disparity of the display plane where only the viewing distance is given.
const SCREEN_DISPARITY: f64 = 127.5;

/// Diagonal of a display that is not known by name.
const USUAL_INCHES: f64 = 42.0;

/// Viewing distances in depth ranges that a display may have; the 20" and 42" models have 6.2 and
/// 7.7.
pub(super) const VZ_RANGE: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

/// The frame a display takes and its curve from scaled depth to disparity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayProfile {
    frame_px: [u32; 2],
    sub_image_px: [u32; 2],
    constants: DisparityConstants,
    diagonal_inches: f64,
}

/// The constants of `D(Z) = M (1 - vz / (Z - Zd + vz)) + C`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisparityConstants {
    /// Zd: scaled depth of the display plane, 0..1.
    pub zd: f64,
    /// vz: viewing distance in units of the depth range, above Zd.
    pub vz: f64,
    /// M: parallax in eye separations is `(D - C) / M`; negative.
    pub m: f64,
    /// C: disparity of the display plane.
    pub c: f64,
}

/// Displays known by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileName {
    /// Philips 20" (`philips-20`), constants as published by its maker.
    Philips20,
    /// Philips 42" (`philips-42`), constants as published by its maker.
    Philips42,
    /// Dimenco 65" with a 3840x2160 panel (`dimenco-4k`). Its constants were never published: they
    /// follow from the viewing distance of the 42" model by the one-parameter family. Set `vz`
    /// where the display's own is known.
    Dimenco4k,
}

/// Constants that no display can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// The viewing distance is not finite or out of range.
    #[error("vz is {0}; allowed: {min} to {max} depth ranges", min = VZ_RANGE.start(), max = VZ_RANGE.end())]
    ViewingDistance(f64),
    /// The display plane is not between the limits.
    #[error("zd is {0}; allowed: above 0 and below 1")]
    DisplayPlane(f64),
    /// The viewer would be inside the depth range.
    #[error("vz is {vz}; allowed: above zd ({zd}), so that the viewer is in front of the near limit")]
    ViewerInside {
        /// Viewing distance.
        vz: f64,
        /// Display plane.
        zd: f64,
    },
    /// Nearer would not be brighter.
    #[error("m is {0}; allowed: finite and below 0, so that nearer is brighter")]
    Slope(f64),
    /// The screen's disparity is not a byte.
    #[error("c is {0}; allowed: 0 to 255")]
    ScreenDisparity(f64),
    /// A frame or sub-image without pixels, or too large.
    #[error("{what} is {}x{}; allowed: 1 to 16384 pixels each way", size_px[0], size_px[1])]
    Size {
        /// The name of the size.
        what: &'static str,
        /// The value.
        size_px: [u32; 2],
    },
}

impl ProfileName {
    /// All of them, in the order of lists shown to users.
    pub const ALL: [Self; 3] = [Self::Philips20, Self::Philips42, Self::Dimenco4k];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Philips20 => "philips-20",
            Self::Philips42 => "philips-42",
            Self::Dimenco4k => "dimenco-4k",
        }
    }

    /// The profile with this name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }
}

impl DisparityConstants {
    /// The constants of the 20" display, as published.
    pub const PHILIPS_20: Self = Self { zd: 0.459_813, vz: 6.180_772, m: -1586.34, c: SCREEN_DISPARITY };
    /// The constants of the 42" display, as published.
    pub const PHILIPS_42: Self = Self { zd: 0.467_481, vz: 7.655_192, m: -1960.37, c: SCREEN_DISPARITY };

    /// The one member of the family with this viewing distance, C = 127.5, D(0) = 255 and D(1) = 0.
    ///
    /// # Errors
    /// When `vz` is not finite or out of range.
    pub fn from_viewing_distance(vz: f64) -> Result<Self, ProfileError> {
        if !VZ_RANGE.contains(&vz) {
            return Err(ProfileError::ViewingDistance(vz));
        }
        Ok(Self::family(vz))
    }

    fn family(vz: f64) -> Self {
        // ((1 + vz) - sqrt(1 + vz²)) / 2 without its cancellation.
        let zd = vz / (1.0 + vz + vz.hypot(1.0));
        let m = -SCREEN_DISPARITY * (1.0 - zd + vz) / (1.0 - zd);
        Self { zd, vz, m, c: SCREEN_DISPARITY }
    }

    /// These constants, when a display can have them.
    ///
    /// # Errors
    /// When a constant is not finite or out of range, or the curve would not fall from near to far.
    pub fn checked(self) -> Result<Self, ProfileError> {
        let Self { zd, vz, m, c } = self;
        if !VZ_RANGE.contains(&vz) {
            return Err(ProfileError::ViewingDistance(vz));
        }
        if !(zd > 0.0 && zd < 1.0) {
            return Err(ProfileError::DisplayPlane(zd));
        }
        if vz <= zd {
            return Err(ProfileError::ViewerInside { vz, zd });
        }
        if !(m.is_finite() && m < 0.0) {
            return Err(ProfileError::Slope(m));
        }
        if !(0.0..=255.0).contains(&c) {
            return Err(ProfileError::ScreenDisparity(c));
        }
        Ok(self)
    }
}

impl DisplayProfile {
    /// A profile of these sizes in pixels (width, height) and constants.
    ///
    /// # Errors
    /// When a size is empty or above 16384, or a constant is out of range.
    pub fn new(
        frame_px: [u32; 2],
        sub_image_px: [u32; 2],
        constants: DisparityConstants,
    ) -> Result<Self, ProfileError> {
        for (what, size_px) in [("frame_px", frame_px), ("sub_image_px", sub_image_px)] {
            if size_px.iter().any(|side| !(1..=super::MAX_FRAME_SIDE_PX).contains(side)) {
                return Err(ProfileError::Size { what, size_px });
            }
        }
        Ok(Self { frame_px, sub_image_px, constants: constants.checked()?, diagonal_inches: USUAL_INCHES })
    }

    /// The profile of a display known by name.
    #[must_use]
    pub fn named(name: ProfileName) -> Self {
        let (frame_px, sub_image_px) = match name {
            ProfileName::Philips20 | ProfileName::Philips42 => ([1920, 1080], [960, 540]),
            ProfileName::Dimenco4k => ([3840, 2160], [1920, 2160]),
        };
        let constants = match name {
            ProfileName::Philips20 => DisparityConstants::PHILIPS_20,
            ProfileName::Philips42 => DisparityConstants::PHILIPS_42,
            ProfileName::Dimenco4k => DisparityConstants::family(DisparityConstants::PHILIPS_42.vz),
        };
        let diagonal_inches = match name {
            ProfileName::Philips20 => 20.0,
            ProfileName::Philips42 => USUAL_INCHES,
            ProfileName::Dimenco4k => 65.0,
        };
        Self { frame_px, sub_image_px, constants, diagonal_inches }
    }

    /// Width of the screen, 16:9, mm. That of 42" where the display is not known by name.
    #[must_use]
    pub fn screen_width_mm(&self) -> f64 {
        self.diagonal_inches * 25.4 * 16.0 / 16f64.hypot(9.0)
    }

    /// Width and height of the frame that the display takes, pixels.
    #[must_use]
    pub const fn frame_px(&self) -> [u32; 2] {
        self.frame_px
    }

    /// Width and height of the picture, and of its depth, inside the display's own frame, pixels.
    #[must_use]
    pub const fn sub_image_px(&self) -> [u32; 2] {
        self.sub_image_px
    }

    /// The constants of the curve.
    #[must_use]
    pub const fn constants(&self) -> DisparityConstants {
        self.constants
    }

    /// D(Z). Z is clamped to 0..1 and D to 0..255.
    #[must_use]
    pub fn disparity(&self, z: ScaledDepth) -> Disparity {
        let DisparityConstants { zd, vz, m, c } = self.constants;
        let z = z.0.clamp(0.0, 1.0);
        Disparity((m * (1.0 - vz / (z - zd + vz)) + c).clamp(0.0, 255.0))
    }

    /// Z of a D, the inverse of [`DisplayProfile::disparity`]. D is clamped to 0..255 and Z to
    /// 0..1.
    #[must_use]
    pub fn scaled_depth(&self, d: Disparity) -> ScaledDepth {
        let DisparityConstants { zd, vz, m, c } = self.constants;
        let d = d.0.clamp(0.0, 255.0);
        ScaledDepth((m * vz / (m + c - d) + zd - vz).clamp(0.0, 1.0))
    }
}
