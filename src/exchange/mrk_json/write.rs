//! From items to markups: one for the points of each list, one for each other item.

use glam::DVec3;

use super::super::extra::Extra;
use super::super::{ExchangeError, Format, written_json};
use super::plane;
use super::wire::{
    ControlPoint, CoordinateSystem, Display, File, Markup, MarkupType, Measurement, PointId, PositionStatus,
    SCHEMA, Units,
};
use relief_annotation::{Geometry, Item, measures};
use relief_base::{Patient, Point};

/// Writes items that are sorted by list.
///
/// # Errors
/// When a number is not finite: JSON has no such numbers.
pub(in super::super) fn write(items: &[&Item]) -> Result<Vec<u8>, ExchangeError> {
    let mut markups = Vec::new();
    for list in items.chunk_by(|a, b| a.list == b.list) {
        let is_point = |item: &Item| matches!(item.geometry, None | Some(Geometry::Point { .. }));
        let points: Vec<&Item> = list.iter().copied().filter(|item| is_point(item)).collect();
        if let Some(first) = points.first() {
            markups.push(point_list(first, &points));
        }
        markups.extend(list.iter().copied().filter(|item| !is_point(item)).map(single));
    }
    written_json::bytes(Format::MrkJson, &File { schema: SCHEMA.to_owned(), markups })
}

fn markup(kind: MarkupType, name: &str) -> Markup {
    Markup {
        kind,
        name: Some(name.to_owned()).filter(|name| !name.is_empty()),
        coordinate_system: CoordinateSystem::Lps,
        coordinate_units: Some(Units::Name("mm".to_owned())),
        locked: false,
        fixed_number_of_control_points: Some(false),
        label_format: Some("%N-%d".to_owned()),
        plane_type: None,
        size_mode: None,
        center: None,
        normal: None,
        object_to_base: None,
        base_to_node: None,
        orientation: None,
        size: None,
        plane_bounds: None,
        control_points: Vec::new(),
        measurements: Vec::new(),
        display: None,
        relief: None,
    }
}

/// The points of a list, in their order.
fn point_list(first: &Item, points: &[&Item]) -> Markup {
    let mut markup = markup(MarkupType::Fiducial, &first.list);
    markup.control_points = points.iter().map(|item| list_point(item)).collect();
    markup.relief = Some(Box::new(Extra { list: Some(first.list.clone()), ..Extra::default() }));
    // A list has one colour in Slicer; the points' own ones are beside it.
    markup.display =
        Some(display(true, first.rgb.filter(|_| points.iter().all(|item| item.rgb == first.rgb))));
    markup
}

fn list_point(item: &Item) -> ControlPoint {
    ControlPoint {
        id: Some(PointId::Text(item.id.to_string())),
        description: item.description.clone(),
        locked: item.locked,
        visibility: item.visible,
        relief: Some(Box::new(Extra::of(item))),
        ..control_point(&item.name, item.point())
    }
}

fn control_point(label: &str, at: Option<Point<Patient>>) -> ControlPoint {
    ControlPoint {
        id: None,
        label: label.to_owned(),
        description: String::new(),
        position: at.map(|at| at.xyz.to_array()),
        // Slicer's own default in LPS: its axes are those of RAS.
        orientation: &[-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
        selected: true,
        locked: false,
        visibility: true,
        position_status: Some(if at.is_some() { PositionStatus::Defined } else { PositionStatus::Undefined }),
        relief: None,
    }
}

fn display(visibility: bool, rgb: Option<[f64; 3]>) -> Display {
    Display { visibility, color: rgb, selected_color: rgb }
}

/// A line, an angle, a curve or a plane.
fn single(item: &Item) -> Markup {
    let kind = match &item.geometry {
        Some(Geometry::Line { .. }) => MarkupType::Line,
        Some(Geometry::Angle { .. }) => MarkupType::Angle,
        Some(Geometry::Curve { closed: true, .. }) => MarkupType::ClosedCurve,
        Some(Geometry::Plane { .. }) => MarkupType::Plane,
        _ => MarkupType::Curve,
    };
    let mut markup = markup(kind, &item.name);
    let geometry = item.geometry.as_ref();
    let points = geometry.map_or(&[][..], Geometry::points);
    markup.control_points =
        (1..).zip(points).map(|(n, at)| control_point(&format!("{}-{n}", item.name), Some(*at))).collect();
    for (n, point) in (1..).zip(&mut markup.control_points) {
        point.id = Some(PointId::Text(n.to_string()));
        point.locked = item.locked;
    }
    if let Some(first) = markup.control_points.first_mut() {
        first.description.clone_from(&item.description);
    }
    if let Some(Geometry::Plane { center_mm, normal, axis, size_mm }) = geometry {
        plane::write(&mut markup, center_mm.xyz, DVec3::from(*normal), DVec3::from(*axis), *size_mm);
    }
    let smooth = match geometry {
        Some(Geometry::Curve { smooth, .. }) => Some(*smooth),
        _ => None,
    };
    markup.measurements = geometry.map_or_else(Vec::new, measured);
    markup.locked = item.locked;
    markup.display = Some(display(item.visible, item.rgb));
    markup.relief = Some(Box::new(Extra { list: Some(item.list.clone()), smooth, ..Extra::of(item) }));
    markup
}

fn measured(geometry: &Geometry) -> Vec<Measurement> {
    let measurement = |measure: relief_annotation::Measure| Measurement {
        name: measure.name,
        enabled: true,
        value: measure.value,
        units: measure.unit,
        print_format: "%-#4.4g%s",
    };
    measures(geometry).into_iter().map(measurement).collect()
}
