//! Transfer functions that other programs wrote: read, checked, and turned into control points.
//!
//! Readers of bytes: 3D Slicer's volume properties (`presets.xml` and MRML scenes, `.vp`,
//! `.vp.json`), and VTK's and ParaView's colour maps in JSON. They open no files and write none of
//! these formats. Nodes with midpoint and sharpness, and colours that are interpolated outside RGB,
//! become piecewise linear functions with an error of less than 1/500 of the whole range. Values
//! are in HU, opacities per mm or as the file defines.

mod curve;
mod draft;
pub(crate) mod error;
mod paraview;
mod points;
mod slicer;
mod slicer_json;
mod space;

pub use draft::ImportedLight;
pub use error::MAX_IMPORT_BYTES;

use self::curve::Curve;
use super::{GradientOpacity, TransferFunction};
use draft::{Draft, FoundFunction};
use error::TransferImportError;

/// The function of a file, and the values that it is stretched over.
#[derive(Clone, Copy, Debug, Default)]
pub struct TransferImportChoice<'a> {
    /// The name of one of several.
    pub name: Option<&'a str>,
    /// Stretches the function's own range of colours to this one, HU: for colour maps of 0 to 1.
    pub range_hu: Option<[f64; 2]>,
}

/// A look that another program saved.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedTransfer {
    /// Its name, where the file has one.
    pub name: Option<String>,
    /// Colour and opacity.
    pub transfer: TransferFunction,
    /// Light, where the file says.
    pub light: Option<ImportedLight>,
    /// Properties of the file that the function does not represent, as sentences.
    pub left_out: Vec<String>,
}

/// Reads the transfer function in a file's bytes, whatever their format.
///
/// # Errors
/// When the format is unknown, a number is out of range, or there are several functions
/// and no name is given.
pub fn import_transfer(
    bytes: &[u8],
    choice: &TransferImportChoice<'_>,
) -> Result<ImportedTransfer, TransferImportError> {
    if bytes.len() > MAX_IMPORT_BYTES {
        return Err(TransferImportError::TooLarge);
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii();
    match bytes.first() {
        Some(b'<') => choose(&slicer::properties_in_xml(bytes)?, choice),
        Some(b'{' | b'[') => {
            let json: serde_json::Value =
                serde_json::from_slice(bytes).map_err(|error| TransferImportError::syntax("JSON", error))?;
            if json.get("volumeProperties").is_some() {
                choose(&slicer_json::properties(&json)?, choice)
            } else {
                choose(&paraview::color_maps(&json)?, choice)
            }
        }
        Some(b'0'..=b'9') => finish(slicer::property_in_lines(bytes)?, choice),
        _ => Err(TransferImportError::Unknown),
    }
}

/// The one that is wanted, or the only one.
fn choose(
    found: &[FoundFunction<'_>],
    choice: &TransferImportChoice<'_>,
) -> Result<ImportedTransfer, TransferImportError> {
    let names = || {
        let known = found.iter().take(100).map(|(name, _)| name.as_deref().unwrap_or("(no name)"));
        known.collect::<Vec<_>>().join(", ")
    };
    let read = match (choice.name, found) {
        (None, [(_, read)]) => read,
        (None, []) => return Err(TransferImportError::Unknown),
        (None, several) => return Err(TransferImportError::Several { count: several.len(), names: names() }),
        (Some(wanted), all) => {
            let same = |(name, _): &&FoundFunction<'_>| name.as_deref() == Some(wanted);
            let missing = || TransferImportError::NoSuchName { wanted: wanted.to_owned(), names: names() };
            &all.iter().find(same).ok_or_else(missing)?.1
        }
    };
    finish(read()?, choice)
}

fn finish(draft: Draft, choice: &TransferImportChoice<'_>) -> Result<ImportedTransfer, TransferImportError> {
    let Draft { name, color, space, opacity, gradient, opacity_unit_mm, light, left_out } = draft;
    let (color, opacity) = match choice.range_hu {
        Some(range_hu) => stretched(color, opacity, range_hu)?,
        None => (color, opacity),
    };
    let points = points::join(&color, space, &opacity);
    let mut transfer = TransferFunction::new(points, opacity_unit_mm)?;
    let acts = |gradient: &Curve<1>| gradient.nodes().iter().any(|node| node.value[0] < 1.0);
    if let Some(gradient) = gradient.filter(acts) {
        transfer = transfer.with_gradient_opacity(GradientOpacity::new(points::over_magnitudes(&gradient))?);
    }
    Ok(ImportedTransfer { name, transfer, light, left_out })
}

/// Both curves, moved so that the colours span `low..high`.
fn stretched(
    color: Curve<3>,
    opacity: Curve<1>,
    [low, high]: [f64; 2],
) -> Result<(Curve<3>, Curve<1>), TransferImportError> {
    if !(low < high && (-1e5..=1e5).contains(&low) && (-1e5..=1e5).contains(&high)) {
        let allowed = "LOW below HIGH, within -100000 to 100000";
        return Err(TransferImportError::range("range_hu", &format!("{low}, {high}"), allowed));
    }
    let [first, last] = color.ends();
    if last - first < 1e-9 {
        return Err(TransferImportError::range(
            "the colours' own range",
            &format!("{first} to {last}"),
            "a longer one",
        ));
    }
    let scale = (high - low) / (last - first);
    let shift = low - first * scale;
    Ok((color.moved(scale, shift), opacity.moved(scale, shift)))
}
