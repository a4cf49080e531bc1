//! Transfer functions: from HU to colour and opacity.
//!
//! Colours are display-referred sRGB values 0..1 and blend as they are. Opacity is per
//! `opacity_unit_mm` of path, so an image does not depend on its sample distance: a sample that
//! stands for `step` mm has the opacity `1 - (1 - a)^(step / unit)`. Colour is not premultiplied at
//! the control points.
//!
//! Values: HU. Lengths: mm. This module uses no GPU: a shader and its f64 twin share
//! [`TransferTable`].

mod foreign;
mod gradient;
mod integral;
mod medium;
mod presets;
mod table;
mod window;

pub use crate::transfer::foreign::error::{TransferImportError, TransferSyntaxError};
pub use foreign::{ImportedLight, ImportedTransfer, MAX_IMPORT_BYTES, TransferImportChoice, import_transfer};
pub use gradient::{GradientOpacity, GradientTable};
pub use integral::IntegralTable;
pub use medium::{MediumTable, linear_from_srgb};
pub use presets::{PRESETS, Preset, PresetGroup, PresetMode, preset};
pub use table::TransferTable;
pub use window::{Window, WindowMap};

/// Colour and opacity at one HU value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// Value in HU.
    pub hu: f64,
    /// Red, green, blue (display-referred sRGB) and opacity per opacity unit, each 0..1.
    pub rgba: [f64; 4],
}

/// A piecewise linear transfer function; constant beyond its first and last control point.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    points: Vec<ControlPoint>,
    opacity_unit_mm: f64,
    gradient_opacity: Option<GradientOpacity>,
}

/// Why control points do not make a transfer function.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// No control point, or more than [`TransferFunction::MAX_POINTS`].
    #[error("{0} control points, allowed: 1 to {max}", max = TransferFunction::MAX_POINTS)]
    Count(usize),
    /// HU values must rise from point to point.
    #[error(
        "control point {index} is at {found} HU, allowed: above {previous} HU, the value of the previous point"
    )]
    Order {
        /// The point, from 0.
        index: usize,
        /// Its value in HU.
        found: f64,
        /// Value of the point before it in HU.
        previous: f64,
    },
    /// A value outside its range.
    #[error("control point {index}: {what} is {found}, allowed: {allowed}")]
    Value {
        /// The point, from 0.
        index: usize,
        /// The name of its value.
        what: &'static str,
        /// The value.
        found: f64,
        /// The permitted values.
        allowed: &'static str,
    },
    /// A window that shows nothing.
    #[error("window {what} is {found}, allowed: {allowed}")]
    Window {
        /// The name of the value: `center_hu` or `width_hu`.
        what: &'static str,
        /// The value.
        found: f64,
        /// The permitted values.
        allowed: &'static str,
    },
    /// No point of opacity by gradient, or more than [`GradientOpacity::MAX_POINTS`].
    #[error("{0} points of opacity by gradient, allowed: 1 to {max}", max = GradientOpacity::MAX_POINTS)]
    GradientCount(usize),
    /// A point of opacity by gradient outside its range, or not above the one before.
    #[error("opacity by gradient, point {index}: {what} is {found}, allowed: {allowed}")]
    Gradient {
        /// The point, from 0.
        index: usize,
        /// The name of its value: `hu_per_mm` or `opacity`.
        what: &'static str,
        /// The value.
        found: f64,
        /// The permitted values.
        allowed: String,
    },
    /// The opacity unit is not a usable length.
    #[error("opacity unit is {0} mm, allowed: 0.000001 to 1000000")]
    Unit(f64),
}

impl TransferFunction {
    /// Most control points a transfer function may have.
    pub const MAX_POINTS: usize = 1024;

    /// A transfer function through `points`, whose opacities are per `opacity_unit_mm` of path.
    ///
    /// # Errors
    /// When there is no point or too many, HU values do not rise, or a value is outside its range.
    pub fn new(points: Vec<ControlPoint>, opacity_unit_mm: f64) -> Result<Self, TransferError> {
        if points.is_empty() || points.len() > Self::MAX_POINTS {
            return Err(TransferError::Count(points.len()));
        }
        if !(1e-6..=1e6).contains(&opacity_unit_mm) {
            return Err(TransferError::Unit(opacity_unit_mm));
        }
        for (index, point) in points.iter().enumerate() {
            check_point(index, point)?;
        }
        for (index, pair) in points.windows(2).enumerate() {
            if pair[1].hu <= pair[0].hu {
                let (found, previous) = (pair[1].hu, pair[0].hu);
                return Err(TransferError::Order { index: index + 1, found, previous });
            }
        }
        Ok(Self { points, opacity_unit_mm, gradient_opacity: None })
    }

    /// The same, with opacities multiplied by a function of the gradient's magnitude.
    #[must_use]
    pub fn with_gradient_opacity(self, gradient_opacity: GradientOpacity) -> Self {
        Self { gradient_opacity: Some(gradient_opacity), ..self }
    }

    /// The same look in a volume whose lengths are `scale` times as large: opacities are per a path
    /// that is longer by as much, and gradients are smaller.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        let gradient_opacity = self.gradient_opacity.map(|function| function.scaled(scale));
        Self { opacity_unit_mm: self.opacity_unit_mm * scale, gradient_opacity, ..self }
    }

    /// The factor of opacities, where there is one.
    #[must_use]
    pub fn gradient_opacity(&self) -> Option<&GradientOpacity> {
        self.gradient_opacity.as_ref()
    }

    /// The control points, HU rising.
    #[must_use]
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }

    /// Path length that the opacities refer to, mm.
    #[must_use]
    pub fn opacity_unit_mm(&self) -> f64 {
        self.opacity_unit_mm
    }

    /// Colour and opacity (per opacity unit) at a value.
    #[must_use]
    pub fn at(&self, hu: f64) -> [f64; 4] {
        let next = self.points.partition_point(|point| point.hu <= hu);
        let (Some(low), Some(high)) = (next.checked_sub(1).map(|i| self.points[i]), self.points.get(next))
        else {
            return self.points[next.saturating_sub(1)].rgba;
        };
        let f = (hu - low.hu) / (high.hu - low.hu);
        std::array::from_fn(|c| low.rgba[c] + f * (high.rgba[c] - low.rgba[c]))
    }

    /// Opacity of a path of `step_mm` at a value: `1 - (1 - a)^(step / unit)`.
    #[must_use]
    pub fn opacity_over(&self, hu: f64, step_mm: f64) -> f64 {
        1.0 - (1.0 - self.at(hu)[3]).powf(step_mm / self.opacity_unit_mm)
    }
}

fn check_point(index: usize, point: &ControlPoint) -> Result<(), TransferError> {
    let fail = |what, found, allowed| Err(TransferError::Value { index, what, found, allowed });
    if !(-1e5..=1e5).contains(&point.hu) {
        return fail("HU", point.hu, "-100000 to 100000");
    }
    for (what, value) in ["red", "green", "blue", "opacity"].into_iter().zip(point.rgba) {
        if !(0.0..=1.0).contains(&value) {
            return fail(what, value, "0 to 1");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(hu: f64, opacity: f64) -> ControlPoint {
        ControlPoint { hu, rgba: [1.0, 0.5, 0.0, opacity] }
    }

    #[test]
    fn interpolates_between_points_and_holds_beyond_them() {
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(100.0, 0.5)], 1.0).unwrap();
        for (hu, opacity) in [(-50.0, 0.0), (0.0, 0.0), (25.0, 0.125), (100.0, 0.5), (900.0, 0.5)] {
            assert!((transfer.at(hu)[3] - opacity).abs() < 1e-12, "{hu} HU");
        }
    }

    #[test]
    fn two_half_steps_absorb_as_much_as_one_whole() {
        let transfer = TransferFunction::new(vec![point(0.0, 0.36)], 2.0).unwrap();
        let half = transfer.opacity_over(0.0, 1.0);
        assert!((1.0 - (1.0 - half).powi(2) - 0.36).abs() < 1e-12);
    }

    #[test]
    fn bad_points_are_named_with_value_and_range() {
        let refused = |points| TransferFunction::new(points, 1.0).unwrap_err().to_string();
        assert!(refused(vec![]).starts_with("0 control points, allowed: 1 to"));
        assert!(
            refused(vec![point(5.0, 0.1), point(5.0, 0.1)])
                .contains("point 1 is at 5 HU, allowed: above 5 HU")
        );
        assert!(refused(vec![point(5.0, 1.5)]).contains("opacity is 1.5, allowed: 0 to 1"));
        assert!(refused(vec![point(f64::NAN, 0.5)]).contains("HU is NaN"));
        assert!(TransferFunction::new(vec![point(0.0, 0.0)], 0.0).is_err());
    }
}
