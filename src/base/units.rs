//! Quantities whose unit a bare float would hide.
//!
//! Three different numbers are called "depth" around 2D-plus-depth displays. They are three types
//! here:
//!
//! | type | meaning | range |
//! |---|---|---|
//! | [`ViewDepth`] | distance from the eye along the viewing axis (not along the ray) | mm, `+inf` for a miss |
//! | [`ScaledDepth`] | Z: view depth between the near (0) and the far limit (1), linear | 0..1 |
//! | [`Disparity`] | D: what a 2D-plus-depth display takes, 255 nearest, 0 farthest | 0..255 |
//!
//! [`DepthLimits`] converts between the first two; `display::profile` between the last two.

/// Distance from the eye along the viewing axis in mm; `+inf` where a ray hit nothing.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct ViewDepth(pub f32);

impl ViewDepth {
    /// A ray that hit nothing.
    pub const MISS: Self = Self(f32::INFINITY);

    /// Whether the ray hit anything.
    #[must_use]
    pub fn is_hit(self) -> bool {
        self.0.is_finite()
    }
}

/// Z: view depth scaled linearly so that the near limit is 0 and the far limit 1.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct ScaledDepth(pub f64);

/// D: the disparity that a 2D-plus-depth display is sent, 0 (farthest) to 255 (nearest).
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Disparity(pub f64);

impl Disparity {
    /// The byte that carries this disparity: rounded to nearest, clamped to 0..=255.
    #[must_use]
    pub fn to_byte(self) -> u8 {
        self.0.round().clamp(0.0, 255.0) as u8
    }
}

/// The view depths between which a frame's depth is scaled to 0..1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthLimits {
    /// View depth that becomes Z = 0, mm.
    pub near_mm: f64,
    /// View depth that becomes Z = 1, mm.
    pub far_mm: f64,
}

impl DepthLimits {
    /// Limits with `near_mm < far_mm`, both finite; `None` otherwise.
    #[must_use]
    pub fn new(near_mm: f64, far_mm: f64) -> Option<Self> {
        (near_mm.is_finite() && far_mm.is_finite() && near_mm < far_mm).then_some(Self { near_mm, far_mm })
    }

    /// Z of a view depth, clamped to 0..1. A miss gets the far limit.
    #[must_use]
    pub fn scaled(self, depth: ViewDepth) -> ScaledDepth {
        if !depth.is_hit() {
            return ScaledDepth(1.0);
        }
        ScaledDepth(((f64::from(depth.0) - self.near_mm) / (self.far_mm - self.near_mm)).clamp(0.0, 1.0))
    }

    /// View depth of a Z, the inverse of [`DepthLimits::scaled`] between the limits.
    #[must_use]
    pub fn view_depth(self, z: ScaledDepth) -> ViewDepth {
        ViewDepth((self.near_mm + z.0 * (self.far_mm - self.near_mm)) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_scale_linearly_and_clamp() {
        let limits = DepthLimits::new(100.0, 300.0).unwrap();
        for (mm, z) in
            [(100.0, 0.0), (150.0, 0.25), (300.0, 1.0), (50.0, 0.0), (400.0, 1.0), (f32::INFINITY, 1.0)]
        {
            assert_eq!(limits.scaled(ViewDepth(mm)), ScaledDepth(z), "{mm} mm");
        }
        assert_eq!(limits.view_depth(ScaledDepth(0.25)), ViewDepth(150.0));
    }

    #[test]
    fn limits_refuse_an_empty_or_endless_range() {
        for (near, far) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert_eq!(DepthLimits::new(near, far), None, "{near}..{far}");
        }
    }

    #[test]
    fn disparity_rounds_and_clamps_to_a_byte() {
        for (d, byte) in [(-3.0, 0), (0.49, 0), (127.5, 128), (254.6, 255), (300.0, 255)] {
            assert_eq!(Disparity(d).to_byte(), byte, "{d}");
        }
    }
}
