//! Coordinates of a measurement group as geometry.
//!
//! Three-dimensional ones are patient mm. Two-dimensional ones are pixels of an image, the corner
//! of the first being 0, 0 (PS3.3 C.18.6.1.1): with the series that the image is of they have a
//! place too.

use dicom_dictionary_std::tags;
use glam::DVec3;

use super::codes::{ANGLE, CATMULL_ROM, CONTROL_POINTS, OTHER_ANGLES, SPLINE_TYPE};
use crate::attributes::quoted;
use crate::reference::{Plane, SeriesReference};
use crate::report::node::Node;
use crate::report::node::Warnings;
use crate::whole::ObjectError;
use relief_annotation::{Geometry, Item};
use relief_base::{Patient, Point};

/// Corners of the closed curve that an ellipse or a circle becomes.
const ELLIPSE_POINTS: u32 = 32;

/// A geometry, and the frame of reference that it names.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FramedGeometry {
    pub(super) geometry: Geometry,
    pub(super) frame_of_reference: Option<String>,
}

/// The graphics of one content item: what kind, and its points.
struct Graphic {
    kind: String,
    points: Vec<DVec3>,
    frame_of_reference: Option<String>,
}

/// The shapes of a group. Its own coordinates count; where it has none, those below its numbers.
pub(super) fn shapes(
    group: &Node<'_>,
    series: Option<&SeriesReference>,
    warnings: &mut Warnings,
) -> Result<Vec<FramedGeometry>, ObjectError> {
    let children = group.children();
    let is_angle = children.iter().any(|child| {
        child.kind() == "NUM" && (child.is(ANGLE) || OTHER_ANGLES.iter().any(|(v, s)| child.has_name(v, s)))
    });
    let inner: Vec<Node<'_>> =
        children.iter().filter(|child| child.kind() == "NUM").flat_map(Node::children).collect();
    let controls = controls(&children, &inner)?;
    let mut shapes = Vec::new();
    for nodes in [&children, &inner] {
        for node in nodes.iter().filter(|node| !node.is(CONTROL_POINTS)) {
            let Some(graphic) = graphic(node, series, warnings)? else { continue };
            for shape in graphic.shapes(node, is_angle, controls.as_deref(), warnings)? {
                if !shapes.contains(&shape) {
                    shapes.push(shape);
                }
            }
        }
        if !shapes.is_empty() {
            break;
        }
    }
    Ok(shapes)
}

/// The points that a smooth curve goes through, of a group that says it is one of ours.
fn controls(children: &[Node<'_>], inner: &[Node<'_>]) -> Result<Option<Vec<DVec3>>, ObjectError> {
    let is_ours = |node: &Node<'_>| node.is(SPLINE_TYPE) && node.text(tags::TEXT_VALUE) == CATMULL_ROM;
    if !children.iter().any(is_ours) {
        return Ok(None);
    }
    let all = children.iter().chain(inner);
    let mut controls = all.filter(|node| node.is(CONTROL_POINTS) && node.kind() == "SCOORD3D");
    controls.next().map(|node| patient_points(node)).transpose()
}

/// The graphic of a content item; `None` of items without coordinates, and, with a warning, of
/// those whose image is not known.
fn graphic(
    node: &Node<'_>,
    series: Option<&SeriesReference>,
    warnings: &mut Warnings,
) -> Result<Option<Graphic>, ObjectError> {
    let kind = node.text(tags::GRAPHIC_TYPE);
    match node.kind() {
        "SCOORD3D" => {
            let frame = node.text(tags::REFERENCED_FRAME_OF_REFERENCE_UID);
            let frame_of_reference = Some(frame).filter(|uid| !uid.is_empty() && uid.len() <= 64);
            if frame_of_reference.is_none() {
                warnings.count("coordinates name no frame of reference", &node.path);
            }
            Ok(Some(Graphic { kind, points: patient_points(node)?, frame_of_reference }))
        }
        "SCOORD" => {
            let plane = plane(node, series);
            let Some((plane, series)) = plane.zip(series) else {
                let why = match series {
                    Some(_) => "coordinates are pixels of an image that is not of the series",
                    None => "coordinates are pixels of an image: give the series that it is of",
                };
                warnings.count(why, &node.path);
                return Ok(None);
            };
            let points = image_points(node, &kind, plane)?;
            let frame_of_reference = series.frame_of_reference().map(str::to_owned);
            Ok(Some(Graphic { kind, points, frame_of_reference }))
        }
        _ => Ok(None),
    }
}

/// The plane of the image that coordinates were selected from.
fn plane<'a>(node: &Node<'_>, series: Option<&'a SeriesReference>) -> Option<&'a Plane> {
    let images = node.children();
    let image = images.iter().flat_map(|image| image.data.items(tags::REFERENCED_SOP_SEQUENCE)).next()?;
    let uid = image.text(tags::REFERENCED_SOP_INSTANCE_UID)?;
    let frame = image.text(tags::REFERENCED_FRAME_NUMBER).unwrap_or_default();
    let frame = frame.split('\\').next().and_then(|first| first.trim().parse().ok()).unwrap_or(1);
    series?.plane(&uid, frame)
}

/// Finite numbers, in groups of the given size.
fn tuples<const N: usize>(node: &Node<'_>, expected: &'static str) -> Result<Vec<[f64; N]>, ObjectError> {
    let (floats, rest) = node.data.floats(tags::GRAPHIC_DATA);
    let wrong = |found: String| node.wrong("GraphicData", tags::GRAPHIC_DATA, found, expected);
    if rest > 0 || floats.is_empty() || !floats.len().is_multiple_of(N) {
        return Err(wrong(format!("{} numbers and {rest} bytes", floats.len())));
    }
    // The shortest decimal of the float: 12.3 is read back as 12.3.
    let mm = |float: f32| float.to_string().parse().unwrap_or(f64::from(float));
    let numbers: Vec<f64> = floats.into_iter().map(mm).collect();
    match numbers.iter().find(|mm| mm.abs() > Item::FARTHEST_MM || !mm.is_finite()) {
        Some(mm) => Err(wrong(mm.to_string())),
        None => Ok(numbers.as_chunks::<N>().0.to_vec()),
    }
}

fn patient_points(node: &Node<'_>) -> Result<Vec<DVec3>, ObjectError> {
    let triplets = tuples::<3>(node, "triplets of mm, -1e6 to 1e6 each")?;
    Ok(triplets.into_iter().map(DVec3::from_array).collect())
}

/// Pixels as patient points. A circle, its middle and a point on it, is made the ellipse that it
/// is.
fn image_points(node: &Node<'_>, kind: &str, plane: &Plane) -> Result<Vec<DVec3>, ObjectError> {
    let expected = "pairs of pixels; two of a circle";
    let pairs = tuples::<2>(node, expected)?;
    let [across, down] = plane.pixel_mm;
    let place = |[x, y]: [f64; 2]| {
        plane.position + plane.row * ((x - 0.5) * across) + plane.column * ((y - 0.5) * down)
    };
    if kind != "CIRCLE" {
        return Ok(pairs.into_iter().map(place).collect());
    }
    let [middle, rim] = pairs[..] else {
        let found = format!("{} pairs", pairs.len());
        return Err(node.wrong("GraphicData", tags::GRAPHIC_DATA, found, expected));
    };
    let (middle, rim) = (place(middle), place(rim));
    let radius = middle.distance(rim);
    let [right, below] = [plane.row * radius, plane.column * radius];
    Ok(vec![middle - right, middle + right, middle - below, middle + below])
}

impl Graphic {
    fn shapes(
        &self,
        node: &Node<'_>,
        is_angle: bool,
        controls: Option<&[DVec3]>,
        warnings: &mut Warnings,
    ) -> Result<Vec<FramedGeometry>, ObjectError> {
        let points: Vec<Point<Patient>> = self.points.iter().copied().map(Point::from_xyz).collect();
        let ends_meet = points.len() >= 4 && points.first() == points.last();
        let too_few = |expected| {
            node.wrong("GraphicData", tags::GRAPHIC_DATA, format!("{} points", points.len()), expected)
        };
        let closed_curve = |points: &[Point<Patient>]| Geometry::Curve {
            points_mm: points.to_vec(),
            closed: true,
            smooth: false,
        };
        let geometry = match (self.kind.as_str(), &points[..]) {
            ("POINT" | "MULTIPOINT", points) => {
                return Ok(points.iter().map(|&at_mm| self.shape(Geometry::Point { at_mm })).collect());
            }
            ("POLYLINE", [_]) => return Err(too_few("at least two points of a POLYLINE")),
            ("POLYLINE", &[a, b]) => Geometry::Line { ends_mm: [a, b] },
            ("POLYLINE", &[a, corner, b]) if is_angle => Geometry::Angle { points_mm: [a, corner, b] },
            ("POLYLINE", &[a, corner, again, b]) if is_angle && corner == again => {
                Geometry::Angle { points_mm: [a, corner, b] }
            }
            ("POLYLINE" | "POLYGON", _) if controls.is_some_and(|controls| controls.len() >= 3) => {
                let controls = controls.unwrap_or_default();
                let points_mm = controls.iter().copied().map(Point::from_xyz).collect();
                Geometry::Curve { points_mm, closed: ends_meet, smooth: true }
            }
            ("POLYGON", [_] | [_, _]) => return Err(too_few("at least three points of a POLYGON")),
            ("POLYLINE" | "POLYGON", points) if ends_meet => closed_curve(&points[..points.len() - 1]),
            ("POLYGON", points) => closed_curve(points),
            ("POLYLINE", points) => {
                Geometry::Curve { points_mm: points.to_vec(), closed: false, smooth: false }
            }
            ("ELLIPSE" | "CIRCLE", &[a, b, c, d]) => {
                warnings.count("ellipses are read as closed curves of 32 points", &node.path);
                closed_curve(&ellipse([a, b, c, d]))
            }
            ("ELLIPSE", _) => return Err(too_few("the four ends of an ellipse's axes")),
            ("ELLIPSOID", _) => {
                warnings.count("ellipsoids are not read", &node.path);
                return Ok(Vec::new());
            }
            _ => {
                let expected = "POINT, MULTIPOINT, POLYLINE, POLYGON, ELLIPSE, ELLIPSOID or CIRCLE";
                let found = quoted(&self.kind);
                return Err(node.wrong("GraphicType", tags::GRAPHIC_TYPE, found, expected));
            }
        };
        if geometry.points().len() > Item::MOST_POINTS {
            warnings.count("curves of more than 10000 points are not read", &node.path);
            return Ok(Vec::new());
        }
        Ok(vec![self.shape(geometry)])
    }

    fn shape(&self, geometry: Geometry) -> FramedGeometry {
        FramedGeometry { geometry, frame_of_reference: self.frame_of_reference.clone() }
    }
}

/// Points of the ellipse through the ends of its axes.
fn ellipse([a, b, c, d]: [Point<Patient>; 4]) -> Vec<Point<Patient>> {
    let middle = (a.xyz + b.xyz) / 2.0;
    let (long, short) = ((b.xyz - a.xyz) / 2.0, (d.xyz - c.xyz) / 2.0);
    let at = |index: u32| {
        let angle = std::f64::consts::TAU * f64::from(index) / f64::from(ELLIPSE_POINTS);
        Point::from_xyz(middle + long * angle.cos() + short * angle.sin())
    };
    (0..ELLIPSE_POINTS).map(at).collect()
}
