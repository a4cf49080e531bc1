//! A transfer function as a medium: linear colour and extinction per mm, for light that is followed
//! in linear terms.
//!
//! Opacity a per unit of path is an extinction of `-ln(1 - a) / unit`: after `d` mm,
//! `exp(-extinction d)` of the light remains. Between entries, colour and extinction are linear in
//! HU.

use super::{TransferFunction, TransferTable};

/// Colour and extinction at equidistant HU values.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumTable {
    /// HU of entry 0.
    pub first_hu: f32,
    /// HU from one entry to the next.
    pub step_hu: f32,
    /// Linear red, green, blue, and extinction per mm.
    pub entries: Vec<[f32; 4]>,
    /// `maxima[k][i]` is the largest extinction of the 2^k entries from i on.
    maxima: Vec<Vec<f32>>,
}

impl MediumTable {
    /// Largest extinction per unit of the volume: light passes a tenth of it on average. Denser
    /// material is clamped to it.
    pub const MAX_EXTINCTION: f64 = 10.0;

    /// The medium of a transfer function whose extinction is multiplied by `density`, in a volume of
    /// `volume_unit_mm` (see [`crate::Grid::unit_mm`]).
    #[must_use]
    pub fn new(transfer: &TransferFunction, density: f64, volume_unit_mm: f64) -> Self {
        let unit_mm = transfer.opacity_unit_mm();
        let largest = Self::MAX_EXTINCTION / volume_unit_mm;
        let TransferTable { first_hu, step_hu, entries, .. } = TransferTable::new(transfer, unit_mm);
        let entry = |i: usize| {
            let hu = f64::from(first_hu) + i as f64 * f64::from(step_hu);
            let [r, g, b, opacity] = transfer.at(hu);
            let extinction = -(-opacity).ln_1p() / unit_mm * density;
            let [r, g, b] = [r, g, b].map(linear_from_srgb);
            [r, g, b, extinction.min(largest)].map(|value| value as f32)
        };
        let entries: Vec<_> = (0..entries.len()).map(entry).collect();
        let maxima = maxima(entries.iter().map(|entry| entry[3]).collect());
        Self { first_hu, step_hu, entries, maxima }
    }

    /// The largest extinction per mm of any value in `low_hu..=high_hu`, by the entries that its
    /// look-up may touch.
    ///
    /// Slightly more than the range, since sampling rounds: no sample may be denser than this
    /// bound.
    #[must_use]
    pub fn largest_extinction(&self, low_hu: f32, high_hu: f32) -> f32 {
        const ROUNDING_HU: f32 = 0.05;
        let last = (self.entries.len() - 1) as f32;
        let position = |hu: f32| ((hu - self.first_hu) / self.step_hu).clamp(0.0, last);
        let low = position(low_hu - ROUNDING_HU).floor() as usize;
        let high = position(high_hu + ROUNDING_HU).ceil() as usize;
        let level = (high + 1 - low).ilog2() as usize;
        self.maxima[level][low].max(self.maxima[level][high + 1 - (1 << level)])
    }
}

/// Maxima of runs of 1, 2, 4, ... entries: two overlapping runs cover any range.
fn maxima(values: Vec<f32>) -> Vec<Vec<f32>> {
    let count = values.len();
    let mut levels = vec![values];
    let mut run = 1;
    while 2 * run <= count {
        let halves = &levels[levels.len() - 1];
        levels.push((0..=count - 2 * run).map(|i| halves[i].max(halves[i + run])).collect());
        run *= 2;
    }
    levels
}

/// Linear light of a display-referred sRGB value (IEC 61966-2-1), both 0..1.
#[must_use]
pub fn linear_from_srgb(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::super::ControlPoint;
    use super::*;

    fn transfer(points: &[(f64, f64)], unit_mm: f64) -> TransferFunction {
        let point = |&(hu, a): &(f64, f64)| ControlPoint { hu, rgba: [0.5, 1.0, 0.0, a] };
        TransferFunction::new(points.iter().map(point).collect(), unit_mm).unwrap()
    }

    #[test]
    fn opacity_over_a_length_becomes_extinction_per_mm() {
        let table = MediumTable::new(&transfer(&[(0.0, 0.0), (100.0, 0.36)], 2.0), 1.5, 1.0);
        let [r, g, b, extinction] = table.entries[table.entries.len() - 1];
        assert!((f64::from(extinction) - 1.5 * -(0.64f64.ln()) / 2.0).abs() < 1e-6);
        assert!((r - 0.214_041).abs() < 1e-5 && g == 1.0 && b == 0.0, "{r} {g} {b}");
    }

    #[test]
    fn opaque_material_has_the_largest_extinction() {
        let table = MediumTable::new(&transfer(&[(0.0, 1.0)], 1.0), 1.0, 1.0);
        assert_eq!(table.largest_extinction(-5.0, 5.0), 10.0);
        let micro = MediumTable::new(&transfer(&[(0.0, 1.0)], 0.01), 1.0, 0.01);
        assert_eq!(micro.largest_extinction(-5.0, 5.0), 1000.0);
    }

    #[test]
    fn no_value_in_a_range_exceeds_its_largest_extinction() {
        let points = [(-900.0, 0.0), (-300.0, 0.2), (0.0, 0.01), (50.0, 0.7), (60.0, 0.0), (1500.0, 0.4)];
        let function = transfer(&points, 1.0);
        let table = MediumTable::new(&function, 1.0, 1.0);
        for low in (-1000..1700).step_by(37) {
            for width in [0, 1, 9, 60, 700, 2500] {
                let bound = f64::from(table.largest_extinction(low as f32, (low + width) as f32));
                let inside = (low..=low + width).map(|hu| -(-function.at(f64::from(hu))[3]).ln_1p());
                let largest = inside.fold(0.0, f64::max);
                assert!(bound >= largest - 1e-6, "{low}..{}: {bound} for {largest}", low + width);
                let near = (low - 2..=low + width + 2).map(|hu| -(-function.at(f64::from(hu))[3]).ln_1p());
                assert!(bound <= near.fold(0.0, f64::max) + 1e-6, "{low}..{}: too loose", low + width);
            }
        }
    }
}
