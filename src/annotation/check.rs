//! The values that an item may have: ranges, lengths of texts, shapes of geometries. Errors name
//! the key's path.

use super::geometry::Geometry;
use relief_base::OutOfRange;

// `Item` has these limits for its callers.
pub(super) const LONGEST_NAME: usize = 120;
pub(super) const LONGEST_DESCRIPTION: usize = 10_000;
pub(super) const MOST_POINTS: usize = 10_000;
pub(super) const FARTHEST_MM: f64 = 1e6;

pub(super) fn validate_geometry(geometry: &Geometry) -> Result<(), OutOfRange> {
    let points = geometry.points();
    for (index, point) in points.iter().enumerate() {
        let far = FARTHEST_MM;
        if let Some(mm) = point.xyz.to_array().iter().find(|mm| !(-far..=far).contains(*mm)) {
            let path = match geometry {
                Geometry::Point { .. } => "geometry.at_mm".to_owned(),
                Geometry::Plane { .. } => "geometry.center_mm".to_owned(),
                Geometry::Line { .. } => format!("geometry.ends_mm[{index}]"),
                _ => format!("geometry.points_mm[{index}]"),
            };
            return Err(OutOfRange::new(path, mm, format!("-{far} to {far} mm each")));
        }
    }
    match geometry {
        Geometry::Curve { closed, .. } => {
            let least = if *closed { 3 } else { 2 };
            if !(least..=MOST_POINTS).contains(&points.len()) {
                let allowed = format!("{least} to {MOST_POINTS} of them");
                let found = format!("{} points", points.len());
                return Err(OutOfRange::new("geometry.points_mm", found, allowed));
            }
            Ok(())
        }
        Geometry::Plane { normal, axis, size_mm, .. } => {
            unit("geometry.normal", normal)?;
            unit("geometry.axis", axis)?;
            let cosine: f64 = normal.iter().zip(axis).map(|(a, b)| a * b).sum();
            if cosine.abs() > 1e-3 {
                return Err(OutOfRange::new(
                    "geometry.axis",
                    "not across the normal",
                    "a direction in the plane",
                ));
            }
            size_mm.iter().try_for_each(|&mm| within("geometry.size_mm", mm, [0.0, FARTHEST_MM]))
        }
        Geometry::Region(region) => within("geometry.volume_ml", region.volume_ml, [0.0, 1e9]),
        Geometry::Mesh(mesh) => {
            within("geometry.area_mm2", mesh.area_mm2, [0.0, 1e15])?;
            mesh.volume_ml.map_or(Ok(()), |ml| within("geometry.volume_ml", ml, [0.0, 1e9]))
        }
        Geometry::Point { .. } | Geometry::Line { .. } | Geometry::Angle { .. } => Ok(()),
    }
}

fn unit(path: &str, direction: &[f64; 3]) -> Result<(), OutOfRange> {
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (0.999..=1.001).contains(&length) {
        return Ok(());
    }
    Err(OutOfRange::new(path, format!("{direction:?}, of length {length}"), "a unit vector"))
}

pub(super) fn within(path: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), OutOfRange> {
    let inside = (low..=high).contains(&value);
    inside.then_some(()).ok_or_else(|| OutOfRange::new(path, value, format!("{low} to {high}")))
}

pub(super) fn finite<'a>(path: &str, values: impl IntoIterator<Item = &'a f64>) -> Result<(), OutOfRange> {
    values.into_iter().try_for_each(|&value| within(path, value, [-1e9, 1e9]))
}

/// One line without control characters.
pub(super) fn line(path: &str, found: &str, least: usize) -> Result<(), OutOfRange> {
    let count = found.chars().count();
    if !(least..=LONGEST_NAME).contains(&count) {
        let allowed = format!("{least} to {LONGEST_NAME} characters");
        return Err(OutOfRange::new(path, format!("{count} characters"), allowed));
    }
    match found.chars().find(|letter| letter.is_control()) {
        Some(letter) => {
            let found = format!("a text with {letter:?}");
            Err(OutOfRange::new(path, found, "one line without control characters"))
        }
        None => Ok(()),
    }
}

pub(super) fn text(path: &str, found: &str) -> Result<(), OutOfRange> {
    let count = found.chars().count();
    if count > LONGEST_DESCRIPTION {
        let allowed = format!("at most {LONGEST_DESCRIPTION} characters");
        return Err(OutOfRange::new(path, format!("{count} characters"), allowed));
    }
    match found.chars().find(|&letter| letter.is_control() && letter != '\n' && letter != '\t') {
        Some(letter) => {
            Err(OutOfRange::new(path, format!("a text with {letter:?}"), "lines without control characters"))
        }
        None => Ok(()),
    }
}

/// As much of a value as an error shows.
pub(super) fn shortened(text: &str) -> String {
    format!("{:?}", text.chars().take(40).collect::<String>())
}
