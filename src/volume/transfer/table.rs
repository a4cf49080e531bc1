//! A transfer function tabulated for one sample distance. The shaders and their f64 twin look it
//! up.

use super::{GradientTable, IntegralTable, TransferFunction};

/// Colour and step-corrected opacity at equidistant HU values, linear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferTable {
    /// HU of entry 0.
    pub first_hu: f32,
    /// HU from one entry to the next: a power of two, at least [`TransferTable::FINEST_STEP_HU`].
    pub step_hu: f32,
    /// Red, green, blue and the opacity of one sample; where there is opacity by gradient, that of
    /// one opacity unit.
    pub entries: Vec<[f32; 4]>,
    /// The factor that opacities are still to be multiplied by.
    pub gradient: Option<GradientTable>,
    /// For pre-integrated classification.
    pub integral: Option<IntegralTable>,
    /// The number of visible entries before each, and of all.
    visible_before: Vec<u32>,
}

impl TransferTable {
    /// Most entries of a table: 4096 of 16 bytes stay in a processor's first caches.
    pub const MAX_ENTRIES: usize = 4096;

    /// The step of functions that span up to 255 HU; wider ones have coarser steps, 1 HU up to 4095
    /// HU.
    pub const FINEST_STEP_HU: f64 = 1.0 / 16.0;

    /// The table of `transfer` for samples that each stand for `step_mm` of path.
    ///
    /// Entries lie at multiples of the step from a whole HU on, so control points at whole HU are
    /// met exactly while all points span at most 4095 HU.
    #[must_use]
    pub fn new(transfer: &TransferFunction, step_mm: f64) -> Self {
        Self::within(transfer, step_mm, Self::MAX_ENTRIES)
    }

    /// As [`TransferTable::new`], with the tables of pre-integrated classification beside; both
    /// have half the room.
    #[must_use]
    pub fn integrated(transfer: &TransferFunction, step_mm: f64) -> Self {
        let table = Self::within(transfer, step_mm, Self::MAX_ENTRIES / 2);
        Self { integral: Some(IntegralTable::new(&table.entries, table.step_hu)), ..table }
    }

    /// As [`TransferTable::new`], with at most `most` entries, 64 to
    /// [`TransferTable::MAX_ENTRIES`]: for tables that share a buffer. A function with opacity by
    /// gradient takes 1025 of them beside.
    ///
    /// # Panics
    /// When `most` leaves no room.
    #[must_use]
    pub fn within(transfer: &TransferFunction, step_mm: f64, most: usize) -> Self {
        let points = transfer.points();
        let (first, last) = (points[0].hu.floor(), points[points.len() - 1].hu.ceil());
        // The table of opacity by gradient lies behind, within the same limit.
        let behind = if transfer.gradient_opacity().is_some() { GradientTable::ENTRIES + 1 } else { 0 };
        let needed = (last - first) / (most - behind - 1) as f64;
        let step = needed.log2().ceil().exp2().max(Self::FINEST_STEP_HU);
        let count = ((last - first) / step).ceil() as usize + 1;
        let path_units = step_mm / transfer.opacity_unit_mm();
        let gradient = transfer.gradient_opacity().map(|opacity| GradientTable::new(opacity, path_units));
        let entry = |i: usize| {
            let hu = first + i as f64 * step;
            let [r, g, b, opacity] = transfer.at(hu);
            // The path comes after the product with the gradient's opacity.
            let opacity = if gradient.is_some() { opacity } else { 1.0 - (1.0 - opacity).powf(path_units) };
            [r, g, b, opacity].map(|value| value as f32)
        };
        // Two entries at least, so that an interpolated look-up always has a neighbour.
        let entries: Vec<_> = (0..count.max(2)).map(entry).collect();
        let mut visible_before = vec![0];
        visible_before.extend(entries.iter().scan(0, |count, entry| {
            *count += u32::from(entry[3] > 0.0);
            Some(*count)
        }));
        Self {
            first_hu: first as f32,
            step_hu: step as f32,
            entries,
            gradient,
            integral: None,
            visible_before,
        }
    }

    /// The content of the shader's buffer: the entries, followed by the integrals, one for each
    /// entry, or by the table of opacity by gradient, whose first entry holds its two numbers.
    #[must_use]
    pub fn buffer(&self) -> Vec<[f32; 4]> {
        let head = self.gradient.iter().map(|table| [table.entries_per_hu_mm, table.path_units, 0.0, 0.0]);
        let opacities = self.gradient.iter().flat_map(|table| &table.entries);
        let behind = head.chain(opacities.map(|opacity| [*opacity, 0.0, 0.0, 0.0]));
        let integrals = self.integral.iter().flat_map(|table| &table.entries).copied();
        self.entries.iter().copied().chain(integrals).chain(behind).collect()
    }

    /// Whether any value in `low_hu..=high_hu` is visible, judged by the entries that its look-up
    /// may touch.
    ///
    /// A little beyond the range, since sampling rounds: a skipped brick must not have shown
    /// anything.
    #[must_use]
    pub fn is_visible(&self, low_hu: f32, high_hu: f32) -> bool {
        const ROUNDING_HU: f32 = 0.5;
        // Positions are not negative: a conversion rounds down, and takes less time than `floor`.
        let (low, high) = (self.position(low_hu - ROUNDING_HU), self.position(high_hu + ROUNDING_HU));
        let above = high as usize + usize::from((high as usize as f32) < high);
        self.visible_before[above + 1] > self.visible_before[low as usize]
    }

    /// Opacity of a value, as the shader has it before any gradient.
    #[must_use]
    pub fn opacity(&self, hu: f32) -> f32 {
        let x = self.position(hu);
        let i = (x as usize).min(self.entries.len() - 2);
        let [low, high] = [i, i + 1].map(|i| self.entries[i][3]);
        low + (x - i as f32) * (high - low)
    }

    /// No value below this is visible, HU; the lowest number when even the lowest entry is, for it
    /// holds below the table.
    #[must_use]
    pub fn lowest_visible_hu(&self) -> f32 {
        // The entry before the first visible one: its look-up may touch that.
        match self.entries.iter().position(|entry| entry[3] > 0.0) {
            Some(0) => f32::MIN,
            Some(i) => self.first_hu + self.step_hu * (i - 1) as f32,
            None => f32::MAX,
        }
    }

    /// The place of a value between entries, as the shader has it.
    fn position(&self, hu: f32) -> f32 {
        ((hu - self.first_hu) / self.step_hu).clamp(0.0, (self.entries.len() - 1) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ControlPoint;
    use super::*;

    fn ramp(low: f64, high: f64) -> TransferFunction {
        let point = |hu, a| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, a] };
        TransferFunction::new(vec![point(low, 0.0), point(high, 0.5)], 1.0).unwrap()
    }

    #[test]
    fn entries_are_the_function_at_steps_from_a_whole_hu_on() {
        let transfer = ramp(100.0, 300.0);
        let table = TransferTable::new(&transfer, 0.5);
        assert_eq!((table.first_hu, table.step_hu, table.entries.len()), (100.0, 0.0625, 3201));
        for i in [0usize, 1, 77, 3200] {
            let expected = transfer.opacity_over(100.0 + i as f64 / 16.0, 0.5);
            assert!((f64::from(table.entries[i][3]) - expected).abs() < 1e-7, "entry {i}");
        }
    }

    #[test]
    fn a_wide_function_keeps_to_the_size_limit_and_covers_its_span() {
        let table = TransferTable::new(&ramp(-30000.0, 30000.0), 1.0);
        assert!(table.entries.len() <= TransferTable::MAX_ENTRIES);
        assert!(table.first_hu + table.step_hu * (table.entries.len() - 1) as f32 >= 30000.0);
    }

    #[test]
    fn tables_that_share_a_buffer_are_coarser_and_cover_the_same_span() {
        for most in [64, 200, 1000] {
            let table = TransferTable::within(&ramp(-1024.0, 3071.0), 1.0, most);
            assert!(table.entries.len() <= most, "{} of {most}", table.entries.len());
            assert_eq!(table.first_hu, -1024.0);
            assert!(table.first_hu + table.step_hu * (table.entries.len() - 1) as f32 >= 3071.0);
        }
    }

    #[test]
    fn the_whole_range_of_ct_has_an_entry_for_each_hu() {
        assert_eq!(TransferTable::new(&ramp(-1024.0, 3071.0), 1.0).step_hu, 1.0);
    }

    #[test]
    fn opacity_by_gradient_lies_behind_the_entries_within_the_same_limit() {
        let gradient = crate::transfer::GradientOpacity::new(vec![[0.0, 0.25], [511.5, 1.0]]).unwrap();
        let table = TransferTable::new(&ramp(-1024.0, 3071.0).with_gradient_opacity(gradient), 0.5);
        let buffer = table.buffer();
        assert!(buffer.len() <= TransferTable::MAX_ENTRIES, "{} entries", buffer.len());
        let last = table.entries.len() - 1;
        assert_eq!(table.entries[last][3], 0.5, "per opacity unit, not per sample");
        assert_eq!((buffer[last + 1], buffer[last + 2][0]), ([2.0, 0.5, 0.0, 0.0], 0.25));
        assert_eq!(buffer.len() - last, 2 + GradientTable::ENTRIES);
        assert_eq!(buffer[buffer.len() - 1][0], 1.0);
    }

    #[test]
    fn opacity_is_linear_between_entries_and_holds_beyond_them() {
        let table = TransferTable::new(&ramp(100.0, 300.0), 1.0);
        for (hu, opacity) in [(-9.0, 0.0), (100.0, 0.0), (200.03, 0.250_075), (300.0, 0.5), (4000.0, 0.5)] {
            assert!((table.opacity(hu) - opacity).abs() < 1e-6, "{hu} HU: {}", table.opacity(hu));
        }
    }

    #[test]
    fn visibility_is_conservative() {
        let table = TransferTable::new(&ramp(100.0, 300.0), 1.0);
        assert!(!table.is_visible(-1000.0, 99.0));
        assert!(table.is_visible(-1000.0, 100.0), "rounding may lift a sample above 100 HU");
        assert!(table.is_visible(-1000.0, 101.0));
        assert!(table.is_visible(2000.0, 3000.0), "the last point's opacity holds beyond it");
    }
}
