//! The voxels as fields over patient space: trilinear, and smoothed by a Gaussian with its
//! derivatives.

use glam::{DAffine3, DMat3, DVec3};

use super::error::SnapError;
use relief_base::OutOfRange;
use relief_volume::Volume;

/// Width of the Gaussian along each voxel axis: the geometric mean of the voxel's sides, but within
/// these limits, voxels. Above 0.8 the samples of a Gaussian add up to its integral within 1e-5,
/// wherever between voxels it stands.
const SIGMA_VOXELS: [f64; 2] = [0.8, 3.0];

/// The Gaussian is cut off at this many standard deviations.
const REACH: f64 = 4.0;

/// Most voxels of a neighbourhood: a ball of 20 mm in voxels of 0.25 mm.
const MOST_VOXELS: f64 = 4_500_000.0;

/// Values that a voxel may have: those of 16 bits.
const VALUES: usize = 1 << 16;

/// Refuses neighbourhoods of too many voxels, with the radius that would do.
///
/// # Errors
/// See above.
pub(super) fn expect_few_voxels(dims: [usize; 3], radius_mm: f64) -> Result<(), SnapError> {
    let count: f64 = dims.iter().map(|&count| count as f64).product();
    if count <= MOST_VOXELS {
        return Ok(());
    }
    let most = radius_mm * (MOST_VOXELS / count).cbrt() * 0.95;
    let allowed = format!("at most {most:.1} mm for voxels as fine as these");
    Err(OutOfRange::new("radius_mm", radius_mm, allowed).into())
}

/// The number of each value: whole HU, as voxels have them, so that nothing is lost.
#[derive(Debug, Default)]
pub(super) struct Histogram(Vec<u32>);

impl Histogram {
    /// The values that occur, rising, HU, and the number of times of each.
    pub(super) fn values(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let counted = (i16::MIN..=i16::MAX).zip(&self.0).filter(|(_, count)| **count > 0);
        counted.map(|(hu, &count)| (f64::from(hu), f64::from(count)))
    }
}

/// Values of a volume's voxels, at any index.
pub(super) struct Field<'a> {
    pub(super) volume: &'a Volume,
    pub(super) voxel_from_patient: DAffine3,
    pub(super) patient_from_voxel: DAffine3,
    /// Width of the Gaussian, voxels.
    pub(super) sigma: [f64; 3],
    /// The smallest distance between neighbouring voxels, mm.
    pub(super) spacing_mm: f64,
    /// The smallest width of the Gaussian, mm.
    pub(super) sigma_mm: f64,
}

/// The smoothed field at a place, in patient mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Smooth {
    pub(super) gradient: DVec3,
    pub(super) hessian: DMat3,
}

/// The Gaussian's samples along an axis, with first and second derivative, and the voxels that they
/// belong to.
struct Kernel {
    voxels: Vec<usize>,
    weights: Vec<[f64; 3]>,
}

impl<'a> Field<'a> {
    pub(super) fn new(volume: &'a Volume) -> Self {
        let grid = volume.grid();
        let spacing = grid.spacing_mm();
        let mean = spacing.iter().product::<f64>().cbrt();
        let sigma = spacing.map(|mm| (mean / mm).clamp(SIGMA_VOXELS[0], SIGMA_VOXELS[1]));
        let least = |a: f64, b: f64| a.min(b);
        Self {
            volume,
            voxel_from_patient: grid.voxel_from_patient().affine,
            patient_from_voxel: grid.patient_from_voxel().affine,
            sigma,
            spacing_mm: spacing.into_iter().fold(f64::INFINITY, least),
            sigma_mm: (0..3).map(|axis| sigma[axis] * spacing[axis]).fold(f64::INFINITY, least),
        }
    }

    /// The first and the last voxel along each axis of the box around a ball, and `more` voxels to
    /// each side; `None` where it is outside of the volume.
    pub(super) fn voxels_around(&self, at: DVec3, radius_mm: f64, more: f64) -> Option<[[usize; 2]; 3]> {
        let middle = self.voxel_from_patient.transform_point3(at).to_array();
        // Rows: how an index grows with each patient coordinate.
        let rows = self.voxel_from_patient.matrix3.transpose();
        let halves = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.length() * radius_mm + more);
        let mut ends = [[0; 2]; 3];
        for (axis, &count) in self.volume.grid().dims().iter().enumerate() {
            let last = count as f64 - 1.0;
            let (low, high) = ((middle[axis] - halves[axis]).floor(), (middle[axis] + halves[axis]).ceil());
            if high < 0.0 || low > last {
                return None;
            }
            ends[axis] = [low.max(0.0) as usize, high.min(last) as usize];
        }
        Some(ends)
    }

    /// The number of each value among the voxels whose centres lie in a ball: from the first
    /// value on, HU, one HU a place.
    ///
    /// # Errors
    /// When the box around the ball holds too many voxels.
    pub(super) fn histogram_within(&self, at: DVec3, radius_mm: f64) -> Result<Histogram, SnapError> {
        let Some([xs, ys, zs]) = self.voxels_around(at, radius_mm, 0.0) else {
            return Ok(Histogram::default());
        };
        expect_few_voxels([xs, ys, zs].map(|[low, high]| high + 1 - low), radius_mm)?;
        let mut counts = vec![0u32; VALUES];
        for k in zs[0]..=zs[1] {
            for j in ys[0]..=ys[1] {
                for i in xs[0]..=xs[1] {
                    let center = DVec3::new(i as f64, j as f64, k as f64);
                    if self.patient_from_voxel.transform_point3(center).distance(at) <= radius_mm {
                        counts[usize::from(self.volume.hu([i, j, k]).abs_diff(i16::MIN))] += 1;
                    }
                }
            }
        }
        Ok(Histogram(counts))
    }

    /// The trilinear value at a patient place, HU; beyond the outermost voxel centres it stays;
    /// `None` outside the volume's box.
    pub(super) fn value(&self, place: DVec3) -> Option<f64> {
        let index = self.voxel_from_patient.transform_point3(place).to_array();
        let dims = self.volume.grid().dims();
        let mut low = [0usize; 3];
        let mut share = [0.0; 3];
        for axis in 0..3 {
            let last = dims[axis] - 1;
            if !(-0.5..=last as f64 + 0.5).contains(&index[axis]) {
                return None;
            }
            let inside = index[axis].clamp(0.0, last as f64);
            low[axis] = (inside as usize).min(last.saturating_sub(1));
            share[axis] = inside - low[axis] as f64;
        }
        let mut sum = 0.0;
        for corner in 0..8usize {
            let bit = |axis: usize| corner >> axis & 1;
            let at: [usize; 3] = std::array::from_fn(|axis| (low[axis] + bit(axis)).min(dims[axis] - 1));
            let weight: f64 =
                (0..3).map(|axis| if bit(axis) == 1 { share[axis] } else { 1.0 - share[axis] }).product();
            sum += weight * f64::from(self.volume.hu(at));
        }
        Some(sum)
    }

    /// The trilinear field's slope by differences over half a voxel to each side, HU per mm; zero
    /// where it is not known.
    pub(super) fn slope(&self, place: DVec3) -> DVec3 {
        let half = self.spacing_mm / 2.0;
        let along = |axis: DVec3| {
            let ends = [place + axis * half, place - axis * half].map(|end| self.value(end));
            if let [Some(after), Some(before)] = ends { (after - before) / self.spacing_mm } else { 0.0 }
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// First and second derivatives of the smoothed field.
    pub(super) fn smooth(&self, place: DVec3) -> Smooth {
        let index = self.voxel_from_patient.transform_point3(place).to_array();
        let dims = self.volume.grid().dims();
        let [x, y, z] = [0, 1, 2].map(|axis| Kernel::new(index[axis], self.sigma[axis], dims[axis]));
        let voxels_hu = self.volume.voxels_hu();
        let (mut gradient, mut hessian) = (DVec3::ZERO, DMat3::ZERO);
        let [sum_x, sum_y, sum_z] = [&x, &y, &z].map(Kernel::sum);
        for (&k, &[z0, z1, z2]) in z.voxels.iter().zip(&z.weights) {
            let (mut plane, mut by_y, mut by_yy) = ([0.0; 3], [0.0; 2], 0.0);
            for (&j, &[y0, y1, y2]) in y.voxels.iter().zip(&y.weights) {
                let row = &voxels_hu[(k * dims[1] + j) * dims[0]..][..dims[0]];
                let mut along = [0.0; 3];
                for (&i, weights) in x.voxels.iter().zip(&x.weights) {
                    let hu = f64::from(row[i]);
                    for (sum, weight) in along.iter_mut().zip(weights) {
                        *sum += weight * hu;
                    }
                }
                for (sum, part) in plane.iter_mut().zip(along) {
                    *sum += y0 * part;
                }
                by_y[0] += y1 * along[0];
                by_y[1] += y1 * along[1];
                by_yy += y2 * along[0];
            }
            gradient += DVec3::new(z0 * plane[1], z0 * by_y[0], z1 * plane[0]);
            let (xy, xz, yz) = (z0 * by_y[1], z1 * plane[1], z1 * by_y[0]);
            hessian += DMat3::from_cols(
                DVec3::new(z0 * plane[2], xy, xz),
                DVec3::new(xy, z0 * by_yy, yz),
                DVec3::new(xz, yz, z2 * plane[0]),
            );
        }
        let share = 1.0 / (sum_x * sum_y * sum_z);
        let to_voxel = self.voxel_from_patient.matrix3;
        let from_voxel = to_voxel.transpose();
        Smooth { gradient: from_voxel * gradient * share, hessian: from_voxel * (hessian * share) * to_voxel }
    }
}

impl Kernel {
    fn new(index: f64, sigma: f64, count: usize) -> Self {
        let last = count as f64 - 1.0;
        // A place far outside has no field; the nearest one inside stands for it.
        let index = index.clamp(-1.0, last + 1.0);
        let reach = (REACH * sigma).ceil();
        let first = index.round() - reach;
        let mut kernel = Self { voxels: Vec::new(), weights: Vec::new() };
        for step in 0..=(2.0 * reach) as usize {
            let at = first + step as f64;
            let off = (at - index) / sigma;
            let weight = (-0.5 * off * off).exp();
            kernel.voxels.push(at.clamp(0.0, last) as usize);
            kernel.weights.push([weight, weight * off / sigma, weight * (off * off - 1.0) / (sigma * sigma)]);
        }
        kernel
    }

    fn sum(&self) -> f64 {
        self.weights.iter().map(|weights| weights[0]).sum()
    }
}

/// The Gaussian at whole voxels, from its middle outwards to both sides, adding up to 1.
pub(super) fn taps(sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma).ceil() as i32;
    let weights: Vec<f64> =
        (-reach..=reach).map(|off| (-0.5 * (f64::from(off) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}
