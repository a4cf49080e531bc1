//! Points outside the volume that a file belongs to.

use relief_annotation::{Geometry, Item};
use relief_base::{Patient, Point};
use relief_volume::Grid;

/// A warning if points lie outside of the volume, with a hint if they are a mirror image of points
/// within.
pub(super) fn warning(items: &[Item], grid: &Grid) -> Option<String> {
    let voxel_from_patient = grid.voxel_from_patient();
    let inside = |point: Point<Patient>| {
        let index = (voxel_from_patient * point).xyz.to_array();
        index.into_iter().zip(grid.dims()).all(|(at, count)| (-0.5..=count as f64 - 0.5).contains(&at))
    };
    let points: Vec<Point<Patient>> =
        items.iter().filter_map(|item| item.geometry.as_ref()).flat_map(Geometry::points).copied().collect();
    let outside = points.iter().filter(|point| !inside(**point)).count();
    if outside == 0 {
        return None;
    }
    let total = points.len();
    let mut text = format!("{outside} of {total} points lie outside of the volume");
    let mirrored = |p: &Point<Patient>| Point::new(-p.xyz.x, -p.xyz.y, p.xyz.z);
    let inside_mirrored = points.iter().filter(|point| inside(mirrored(point))).count();
    if inside_mirrored > total - outside {
        text += &format!(
            "; with x and y mirrored (RAS for LPS, or LPS for RAS) {inside_mirrored} lie inside: \
             does the file name its coordinate system rightly?"
        );
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_image_is_recognised() {
        let grid = Grid::axis_aligned([10, 20, 30], [1.0, 2.0, 0.5], [50.0, 60.0, 7.0]).unwrap();
        let warned = |points: &[[f64; 3]]| {
            let item = |at: &[f64; 3]| {
                let at_mm = Point::new(at[0], at[1], at[2]);
                Item::new("a", "anna", Some(Geometry::Point { at_mm })).unwrap()
            };
            warning(&points.iter().map(item).collect::<Vec<_>>(), &grid)
        };
        assert_eq!(warned(&[[49.5, 60.0, 7.0], [59.5, 99.0, 21.75]]), None);
        let plain = warned(&[[49.4, 60.0, 7.0], [50.0, 60.0, 7.0]]).unwrap();
        assert_eq!(plain, "1 of 2 points lie outside of the volume");
        let mirror = warned(&[[-51.0, -60.0, 8.0], [-55.0, -70.0, 9.0]]).unwrap();
        assert!(
            mirror.contains("2 of 2") && mirror.contains("mirrored") && mirror.contains(" 2 lie inside"),
            "{mirror}"
        );
    }
}
