//! The smoothed field at the voxels around a place: where edges and extremes are looked for first.

use glam::DVec3;

use super::SnapError;
use super::field::{Field, expect_few_voxels, taps};

/// A box of voxels around a ball, with two more voxels on each side where there are any.
pub(super) struct Lattice {
    /// The first voxel.
    first: [usize; 3],
    dims: [usize; 3],
    /// Dimensions of the volume.
    whole: [usize; 3],
    /// Smoothed values, x fastest.
    values: Vec<f64>,
}

impl Lattice {
    /// The voxels of a ball; `None` where it is outside of the volume.
    ///
    /// # Errors
    /// When it holds too many.
    pub(super) fn around(field: &Field<'_>, at: DVec3, radius_mm: f64) -> Result<Option<Self>, SnapError> {
        let Some(ends) = field.voxels_around(at, radius_mm, 2.0) else { return Ok(None) };
        let (first, dims) = (ends.map(|[low, _]| low), ends.map(|[low, high]| high + 1 - low));
        expect_few_voxels(dims, radius_mm)?;
        let whole = field.volume.grid().dims();
        Ok(Some(Self { first, dims, whole, values: smoothed(field, first, dims) }))
    }

    /// Whether all voxels beside a place are here, but those that the volume does not have.
    pub(super) fn knows_around(&self, place: [usize; 3]) -> bool {
        (0..3).all(|axis| {
            let index = self.first[axis] + place[axis];
            (place[axis] > 0 || index == 0)
                && (place[axis] + 1 < self.dims[axis] || index + 1 == self.whole[axis])
        })
    }

    /// Every voxel of the box, as (place in it, index in the volume).
    pub(super) fn voxels(&self) -> impl Iterator<Item = ([usize; 3], DVec3)> + '_ {
        let [nx, ny, nz] = self.dims;
        let places = (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
        places.map(|place| {
            (place, DVec3::from(std::array::from_fn(|axis| (self.first[axis] + place[axis]) as f64)))
        })
    }

    pub(super) fn value(&self, [i, j, k]: [usize; 3]) -> f64 {
        self.values[(k * self.dims[1] + j) * self.dims[0] + i]
    }

    /// The places beside one, up to 26.
    pub(super) fn neighbours(&self, place: [usize; 3]) -> impl Iterator<Item = [usize; 3]> + '_ {
        (0..27usize).filter(|&code| code != 13).filter_map(move |code| {
            let offset = [code % 3, code / 3 % 3, code / 9];
            let mut beside = [0; 3];
            for axis in 0..3 {
                beside[axis] = (place[axis] + offset[axis]).checked_sub(1)?;
                if beside[axis] >= self.dims[axis] {
                    return None;
                }
            }
            Some(beside)
        })
    }

    /// The place a whole step away along each axis, where it is here.
    pub(super) fn beside(&self, place: [usize; 3], step: DVec3) -> Option<[usize; 3]> {
        let mut beside = place;
        for (axis, step) in step.to_array().into_iter().enumerate() {
            beside[axis] = place[axis].checked_add_signed(step as isize)?;
            if beside[axis] >= self.dims[axis] {
                return None;
            }
        }
        Some(beside)
    }

    /// Differences along the voxel axes, per voxel; one-sided at the faces.
    pub(super) fn differences(&self, place: [usize; 3]) -> DVec3 {
        let along = |axis: usize| {
            let (mut before, mut after) = (place, place);
            before[axis] = place[axis].saturating_sub(1);
            after[axis] = (place[axis] + 1).min(self.dims[axis] - 1);
            let steps = (after[axis] - before[axis]).max(1) as f64;
            (self.value(after) - self.value(before)) / steps
        };
        DVec3::new(along(0), along(1), along(2))
    }
}

/// One axis after the other: x over all rows that are needed, then y, then z.
fn smoothed(field: &Field<'_>, first: [usize; 3], dims: [usize; 3]) -> Vec<f64> {
    let counts = field.volume.grid().dims();
    let kernels = field.sigma.map(taps);
    // The voxels that each axis needs, its reach included; the outermost ones stand for those
    // beyond.
    let needed: [Vec<usize>; 3] = std::array::from_fn(|axis| {
        let reach = kernels[axis].len() / 2;
        let index = |at: usize| (first[axis] + at).saturating_sub(reach).min(counts[axis] - 1);
        (0..dims[axis] + 2 * reach).map(index).collect()
    });
    let voxels_hu = field.volume.voxels_hu();
    let [rows, planes] = [needed[1].len(), needed[2].len()];
    let mut by_x = Vec::with_capacity(dims[0] * rows * planes);
    for &k in &needed[2] {
        for &j in &needed[1] {
            let row = &voxels_hu[(k * counts[1] + j) * counts[0]..][..counts[0]];
            by_x.extend((0..dims[0]).map(|i| -> f64 {
                kernels[0].iter().zip(&needed[0][i..]).map(|(tap, &at)| tap * f64::from(row[at])).sum()
            }));
        }
    }
    let by_y = along(&by_x, [dims[0], rows, planes], dims[1], &kernels[1]);
    along(&by_y, [dims[0] * dims[1], planes, 1], dims[2], &kernels[2])
}

/// Smooths the middle one of three axes, `size[0]` values lying together; it has `count` values
/// afterwards.
fn along(values: &[f64], size: [usize; 3], count: usize, kernel: &[f64]) -> Vec<f64> {
    let [run, length, planes] = size;
    let mut out = vec![0.0; run * count * planes];
    for plane in 0..planes {
        for at in 0..count {
            let sum = &mut out[(plane * count + at) * run..][..run];
            for (tap, from) in kernel.iter().zip(at..) {
                let line = &values[(plane * length + from) * run..][..run];
                sum.iter_mut().zip(line).for_each(|(sum, value)| *sum += tap * value);
            }
        }
    }
    out
}
