//! Measures of a geometry: lengths, angles, areas, volumes.

use glam::DVec3;

use super::curve::catmull_rom;
use super::geometry::Geometry;
use relief_base::{Patient, Point};

/// Straight parts between two points of a smooth curve: its length is right to a thousandth.
const PARTS: usize = 32;

/// A number with its name and unit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Measure {
    /// The quantity: `length`, `angle`, `area` or `volume`.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// UCUM: `mm`, `deg`, `mm2` or `mL`.
    pub unit: &'static str,
}

/// The measures of a geometry, the first being the one it is made for; none of points and planes.
///
/// The area of a closed curve is that of its projection along its own mean normal (Newell's).
#[must_use]
pub fn measures(geometry: &Geometry) -> Vec<Measure> {
    let length = |value| Measure { name: "length", value, unit: "mm" };
    let area = |value| Measure { name: "area", value, unit: "mm2" };
    let volume = |value| Measure { name: "volume", value, unit: "mL" };
    match geometry {
        Geometry::Point { .. } | Geometry::Plane { .. } => Vec::new(),
        Geometry::Line { ends_mm: [a, b] } => vec![length(a.distance(*b))],
        Geometry::Angle { points_mm: [a, corner, b] } => {
            let (first, second) = ((*a - *corner).xyz, (*b - *corner).xyz);
            // By tangent: exact near 0 and 180 degrees, where a cosine is flat. 0 for an arm of no
            // length.
            let angle = first.cross(second).length().atan2(first.dot(second));
            vec![Measure { name: "angle", value: angle.to_degrees(), unit: "deg" }]
        }
        Geometry::Curve { points_mm, closed, smooth } => {
            let line = polyline(points_mm, *closed, *smooth);
            let mut found = vec![length(line.windows(2).map(|ends| ends[0].distance(ends[1])).sum())];
            if *closed {
                found.push(area(enclosed(&line)));
            }
            found
        }
        Geometry::Region(region) => vec![volume(region.volume_ml)],
        Geometry::Mesh(mesh) => {
            let area = area(mesh.area_mm2);
            mesh.volume_ml.map(volume).into_iter().chain([area]).collect()
        }
    }
}

/// The curve as straight parts; a closed one ends where it begins.
fn polyline(points: &[Point<Patient>], closed: bool, smooth: bool) -> Vec<DVec3> {
    let mut line: Vec<DVec3> = points.iter().map(|point| point.xyz).collect();
    if smooth {
        return catmull_rom(&line, closed, PARTS);
    }
    line.extend(closed.then(|| line.first().copied()).flatten());
    line
}

/// Area of a closed line's projection along its mean normal.
fn enclosed(line: &[DVec3]) -> f64 {
    let Some(&origin) = line.first() else { return 0.0 };
    line.windows(2).map(|ends| (ends[0] - origin).cross(ends[1] - origin)).sum::<DVec3>().length() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points<const N: usize>(xyz: [[f64; 3]; N]) -> [Point<Patient>; N] {
        xyz.map(|[x, y, z]| Point::new(x, y, z))
    }

    fn only(geometry: &Geometry) -> (f64, &'static str) {
        let found = measures(geometry);
        assert_eq!(found.len(), 1, "{found:?}");
        (found[0].value, found[0].unit)
    }

    #[test]
    fn lengths_and_angles_are_those_of_school() {
        let line = Geometry::Line { ends_mm: points([[1.0, 2.0, 3.0], [4.0, 6.0, 15.0]]) };
        assert_eq!(only(&line), (13.0, "mm"));
        for (end, degrees) in
            [([0.0, 5.0, 0.0], 90.0), ([-3.0, 0.0, 0.0], 180.0), ([2.0, 0.0, 0.0], 0.0), ([0.0; 3], 0.0)]
        {
            let angle = Geometry::Angle { points_mm: points([[1.0, 0.0, 0.0], [0.0; 3], end]) };
            assert_eq!(only(&angle), (degrees, "deg"));
        }
    }

    #[test]
    fn a_tilted_square_and_a_smooth_ring_have_their_length_and_area() {
        let s = std::f64::consts::FRAC_1_SQRT_2;
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0 * s, 3.0 * s], [0.0, 3.0 * s, 3.0 * s]];
        let square = Geometry::Curve { points_mm: points(corners).to_vec(), closed: true, smooth: false };
        let [length, area] = measures(&square).try_into().unwrap();
        assert!((length.value - 14.0).abs() < 1e-12 && (area.value - 12.0).abs() < 1e-12);
        let angle = |i: i32| f64::from(i) * std::f64::consts::TAU / 24.0;
        let ring = (0..24).map(|i| Point::new(10.0 * angle(i).cos(), 10.0 * angle(i).sin(), 5.0)).collect();
        let ring = Geometry::Curve { points_mm: ring, closed: true, smooth: true };
        let [length, area] = measures(&ring).try_into().unwrap();
        assert!((length.value / (std::f64::consts::TAU * 10.0) - 1.0).abs() < 1e-3, "{length:?}");
        assert!((area.value / (std::f64::consts::PI * 100.0) - 1.0).abs() < 1e-3, "{area:?}");
    }
}
