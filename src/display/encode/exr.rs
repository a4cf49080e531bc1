//! OpenEXR: view depth in mm with, if wanted, the colours, the camera and any further attributes.
//!
//! Channels: `Z` (32-bit float, mm, `+inf` where the ray hit nothing) and `R G B A` (16-bit float).
//! As the format wants it, R, G and B are linear light: the sRGB curve is taken off on writing and
//! put back on reading, which gives the same bytes. A is as rendered.
//!
//! Attributes: `near_mm` and `far_mm` (double), the standard `worldToCamera` and `worldToNDC`, and
//! the caller's.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::LazyLock;

use ::exr::image::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, read::read, write::WritableImage,
};
use ::exr::meta::MetaData;
use ::exr::meta::attribute::{AttributeValue, Text};
use ::exr::meta::header::LayerAttributes;
use ::exr::prelude::{ReadChannels, ReadLayers};
use glam::{DMat4, DVec3};
use half::f16;

use super::{EncodeError, check_count};
use crate::MAX_FRAME_SIDE_PX;
use relief_base::{DepthLimits, Patient, Transform, View};

/// The most memory that the channels of a file may take.
const MAX_DECODED_BYTES: u64 = 2 << 30;

/// The value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// A `double`.
    Number(f64),
    /// A `v3d`.
    Vector([f64; 3]),
    /// A `string`, Latin-1.
    Text(String),
}

/// The camera as OpenEXR's standard attributes give it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMatrices {
    /// Patient mm to view mm.
    pub view_from_patient: Transform<View, Patient>,
    /// View mm to the picture: after division by w, (0, 0) is its top left and (1, 1) its bottom
    /// right corner.
    pub ndc_from_view: DMat4,
}

/// The channels of a file. Rows from the top left.
#[derive(Clone, Copy, Debug)]
pub struct DepthImage<'a> {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// View depth in mm, `+inf` for a miss.
    pub depth_mm: &'a [f32],
    /// Display-referred sRGB and alpha.
    pub color: Option<&'a [[u8; 4]]>,
    /// The limits between which depth is scaled for displays, mm.
    pub limits: DepthLimits,
    /// The camera.
    pub camera: Option<CameraMatrices>,
    /// Further attributes by name.
    pub attributes: &'a BTreeMap<String, Attribute>,
}

/// The decoded content of a file. Rows from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodedDepthImage {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// View depth in mm, `+inf` for a miss.
    pub depth_mm: Vec<f32>,
    /// Display-referred sRGB and alpha, when the file has R, G, B and A.
    pub color: Option<Vec<[u8; 4]>>,
    /// Attributes that are numbers (`double`), vectors (`v3d`) or texts, `near_mm` and `far_mm`
    /// among them.
    pub attributes: BTreeMap<String, Attribute>,
}

/// An OpenEXR file: scan lines, losslessly compressed, the same bytes for the same input.
///
/// # Errors
/// When a slice does not fill the size, an attribute cannot be stored, or the encoder fails.
pub fn encode_exr(image: &DepthImage<'_>) -> Result<Vec<u8>, EncodeError> {
    check_count("the depth", image.size_px, image.depth_mm.len())?;
    let mut channels = vec![AnyChannel::new("Z", FlatSamples::F32(image.depth_mm.to_vec()))];
    if let Some(color) = image.color {
        check_count("the colour", image.size_px, color.len())?;
        channels.extend(color_channels(color));
    }
    let size = image.size_px.map(|side| side as usize);
    let layer = Layer::new(
        (size[0], size[1]),
        layer_attributes(image)?,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels.into()),
    );
    let mut file = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut file).map_err(EncodeError::Exr)?;
    let mut file = file.into_inner();
    sort_attributes(&mut file)?;
    Ok(file)
}

/// Reads an OpenEXR file with a channel `Z`.
///
/// # Errors
/// When the file is damaged, has no `Z`, is larger than 16384 pixels each way or than 2 GiB in all.
pub fn decode_exr(file: &[u8]) -> Result<DecodedDepthImage, EncodeError> {
    check_size(file)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(file))
        .map_err(EncodeError::Exr)?;
    let layer = image.layer_data;
    let size_px = [layer.size.width(), layer.size.height()].map(|side| side as u32);
    let channel = |name: &str| {
        let found = layer.channel_data.list.iter().find(|channel| channel.name == *name);
        found.map(|channel| channel.sample_data.values_as_f32())
    };
    let depth_mm: Vec<f32> = channel("Z").ok_or(EncodeError::NoDepthChannel)?.collect();
    check_count("the channel Z", size_px, depth_mm.len())?; // other programs may subsample
    let color: Option<Vec<_>> = match (channel("R"), channel("G"), channel("B"), channel("A")) {
        (Some(r), Some(g), Some(b), Some(a)) => {
            let rgb = r.zip(g).zip(b).map(|((r, g), b)| [r, g, b].map(srgb_from_linear));
            Some(rgb.zip(a).map(|([r, g, b], a)| [r, g, b, to_byte(a)]).collect())
        }
        _ => None,
    };
    if let Some(color) = &color {
        check_count("the colour", size_px, color.len())?;
    }
    let attributes = layer.attributes.other.iter();
    let attributes =
        attributes.filter_map(|(name, value)| Some((name.to_string(), own_value(value)?))).collect();
    Ok(DecodedDepthImage { size_px, depth_mm, color, attributes })
}

/// Rejects a size that is too large, before allocating memory for it.
fn check_size(file: &[u8]) -> Result<(), EncodeError> {
    let meta = MetaData::read_from_buffered(Cursor::new(file), false).map_err(EncodeError::Exr)?;
    for header in &meta.headers {
        let size @ [width, height] = [header.layer_size.width(), header.layer_size.height()];
        let side = 1..=MAX_FRAME_SIDE_PX as usize;
        let bytes = || width as u64 * height as u64 * header.channels.bytes_per_pixel as u64;
        if !side.contains(&width) || !side.contains(&height) || bytes() > MAX_DECODED_BYTES {
            return Err(EncodeError::ExrSize(size));
        }
    }
    Ok(())
}

fn color_channels(color: &[[u8; 4]]) -> [AnyChannel<FlatSamples>; 4] {
    let linear = &*LINEAR_FROM_SRGB;
    let channel = |name: &str, index: usize| {
        AnyChannel::new(name, FlatSamples::F16(color.iter().map(|c| linear[usize::from(c[index])]).collect()))
    };
    let alpha = color.iter().map(|c| f16::from_f32(f32::from(c[3]) / 255.0)).collect();
    [channel("R", 0), channel("G", 1), channel("B", 2), AnyChannel::new("A", FlatSamples::F16(alpha))]
}

/// Linear light of each sRGB byte (IEC 61966-2-1).
static LINEAR_FROM_SRGB: LazyLock<[f16; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let srgb = byte as f64 / 255.0;
        f16::from_f64(if srgb <= 0.04045 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) })
    })
});

/// The sRGB byte of linear light, the inverse of [`LINEAR_FROM_SRGB`].
fn srgb_from_linear(linear: f32) -> u8 {
    let linear = f64::from(linear).clamp(0.0, 1.0);
    let srgb = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    to_byte(srgb as f32)
}

fn to_byte(unit: f32) -> u8 {
    (unit.clamp(0.0, 1.0) * 255.0).round() as u8
}

fn layer_attributes(image: &DepthImage<'_>) -> Result<LayerAttributes, EncodeError> {
    let mut attributes = LayerAttributes::default();
    for (name, value) in [("near_mm", image.limits.near_mm), ("far_mm", image.limits.far_mm)] {
        attributes.other.insert(Text::from(name), AttributeValue::F64(value));
    }
    for (name, value) in image.attributes {
        let refused = || EncodeError::Attribute(name.clone());
        if name.is_empty() || name.len() > 255 || !name.bytes().all(|c| c.is_ascii_graphic()) {
            return Err(refused());
        }
        let text = Text::new_or_none(name).ok_or_else(refused)?;
        attributes.other.insert(text, exr_value(value).ok_or_else(refused)?);
    }
    if let Some(camera) = image.camera {
        let affine = camera.view_from_patient.affine;
        // OpenEXR's camera space looks along +z.
        let camera_from_patient = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)) * DMat4::from(affine);
        attributes.world_to_camera = Some(row_vector_matrix(camera_from_patient));
        attributes.world_to_normalized_device =
            Some(row_vector_matrix(camera.ndc_from_view * DMat4::from(affine)));
    }
    Ok(attributes)
}

/// OpenEXR multiplies row vectors, so its rows are our columns.
fn row_vector_matrix(matrix: DMat4) -> [f32; 16] {
    matrix.to_cols_array().map(|value| value as f32)
}

fn exr_value(value: &Attribute) -> Option<AttributeValue> {
    Some(match value {
        Attribute::Number(number) => AttributeValue::F64(*number),
        Attribute::Vector(vector) => AttributeValue::Custom {
            kind: Text::from("v3d"),
            bytes: vector.iter().flat_map(|v| v.to_le_bytes()).collect(),
        },
        Attribute::Text(text) => AttributeValue::Text(Text::new_or_none(text)?),
    })
}

fn own_value(value: &AttributeValue) -> Option<Attribute> {
    match value {
        AttributeValue::F64(number) => Some(Attribute::Number(*number)),
        AttributeValue::Text(text) => Some(Attribute::Text(text.to_string())),
        AttributeValue::Custom { kind, bytes } if *kind == *"v3d" => {
            let ([x, y, z], []) = bytes.as_chunks::<8>() else { return None };
            Some(Attribute::Vector([*x, *y, *z].map(f64::from_le_bytes)))
        }
        _ => None,
    }
}

/// Puts the header's attributes in the order of their names: the encoder keeps them in a hash map,
/// whose order changes from run to run. The header's length stays, so the offsets behind it stay
/// right.
fn sort_attributes(file: &mut [u8]) -> Result<(), EncodeError> {
    const START: usize = 8; // magic number and version
    let broken = || EncodeError::ExrHeader;
    let mut attributes: Vec<Vec<u8>> = Vec::new();
    let mut rest = file.get(START..).ok_or_else(broken)?;
    while rest.first().ok_or_else(broken)? != &0 {
        let length = attribute_len(rest).ok_or_else(broken)?;
        let (attribute, behind) = rest.split_at_checked(length).ok_or_else(broken)?;
        attributes.push(attribute.to_vec());
        rest = behind;
    }
    attributes.sort();
    let sorted = attributes.concat();
    file.get_mut(START..START + sorted.len()).ok_or_else(broken)?.copy_from_slice(&sorted);
    Ok(())
}

/// Bytes of the attribute at the front: name, 0, type, 0, length (32 bits), value.
fn attribute_len(bytes: &[u8]) -> Option<usize> {
    let name = bytes.iter().position(|&byte| byte == 0)? + 1;
    let kind = bytes.get(name..)?.iter().position(|&byte| byte == 0)? + 1;
    let length = u32::from_le_bytes(*bytes.get(name + kind..)?.first_chunk()?);
    Some(name + kind + 4 + length as usize)
}
