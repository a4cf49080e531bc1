//! From Cornerstone's annotations to items.

use std::collections::BTreeMap;

use serde::de::IgnoredAny;

use super::super::reading::{self, Reading};
use super::super::{ExchangeError, Format, Imported, ReadContext};
use super::wire::{Annotation, AnnotationList};
use relief_annotation::{FrameOfReference, Geometry};
use relief_base::{Patient, Point};

const FORMAT: Format = Format::Cornerstone;

/// Annotations by frame of reference and tool.
type State = BTreeMap<String, BTreeMap<String, Vec<Annotation>>>;

/// Reads annotations.
///
/// # Errors
/// As [`super::super::read`]; places are JSON paths.
pub(in super::super) fn read(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let text = reading::text(FORMAT, bytes)?;
    let mut reading = Reading::new(FORMAT, context);
    if text.trim_start().starts_with('[') {
        let annotations: Vec<Annotation> = reading::json(FORMAT, text)?;
        read_all(&mut reading, "", annotations)?;
        return Ok(reading.finish());
    }
    let keys: BTreeMap<String, IgnoredAny> = reading::json(FORMAT, text)?;
    if keys.contains_key("metadata") {
        let annotation: Annotation = reading::json(FORMAT, text)?;
        read_one(&mut reading, "the file", annotation)?;
    } else if keys.contains_key("annotations") {
        let listed: AnnotationList = reading::json(FORMAT, text)?;
        read_all(&mut reading, "annotations", listed.annotations)?;
    } else {
        let state: State = reading::json_hiding(FORMAT, text, 1)?;
        for (tool, annotations) in state.into_values().flatten() {
            let tool: String = tool.chars().take(40).collect();
            read_all(&mut reading, &format!("....{tool}"), annotations)?;
        }
    }
    Ok(reading.finish())
}

fn read_all(
    reading: &mut Reading<'_>,
    place: &str,
    annotations: Vec<Annotation>,
) -> Result<(), ExchangeError> {
    for (index, annotation) in annotations.into_iter().enumerate() {
        read_one(reading, &format!("{place}[{index}]"), annotation)?;
    }
    Ok(())
}

fn read_one(reading: &mut Reading<'_>, place: &str, annotation: Annotation) -> Result<(), ExchangeError> {
    let Annotation { annotation_uid, is_locked, is_visible, metadata, data, relief, .. } = annotation;
    let tool: String = metadata.tool_name.chars().take(40).collect();
    let smooth = tool == "SplineROI";
    let mut drawn = data.contour.map_or((Vec::new(), true), |contour| (contour.polyline, contour.closed));
    if smooth && !data.handles.points.is_empty() {
        drawn.0.clone_from(&data.handles.points); // what the curve is drawn through
    }
    let points: Vec<Point<Patient>> = data.handles.points.into_iter().map(reading::point).collect();
    let geometry = match (tool.as_str(), points.as_slice()) {
        ("Probe" | "ArrowAnnotate", &[at_mm, ..]) => Geometry::Point { at_mm },
        ("Length", &[a, b]) => Geometry::Line { ends_mm: [a, b] },
        ("Angle", &[a, corner, b]) => Geometry::Angle { points_mm: [a, corner, b] },
        // Its corners are those of the rows, not those around it.
        ("RectangleROI", &[a, b, d, c]) => {
            Geometry::Curve { points_mm: vec![a, b, c, d], closed: true, smooth: false }
        }
        ("PlanarFreehandROI" | "SplineROI" | "LivewireContour", _) => {
            let (polyline, closed) = drawn;
            let points_mm = polyline.into_iter().map(reading::point).collect();
            Geometry::Curve { points_mm, closed, smooth }
        }
        ("Probe" | "ArrowAnnotate" | "Length" | "Angle" | "RectangleROI", points) => {
            let place = format!("{place}.data.handles.points");
            let found = format!("{} points", points.len());
            return Err(ExchangeError::value(FORMAT, place, found, format!("as many as {tool} has")));
        }
        _ => {
            reading.warn(
                place,
                &format!("an annotation of the tool {tool:?} is left out: Relief has none like it"),
            );
            return Ok(());
        }
    };
    let said = [data.label, data.text].into_iter().flatten().find(|text| !text.is_empty());
    let name = said.unwrap_or_else(|| format!("{tool}-{}", reading.count() + 1));
    let mut item = reading.item(&name, Some(geometry))?;
    item.locked = is_locked;
    item.visible = is_visible;
    if let Some(uid) = metadata.frame_of_reference_uid.filter(|uid| !uid.is_empty()) {
        let frame = FrameOfReference(uid);
        if item.frame_of_reference.as_ref().is_some_and(|known| *known != frame) {
            let place = format!("{place}.metadata.FrameOfReferenceUID");
            let allowed = "that one; read the file without a series to keep its own";
            return Err(ExchangeError::value(FORMAT, place, "another one than the series'", allowed));
        }
        item.frame_of_reference = Some(frame);
    }
    if let Some(id) = annotation_uid.and_then(|uid| uid.parse().ok()) {
        item.id = id;
    }
    if let Some(extra) = relief {
        extra.apply(&mut item);
    }
    reading.push(place, item)
}
