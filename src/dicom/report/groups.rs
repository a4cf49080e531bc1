//! One measurement group for each item: its kind and its content.

use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use glam::DVec3;
use sha2::{Digest, Sha256};

use super::codes::*;
use super::content::{CONTAINS, CONTEXT, Content, INFERRED};
use crate::object::{Code, LONG_STRING_CHARS, code_item, date_and_time, limited, put_items};
use relief_annotation::{Geometry, Item, Measure, catmull_rom, measures};

/// Largest distance of a closed curve's points from a plane for a `POLYGON`, mm: more than the
/// rounding of 32-bit floats, less than is visible.
const PLANAR_MM: f64 = 1e-3;
/// Straight parts between two points of a smooth curve, at most.
const PARTS: usize = 16;
/// Most points of a smooth curve's path, where it has fewer itself.
const PATH_POINTS: usize = 4096;

/// Points of `GraphicData` beyond which the 16-bit length of explicit VR does not reach.
pub(super) const LONGEST_EXPLICIT: usize = 65534 / 12;

/// Coordinates of an item, ready for a report.
struct Graphics {
    tracking: Option<&'static str>,
    template: &'static str,
    graphic: &'static str,
    path: Vec<DVec3>,
    /// The control points of a smooth curve.
    controls: Vec<DVec3>,
    numbers: Vec<(Code, f64, Code)>,
}

/// Why an item has no group.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnreportableItem {
    /// It has no position.
    #[error("it is {state}: a report holds places")]
    NoPlace {
        /// Missing or skipped.
        state: &'static str,
    },
    /// It belongs to another frame of reference than the series.
    #[error("it belongs to another frame of reference than the series")]
    FrameOfReference,
    /// A kind of geometry that reports do not have.
    #[error("a report has no {kind}; {advice}")]
    Kind {
        /// The kind of geometry, as a plural.
        kind: &'static str,
        /// The form that holds it.
        advice: &'static str,
    },
}

/// The number of points of an item's longest graphic, or the reason why a report cannot hold the item.
pub(super) fn points(item: &Item, frame_of_reference: &str) -> Result<usize, UnreportableItem> {
    let graphics = graphics_of(item, frame_of_reference)?;
    Ok(graphics.path.len().max(graphics.controls.len()))
}

fn graphics_of(item: &Item, frame_of_reference: &str) -> Result<Graphics, UnreportableItem> {
    let Some(geometry) = &item.geometry else {
        return Err(UnreportableItem::NoPlace { state: state_name(item) });
    };
    if item.frame_of_reference.as_ref().is_some_and(|frame| frame.0 != frame_of_reference) {
        return Err(UnreportableItem::FrameOfReference);
    }
    graphics(geometry)
}

/// The group of an item, or the reason why a report cannot hold the item.
pub(super) fn group(
    item: &Item,
    frame_of_reference: &str,
    observer: Option<Content>,
) -> Result<Content, UnreportableItem> {
    let graphics = graphics_of(item, frame_of_reference)?;
    let tracking = graphics.tracking.unwrap_or(&item.name);
    let mut parts: Vec<Content> = observer.into_iter().collect();
    parts.push(Content::text(CONTEXT, TRACKING_IDENTIFIER, tracking));
    parts.push(Content::uid(CONTEXT, TRACKING_UID, &format!("2.25.{}", item.id.number())));
    if !graphics.controls.is_empty() {
        parts.push(Content::text(CONTEXT, SPLINE_TYPE, CATMULL_ROM));
    }
    parts.push(Content::code(CONTAINS, FINDING, finding(item)));
    if !item.description.is_empty() {
        parts.push(Content::text(CONTAINS, COMMENT, &item.description));
    }
    let coordinates = |relationship: &str, name: Code| {
        Content::coordinates(relationship, name, graphics.graphic, &graphics.path, frame_of_reference)
    };
    let is_region = graphics.template == "1410";
    if is_region {
        parts.push(coordinates(CONTAINS, IMAGE_REGION));
    }
    for (index, (name, value, unit)) in graphics.numbers.iter().enumerate() {
        let mut number = Content::number(*name, *value, *unit);
        // Cornerstone looks for coordinates below the first number, whatever the group has.
        if index == 0 {
            number = number.with([coordinates(INFERRED, PATH)]);
            if !graphics.controls.is_empty() {
                let controls = Content::coordinates(
                    INFERRED,
                    CONTROL_POINTS,
                    "MULTIPOINT",
                    &graphics.controls,
                    frame_of_reference,
                );
                number = number.with([controls]);
            }
        }
        parts.push(number);
    }
    let observed = date_and_time(item.created);
    let observed = format!("{}{}+0000", observed.0, observed.1);
    Ok(Content::group(GROUP, graphics.template).observed(&observed).with(parts))
}

const fn state_name(item: &Item) -> &'static str {
    match item.state {
        relief_annotation::State::Defined => "defined",
        relief_annotation::State::Missing => "missing",
        relief_annotation::State::Skipped => "skipped",
    }
}

/// The item's name as a code: that of its concept, or a code for the name. A concept with another
/// name keeps its code, and its own meaning as an equivalent code.
fn finding(item: &Item) -> InMemDicomObject {
    let name = limited(&item.name, LONG_STRING_CHARS);
    let name = if name.is_empty() { "unnamed" } else { &name };
    let Some(concept) = &item.concept else {
        let digest = Sha256::digest(item.name.as_bytes());
        let value: String = digest.iter().take(8).map(|byte| format!("{byte:02X}")).collect();
        return code_item(&value, NAMES, name);
    };
    let mut code = code_item(&concept.code, &concept.scheme, name);
    if concept.meaning != name {
        let equivalent = code_item(&concept.code, &concept.scheme, &concept.meaning);
        put_items(&mut code, tags::EQUIVALENT_CODE_SEQUENCE, vec![equivalent]);
    }
    code
}

fn graphics(geometry: &Geometry) -> Result<Graphics, UnreportableItem> {
    let without = |kind, advice| UnreportableItem::Kind { kind, advice };
    let points: Vec<DVec3> = geometry.points().iter().map(|point| point.xyz).collect();
    let first = || measures(geometry).first().map_or(0.0, |measure| measure.value);
    let line = |tracking, path, number| Graphics {
        tracking: Some(tracking),
        template: "1501",
        graphic: "POLYLINE",
        path,
        controls: Vec::new(),
        numbers: vec![number],
    };
    Ok(match geometry {
        Geometry::Point { .. } => Graphics {
            tracking: None,
            template: "1410",
            graphic: "POINT",
            path: points,
            controls: Vec::new(),
            numbers: Vec::new(),
        },
        Geometry::Line { .. } => line(CORNERSTONE_LENGTH, points, (LENGTH, first(), MILLIMETRE)),
        Geometry::Angle { points_mm: [a, corner, b] } => {
            let path = [a, corner, corner, b].map(|point| point.xyz).to_vec();
            line(CORNERSTONE_ANGLE, path, (ANGLE, first(), DEGREE))
        }
        Geometry::Curve { closed, smooth, .. } => curve(points, *closed, *smooth, &measures(geometry)),
        Geometry::Plane { .. } => return Err(without("planes", "mrk.json does")),
        Geometry::Region(_) => return Err(without("voxels", "a segmentation (seg) does")),
        Geometry::Mesh(_) => return Err(without("surfaces", "stl, ply, obj and glb do")),
    })
}

fn curve(points: Vec<DVec3>, closed: bool, smooth: bool, measures: &[Measure]) -> Graphics {
    let spans = points.len().max(1);
    let mut path = match smooth {
        true => catmull_rom(&points, closed, (PATH_POINTS / spans).clamp(1, PARTS)),
        false => points.clone(),
    };
    if closed && path.first() != path.last() {
        path.extend(path.first().copied());
    }
    let measure = |name: &str| measures.iter().find(|measure| measure.name == name).map(|found| found.value);
    let is_region = closed && off_plane(&path) <= PLANAR_MM;
    let around = if closed { PERIMETER } else { LENGTH };
    let length = measure("length").map(|mm| (around, mm, MILLIMETRE));
    let area = measure("area").filter(|_| is_region).map(|mm2| (AREA, mm2, SQUARE_MILLIMETRE));
    Graphics {
        tracking: Some(if smooth { CORNERSTONE_SPLINE } else { CORNERSTONE_FREEHAND }),
        template: if is_region { "1410" } else { "1501" },
        graphic: if is_region { "POLYGON" } else { "POLYLINE" },
        path,
        controls: if smooth { points } else { Vec::new() },
        numbers: area.into_iter().chain(length).collect(),
    }
}

/// How far the farthest point of a closed line is off the plane through its middle along its mean
/// normal (Newell's).
fn off_plane(path: &[DVec3]) -> f64 {
    let middle = path.iter().sum::<DVec3>() / path.len().max(1) as f64;
    let normal: DVec3 = path.windows(2).map(|ends| (ends[0] - middle).cross(ends[1] - middle)).sum();
    let Some(normal) = normal.try_normalize() else {
        return 0.0; // a line back and forth: any plane through it will do
    };
    path.iter().map(|point| (*point - middle).dot(normal).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_curve_is_a_polygon_only_within_a_plane() {
        let tilted =
            |z: f64| [[0.0, 0.0, 0.0], [4.0, 0.0, 4.0], [4.0, 3.0, 4.0], [0.0, 3.0, z]].map(DVec3::from);
        let made = |z| curve(tilted(z).to_vec(), true, false, &[]);
        assert_eq!((made(0.0).graphic, made(0.0).template), ("POLYGON", "1410"));
        assert_eq!((made(0.5).graphic, made(0.5).template), ("POLYLINE", "1501"));
        assert_eq!(made(0.5).path.len(), 5, "it ends where it begins");
        let open = curve(tilted(0.0).to_vec(), false, true, &[]);
        assert_eq!((open.graphic, open.path.len(), open.controls.len()), ("POLYLINE", 3 * PARTS + 1, 4));
    }
}
