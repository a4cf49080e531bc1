//! Planes, as 3D Slicer has said them in its several versions.

use glam::DVec3;

use super::super::reading::{mirrored, point};
use super::wire::{ControlPoint, CoordinateSystem, Markup, PositionStatus};
use relief_annotation::Geometry;

/// Why there is no plane.
pub(super) enum NoPlane {
    /// It is not placed yet.
    Undefined,
    /// Its axes are not two directions.
    Flat,
}

/// A plane in the file's own axes and mm.
struct FilePlane {
    center: DVec3,
    x: DVec3,
    normal: DVec3,
    size: [f64; 2],
}

/// The plane of a markup, LPS mm of `mm` millimetres a unit; whether its size was made up.
pub(super) fn read(markup: &Markup, mm: f64) -> Result<(Geometry, bool), NoPlane> {
    let points: Vec<DVec3> = markup.control_points.iter().filter_map(position).collect();
    let found = match (markup.center.map(DVec3::from), axes(markup)) {
        // A plane that is not placed yet has its centre in the origin.
        (Some(_), _) if points.is_empty() && !markup.control_points.is_empty() => {
            return Err(NoPlane::Undefined);
        }
        (Some(center), Some((x, normal))) => FilePlane { center, x, normal, size: [0.0; 2] },
        _ => through(&points)?,
    };
    let (x, normal) = directions(found.x, found.normal).ok_or(NoPlane::Flat)?;
    let y = normal.cross(x);
    let mut center = found.center;
    let mut size = found.size;
    if let Some([low_x, high_x, low_y, high_y]) = markup.plane_bounds {
        size = [high_x - low_x, high_y - low_y];
        center += x * ((low_x + high_x) / 2.0) + y * ((low_y + high_y) / 2.0);
    } else if let Some([width, height, _]) = markup.size {
        size = [width, height];
    }
    let is_made_up = size.iter().any(|side| side.is_nan() || *side <= 0.0);
    if is_made_up {
        // As wide as its points are apart.
        let span = points.iter().flat_map(|a| points.iter().map(|b| a.distance(*b))).fold(0.0, f64::max);
        size = [if span > 0.0 { span } else { 100.0 / mm }; 2];
    }
    let is_ras = markup.coordinate_system == CoordinateSystem::Ras;
    let lps = |v: DVec3| if is_ras { mirrored(v.to_array()) } else { v.to_array() };
    let geometry = Geometry::Plane {
        center_mm: point(lps(center * mm)),
        normal: lps(normal),
        axis: lps(x),
        size_mm: size.map(|side| side * mm),
    };
    Ok((geometry, is_made_up))
}

fn position(point: &ControlPoint) -> Option<DVec3> {
    let is_defined = point.position_status.is_none_or(|status| status == PositionStatus::Defined);
    point.position.filter(|_| is_defined).map(DVec3::from)
}

/// The first axis and the normal, as the file has them.
fn axes(markup: &Markup) -> Option<(DVec3, DVec3)> {
    if let Some(o) = markup.orientation {
        return Some((DVec3::new(o[0], o[3], o[6]), DVec3::new(o[2], o[5], o[8])));
    }
    let normal = DVec3::from(markup.normal?);
    Some((normal.try_normalize()?.any_orthonormal_vector(), normal))
}

/// The plane of the first versions: an origin, a point on its first axis, a third point.
fn through(points: &[DVec3]) -> Result<FilePlane, NoPlane> {
    let &[origin, along, third, ..] = points else { return Err(NoPlane::Undefined) };
    let x = along - origin;
    Ok(FilePlane { center: origin, x, normal: x.cross(third - origin), size: [0.0; 2] })
}

/// Unit vectors across each other: the normal as it is, and the first axis as near as that allows.
fn directions(x: DVec3, normal: DVec3) -> Option<(DVec3, DVec3)> {
    let normal = normal.try_normalize()?;
    let x = x.try_normalize()?.reject_from_normalized(normal);
    (x.length() > 1e-6).then(|| (x.normalize(), normal))
}

/// Everything of a plane that Slicer reads: LPS mm.
pub(super) fn write(markup: &mut Markup, center: DVec3, normal: DVec3, x: DVec3, [width, height]: [f64; 2]) {
    let y = normal.cross(x);
    let rows = |at: usize| [x[at], y[at], normal[at]].map(|v| v + 0.0);
    let [a, b, c] = [rows(0), rows(1), rows(2)];
    markup.plane_type = Some("pointNormal".to_owned());
    markup.size_mode = Some("absolute".to_owned());
    markup.center = Some(center.to_array());
    markup.normal = Some(normal.to_array());
    markup.orientation = Some([a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]);
    // Slicer negates the first two rows when it reads LPS: this matrix becomes its identity.
    let mut identity = [0.0; 16];
    (identity[0], identity[5], identity[10], identity[15]) = (-1.0, -1.0, 1.0, 1.0);
    markup.object_to_base = Some(identity);
    let [cx, cy, cz] = center.to_array();
    markup.base_to_node =
        Some([a[0], a[1], a[2], cx, b[0], b[1], b[2], cy, c[0], c[1], c[2], cz, 0.0, 0.0, 0.0, 1.0]);
    markup.size = Some([width, height, 0.0]);
    markup.plane_bounds = Some([-width / 2.0, width / 2.0, -height / 2.0, height / 2.0]);
}
