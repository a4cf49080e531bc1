//! D of many depths at once: the same bytes as the curve itself, in a fraction of its time.
//!
//! Along depth D only falls, rounding included: scaling, the curve and the byte are monotone, step
//! by step. So there is a largest depth for each byte, found once by bisection over all numbers of
//! single precision; a depth then starts from the byte of its cell, and goes the few steps to its
//! own.

use crate::profile::DisplayProfile;
use relief_base::{DepthLimits, ViewDepth};

/// Cells between the limits: several for each byte, so that few steps are needed.
const CELLS: usize = 4096;

/// The disparity at the near side of each cell of depth, and the depths at which it changes.
pub(super) struct DisparityTable {
    near_mm: f32,
    cells_per_mm: f32,
    /// The byte at the near side of each cell.
    start: Vec<u8>,
    /// The largest depth that has this byte or a larger one, mm.
    last_mm: Vec<f32>,
    /// The byte of a miss.
    miss: u8,
}

impl DisparityTable {
    pub(super) fn new(profile: &DisplayProfile, limits: DepthLimits) -> Self {
        let byte = |mm: f32| profile.disparity(limits.scaled(ViewDepth(mm))).to_byte();
        let last_mm = (0..=255).map(|least| last_with(|mm| byte(mm) >= least)).collect();
        let cell_mm = (limits.far_mm - limits.near_mm) / CELLS as f64;
        let edge = |cell: usize| (limits.near_mm + cell as f64 * cell_mm) as f32;
        Self {
            near_mm: limits.near_mm as f32,
            cells_per_mm: (1.0 / cell_mm) as f32,
            start: (0..=CELLS).map(|cell| byte(edge(cell))).collect(),
            last_mm,
            miss: byte(f32::INFINITY),
        }
    }

    pub(super) fn byte(&self, mm: f32) -> u8 {
        if !mm.is_finite() {
            return self.miss;
        }
        let cell = ((mm - self.near_mm) * self.cells_per_mm) as usize;
        let mut byte = self.start[cell.min(CELLS)];
        while mm > self.last_mm[usize::from(byte)] {
            byte -= 1; // ends at 0 at the latest, which every depth has
        }
        while byte < u8::MAX && mm <= self.last_mm[usize::from(byte) + 1] {
            byte += 1;
        }
        byte
    }
}

/// The largest number of single precision for which `holds` is true, where it is true up to some
/// number and false beyond; infinite where it is true, or false, for all.
fn last_with(holds: impl Fn(f32) -> bool) -> f32 {
    if holds(f32::MAX) {
        return f32::INFINITY;
    }
    if !holds(f32::MIN) {
        return f32::NEG_INFINITY;
    }
    let (mut low, mut high) = (order(f32::MIN), order(f32::MAX));
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if holds(number(middle)) { low = middle } else { high = middle }
    }
    number(low)
}

/// Place of a finite number among all, rising with it.
fn order(number: f32) -> i64 {
    let bits = i64::from(number.to_bits() & 0x7FFF_FFFF);
    if number.is_sign_negative() { -bits } else { bits }
}

/// The number at a place.
fn number(order: i64) -> f32 {
    let magnitude = f32::from_bits(order.unsigned_abs() as u32);
    if order < 0 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ProfileName;

    fn check(profile: &DisplayProfile, limits: DepthLimits, mm: f32) {
        let table = DisparityTable::new(profile, limits);
        let expected = profile.disparity(limits.scaled(ViewDepth(mm))).to_byte();
        assert_eq!(table.byte(mm), expected, "{mm} mm between {limits:?}");
    }

    #[test]
    fn every_byte_is_that_of_the_curve_at_and_beside_its_steps() {
        for name in ProfileName::ALL {
            let profile = DisplayProfile::named(name);
            for (near, far) in [(400.0, 1300.0), (-50.0, 50.0), (1e-3, 2e-3), (999_999.0, 1e6), (0.0, 1e9)] {
                let limits = DepthLimits::new(near, far).unwrap();
                let table = DisparityTable::new(&profile, limits);
                let byte = |mm: f32| profile.disparity(limits.scaled(ViewDepth(mm))).to_byte();
                let beside = |mm: f32| [mm.next_down(), mm, mm.next_up()];
                for mm in table.last_mm.iter().copied().filter(|mm| mm.is_finite()).flat_map(beside) {
                    assert_eq!(table.byte(mm), byte(mm), "{mm} mm between {limits:?}");
                }
                for i in -1000..6000 {
                    let mm = (near + (far - near) * f64::from(i) / 5000.0) as f32;
                    assert_eq!(table.byte(mm), byte(mm), "{mm} mm between {limits:?}");
                }
                for mm in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::MAX, f32::MIN, 0.0, -0.0] {
                    assert_eq!(table.byte(mm), byte(mm), "{mm} mm between {limits:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn any_depth_has_the_byte_of_the_curve(
            near in -1e4f64..1e4, range in 1e-3f64..1e5, vz in 0.2f64..50.0, share in -0.5f64..1.5,
        ) {
            let constants = crate::DisparityConstants::from_viewing_distance(vz).unwrap();
            let profile = DisplayProfile::new([1920, 1080], [960, 540], constants).unwrap();
            let limits = DepthLimits::new(near, near + range).unwrap();
            check(&profile, limits, (near + share * range) as f32);
        }
    }
}
