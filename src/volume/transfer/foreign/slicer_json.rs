//! Volume properties of 3D Slicer in JSON, `.vp.json`, by its schema v1.0.0.
//!
//! A file has `volumeProperties`, each with `components`; those of CT have one. Functions are lists
//! of points with `x`, a value (`y` or `color`), and optionally `midpoint` and `sharpness`. Other
//! keys are ignored, since the schema permits any.

use serde_json::Value;

use super::curve::{CoincidentNodes, Curve, Node};
use super::draft::{Draft, FoundFunction, light};
use super::error::{TransferImportError, TransferSyntaxError};
use super::space::ColorSpace;

const PROPERTIES: &str = "volumeProperties";

pub(super) fn properties(json: &Value) -> Result<Vec<FoundFunction<'_>>, TransferImportError> {
    let listed = json[PROPERTIES].as_array();
    let listed =
        listed.ok_or_else(|| TransferImportError::syntax(PROPERTIES, TransferSyntaxError::NotAList))?;
    Ok(listed.iter().enumerate().map(|(i, property)| found(i, property)).collect())
}

fn found(i: usize, property: &Value) -> FoundFunction<'_> {
    (name_of(property), Box::new(move || draft(property, &format!("{PROPERTIES}[{i}]"))))
}

fn name_of(property: &Value) -> Option<String> {
    property["name"].as_str().map(str::to_owned)
}

fn draft(property: &Value, place: &str) -> Result<Draft, TransferImportError> {
    let components = property["components"].as_array().map_or(&[][..], Vec::as_slice);
    let place = format!("{place}.components");
    let [component, others @ ..] = components else {
        return Err(TransferImportError::syntax(&place, TransferSyntaxError::EmptyList));
    };
    let place = format!("{place}[0]");
    let lighting = &component["lighting"];
    let light_place = format!("{place}.lighting");
    let share =
        |key: &str, otherwise: f64| number(&lighting[key], otherwise, &format!("{light_place}.{key}"));
    let shares = [share("ambient", 0.1)?, share("diffuse", 0.7)?, share("specular", 0.2)?];
    let is_lit = component["shade"].as_bool().unwrap_or(false);
    let light = light(&light_place, is_lit, shares, share("specularPower", 10.0)?)?;

    let at = |key: &str| format!("{place}.{key}");
    let color = match &component["rgbTransferFunction"] {
        Value::Null => {
            let grey: Curve<1> = curve(&component["grayTransferFunction"], "y", &at("grayTransferFunction"))?;
            let rgb = |&Node { x, value: [grey], midpoint, sharpness }: &Node<1>| Node {
                x,
                value: [grey; 3],
                midpoint,
                sharpness,
            };
            Curve::new(
                grey.nodes().iter().map(rgb).collect(),
                CoincidentNodes::Replace,
                &at("grayTransferFunction"),
            )?
        }
        rgb => curve(rgb, "color", &at("rgbTransferFunction"))?,
    };
    let gradient = match &component["gradientOpacity"] {
        Value::Null => None,
        _ if component["disableGradientOpacity"].as_bool() == Some(true) => None,
        gradient => Some(curve::<1>(gradient, "y", &at("gradientOpacity"))?),
    };
    let mut left_out = Vec::new();
    if !others.is_empty() {
        left_out.push(format!("{} more components", others.len()));
    }
    let unit = number(&component["scalarOpacityUnitDistance"], 1.0, &at("scalarOpacityUnitDistance"))?;
    Ok(Draft {
        name: name_of(property),
        color,
        space: ColorSpace::Rgb,
        opacity: curve(&component["scalarOpacity"], "y", &at("scalarOpacity"))?,
        gradient,
        opacity_unit_mm: unit,
        light: Some(light),
        left_out,
    })
}

/// A number, or a default where it is missing.
fn number(json: &Value, otherwise: f64, place: &str) -> Result<f64, TransferImportError> {
    match json {
        Value::Null => Ok(otherwise),
        other => {
            other.as_f64().ok_or_else(|| TransferImportError::syntax(place, TransferSyntaxError::NotANumber))
        }
    }
}

/// A function; `key` is where a point has its value, one number or `N` of them.
fn curve<const N: usize>(
    json: &Value,
    key: &'static str,
    place: &str,
) -> Result<Curve<N>, TransferImportError> {
    let points = json["points"].as_array();
    let points = points.ok_or_else(|| TransferImportError::syntax(place, TransferSyntaxError::NoPoints))?;
    if points.len() > Curve::<N>::MAX_NODES {
        let allowed = format!("1 to {}", Curve::<N>::MAX_NODES);
        return Err(TransferImportError::range(
            &format!("{place}: number of points"),
            &points.len(),
            &allowed,
        ));
    }
    let node = |(i, point): (usize, &Value)| -> Result<Node<N>, TransferImportError> {
        let place = format!("{place}.points[{i}]");
        let numbers: Option<Vec<f64>> = match &point[key] {
            Value::Array(values) => values.iter().map(Value::as_f64).collect(),
            one => one.as_f64().map(|value| vec![value]),
        };
        let value = numbers.and_then(|numbers| numbers.try_into().ok());
        let not = |key, count| TransferImportError::syntax(&place, TransferSyntaxError::Count { key, count });
        let value = value.ok_or_else(|| not(key, N))?;
        let x = point["x"].as_f64().ok_or_else(|| not("x", 1))?;
        let midpoint = number(&point["midpoint"], 0.5, &format!("{place}.midpoint"))?;
        let sharpness = number(&point["sharpness"], 0.0, &format!("{place}.sharpness"))?;
        Ok(Node { x, value, midpoint, sharpness })
    };
    // Slicer fills its functions point by point, so the last of several at one place counts.
    Curve::new(
        points.iter().enumerate().map(node).collect::<Result<_, _>>()?,
        CoincidentNodes::Replace,
        place,
    )
}
