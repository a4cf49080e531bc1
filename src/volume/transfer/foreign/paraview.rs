//! Colour maps of VTK and ParaView in JSON: `RGBPoints` of four numbers a point, and perhaps
//! `Points` of opacity with midpoint and sharpness.
//!
//! A file is one map or a list of them. A map without opacity becomes one whose opacity rises from
//! 0 to 1 over its range, which is what ParaView begins with. Many maps run from 0 to 1;
//! `TransferImportChoice::range_hu` puts them where CT is.

use serde_json::Value;

use super::curve::{CoincidentNodes, Curve, Node};
use super::draft::{Draft, FoundFunction};
use super::error::{TransferImportError, TransferSyntaxError};
use super::slicer::shortened;
use super::space::ColorSpace;

/// Most maps of a file that are looked at.
const MAX_MAPS: usize = 4096;

pub(super) fn color_maps(json: &Value) -> Result<Vec<FoundFunction<'_>>, TransferImportError> {
    let maps = match json {
        Value::Array(maps) => maps.as_slice(),
        one => std::slice::from_ref(one),
    };
    let is_map = |map: &Value| map.get("RGBPoints").is_some() || map.get("IndexedColors").is_some();
    if !maps.iter().any(is_map) {
        return Err(TransferImportError::Unknown);
    }
    if maps.len() > MAX_MAPS {
        return Err(TransferImportError::range("number of maps", &maps.len(), &format!("up to {MAX_MAPS}")));
    }
    Ok(maps.iter().map(found).collect())
}

fn found(map: &Value) -> FoundFunction<'_> {
    (map["Name"].as_str().map(str::to_owned), Box::new(|| draft(map)))
}

fn draft(map: &Value) -> Result<Draft, TransferImportError> {
    let name = map["Name"].as_str().unwrap_or("colour map");
    let rgb = numbers(map, "RGBPoints", name)?;
    let rgb = rgb.ok_or_else(|| TransferImportError::syntax(name, TransferSyntaxError::NoColorPoints))?;
    let place = format!("{name}: RGBPoints");
    let node = |p: &[f64]| Node::plain(p[0], [p[1], p[2], p[3]]);
    let color = Curve::new(groups_of_four(&rgb, &place)?.map(node).collect(), CoincidentNodes::Step, &place)?;
    let opacity = match numbers(map, "Points", name)? {
        Some(points) => {
            let place = format!("{name}: Points");
            let node = |p: &[f64]| Node { x: p[0], value: [p[1]], midpoint: p[2], sharpness: p[3] };
            Curve::new(groups_of_four(&points, &place)?.map(node).collect(), CoincidentNodes::Step, &place)?
        }
        None => ramp(&color, &place)?,
    };
    let mut left_out = Vec::new();
    if map["UseLogScale"].as_f64() == Some(1.0) || map["UseLogScale"].as_bool() == Some(true) {
        left_out.push("the logarithmic scale".to_owned());
    }
    let name_of = map["Name"].as_str().map(str::to_owned);
    let space = space_of(map, name)?;
    Ok(Draft {
        name: name_of,
        color,
        space,
        opacity,
        gradient: None,
        opacity_unit_mm: 1.0,
        light: None,
        left_out,
    })
}

/// The opacity of a map that has none.
fn ramp(color: &Curve<3>, place: &str) -> Result<Curve<1>, TransferImportError> {
    let [first, last] = color.ends();
    let ends = [(first, 0.0), (last, 1.0)];
    Curve::new(ends.map(|(x, opacity)| Node::plain(x, [opacity])).to_vec(), CoincidentNodes::Replace, place)
}

fn space_of(map: &Value, name: &str) -> Result<ColorSpace, TransferImportError> {
    let wraps = map["HSVWrap"].as_bool().or(map["HSVWrap"].as_f64().map(|flag| flag != 0.0)).unwrap_or(true);
    match map["ColorSpace"].as_str().unwrap_or("RGB") {
        "RGB" => Ok(ColorSpace::Rgb),
        "HSV" => Ok(ColorSpace::Hsv { wraps }),
        "Lab" => Ok(ColorSpace::Lab),
        "Diverging" => Ok(ColorSpace::Diverging),
        "Step" => Ok(ColorSpace::Step),
        other => {
            let allowed = "RGB, HSV, Lab, Diverging or Step";
            Err(TransferImportError::range(&format!("{name}: ColorSpace"), &shortened(other), allowed))
        }
    }
}

/// A flat list of numbers; `None` where there is no such key.
fn numbers(map: &Value, key: &str, name: &str) -> Result<Option<Vec<f64>>, TransferImportError> {
    match &map[key] {
        Value::Null => Ok(None),
        Value::Array(values) => {
            let numbers: Option<Vec<f64>> = values.iter().map(Value::as_f64).collect();
            let place = format!("{name}: {key}");
            numbers
                .map(Some)
                .ok_or_else(|| TransferImportError::syntax(&place, TransferSyntaxError::NotNumbers))
        }
        _ => Err(TransferImportError::syntax(&format!("{name}: {key}"), TransferSyntaxError::NotAList)),
    }
}

fn groups_of_four<'a>(
    numbers: &'a [f64],
    place: &str,
) -> Result<impl Iterator<Item = &'a [f64]>, TransferImportError> {
    if !numbers.len().is_multiple_of(4) || numbers.len() > 4 * Curve::<3>::MAX_NODES {
        let allowed = format!("four for each of 1 to {} points", Curve::<3>::MAX_NODES);
        return Err(TransferImportError::range(
            &format!("{place}: number of values"),
            &numbers.len(),
            &allowed,
        ));
    }
    Ok(numbers.chunks_exact(4))
}
