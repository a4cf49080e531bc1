//! Closed curves as levels of one direction: what [`fill_contours`](super::fill_contours) works on.
//!
//! Tolerances, all named below: a curve's points are within 2 mm of its plane (they are moved into
//! it, along its normal), planes are parallel to 5 degrees (all get the mean normal), and curves
//! less than 0.05 mm apart are on one level.

use glam::DVec3;

use crate::{Geometry, catmull_rom};
use relief_base::{Patient, Point};

/// A closed curve: straight between its points, the last joined to the first. Patient LPS mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Three or more.
    pub points: Vec<Point<Patient>>,
}

/// Why contours cannot be filled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FillError {
    /// No contour.
    #[error("no contour to fill, expected at least one closed curve")]
    Empty,
    /// Too much.
    #[error("{found} {what}, allowed: at most {allowed}")]
    TooMany {
        /// The kind of the limit.
        what: &'static str,
        /// The number found.
        found: usize,
        /// The limit.
        allowed: usize,
    },
    /// Too few points, or points on one line: no area.
    #[error("contour {contour} encloses no area; it needs three points that are not on one line")]
    Flat {
        /// The contour, from 1.
        contour: usize,
    },
    /// A coordinate that is no number, or far away.
    #[error("contour {contour}: point {point} is not within {farthest_mm:.0} mm of the origin")]
    Place {
        /// The contour, from 1.
        contour: usize,
        /// Its point, from 1.
        point: usize,
        /// The limit.
        farthest_mm: f64,
    },
    /// Points that are not in one plane.
    #[error(
        "contour {contour} is not planar: a point is {found_mm:.1} mm off its plane, allowed: {allowed_mm} mm"
    )]
    Bent {
        /// The contour, from 1.
        contour: usize,
        /// The farthest point's distance, mm.
        found_mm: f64,
        /// The limit, mm.
        allowed_mm: f64,
    },
    /// Planes that are not parallel.
    #[error(
        "contour {contour} is {found_deg:.1} degrees off the plane of the others, allowed: {allowed_deg} degrees"
    )]
    Tilted {
        /// The contour, from 1.
        contour: usize,
        /// The angle between its normal and that of the first, degrees.
        found_deg: f64,
        /// The limit, degrees.
        allowed_deg: f64,
    },
}

/// Farthest that a point may be from its curve's plane, mm.
const PLANAR_MM: f64 = 2.0;
/// Largest angle between planes, degrees.
const PARALLEL_DEG: f64 = 5.0;
/// Curves that are nearer to each other than this are on one level, mm.
const LEVEL_MM: f64 = 0.05;
/// Straight parts between two points of a smooth curve.
const PARTS: usize = 16;
/// Most curves, and points of all together.
const MOST: [usize; 2] = [10_000, 2_000_000];

impl Contour {
    /// The closed curve of an item, smooth where that is; `None` of other geometries.
    #[must_use]
    pub fn of(geometry: &Geometry) -> Option<Self> {
        let Geometry::Curve { points_mm, closed: true, smooth } = geometry else { return None };
        let mut points = points_mm.clone();
        if *smooth {
            let given: Vec<DVec3> = points.iter().map(|point| point.xyz).collect();
            points = catmull_rom(&given, true, PARTS).into_iter().map(Point::from_xyz).collect();
        }
        Some(Self { points })
    }

    /// Twice the area, along the normal around which the points go counter-clockwise (Newell's).
    fn area(&self) -> DVec3 {
        let origin = self.points[0].xyz;
        let ends = self.points.iter().zip(self.points.iter().cycle().skip(1));
        ends.map(|(a, b)| (a.xyz - origin).cross(b.xyz - origin)).sum()
    }

    fn middle(&self) -> DVec3 {
        self.points.iter().map(|point| point.xyz).sum::<DVec3>() / self.points.len() as f64
    }
}

/// Levels in one direction.
pub(super) struct Levels {
    /// Directions of u, v and of rising levels: unit vectors, right-handed.
    pub(super) axes: [DVec3; 3],
    /// In the order of their height.
    pub(super) levels: Vec<Level>,
}

/// The curves of one plane.
pub(super) struct Level {
    /// Height along the third axis, mm.
    pub(super) height: f64,
    /// Edges of all curves in u and v, mm.
    pub(super) edges: Vec<[glam::DVec2; 2]>,
}

impl Levels {
    /// Sorts curves into levels.
    pub(super) fn of(contours: &[Contour]) -> Result<Self, FillError> {
        check(contours)?;
        let areas: Vec<DVec3> = contours.iter().map(Contour::area).collect();
        let first = areas[0].normalize();
        let aligned = areas.iter().map(|area| *area * area.dot(first).signum());
        let normal = aligned.sum::<DVec3>().normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let axes = if u.cross(v).dot(normal) > 0.0 { [u, v, normal] } else { [v, u, normal] };
        let mut levels: Vec<Level> = Vec::new();
        let mut order: Vec<(f64, &Contour)> =
            contours.iter().map(|contour| (contour.middle().dot(normal), contour)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (n, (height, contour)) in order.into_iter().enumerate() {
            let off_plane = contour.points.iter().map(|point| (point.xyz.dot(normal) - height).abs());
            let found_mm = off_plane.fold(0.0, f64::max);
            if found_mm > PLANAR_MM {
                let contour = contours.iter().position(|other| std::ptr::eq(other, contour)).unwrap_or(n) + 1;
                return Err(FillError::Bent { contour, found_mm, allowed_mm: PLANAR_MM });
            }
            let flat =
                |point: &Point<Patient>| glam::DVec2::new(point.xyz.dot(axes[0]), point.xyz.dot(axes[1]));
            let ends = contour.points.iter().zip(contour.points.iter().cycle().skip(1));
            let edges = ends.map(|(a, b)| [flat(a), flat(b)]).filter(|[a, b]| a != b);
            match levels.last_mut().filter(|level| height - level.height < LEVEL_MM) {
                Some(level) => level.edges.extend(edges),
                None => levels.push(Level { height, edges: edges.collect() }),
            }
        }
        Ok(Self { axes, levels })
    }
}

fn check(contours: &[Contour]) -> Result<(), FillError> {
    let points = contours.iter().map(|contour| contour.points.len()).sum();
    let [most_contours, most_points] = MOST;
    for (what, found, allowed) in
        [("contours", contours.len(), most_contours), ("points", points, most_points)]
    {
        if found > allowed {
            return Err(FillError::TooMany { what, found, allowed });
        }
    }
    let mut first: Option<DVec3> = None;
    for (contour, Contour { points }) in (1..).zip(contours) {
        let farthest_mm = crate::Item::FARTHEST_MM;
        let is_place =
            |point: &Point<Patient>| point.xyz.abs().max_element() <= farthest_mm && point.xyz.is_finite();
        if let Some(at) = points.iter().position(|point| !is_place(point)) {
            return Err(FillError::Place { contour, point: at + 1, farthest_mm });
        }
        let area = if points.len() < 3 { DVec3::ZERO } else { contours[contour - 1].area() };
        if area.length() < 1e-6 {
            return Err(FillError::Flat { contour });
        }
        let normal = area.normalize();
        let off = normal.dot(*first.get_or_insert(normal)).abs().min(1.0).acos().to_degrees();
        if off > PARALLEL_DEG {
            return Err(FillError::Tilted { contour, found_deg: off, allowed_deg: PARALLEL_DEG });
        }
    }
    first.map(|_| ()).ok_or(FillError::Empty)
}
