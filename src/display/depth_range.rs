//! Between which depths a frame's disparity is spread.
//!
//! Spaces: view depth in mm. A display has a fixed range of disparity; what lies outside of the
//! limits is as near or as far as these.

use serde::{Deserialize, Serialize};

use relief_base::DepthLimits;

/// The rule for depth limits where a request gives none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthRange {
    /// The visible surfaces of the picture: all but outliers use the whole range.
    #[default]
    Visible,
    /// The bounding sphere of the volume: steady while the camera circles.
    Volume,
}

impl DepthRange {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Visible, Self::Volume];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Visible => "visible",
            Self::Volume => "volume",
        }
    }
}

/// Share of the visible pixels that lie before the near limit at most, and beyond the far limit: a
/// wire in front, or a gap that shows the far side.
const OUTLIERS: f64 = 0.012;
/// Room beyond the surfaces, as a share of their extent.
const MARGIN: f64 = 0.025;
/// Smallest extent of limits, mm, and the largest share of the volume's extent that it is: noise of a
/// flat surface is no relief.
const LEAST_MM: f64 = 20.0;
const LEAST_SHARE: f64 = 0.2;
/// Surfaces within less have no depth, mm, or this share of the volume's extent: a slice.
const FLAT_MM: f64 = 0.5;
const FLAT_SHARE: f64 = 0.005;
/// Bins of the histogram.
const BINS: usize = 4096;

/// The limits of the visible surfaces: between percentiles of the depths of pixels, with a margin;
/// `None` where nothing is visible, or all of it at one depth. Depths that are not finite are those
/// of rays that hit nothing. `volume_mm` is the extent of the whole volume.
#[must_use]
pub fn visible_limits(
    depths_mm: &(impl Iterator<Item = f32> + Clone),
    volume_mm: f64,
) -> Option<DepthLimits> {
    let hits = || depths_mm.clone().filter(|depth| depth.is_finite());
    // Without branches on hits, which vary from pixel to pixel.
    let ends = |(low, high): (f32, f32), depth: f32| {
        let is_hit = depth.is_finite();
        (if is_hit & (depth < low) { depth } else { low }, if is_hit & (depth > high) { depth } else { high })
    };
    let (low, high) = depths_mm.clone().fold((f32::INFINITY, f32::NEG_INFINITY), ends);
    let (low, extent) = (f64::from(low), f64::from(high) - f64::from(low));
    if !extent.is_finite() || extent < FLAT_MM.min(FLAT_SHARE * volume_mm) {
        return None;
    }
    let mut counts = [0u64; BINS];
    let per_mm = BINS as f64 / extent;
    hits().for_each(|depth| counts[(((f64::from(depth) - low) * per_mm) as usize).min(BINS - 1)] += 1);
    let most = (OUTLIERS * counts.iter().sum::<u64>() as f64) as u64;
    let beyond = |counts: &mut dyn Iterator<Item = &u64>| {
        let mut sum = 0;
        counts
            .take_while(|count| {
                sum += **count;
                sum <= most
            })
            .count() as f64
            / per_mm
    };
    let near = low + beyond(&mut counts.iter());
    let far = low + extent - beyond(&mut counts.iter().rev());
    let least_mm = LEAST_MM.min(LEAST_SHARE * volume_mm);
    let room = (MARGIN * (far - near)).max((least_mm - (far - near)) / 2.0);
    DepthLimits::new((near - room).max(0.0), far + room)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_hold_the_surfaces_without_outliers() {
        // A slope from 500 to 700 mm, a wire at 300 mm in 0.3 % of the pixels, and background.
        let mut depths: Vec<f32> = (0..100_000).map(|i| 500.0 + i as f32 * 0.002).collect();
        depths.extend([300.0; 300]);
        depths.extend([f32::INFINITY; 50_000]);
        let found = visible_limits(&depths.iter().copied(), 400.0).unwrap();
        assert!((found.near_mm - 497.0).abs() < 1.0 && (found.far_mm - 702.0).abs() < 1.5, "{found:?}");
        let within = depths
            .iter()
            .filter(|d| d.is_finite() && f64::from(**d) >= found.near_mm && f64::from(**d) <= found.far_mm);
        assert!(within.count() as f64 > 0.99 * 100_300.0);
    }

    #[test]
    fn flat_pictures_have_no_limits_of_their_own_or_wide_ones() {
        assert_eq!(visible_limits(&std::iter::empty(), 400.0), None);
        assert_eq!(visible_limits(&[f32::INFINITY; 9].into_iter(), 400.0), None);
        assert_eq!(visible_limits(&[400.0; 9].into_iter(), 400.0), None);
        let wall: Vec<f32> = (0..1000).map(|i| 400.0 + i as f32 * 0.004).collect();
        let found = visible_limits(&wall.into_iter(), 400.0).unwrap();
        assert!((found.far_mm - found.near_mm - LEAST_MM).abs() < 0.1, "{found:?}");
        // The same in micro-CT, a thousandth as large.
        let wall: Vec<f32> = (0..1000).map(|i| 0.4 + i as f32 * 0.000_004).collect();
        let found = visible_limits(&wall.into_iter(), 0.1).unwrap();
        assert!((found.far_mm - found.near_mm - 0.02).abs() < 1e-4, "{found:?}");
    }
}
