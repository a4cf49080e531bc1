//! How points lie about where they should be: bias, sizes of errors, and the ellipsoid that holds
//! 95 % of them. LPS, mm.

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::quantile;

/// Errors of points: found less expected.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ErrorSummary {
    /// Their number.
    pub count: usize,
    /// Mean along L, P and S.
    pub bias_mm: [f64; 3],
    /// Standard deviation along L, P and S; missing for a single error.
    pub deviation_mm: Option<[f64; 3]>,
    /// Mean length.
    pub mean_mm: f64,
    /// Median length.
    pub median_mm: f64,
    /// 95th percentile of the lengths, interpolated between neighbours (type 7 of Hyndman and Fan,
    /// 1996).
    pub p95_mm: f64,
    /// Greatest length.
    pub max_mm: f64,
    /// Root of the mean square length.
    pub rms_mm: f64,
}

/// The region that holds 95 % of further points of the same kind, if they are normal.
///
/// With mean m and covariance S of n points these are all x with `(x-m)ᵀ S⁻¹ (x-m) <= 3 (n²-1) / (n
/// (n-3)) F(0.95; 3, n-3)`: V. Chew, "Confidence, prediction, and tolerance regions for the
/// multivariate normal distribution", JASA 61, 1966.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Ellipsoid {
    /// Its middle, along L, P and S.
    pub center_mm: [f64; 3],
    /// Halves of its axes, the longest first.
    pub semi_axes_mm: [f64; 3],
    /// Their directions along L, P and S: unit vectors.
    pub directions: [[f64; 3]; 3],
}

impl ErrorSummary {
    /// Of these errors; none of none.
    #[must_use]
    pub fn of(errors: &[DVec3]) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let count = errors.len();
        let n = count as f64;
        let bias = errors.iter().sum::<DVec3>() / n;
        let squares: DVec3 = errors.iter().map(|error| (error - bias).powf(2.0)).sum();
        let mut lengths: Vec<f64> = errors.iter().map(|error| error.length()).collect();
        lengths.sort_by(f64::total_cmp);
        Some(Self {
            count,
            bias_mm: bias.to_array(),
            deviation_mm: (count > 1).then(|| squares.to_array().map(|square| (square / (n - 1.0)).sqrt())),
            mean_mm: lengths.iter().sum::<f64>() / n,
            median_mm: percentile(&lengths, 0.5),
            p95_mm: percentile(&lengths, 0.95),
            max_mm: lengths[count - 1],
            rms_mm: (lengths.iter().map(|length| length * length).sum::<f64>() / n).sqrt(),
        })
    }
}

impl Ellipsoid {
    /// Fewest points that tell of all three directions and leave a degree of freedom.
    pub const FEWEST: usize = 4;

    /// Of these points; none of fewer than [`FEWEST`](Self::FEWEST).
    #[must_use]
    pub fn of(points: &[DVec3]) -> Option<Self> {
        let count = points.len();
        if count < Self::FEWEST {
            return None;
        }
        let n = count as f64;
        let mean = points.iter().sum::<DVec3>() / n;
        let covariance = points.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, point| {
            let from_mean = nalgebra::Vector3::from((point - mean).to_array());
            sum + from_mean * from_mean.transpose() / (n - 1.0)
        });
        let eigen = SymmetricEigen::new(covariance);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let size = 3.0 * (n * n - 1.0) / (n * (n - 3.0)) * quantile::f(0.95, 3.0, n - 3.0);
        Some(Self {
            center_mm: mean.to_array(),
            // Points in a plane have an eigenvalue of nothing, which rounding may leave below.
            semi_axes_mm: order.map(|at| (size * eigen.eigenvalues[at].max(0.0)).sqrt()),
            directions: order.map(|at| eigen.eigenvectors.column(at).into_owned().into()),
        })
    }
}

/// The value below which this share of the sorted values lies, interpolated.
fn percentile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    below + (above - below) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::super::tests::Normal;
    use super::*;

    #[test]
    fn a_summary_is_that_of_school() {
        let errors = [[3.0, 4.0, 0.0], [0.0, 0.0, 1.0], [-3.0, 0.0, 0.0], [0.0, 0.0, 3.0]].map(DVec3::from);
        let found = ErrorSummary::of(&errors).unwrap();
        assert_eq!((found.count, found.bias_mm, found.max_mm), (4, [0.0, 1.0, 1.0], 5.0));
        assert_eq!((found.mean_mm, found.median_mm, found.rms_mm), (3.0, 3.0, 11_f64.sqrt()));
        assert!((found.p95_mm - 4.7).abs() < 1e-12, "numpy.percentile([5, 1, 3, 3], 95) is 4.7: {found:?}");
        assert_eq!(found.deviation_mm, Some([6_f64.sqrt(), 2.0, 2_f64.sqrt()]));
        assert_eq!(ErrorSummary::of(&[]), None);
        assert_eq!(ErrorSummary::of(&errors[..1]).unwrap().deviation_mm, None);
    }

    /// Of normal points with known axes, 95 of 100 further ones are inside, and the axes are
    /// theirs.
    #[test]
    fn an_ellipsoid_holds_as_many_further_points_as_it_says() {
        let mut normal = Normal::new(5);
        let turn = glam::DQuat::from_rotation_z(0.5) * glam::DQuat::from_rotation_x(0.3);
        let mut point =
            || turn * (DVec3::new(normal.next(), normal.next(), normal.next()) * DVec3::new(3.0, 1.0, 0.3));
        let (mut inside, mut all) = (0, 0);
        for _ in 0..2000 {
            let ellipsoid = Ellipsoid::of(&(0..8).map(|_| point()).collect::<Vec<_>>()).unwrap();
            let from_middle = point() - DVec3::from(ellipsoid.center_mm);
            let share = |(axis, direction): (&f64, &[f64; 3])| {
                (from_middle.dot(DVec3::from(*direction)) / axis).powi(2)
            };
            let shares: f64 = ellipsoid.semi_axes_mm.iter().zip(&ellipsoid.directions).map(share).sum();
            inside += usize::from(shares <= 1.0);
            all += 1;
        }
        let share = f64::from(inside as u32) / f64::from(all);
        assert!((0.935..0.965).contains(&share), "{share}");
        let many = Ellipsoid::of(&(0..20_000).map(|_| point()).collect::<Vec<_>>()).unwrap();
        // With many points the square of the size is that of chi-squared with 3 degrees of freedom:
        // 7.8147.
        for (axis, deviation) in many.semi_axes_mm.iter().zip([3.0, 1.0, 0.3]) {
            assert!((axis / (deviation * 7.8147_f64.sqrt()) - 1.0).abs() < 0.03, "{many:?}");
        }
        let along = DVec3::from(many.directions[0]).dot(turn * DVec3::X).abs();
        assert!(along > 0.999, "{along}");
    }

    #[test]
    fn flat_and_few_points_make_no_nonsense() {
        assert_eq!(Ellipsoid::of(&[DVec3::ONE; 3]), None);
        let same = Ellipsoid::of(&[DVec3::ONE; 5]).unwrap();
        assert_eq!((same.center_mm, same.semi_axes_mm), ([1.0; 3], [0.0; 3]));
        let flat = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0], [1.0, 1.0, 2.0]].map(DVec3::from);
        let flat = Ellipsoid::of(&flat).unwrap();
        assert!(flat.semi_axes_mm[2].abs() < 1e-6 && flat.semi_axes_mm[1] > 1.0, "{flat:?}");
    }
}
