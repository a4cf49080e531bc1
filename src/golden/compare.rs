//! The difference of two pictures, and its comparison with a tolerance.
//!
//! Colour is measured in steps of 1/255 per channel, coverage being the fourth; depth in mm of view
//! depth. Pixels that are hit in one picture and missed in the other are counted apart from
//! distances. NaN, `-inf` and depths behind the eye are defects of the picture itself, whatever the
//! other has there.

use serde::Serialize;

use super::raster::{Raster, Samples};

/// Largest permitted difference of pictures. Only these named ones exist.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tolerance {
    /// Its name.
    pub name: &'static str,
    /// Most steps of 1/255 by which a channel may differ.
    pub color_steps: u8,
    /// Share of pixels whose colour may differ at all.
    pub differing_share: f64,
    /// Most mm by which a depth may differ.
    pub depth_mm: f64,
    /// Share of pixels that may differ by more than that, in colour or in depth, or be hit in one
    /// picture only.
    pub outlier_share: f64,
}

impl Tolerance {
    /// Not one bit may differ.
    pub const EXACT: Self =
        Self { name: "exact", color_steps: 0, differing_share: 0.0, depth_mm: 0.0, outlier_share: 0.0 };

    /// The same renderer on another CPU: rounding may move a few pixels by one step, and depth by
    /// what 32 bits hold.
    pub const STRICT: Self =
        Self { name: "strict", color_steps: 1, differing_share: 0.001, depth_mm: 0.01, outlier_share: 0.0 };

    /// A renderer in 32 bits against its twin in 64: rounding moves a sample across an edge now and
    /// then.
    pub const TWIN: Self =
        Self { name: "twin", color_steps: 1, differing_share: 1.0, depth_mm: 0.05, outlier_share: 0.001 };
}

/// The result of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The measured differences.
    pub difference: Difference,
    /// The limits that were exceeded; empty when the pictures are close enough.
    pub mismatches: Vec<Mismatch>,
}

impl Comparison {
    /// Whether not one bit differs.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        match &self.difference {
            Difference::Size { .. } => false,
            Difference::Color(color) => color.differing == 0,
            Difference::Depth(depth) => depth.differing == 0 && depth.invalid == 0,
        }
    }
}

/// The difference of two pictures.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Difference {
    /// Their sizes or kinds differ: nothing else was measured.
    Size {
        /// Width and height of the expected picture.
        expected_px: [u32; 2],
        /// Width and height of the other.
        actual_px: [u32; 2],
    },
    /// Two pictures in colour.
    Color(ColorDifference),
    /// Two depths.
    Depth(DepthDifference),
}

/// The difference of two pictures in colour.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ColorDifference {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that differ at all.
    pub differing: usize,
    /// Pixels with a channel that differs by more than the tolerance.
    pub outliers: usize,
    /// Most steps of 1/255 by which a channel differs.
    pub max_steps: u8,
    /// Mean difference of all channels of all pixels, steps of 1/255.
    pub mean_steps: f64,
    /// Column and row of the pixel that differs most.
    pub worst_at: [usize; 2],
}

/// The difference of two depths.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DepthDifference {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that differ at all.
    pub differing: usize,
    /// Pixels hit in both whose depths differ by more than the tolerance.
    pub outliers: usize,
    /// Pixels hit in one picture and missed in the other.
    pub hit_mismatches: usize,
    /// Pixels that are no depth in one of the pictures.
    pub invalid: usize,
    /// Most mm by which depths differ where both are hit.
    pub max_mm: f64,
    /// Root mean square of that difference, mm.
    pub rms_mm: f64,
    /// Column and row of the pixel that differs most.
    pub worst_at: [usize; 2],
}

/// Something that a tolerance does not allow.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// Pictures of different sizes.
    #[error("it is {}x{}, expected {}x{}", actual_px[0], actual_px[1], expected_px[0], expected_px[1])]
    Size {
        /// Width and height that were expected.
        expected_px: [u32; 2],
        /// Width and height found.
        actual_px: [u32; 2],
    },
    /// Colours too far apart.
    #[error(
        "{found} of {pixels} pixels differ by more than {steps}/255, allowed: {allowed}; \
         the most by {max_steps}/255 at column {}, row {}",
        at[0], at[1]
    )]
    ColorOutliers {
        /// Pixels beyond the tolerance.
        found: usize,
        /// Pixels compared.
        pixels: usize,
        /// Pixels that may be.
        allowed: usize,
        /// The tolerance.
        steps: u8,
        /// The largest difference.
        max_steps: u8,
        /// The pixel of that difference.
        at: [usize; 2],
    },
    /// Too many colours differ, if only a little.
    #[error("{found} of {pixels} pixels differ (the most by {max_steps}/255), allowed: {allowed}")]
    ColorCount {
        /// Pixels that differ.
        found: usize,
        /// Pixels compared.
        pixels: usize,
        /// Pixels that may.
        allowed: usize,
        /// The largest difference.
        max_steps: u8,
    },
    /// Depths too far apart.
    #[error(
        "{found} of {pixels} depths differ by more than {depth_mm} mm, allowed: {allowed}; \
         the most by {max_mm:.4} mm at column {}, row {}",
        at[0], at[1]
    )]
    DepthOutliers {
        /// Pixels beyond the tolerance.
        found: usize,
        /// Pixels compared.
        pixels: usize,
        /// Pixels that may be.
        allowed: usize,
        /// The tolerance.
        depth_mm: f64,
        /// The largest difference.
        max_mm: f64,
        /// The pixel of that difference.
        at: [usize; 2],
    },
    /// Silhouettes that differ.
    #[error("{found} of {pixels} pixels are hit in one picture and missed in the other, allowed: {allowed}")]
    Hits {
        /// Pixels hit in one picture only.
        found: usize,
        /// Pixels compared.
        pixels: usize,
        /// Pixels that may be.
        allowed: usize,
    },
    /// Values that are no depth.
    #[error("{found} of {pixels} depths are NaN, -inf or behind the eye, allowed: 0")]
    Invalid {
        /// Pixels without a depth in one of the pictures.
        found: usize,
        /// Pixels compared.
        pixels: usize,
    },
}

impl Serialize for Mismatch {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Compares two pictures pixel by pixel.
#[must_use]
pub fn compare(expected: &Raster, actual: &Raster, tolerance: &Tolerance) -> Comparison {
    let (expected_px, actual_px) = (expected.size_px, actual.size_px);
    let same_size = expected_px == actual_px && expected.pixels() == actual.pixels();
    match (&expected.samples, &actual.samples) {
        (Samples::Color(a), Samples::Color(b)) if same_size => {
            let difference = color_difference(expected, a, b, tolerance);
            Comparison {
                mismatches: difference.mismatches(tolerance),
                difference: Difference::Color(difference),
            }
        }
        (Samples::DepthMm(a), Samples::DepthMm(b)) if same_size => {
            let difference = depth_difference(expected, a, b, tolerance);
            Comparison {
                mismatches: difference.mismatches(tolerance),
                difference: Difference::Depth(difference),
            }
        }
        _ => Comparison {
            difference: Difference::Size { expected_px, actual_px },
            mismatches: vec![Mismatch::Size { expected_px, actual_px }],
        },
    }
}

/// Whether a value can be a view depth: a miss, or a distance in front of the eye.
pub(super) fn is_depth(mm: f32) -> bool {
    mm >= 0.0
}

fn color_difference(
    place: &Raster,
    expected: &[[u8; 4]],
    actual: &[[u8; 4]],
    tolerance: &Tolerance,
) -> ColorDifference {
    let mut found = ColorDifference { pixels: expected.len(), ..Default::default() };
    let mut sum = 0u64;
    for (index, (a, b)) in expected.iter().zip(actual).enumerate() {
        let steps: [u8; 4] = std::array::from_fn(|channel| a[channel].abs_diff(b[channel]));
        let most = steps.into_iter().fold(0, u8::max);
        sum += steps.into_iter().map(u64::from).sum::<u64>();
        found.differing += usize::from(most > 0);
        found.outliers += usize::from(most > tolerance.color_steps);
        if most > found.max_steps {
            (found.max_steps, found.worst_at) = (most, place.position(index));
        }
    }
    found.mean_steps = sum as f64 / (4 * found.pixels.max(1)) as f64;
    found
}

fn depth_difference(
    place: &Raster,
    expected: &[f32],
    actual: &[f32],
    tolerance: &Tolerance,
) -> DepthDifference {
    let mut found = DepthDifference { pixels: expected.len(), ..Default::default() };
    let (mut squares, mut both_hit) = (0.0, 0usize);
    for (index, (&a, &b)) in expected.iter().zip(actual).enumerate() {
        found.differing += usize::from(a.to_bits() != b.to_bits());
        match (is_depth(a) && is_depth(b), a.is_finite(), b.is_finite()) {
            (false, ..) => found.invalid += 1,
            (true, true, true) => {
                let apart = (f64::from(a) - f64::from(b)).abs();
                squares += apart * apart;
                both_hit += 1;
                found.outliers += usize::from(apart > tolerance.depth_mm);
                if apart > found.max_mm {
                    (found.max_mm, found.worst_at) = (apart, place.position(index));
                }
            }
            (true, in_expected, in_actual) => found.hit_mismatches += usize::from(in_expected != in_actual),
        }
    }
    found.rms_mm = (squares / both_hit.max(1) as f64).sqrt();
    found
}

/// Whole pixels of a share.
fn allowed(pixels: usize, share: f64) -> usize {
    (pixels as f64 * share) as usize
}

impl ColorDifference {
    fn mismatches(&self, tolerance: &Tolerance) -> Vec<Mismatch> {
        let &Self { pixels, differing, outliers, max_steps, worst_at, .. } = self;
        let may_stray = allowed(pixels, tolerance.outlier_share);
        let may_differ = allowed(pixels, tolerance.differing_share);
        let mut mismatches = Vec::new();
        if outliers > may_stray {
            let (allowed, steps, at) = (may_stray, tolerance.color_steps, worst_at);
            mismatches.push(Mismatch::ColorOutliers {
                found: outliers,
                pixels,
                allowed,
                steps,
                max_steps,
                at,
            });
        }
        if differing > may_differ {
            mismatches.push(Mismatch::ColorCount {
                found: differing,
                pixels,
                allowed: may_differ,
                max_steps,
            });
        }
        mismatches
    }
}

impl DepthDifference {
    fn mismatches(&self, tolerance: &Tolerance) -> Vec<Mismatch> {
        let &Self { pixels, outliers, hit_mismatches, invalid, max_mm, worst_at, .. } = self;
        let allowed = allowed(pixels, tolerance.outlier_share);
        let mut mismatches = Vec::new();
        if invalid > 0 {
            mismatches.push(Mismatch::Invalid { found: invalid, pixels });
        }
        if hit_mismatches > allowed {
            mismatches.push(Mismatch::Hits { found: hit_mismatches, pixels, allowed });
        }
        if outliers > allowed {
            let (depth_mm, at) = (tolerance.depth_mm, worst_at);
            mismatches.push(Mismatch::DepthOutliers {
                found: outliers,
                pixels,
                allowed,
                depth_mm,
                max_mm,
                at,
            });
        }
        mismatches
    }
}
