//! From disparity to parallax, and from a display to the cameras whose pictures have the same
//! parallax.
//!
//! A viewer at the distance vz before the screen (in depth ranges) sees a point at Z on the screen
//! at parallax `p / e = 1 - vz / (Z - Zd + vz)`, by similar triangles, where e is the separation of
//! the eyes. D(Z) is chosen so that `p / e = (D - C) / M`; M is negative, so points nearer than the
//! screen have crossed parallax. An eye s separations to the right of the middle sees a
//! proportional shift of `s e (D - C) / M`. The header's offset replaces C, and its factor scales
//! the shift (64 is 100 %):
//!
//! `shift = s e (factor / 64) (D - offset) / M`
//!
//! To an eye on the right, nearer things move left. e in pixels is 65 mm, the usual separation of
//! eyes, on a screen of the profile's width.

use crate::profile::{DisparityConstants, DisplayProfile};
use relief_base::{DepthLimits, Disparity};

/// Separation of a viewer's eyes, mm.
pub(super) const EYE_SEPARATION_MM: f64 = 65.0;
/// The factor that stands for 100 %.
const USUAL_FACTOR: f64 = 64.0;

/// The apparent place of a disparity, as an eye sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parallax {
    constants: DisparityConstants,
    /// Separation of the eyes times the factor, pixels.
    separation_px: f64,
    offset: f64,
}

/// Cameras whose pictures have a display's parallax: side by side, with lenses shifted so that they
/// converge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueViews {
    /// View depth of points that stay in their place, mm: where D is the offset.
    pub converging_mm: f64,
    /// The shift of a camera to the right for one eye separation, mm.
    pub baseline_mm: f64,
    /// The largest difference to the parallax by disparity between the depth limits, for one eye
    /// separation, pixels.
    ///
    /// The display's viewer and the camera are at different distances, so both agree at the screen
    /// plane in place and slope, and apart from it to second order. 0 when the camera is where the
    /// display's viewer is.
    pub difference_px: f64,
}

impl TrueViews {
    /// The eye separations between the outermost views of a view cone of this angle, degrees. 0 where
    /// all eyes see the same picture.
    #[must_use]
    pub fn span_of_cone(&self, cone_deg: f64) -> f64 {
        let between_mm = 2.0 * (cone_deg.to_radians() / 2.0).tan() * self.converging_mm;
        if self.baseline_mm == 0.0 { 0.0 } else { between_mm / self.baseline_mm }
    }
}

impl Parallax {
    /// The parallax on a display of this profile, for pictures of `width_px` across the whole
    /// screen, with the header's factor and offset.
    #[must_use]
    pub fn new(profile: &DisplayProfile, factor: u8, offset: u8, width_px: u32) -> Self {
        let separation_px = f64::from(width_px) * EYE_SEPARATION_MM / profile.screen_width_mm();
        Self {
            constants: profile.constants(),
            separation_px: separation_px * f64::from(factor) / USUAL_FACTOR,
            offset: f64::from(offset),
        }
    }

    /// The horizontal shift of a pixel with this disparity, as an eye sees it, pixels to the right.
    #[must_use]
    pub fn shift_px(&self, d: Disparity, eye: f64) -> f64 {
        eye * self.separation_px * (d.0 - self.offset) / self.constants.m
    }

    /// The width of a pixel in [`Parallax::shifts`].
    pub const UNIT: i32 = 4096;

    /// The shift of each disparity to the right for an eye, 1/4096 pixel, in pictures of this width.
    /// Even numbers, so that the middle between two is a whole one. Nothing moves by more than the
    /// picture's width: it would be out of it.
    #[must_use]
    pub fn shifts(&self, eye: f64, width_px: u32) -> [i32; 256] {
        let most = f64::from(width_px);
        std::array::from_fn(|d| {
            let shift = self.shift_px(Disparity(d as f64), eye).clamp(-most, most);
            2 * (shift * f64::from(Self::UNIT / 2)).round() as i32
        })
    }

    /// The cameras for a picture of `width_px`, half of which is `half_width` mm at 1 mm before the
    /// eye, with depth scaled between `limits`; `None` when the depth of the offset's disparity is
    /// not before the camera.
    ///
    /// With R the depth range and v the view depth of the display's own viewer, `near + (Zd - vz)
    /// R`, a depth d is shifted by `s e (1 - vz R / (d - v))` and a constant. A camera moved by t
    /// with its picture's middle moved back shifts it by `t w (1 / c - 1 / d)`, w pixels per mm at
    /// 1 mm. Both are 0 at c; t follows from equal slopes there.
    #[must_use]
    pub fn true_views(&self, limits: DepthLimits, half_width: f64, width_px: u32) -> Option<TrueViews> {
        let DisparityConstants { zd, vz, m, c } = self.constants;
        let range_mm = limits.far_mm - limits.near_mm;
        let screen_z = m * vz / (m + c - self.offset) + zd - vz;
        let converging_mm = limits.near_mm + screen_z * range_mm;
        if !(converging_mm.is_finite() && converging_mm > 0.0) {
            return None;
        }
        let viewer_mm = limits.near_mm + (zd - vz) * range_mm;
        let px_per_mm = f64::from(width_px) / (2.0 * half_width);
        let slope = self.separation_px * vz * range_mm / (converging_mm - viewer_mm).powi(2);
        let baseline_mm = slope * converging_mm.powi(2) / px_per_mm;
        let difference = |mm: f64| {
            let d = m * (1.0 - vz * range_mm / (mm - viewer_mm)) + c;
            let moved = baseline_mm * px_per_mm * (1.0 / converging_mm - 1.0 / mm);
            (self.shift_px(Disparity(d), 1.0) - moved).abs()
        };
        // The difference is monotonic on both sides of c, where it is 0, so it is largest at the
        // limits.
        let ends = [limits.near_mm, limits.far_mm].into_iter().filter(|mm| *mm > 0.0);
        Some(TrueViews {
            converging_mm,
            baseline_mm,
            difference_px: ends.map(difference).fold(0.0, f64::max),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::ProfileName;
    use relief_base::ScaledDepth;

    /// Two eyes, a screen and a point, by intersecting lines, without any of the formulas above.
    #[test]
    fn the_shift_is_where_the_line_from_eye_to_point_meets_the_screen() {
        let profile = DisplayProfile::named(ProfileName::Philips42);
        let DisparityConstants { zd, vz, .. } = profile.constants();
        let parallax = Parallax::new(&profile, 64, 128, 960);
        let eye_px = 960.0 * 65.0 / profile.screen_width_mm();
        for (z, eye) in [(0.0, 0.5), (0.25, -0.5), (0.467_481, 1.0), (0.9, -2.0), (1.0, 0.25)] {
            // The point is on the axis, z - zd behind the screen; the eye is vz before it.
            let share = (z - zd) / (z - zd + vz);
            let on_screen = eye * eye_px * share;
            // The offset of 128 is half a step from C.
            let offset = parallax.shift_px(Disparity(127.5), eye);
            let found = parallax.shift_px(profile.disparity(ScaledDepth(z)), eye) - offset;
            assert!((found - on_screen).abs() < 2e-3, "{z} {eye}: {found} for {on_screen}");
        }
        let near = parallax.shift_px(Disparity(255.0), 1.0);
        assert!(near < -4.0 && near > -5.0, "nearer moves left to the right eye: {near}");
        let half = Parallax::new(&profile, 32, 128, 960).shift_px(Disparity(255.0), 1.0);
        assert!((half - near / 2.0).abs() < 1e-12);
    }

    /// Invariant: Synthesised views agree with true renders, which agree with point projection.
    #[test]
    fn a_camera_where_the_displays_viewer_is_has_its_very_parallax() {
        let profile = DisplayProfile::named(ProfileName::Philips42);
        let DisparityConstants { zd, vz, .. } = profile.constants();
        let near_mm = (vz - zd) * 100.0;
        let limits = DepthLimits { near_mm, far_mm: near_mm + 100.0 };
        let parallax = Parallax::new(&profile, 64, 200, 960);
        let exact = parallax.true_views(limits, 0.2, 960).unwrap();
        assert!(exact.difference_px < 1e-9, "{exact:?}");
        // Elsewhere place and slope agree at the screen: a tenth of the way there leaves a
        // hundredth of the difference.
        let near = DepthLimits { near_mm: 300.0, far_mm: 500.0 };
        let cameras = parallax.true_views(near, 0.2, 960).unwrap();
        let difference = |mm: f64| {
            let z = (mm - near.near_mm) / 200.0;
            let d = profile.constants().m * (1.0 - vz / (z - zd + vz)) + profile.constants().c;
            let px = 960.0 / 0.4 * cameras.baseline_mm;
            parallax.shift_px(Disparity(d), 1.0) - px * (1.0 / cameras.converging_mm - 1.0 / mm)
        };
        let [at, close, closer] = [0.0, 10.0, 1.0].map(|mm| difference(cameras.converging_mm + mm).abs());
        assert!(at < 1e-9 && closer < 0.011 * close, "{at} {close} {closer}");
        assert!(parallax.true_views(DepthLimits { near_mm: -500.0, far_mm: -300.0 }, 0.2, 960).is_none());
    }
}
