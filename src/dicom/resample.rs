//! Resampling of a sheared or unevenly spaced stack onto a regular grid.
//!
//! Rows and columns keep their directions and spacing; slices of the new grid are even along the
//! normal. Values are linear between the two slices around a point, each sampled bilinearly at its
//! true position; places that no slice covers get a value for "outside". A slice of the grid that
//! coincides with one of the stack, unshifted, is a copy.
//!
//! Spaces: heights and shifts as in [`stack`](super::stack), mm; pixels of the first slice's
//! lattice.

use glam::DVec3;
use rayon::prelude::*;

use super::error::Error;
use super::stack::Stack;

/// The new grid may have this many times the voxels that were read. Missing slices at most double a
/// stack, and a tilt of 45 degrees adds rows as long as the stack is high.
const GROWTH_LIMIT: u64 = 8;
/// Or this many, whatever was read: 128 MiB.
const ALWAYS_ALLOWED: u64 = 1 << 26;
/// Shifts this near to whole pixels and heights this near to slices are taken as such, so that
/// copies stay exact.
const SNAP: f64 = 1e-3;

/// The regular grid over a stack.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RegularGrid {
    pub(super) dims: [usize; 3],
    /// Distance between the new slices, mm.
    pub(super) slice_spacing_mm: f64,
    /// Columns and rows of the stack's own slices.
    slice_dims: [usize; 2],
    /// Pixels by which the grid begins before the first slice's first voxel, along i and j.
    before: [f64; 2],
}

impl RegularGrid {
    /// A grid that covers the stack, whose slices have `slice_dims` columns and rows.
    ///
    /// # Errors
    /// When it would be many times as large as the stack.
    pub(super) fn over(stack: &Stack, slice_dims: [usize; 2]) -> Result<Self, Error> {
        let [i, j] = [0, 1].map(|axis| shift_range(stack, axis));
        let steps = (stack.extent_mm() / stack.median_gap_mm()).round().max(1.0);
        let sizes = [slice_dims[0] as f64 + i.1 - i.0, slice_dims[1] as f64 + j.1 - j.0, steps + 1.0];
        check_growth(sizes, (slice_dims[0] * slice_dims[1] * stack.len()) as u64)?;
        let dims = sizes.map(|n| n as usize);
        Ok(Self { dims, slice_spacing_mm: stack.extent_mm() / steps, slice_dims, before: [-i.0, -j.0] })
    }

    /// Bytes of its voxels.
    pub(super) fn voxel_bytes(&self) -> u64 {
        (self.dims.iter().product::<usize>() * size_of::<i16>()) as u64 // bounded by `over`
    }

    /// Patient position of the grid's first voxel.
    pub(super) fn origin(&self, stack: &Stack) -> DVec3 {
        let [i, j] = [0, 1].map(|axis| self.before[axis] * stack.spacing_mm[axis]);
        stack.origin - stack.axes[0] * i - stack.axes[1] * j
    }

    /// Fills `target` with the stack's voxels `hu` on this grid.
    pub(super) fn resample(&self, stack: &Stack, hu: &[i16], outside_hu: i16, target: &mut [i16]) {
        let [nx, ny, _] = self.dims;
        target.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slice)| {
            let (below, above, weight) = neighbours(&stack.heights_mm, k as f64 * self.slice_spacing_mm);
            let (below, above) = (self.plane(stack, hu, below), self.plane(stack, hu, above));
            let outside = f32::from(outside_hu);
            for (y, row) in slice.chunks_exact_mut(nx).enumerate() {
                for (x, voxel) in row.iter_mut().enumerate() {
                    let low = below.value(x, y).unwrap_or(outside);
                    let high = if weight > 0.0 { above.value(x, y).unwrap_or(outside) } else { low };
                    let value = (low + (high - low) * weight).round() as i16;
                    *voxel = value;
                }
            }
        });
    }

    fn plane<'a>(&self, stack: &Stack, hu: &'a [i16], index: usize) -> Plane<'a> {
        let [columns, rows] = self.slice_dims;
        let [x, y] = [0, 1].map(|axis| {
            let pixels = -self.before[axis] - stack.shifts_mm[index][axis] / stack.spacing_mm[axis];
            if (pixels - pixels.round()).abs() < SNAP { pixels.round() } else { pixels }
        });
        let len = columns * rows;
        Plane { hu: &hu[index * len..][..len], columns, rows, x, y }
    }
}

/// Smallest and largest shift along an axis, in whole pixels that cover it; contains 0, the first
/// slice.
fn shift_range(stack: &Stack, axis: usize) -> (f64, f64) {
    let pixels = stack.shifts_mm.iter().map(|shift| shift[axis] / stack.spacing_mm[axis]);
    let (low, high) = pixels.fold((0.0, 0.0), |(low, high): (f64, f64), p| (low.min(p), high.max(p)));
    ((low + SNAP).floor().min(0.0), (high - SNAP).ceil().max(0.0))
}

fn check_growth(sizes: [f64; 3], given: u64) -> Result<(), Error> {
    let limit = given.saturating_mul(GROWTH_LIMIT).max(ALWAYS_ALLOWED);
    let needed = sizes.iter().product::<f64>();
    if needed > limit as f64 {
        return Err(Error::TooUneven { needed: needed as u64, given, limit });
    }
    Ok(())
}

/// The slices around a height and the weight of the upper one.
fn neighbours(heights_mm: &[f64], height_mm: f64) -> (usize, usize, f32) {
    let above = heights_mm.partition_point(|&h| h <= height_mm).clamp(1, heights_mm.len() - 1);
    let (low, high) = (heights_mm[above - 1], heights_mm[above]);
    let weight = ((height_mm - low) / (high - low)).clamp(0.0, 1.0);
    match weight {
        w if w < SNAP => (above - 1, above, 0.0),
        w if w > 1.0 - SNAP => (above, above, 0.0),
        w => (above - 1, above, w as f32),
    }
}

/// One slice of the stack, seen from the grid's pixels.
struct Plane<'a> {
    hu: &'a [i16],
    columns: usize,
    rows: usize,
    /// Column and row of this slice at the grid's pixel (0, 0).
    x: f64,
    y: f64,
}

impl Plane<'_> {
    /// The value at a pixel of the grid; `None` outside of the slice's outermost pixel faces.
    fn value(&self, x: usize, y: usize) -> Option<f32> {
        let (x0, x1, wx) = cell(x as f64 + self.x, self.columns)?;
        let (y0, y1, wy) = cell(y as f64 + self.y, self.rows)?;
        let at = |x: usize, y: usize| f32::from(self.hu[y * self.columns + x]);
        let low = at(x0, y0) + (at(x1, y0) - at(x0, y0)) * wx;
        let high = at(x0, y1) + (at(x1, y1) - at(x0, y1)) * wx;
        Some(low + (high - low) * wy)
    }
}

/// The two pixels around a coordinate among `count`, and the weight of the second.
fn cell(at: f64, count: usize) -> Option<(usize, usize, f32)> {
    let last = count as f64 - 1.0;
    if !(-0.5..=last + 0.5).contains(&at) {
        return None;
    }
    let at = at.clamp(0.0, last);
    let first = at as usize;
    Some((first, (first + 1).min(count - 1), (at - first as f64) as f32))
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    /// A stack of 1 mm pixels whose value is a linear function of the patient position.
    fn linear_stack(heights_mm: &[f64], shift_per_mm: f64) -> (Stack, Vec<i16>) {
        let stack = Stack {
            origin: DVec3::ZERO,
            axes: [DVec3::X, DVec3::Y, DVec3::Z],
            spacing_mm: [1.0, 1.0],
            heights_mm: heights_mm.to_vec(),
            shifts_mm: heights_mm.iter().map(|z| DVec2::new(0.0, z * shift_per_mm)).collect(),
        };
        let value = |x: f64, y: f64, z: f64| (10.0 * x + 20.0 * y + 40.0 * z) as i16;
        let mut hu = Vec::new();
        for (z, shift) in heights_mm.iter().zip(&stack.shifts_mm) {
            for y in 0..20 {
                hu.extend((0..8).map(|x| value(f64::from(x), f64::from(y) + shift.y, *z)));
            }
        }
        (stack, hu)
    }

    #[test]
    fn a_linear_function_survives_uneven_gaps_and_shear() {
        for (heights, shear) in [(vec![0.0, 1.0, 2.0, 4.0, 5.5], 0.0), (vec![0.0, 1.0, 2.0, 3.0, 4.0], 0.5)] {
            let (stack, hu) = linear_stack(&heights, shear);
            let grid = RegularGrid::over(&stack, [8, 20]).unwrap();
            let mut out = vec![0; grid.dims.iter().product()];
            grid.resample(&stack, &hu, i16::MIN, &mut out);
            let origin = grid.origin(&stack);
            let [nx, ny, _] = grid.dims;
            let mut inside = 0;
            for (index, &value) in out.iter().enumerate().filter(|(_, value)| **value > -1000) {
                let (x, y, k) = (index % nx, index / nx % ny, index / (nx * ny));
                let (y, z) = (origin.y + y as f64, k as f64 * grid.slice_spacing_mm);
                // Keep off the rows where a neighbour ends: there half a pixel repeats the edge.
                if y < shear * (z + 1.0) || y > 18.0 + shear * (z - 1.0) {
                    continue;
                }
                let expected = 10.0 * x as f64 + 20.0 * y + 40.0 * z;
                assert!((f64::from(value) - expected).abs() <= 1.0, "{value} at {x} {y} {z}, not {expected}");
                inside += 1;
            }
            assert!(inside > hu.len() / 2, "{inside} voxels compared");
        }
    }

    #[test]
    fn a_missing_slice_leaves_the_others_as_they_were() {
        let (stack, hu) = linear_stack(&[0.0, 1.0, 2.0, 4.0, 5.0], 0.0);
        let grid = RegularGrid::over(&stack, [8, 20]).unwrap();
        assert_eq!((grid.dims, grid.slice_spacing_mm), ([8, 20, 6], 1.0));
        let mut out = vec![0; 8 * 20 * 6];
        grid.resample(&stack, &hu, 0, &mut out);
        assert_eq!(out[..3 * 160], hu[..3 * 160]);
        assert_eq!(out[4 * 160..], hu[3 * 160..]);
    }

    #[test]
    fn positions_that_would_blow_up_memory_are_refused() {
        let (stack, _) = linear_stack(&[0.0, 1.0, 2.0, 3.0, 1e9], 0.0);
        assert!(matches!(RegularGrid::over(&stack, [8, 20]), Err(Error::TooUneven { .. })));
    }
}
