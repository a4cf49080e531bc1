//! From items to Cornerstone's annotations.

use glam::DVec3;

use super::super::extra::Extra;
use super::super::{ExchangeError, Format, written_json};
use super::wire::{Annotation, Contour, Data, Handles, Metadata, Spline};
use relief_annotation::{Geometry, Item, catmull_rom};
use relief_base::{Patient, Point};

/// Straight parts between two points of a smooth curve.
const PARTS: usize = 16;

/// Writes an array of annotations.
///
/// # Errors
/// Only those of JSON, which has no other numbers than finite ones.
pub(in super::super) fn write(items: &[&Item]) -> Result<Vec<u8>, ExchangeError> {
    let annotations: Vec<Annotation> = items.iter().filter_map(|item| annotation(item)).collect();
    written_json::bytes(Format::Cornerstone, &annotations)
}

fn annotation(item: &Item) -> Option<Annotation> {
    let geometry = item.geometry.as_ref()?;
    let (tool, contour) = match geometry {
        Geometry::Point { .. } => ("Probe", None),
        Geometry::Line { .. } => ("Length", None),
        Geometry::Angle { .. } => ("Angle", None),
        Geometry::Curve { points_mm, closed, smooth } => {
            let points: Vec<DVec3> = points_mm.iter().map(|at| at.xyz).collect();
            let line = if *smooth { catmull_rom(&points, *closed, PARTS) } else { points };
            let polyline = line.into_iter().map(|at| at.to_array()).collect();
            let tool = if *smooth { "SplineROI" } else { "PlanarFreehandROI" };
            (tool, Some(Contour { polyline, closed: *closed }))
        }
        Geometry::Plane { .. } | Geometry::Region(_) | Geometry::Mesh(_) => return None,
    };
    let has_handles = tool != "PlanarFreehandROI";
    let points = geometry.points().iter().filter(|_| has_handles).map(|at| at.xyz.to_array()).collect();
    let normal = normal(geometry.points());
    // The up direction lies in the slice: towards the front, as in axial slices, or else towards
    // the head.
    let up = [-DVec3::Y, DVec3::Z].into_iter().map(|up| up.reject_from_normalized(normal));
    let up = up.filter(|up| up.length() > 0.1).map(DVec3::normalize).next();
    let frame = item.frame_of_reference.as_ref().map(|frame| frame.0.clone());
    Some(Annotation {
        annotation_uid: Some(item.id.to_string()),
        highlighted: false,
        is_locked: item.locked,
        is_visible: item.visible,
        invalidated: true,
        metadata: Metadata {
            tool_name: tool.to_owned(),
            frame_of_reference_uid: frame.filter(|frame| is_uid(frame)),
            view_plane_normal: Some(normal.to_array().map(|v| v + 0.0)),
            view_up: up.map(|up| up.to_array().map(|v| v + 0.0)),
        },
        data: Data {
            label: Some(item.name.clone()),
            text: None,
            handles: Handles { points, ..Handles::default() },
            contour,
            spline: (tool == "SplineROI").then_some(Spline { kind: "CATMULLROM", resolution: 20 }),
            cached_stats: super::wire::EmptyObject {},
        },
        relief: Some(Box::new(Extra {
            list: Some(item.list.clone()),
            description: Some(item.description.clone()).filter(|text| !text.is_empty()),
            ..Extra::of(item)
        })),
    })
}

/// Whether a frame of reference is one of DICOM, not the hash of a volume without one.
fn is_uid(frame: &str) -> bool {
    !frame.is_empty() && frame.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.')
}

/// The direction across the slice that shows an item whole: that of axial slices, as nearly as its
/// points allow.
fn normal(points: &[Point<Patient>]) -> DVec3 {
    let axial = -DVec3::Z;
    let &[first, second, ..] = points else { return axial };
    let around = points.iter().zip(points.iter().cycle().skip(1));
    let newell: DVec3 = around.map(|(a, b)| (*a - first).xyz.cross((*b - first).xyz)).sum();
    if let Some(normal) = newell.try_normalize() {
        return if normal.dot(axial) < 0.0 { -normal } else { normal };
    }
    let Some(along) = (second - first).xyz.try_normalize() else { return axial };
    let across = axial.reject_from_normalized(along);
    across
        .try_normalize()
        .filter(|_| across.length() > 1e-6)
        .unwrap_or_else(|| along.any_orthonormal_vector())
}
