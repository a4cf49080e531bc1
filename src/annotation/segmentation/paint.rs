//! Painting with a ball: voxels come in or go.
//!
//! A voxel is the ball's where at least half of it lies in it, judged at 5³ places inside the
//! voxel. A ball that has no voxel by that rule, since voxels are larger than it, has the voxel in
//! which its centre lies. So strokes behave alike on voxels of any shape, and their volume is right
//! to less than a hundredth from a radius of five voxels on.

use glam::DVec3;

use super::ball::span;
use relief_base::{OutOfRange, Patient, Point};
use relief_volume::Mask;

/// The effect of a brush.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stroke {
    /// Voxels come in.
    Add,
    /// Voxels go.
    Erase,
}

/// Places along each axis of a voxel, from its centre. An odd number: halves of a voxel must not
/// tie.
const PLACES: [f64; 5] = [-0.4, -0.2, 0.0, 0.2, 0.4];
/// Largest radius, mm.
const LARGEST_MM: f64 = 1000.0;

/// Paints a ball of `radius_mm` around `center`; returns the number of changed voxels. Parts outside
/// of the grid are left out.
///
/// # Errors
/// When the radius is not above 0 and at most 1000 mm, or the centre is no place.
pub fn paint_strokes(
    mask: &mut Mask,
    center: Point<Patient>,
    radius_mm: f64,
    stroke: Stroke,
) -> Result<u64, OutOfRange> {
    if !(radius_mm > 0.0 && radius_mm <= LARGEST_MM) {
        let allowed = format!("more than 0, at most {LARGEST_MM} mm");
        return Err(OutOfRange::new("radius_mm", radius_mm, allowed));
    }
    if !center.xyz.is_finite() {
        return Err(OutOfRange::new("center_mm", center.xyz, "three numbers, mm"));
    }
    let grid = mask.grid().clone();
    let linear = grid.patient_from_voxel().linear();
    // Half the longest way through a voxel: a voxel that has a part in the ball has its centre so
    // near.
    let half = [1.0, -1.0].into_iter().flat_map(|y| [1.0, -1.0].map(|z| DVec3::new(0.5, 0.5 * y, 0.5 * z)));
    let half = half.map(|corner| (linear * corner).length()).fold(0.0, f64::max);
    let is_in = |index: DVec3| {
        let middle = grid.patient_from_voxel().affine.transform_point3(index) - center.xyz;
        let distance = middle.length();
        if distance + half <= radius_mm {
            return true;
        }
        distance - half < radius_mm && share(linear, middle, radius_mm) * 2 >= PLACES.len().pow(3)
    };
    let mut changed = 0;
    let mut change = |mask: &mut Mask, index: [usize; 3]| {
        changed += u64::from(mask.contains(index) != (stroke == Stroke::Add));
        mask.set(index, stroke == Stroke::Add);
    };
    let mut is_empty = true;
    let [near_j, near_k] = near(&grid, center, radius_mm + half);
    for (j, k) in near_k.flat_map(|k| near_j.clone().map(move |j| (j, k))) {
        for i in span(&grid, center, radius_mm + half, [j, k]) {
            if is_in(DVec3::new(i as f64, j as f64, k as f64)) {
                is_empty = false;
                change(mask, [i, j, k]);
            }
        }
    }
    let middle = (grid.voxel_from_patient() * center).xyz.round();
    let inside = (0..3).all(|axis| middle[axis] >= 0.0 && middle[axis] < grid.dims()[axis] as f64);
    if is_empty && inside {
        change(mask, middle.to_array().map(|i| i as usize));
    }
    Ok(changed)
}

/// Places of a voxel with this middle, from the ball's centre, that lie in the ball.
fn share(linear: glam::DMat3, middle: DVec3, radius_mm: f64) -> usize {
    let places =
        PLACES.iter().flat_map(|&x| PLACES.iter().flat_map(move |&y| PLACES.map(|z| DVec3::new(x, y, z))));
    places.filter(|place| (middle + linear * *place).length_squared() <= radius_mm * radius_mm).count()
}

/// Rows that a ball may touch: ranges of j and k.
fn near(grid: &relief_volume::Grid, center: Point<Patient>, radius_mm: f64) -> [std::ops::Range<usize>; 2] {
    let inverse = grid.patient_from_voxel().linear().inverse().transpose();
    let middle = (grid.voxel_from_patient() * center).xyz;
    [(1, inverse.y_axis), (2, inverse.z_axis)].map(|(axis, gradient)| {
        let (reach, n) = (gradient.length() * radius_mm, grid.dims()[axis] as f64);
        let start = (middle[axis] - reach).floor().clamp(0.0, n) as usize;
        start..((middle[axis] + reach).ceil() + 1.0).clamp(0.0, n) as usize
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Transform;
    use relief_volume::Grid;

    #[test]
    fn a_painted_ball_has_its_volume_on_oblique_voxels_of_any_shape() {
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.4, 0.2, -0.7);
        for spacing in [[1.0, 1.0, 1.0], [0.6, 0.6, 2.5], [1.5, 0.4, 0.9]] {
            let axes = [0, 1, 2].map(|axis| turn.col(axis) * spacing[axis]);
            let dims = spacing.map(|step: f64| (60.0 / step) as usize);
            let grid = Grid::new(dims, Transform::from_axes(axes[0], axes[1], axes[2], DVec3::ZERO)).unwrap();
            let mut mask = Mask::empty(grid.clone());
            let center = Point::from_xyz(grid.center().xyz + DVec3::new(0.3, -0.2, 0.4));
            let added = paint_strokes(&mut mask, center, 20.0, Stroke::Add).unwrap();
            let truth = 4.0 / 3.0 * std::f64::consts::PI * 8.0;
            assert!((mask.volume_ml() / truth - 1.0).abs() < 0.004, "{} of {truth} ml", mask.volume_ml());
            assert_eq!(added, mask.voxels());
            assert_eq!(
                paint_strokes(&mut mask, center, 20.0, Stroke::Add).unwrap(),
                0,
                "it is there already"
            );
            assert_eq!(paint_strokes(&mut mask, center, 20.0, Stroke::Erase).unwrap(), added);
            assert_eq!(mask.voxels(), 0);
        }
    }

    #[test]
    fn a_ball_smaller_than_voxels_is_the_voxel_that_it_lies_in() {
        let grid = Grid::axis_aligned([4, 4, 4], [2.0; 3], [0.0; 3]).unwrap();
        let mut mask = Mask::empty(grid);
        assert_eq!(paint_strokes(&mut mask, Point::new(2.9, 4.2, 1.2), 0.1, Stroke::Add), Ok(1));
        assert!(mask.contains([1, 2, 1]));
        assert_eq!(paint_strokes(&mut mask, Point::new(-20.0, 0.0, 0.0), 0.1, Stroke::Add), Ok(0), "outside");
        for bad in [0.0, -1.0, f64::NAN, 1e4] {
            assert!(paint_strokes(&mut mask, Point::new(0.0, 0.0, 0.0), bad, Stroke::Add).is_err());
        }
        assert!(paint_strokes(&mut mask, Point::new(f64::NAN, 0.0, 0.0), 1.0, Stroke::Add).is_err());
    }
}
