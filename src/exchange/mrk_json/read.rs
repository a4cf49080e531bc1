//! From markups to items.

use std::collections::HashSet;

use super::super::reading::{self, Reading, mirrored};
use super::super::{ExchangeError, Format, Imported, ReadContext};
use super::plane::{self, NoPlane};
use super::wire::{
    ControlPoint, CoordinateSystem, File, Head, Markup, MarkupType, PointId, PositionStatus, Units,
};
use relief_annotation::{Geometry, Item};
use relief_base::{Patient, Point};

const FORMAT: Format = Format::MrkJson;

/// Reads a file of markups.
///
/// # Errors
/// As [`super::super::read`]; places are JSON paths.
pub(in super::super) fn read(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let text = reading::text(FORMAT, bytes)?;
    let head: Head = reading::json(FORMAT, text)?;
    if !is_version_1(&head.schema) {
        let allowed = "one that ends in markups-schema-v1.X.Y.json";
        return Err(ExchangeError::value(FORMAT, "@schema", format!("{:?}", head.schema), allowed));
    }
    let file: File = reading::json(FORMAT, text)?;
    let mut reading = Reading::new(FORMAT, context);
    for (index, markup) in file.markups.iter().enumerate() {
        read_markup(&mut reading, &format!("markups[{index}]"), markup)?;
    }
    Ok(reading.finish())
}

/// As Slicer's own reader does it: by the end of the identifier, in any case.
fn is_version_1(schema: &str) -> bool {
    let schema = schema.to_lowercase();
    let name = schema.trim_end_matches('#').strip_suffix(".json");
    let Some((_, version)) = name.and_then(|name| name.rsplit_once("markups-schema-v")) else { return false };
    let parts: Vec<&str> = version.split('.').collect();
    let is_number = |part: &&str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    parts.len() == 3 && parts[0] == "1" && parts.iter().all(is_number)
}

fn read_markup(reading: &mut Reading<'_>, place: &str, markup: &Markup) -> Result<(), ExchangeError> {
    let mm = millimetres(place, markup)?;
    check_ids(place, &markup.control_points)?;
    if let MarkupType::Roi = markup.kind {
        reading.warn(place, "a box (ROI) is left out: Relief has none");
        return Ok(());
    }
    if let MarkupType::Fiducial = markup.kind {
        return read_points(reading, place, markup, mm);
    }
    let geometry = if markup.kind == MarkupType::Plane {
        read_plane(reading, place, markup, mm)?
    } else {
        read_line(reading, place, markup, mm)?
    };
    if geometry.is_none() {
        reading.warn(place, "it has fewer points with a position than its type needs, and is missing");
    }
    let mut item = reading.item(&named(markup.name.as_deref(), reading, reading.count()), geometry)?;
    let said = markup.control_points.iter().map(|point| point.description.as_str());
    item.description = said.filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n");
    finish(reading, place, item, markup, None)
}

/// A name that a file leaves out is made of the list's and a number, as Slicer labels points.
fn named(name: Option<&str>, reading: &Reading<'_>, index: usize) -> String {
    match name {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => format!("{}-{}", reading.context.list, index + 1),
    }
}

/// Millimetres of a unit of the markup.
fn millimetres(place: &str, markup: &Markup) -> Result<f64, ExchangeError> {
    let unit = match &markup.coordinate_units {
        None => "mm",
        Some(Units::Name(name)) => name,
        Some(Units::Code([code, scheme, _])) if scheme == "UCUM" => code,
        Some(Units::Code([code, scheme, _])) => {
            let found = format!("{code:?} of {scheme:?}");
            return Err(ExchangeError::value(
                FORMAT,
                format!("{place}.coordinateUnits"),
                found,
                "mm or um of UCUM",
            ));
        }
    };
    match unit {
        "mm" => Ok(1.0),
        "um" => Ok(1e-3),
        _ => {
            let found = format!("{unit:?}");
            Err(ExchangeError::value(FORMAT, format!("{place}.coordinateUnits"), found, "mm or um"))
        }
    }
}

fn check_ids(place: &str, points: &[ControlPoint]) -> Result<(), ExchangeError> {
    let mut known = HashSet::new();
    for (index, point) in points.iter().enumerate() {
        let Some(id) = &point.id else { continue };
        let is_empty = matches!(id, PointId::Text(text) if text.is_empty());
        if !is_empty && !known.insert(id) {
            let place = format!("{place}.controlPoints[{index}].id");
            return Err(ExchangeError::value(FORMAT, place, "there twice", "each id once in a markup"));
        }
    }
    Ok(())
}

/// The position of a control point, LPS mm; `None` where it is not defined.
fn position(
    place: &str,
    markup: &Markup,
    index: usize,
    mm: f64,
) -> Result<Option<Point<Patient>>, ExchangeError> {
    let point = &markup.control_points[index];
    match (point.position_status.unwrap_or(PositionStatus::Defined), point.position) {
        (PositionStatus::Defined, None) => {
            let place = format!("{place}.controlPoints[{index}].position");
            Err(ExchangeError::value(
                FORMAT,
                place,
                "not there",
                "three numbers, or positionStatus undefined",
            ))
        }
        (PositionStatus::Defined, Some(xyz)) => {
            let is_ras = markup.coordinate_system == CoordinateSystem::Ras;
            let xyz = if is_ras { mirrored(xyz) } else { xyz };
            Ok(Some(reading::point(xyz.map(|v| v * mm))))
        }
        (PositionStatus::Undefined | PositionStatus::Preview, _) => Ok(None),
    }
}

/// Each point of a list is an item.
fn read_points(
    reading: &mut Reading<'_>,
    place: &str,
    markup: &Markup,
    mm: f64,
) -> Result<(), ExchangeError> {
    let own = markup.relief.as_ref().and_then(|extra| extra.list.clone());
    let list = own.or_else(|| markup.name.clone().filter(|name| !name.is_empty()));
    for (index, point) in markup.control_points.iter().enumerate() {
        let geometry = position(place, markup, index, mm)?.map(|at_mm| Geometry::Point { at_mm });
        let place = format!("{place}.controlPoints[{index}]");
        if point.position_status == Some(PositionStatus::Preview) {
            reading.warn(&place, "a point that was being placed is missing");
        }
        let label = Some(point.label.as_str()).filter(|label| !label.is_empty()).map(str::to_owned);
        let name = label
            .unwrap_or_else(|| format!("{}-{}", list.as_deref().unwrap_or(reading.context.list), index + 1));
        let mut item = reading.item(&name, geometry)?;
        if let Some(list) = &list {
            item.list.clone_from(list);
        }
        item.description.clone_from(&point.description);
        finish(reading, &place, item, markup, Some(point))?;
    }
    Ok(())
}

/// Other values of markups and points: locks, visibility, colours, and Relief's own property.
fn finish(
    reading: &mut Reading<'_>,
    place: &str,
    mut item: Item,
    markup: &Markup,
    point: Option<&ControlPoint>,
) -> Result<(), ExchangeError> {
    let display = markup.display.as_ref();
    item.locked = markup.locked || point.is_some_and(|point| point.locked);
    item.visible =
        display.is_none_or(|display| display.visibility) && point.is_none_or(|point| point.visibility);
    let is_selected = point.is_none_or(|point| point.selected);
    item.rgb = display.and_then(|display| if is_selected { display.selected_color } else { display.color });
    if let Some(extra) = point.map_or(markup.relief.as_ref(), |point| point.relief.as_ref()) {
        extra.clone().apply(&mut item);
    } else if let Some(PointId::Text(id)) = point.and_then(|point| point.id.as_ref())
        && let Ok(id) = id.parse()
    {
        item.id = id; // Slicer saved a file of ours
    }
    reading.push(place, item)
}

/// The geometry of a line, an angle or a curve; `None` where too few points have a position.
fn read_line(
    reading: &mut Reading<'_>,
    place: &str,
    markup: &Markup,
    mm: f64,
) -> Result<Option<Geometry>, ExchangeError> {
    let (most, what) = match markup.kind {
        MarkupType::Line => (2, "2 of a Line"),
        MarkupType::Angle => (3, "3 of an Angle"),
        _ => (Item::MOST_POINTS, "10000 of a curve"),
    };
    let count = markup.control_points.len();
    if count > most {
        let allowed = format!("at most {what}");
        return Err(ExchangeError::value(
            FORMAT,
            format!("{place}.controlPoints"),
            format!("{count} points"),
            allowed,
        ));
    }
    let mut points = Vec::with_capacity(count);
    for index in 0..count {
        points.extend(position(place, markup, index, mm)?);
    }
    let missing = count - points.len();
    // Slicer's own curves are smooth; a file does not say.
    let smooth = markup.relief.as_ref().and_then(|extra| extra.smooth).unwrap_or(true);
    let geometry = match (markup.kind, points.as_slice()) {
        (MarkupType::Line, &[a, b]) => Some(Geometry::Line { ends_mm: [a, b] }),
        (MarkupType::Angle, &[a, corner, b]) => Some(Geometry::Angle { points_mm: [a, corner, b] }),
        (MarkupType::Curve, [_, _, ..]) => Some(Geometry::Curve { points_mm: points, closed: false, smooth }),
        (MarkupType::ClosedCurve, [_, _, _, ..]) => {
            Some(Geometry::Curve { points_mm: points, closed: true, smooth })
        }
        _ => None,
    };
    if missing > 0 && geometry.is_some() {
        reading.warn(place, "points without a position are left out of a curve");
    }
    Ok(geometry)
}

fn read_plane(
    reading: &mut Reading<'_>,
    place: &str,
    markup: &Markup,
    mm: f64,
) -> Result<Option<Geometry>, ExchangeError> {
    for index in 0..markup.control_points.len() {
        position(place, markup, index, mm)?;
    }
    match plane::read(markup, mm) {
        Ok((geometry, is_made_up)) => {
            if is_made_up {
                reading.warn(place, "a plane has no size: it is made as wide as its points are apart");
            }
            Ok(Some(geometry))
        }
        Err(NoPlane::Undefined) => Ok(None),
        Err(NoPlane::Flat) => {
            let place = format!("{place} (normal, orientation or controlPoints)");
            Err(ExchangeError::value(FORMAT, place, "no two directions", "axes that span a plane"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_parsed_as_slicer_does() {
        for good in
            ["markups-schema-v1.0.0.json", "x/Markups-Schema-V1.20.3.JSON##", super::super::wire::SCHEMA]
        {
            assert!(is_version_1(good), "{good}");
        }
        for bad in [
            "",
            "markups-schema-v2.0.0.json",
            "markups-schema-v1.0.json",
            "markups-v1.0.3-schema.json#",
            "v1.0.0",
        ] {
            assert!(!is_version_1(bad), "{bad}");
        }
    }
}
