//! Opacity by gradient: surfaces stay, the even insides of things fade.
//!
//! A sample's opacity per opacity unit is that of its value times that of its gradient's magnitude,
//! HU per mm. The path that a sample stands for is corrected for after the product, so that
//! pictures do not depend on the sample distance.

use super::TransferError;

/// Piecewise linear opacity, 0..1, over the gradient's magnitude in HU per mm; constant beyond its
/// ends.
#[derive(Clone, Debug, PartialEq)]
pub struct GradientOpacity {
    points: Vec<[f64; 2]>,
}

impl GradientOpacity {
    /// Most points.
    pub const MAX_POINTS: usize = 256;

    /// A function through `points` of magnitude (HU per mm) and opacity.
    ///
    /// # Errors
    /// When there are no points or too many, magnitudes do not rise, or a value is outside
    /// its range.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, TransferError> {
        if points.is_empty() || points.len() > Self::MAX_POINTS {
            return Err(TransferError::GradientCount(points.len()));
        }
        let mut least = 0.0;
        for (index, &[hu_per_mm, opacity]) in points.iter().enumerate() {
            let fail = |what, found, allowed| Err(TransferError::Gradient { index, what, found, allowed });
            if !(0.0..=1e5).contains(&hu_per_mm) {
                return fail("hu_per_mm", hu_per_mm, "0 to 100000".to_owned());
            }
            if index > 0 && hu_per_mm <= least {
                return fail("hu_per_mm", hu_per_mm, format!("more than {least}, that of the point before"));
            }
            if !(0.0..=1.0).contains(&opacity) {
                return fail("opacity", opacity, "0 to 1".to_owned());
            }
            least = hu_per_mm;
        }
        Ok(Self { points })
    }

    /// The same in a volume whose lengths are `scale` times as large.
    pub(super) fn scaled(self, scale: f64) -> Self {
        Self {
            points: self
                .points
                .into_iter()
                .map(|[hu_per_mm, opacity]| [hu_per_mm / scale, opacity])
                .collect(),
        }
    }

    /// Magnitude, HU per mm, and opacity of each point.
    #[must_use]
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// Opacity at a magnitude.
    #[must_use]
    pub fn at(&self, hu_per_mm: f64) -> f64 {
        let next = self.points.partition_point(|[x, _]| *x <= hu_per_mm);
        match (next.checked_sub(1).map(|i| self.points[i]), self.points.get(next)) {
            (Some([x0, y0]), Some([x1, y1])) => y0 + (hu_per_mm - x0) / (x1 - x0) * (y1 - y0),
            (Some([_, end]), None) | (None, Some(&[_, end])) => end,
            (None, None) => 1.0,
        }
    }
}

/// The tabulated function, corrected for the length of a sample's path. Shaders and their twin look
/// it up.
#[derive(Clone, Debug, PartialEq)]
pub struct GradientTable {
    /// Entries per HU/mm.
    pub entries_per_hu_mm: f32,
    /// A sample's path in opacity units: the exponent of its transparency.
    pub path_units: f32,
    /// Opacity at equidistant magnitudes from 0 on, linear between them.
    pub entries: Vec<f32>,
}

impl GradientTable {
    /// Entries of every table. `GRADIENT_LAST` of `shaders/lib/gradient.wgsl` is one less.
    pub const ENTRIES: usize = 1024;

    /// The table of a function up to its last point, for samples that each stand for `path_units`
    /// opacity units.
    #[must_use]
    pub fn new(opacity: &GradientOpacity, path_units: f64) -> Self {
        let span = opacity.points[opacity.points.len() - 1][0].max(1.0);
        let per = (Self::ENTRIES - 1) as f64 / span;
        let entries = (0..Self::ENTRIES).map(|i| opacity.at(i as f64 / per) as f32).collect();
        Self { entries_per_hu_mm: per as f32, path_units: path_units as f32, entries }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_between_points_and_holds_beyond_them() {
        let opacity = GradientOpacity::new(vec![[10.0, 0.0], [30.0, 1.0], [50.0, 0.5]]).unwrap();
        for (hu_per_mm, expected) in
            [(0.0, 0.0), (10.0, 0.0), (20.0, 0.5), (30.0, 1.0), (40.0, 0.75), (900.0, 0.5)]
        {
            assert!((opacity.at(hu_per_mm) - expected).abs() < 1e-12, "{hu_per_mm} HU/mm");
        }
        let table = GradientTable::new(&opacity, 0.5);
        for hu_per_mm in [0.0f32, 12.5, 29.0, 44.4] {
            let x = hu_per_mm * table.entries_per_hu_mm;
            let i = x as usize;
            let found = table.entries[i] + (x - i as f32) * (table.entries[i + 1] - table.entries[i]);
            assert!((f64::from(found) - opacity.at(f64::from(hu_per_mm))).abs() < 2e-3, "{hu_per_mm} HU/mm");
        }
    }

    #[test]
    fn bad_points_are_named_with_value_and_range() {
        let refused = |points: &[[f64; 2]]| GradientOpacity::new(points.to_vec()).unwrap_err().to_string();
        assert!(refused(&[]).contains("0 points of opacity by gradient, allowed: 1 to 256"));
        assert!(refused(&[[5.0, 0.0], [5.0, 1.0]]).contains("more than 5"));
        assert!(refused(&[[-1.0, 0.0]]).contains("hu_per_mm is -1, allowed: 0 to 100000"));
        assert!(refused(&[[0.0, 1.5]]).contains("opacity is 1.5, allowed: 0 to 1"));
    }
}
