//! Integrals of a transfer table over values: what pre-integrated classification looks up.
//!
//! Let a value change linearly from one end of a sample's path to the other. Then the path's
//! optical depth is the mean extinction of the values between, and its colour is their mean
//! weighted by extinction. Both means are differences of integrals over values (after Engel, Kraus
//! and Ertl, High-Quality Pre-Integrated Volume Rendering, 2001, whose table has two dimensions;
//! integrals need one). Attenuation within the path is not modelled.

use glam::DVec4;

/// The integral over values, in HU, up to each entry of a table: of colour times optical depth, and
/// of optical depth, both of one sample's path.
#[derive(Clone, Debug, PartialEq)]
pub struct IntegralTable {
    /// One for each entry of the table; linear between them.
    pub entries: Vec<[f32; 4]>,
}

impl IntegralTable {
    /// Optical depth of an opaque sample: what 1 - exp(-12) lacks is far below a byte, and sums
    /// keep their precision.
    pub const OPAQUE_DEPTH: f64 = 12.0;

    /// The integrals of a table: its entries, as [`TransferTable`](super::TransferTable) has them,
    /// and the HU from one to the next.
    #[must_use]
    pub(super) fn new(entries: &[[f32; 4]], step_hu: f32) -> Self {
        let weighted = |&[r, g, b, a]: &[f32; 4]| {
            DVec4::new(r.into(), g.into(), b.into(), 1.0) * optical_depth(f64::from(a))
        };
        let mut sum = DVec4::ZERO;
        let rest = entries.windows(2).map(|pair| {
            sum += 0.5 * f64::from(step_hu) * (weighted(&pair[0]) + weighted(&pair[1]));
            sum.as_vec4().to_array()
        });
        Self { entries: std::iter::once([0.0; 4]).chain(rest).collect() }
    }
}

/// Optical depth of a sample of this opacity.
fn optical_depth(opacity: f64) -> f64 {
    (-(1.0 - opacity).ln()).min(IntegralTable::OPAQUE_DEPTH)
}

#[cfg(test)]
mod tests {
    use super::super::{ControlPoint, TransferFunction, TransferTable};

    #[test]
    fn a_ramps_integral_is_that_of_its_extinction() {
        // Opacity 1 - exp(-x) over one unit, where x rises from 0 to 1 between 0 and 200 HU:
        // extinction x, but for the control points' straight lines between.
        let points = (0..=50).map(|i| {
            let x = f64::from(i) / 50.0;
            ControlPoint { hu: 4.0 * f64::from(i), rgba: [0.5, 1.0, x, 1.0 - (-x).exp()] }
        });
        let transfer = TransferFunction::new(points.collect(), 1.0).unwrap();
        let table = TransferTable::integrated(&transfer, 2.0);
        let integral = table.integral.as_ref().unwrap();
        assert_eq!(integral.entries.len(), table.entries.len());
        for hu in [0.0f32, 40.0, 100.0, 200.0] {
            let x = f64::from(hu) / 200.0;
            let found = integral.entries[(hu / table.step_hu) as usize].map(f64::from);
            // Twice the extinction, for samples of 2 mm: 2 x; its integral over HU is 200 x², of
            // colours accordingly.
            let expected = [100.0 * x * x, 200.0 * x * x, 400.0 / 3.0 * x * x * x, 200.0 * x * x];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 0.05, "{hu} HU: {found} for {expected}");
            }
        }
        assert!(table.buffer().len() <= TransferTable::MAX_ENTRIES);
    }

    #[test]
    fn opaque_values_have_a_finite_depth() {
        let transfer = TransferFunction::new(vec![ControlPoint { hu: 0.0, rgba: [1.0; 4] }], 1.0).unwrap();
        let table = TransferTable::integrated(&transfer, 1.0);
        let last = *table.integral.unwrap().entries.last().unwrap();
        assert_eq!(last[3], 12.0 * table.step_hu);
    }
}
