//! From a rendered frame to the bytes of a file or a response: the same for command line, HTTP and
//! batch.
//!
//! The raw form is little-endian: `RLFR`, version (u16, 1), header length (u16, 32), width and
//! height (u32 each), near and far limit in mm (f64 each); then RGBA8 rows from the top, then view
//! depth in mm as f32 rows, `+inf` where the ray hit nothing. Raw depth is only those f32 rows.

use std::collections::BTreeMap;

use relief_base::{DepthLimits, OutOfRange};
use relief_display::{
    CameraMatrices, DepthImage, DisplaySettings, EncodeError, FrameContent, FrameEncoder, Layout,
    LayoutError, Picture, encode_exr, encode_jpeg, encode_png, encode_views,
};
use relief_render::{RenderedFrame, with_span_of_cone};
use relief_volume::{Camera, Projection};

/// Colour fringes of chroma subsampling stay invisible; half the bytes of 95.
const JPEG_QUALITY: u8 = 90;

/// The content of an encoded picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// Colour with depth.
    Frame,
    /// Only depth.
    Depth,
}

/// How a picture is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileFormat {
    /// Lossless, in the layout of the display settings; depth as 16-bit grey.
    Png,
    /// Only colour, lossy.
    Jpeg,
    /// Colour and view depth in mm, with the camera and the depth limits as attributes.
    Exr,
    /// The raw form of the module's documentation.
    Raw,
}

impl FileFormat {
    /// The media type's name.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg => "image/jpeg",
            Self::Exr => "image/x-exr",
            Self::Raw => "application/octet-stream",
        }
    }
}

impl Product {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Depth => "depth",
        }
    }

    /// The formats that it can be written in, the preferred one first.
    #[must_use]
    pub const fn formats(self) -> &'static [FileFormat] {
        match self {
            Self::Frame => &[FileFormat::Png, FileFormat::Jpeg, FileFormat::Exr, FileFormat::Raw],
            Self::Depth => &[FileFormat::Png, FileFormat::Exr, FileFormat::Raw],
        }
    }
}

/// Why a frame could not be encoded.
#[derive(Debug, thiserror::Error)]
pub enum EncodingError {
    /// A display setting is out of range.
    #[error(transparent)]
    Settings(#[from] OutOfRange),
    /// The picture does not fit the layout.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The file could not be made.
    #[error(transparent)]
    File(#[from] EncodeError),
}

/// The bytes of a frame, or of its depth.
///
/// # Errors
/// When a display setting is out of range or the picture does not fit the layout.
pub fn encode(
    frame: &RenderedFrame,
    display: &DisplaySettings,
    product: Product,
    format: FileFormat,
) -> Result<Vec<u8>, EncodingError> {
    let shows_depth = match format {
        FileFormat::Png => {
            product == Product::Depth || display.layout.info().content != FrameContent::Picture
        }
        FileFormat::Jpeg => false,
        FileFormat::Exr | FileFormat::Raw => true,
    };
    // Those of the visible surfaces take as long to find as a picture to compress.
    let limits = if shows_depth { frame.limits_for(display)? } else { display.limits(frame.limits)? };
    match (format, product) {
        (FileFormat::Png, Product::Frame) => {
            let display = with_span_of_cone(display, &frame.camera, frame.size_px, limits)?;
            png(frame, &display.encoder()?, limits)
        }
        (FileFormat::Png, Product::Depth) => {
            let encoder = FrameEncoder::new(Layout::Depth16, display.profile()?, display.header())?;
            png(frame, &encoder.with_depth_filter(display.depth_filter), limits)
        }
        (FileFormat::Jpeg, _) => Ok(encode_jpeg(frame.size_px, &frame.color_rgba, JPEG_QUALITY)?),
        (FileFormat::Exr, Product::Frame) => exr(frame, Some(&frame.color_rgba), limits),
        (FileFormat::Exr, Product::Depth) => exr(frame, None, limits),
        (FileFormat::Raw, Product::Frame) => Ok(raw(frame, limits)),
        (FileFormat::Raw, Product::Depth) => Ok(depth_bytes(frame).collect()),
    }
}

fn png(frame: &RenderedFrame, encoder: &FrameEncoder, limits: DepthLimits) -> Result<Vec<u8>, EncodingError> {
    let picture = match encoder.layout() {
        // For programs: the depth of the rays.
        Layout::Depth16 => Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm)?,
        _ => frame.picture()?,
    };
    if encoder.layout().view_count() > 0 {
        return Ok(encode_views(encoder.layout(), &encoder.views(&picture, limits)?, encoder.panel())?);
    }
    Ok(encode_png(&encoder.encode(&picture, limits)?)?)
}

fn exr(
    frame: &RenderedFrame,
    color: Option<&[[u8; 4]]>,
    limits: DepthLimits,
) -> Result<Vec<u8>, EncodingError> {
    let camera = CameraMatrices {
        view_from_patient: frame.camera.view_from_patient(),
        ndc_from_view: ndc_from_view(&frame.camera, frame.size_px),
    };
    let image = DepthImage {
        size_px: frame.size_px,
        depth_mm: &frame.depth_mm,
        color,
        limits,
        camera: Some(camera),
        attributes: &BTreeMap::new(),
    };
    Ok(encode_exr(&image)?)
}

/// View mm to the picture's unit square, y down, after division by w.
fn ndc_from_view(camera: &Camera, size_px: [u32; 2]) -> glam::DMat4 {
    use glam::{DMat4, DVec4};
    let [x, y] = camera.half_extent(size_px).map(|half| 0.5 / half);
    let [shift_x, shift_y] = camera.lens_shift();
    match camera.projection() {
        // Depth along -z is w, so that the middle, 0.5 of it, comes from z.
        Projection::Perspective { .. } => DMat4::from_cols(
            DVec4::new(x, 0.0, 0.0, 0.0),
            DVec4::new(0.0, -y, 0.0, 0.0),
            DVec4::new(x * shift_x - 0.5, -y * shift_y - 0.5, -1.0, -1.0),
            DVec4::ZERO,
        ),
        Projection::Orthographic { .. } => DMat4::from_cols(
            DVec4::new(x, 0.0, 0.0, 0.0),
            DVec4::new(0.0, -y, 0.0, 0.0),
            DVec4::new(0.0, 0.0, -1.0, 0.0),
            DVec4::new(0.5, 0.5, 0.0, 1.0),
        ),
    }
}

fn raw(frame: &RenderedFrame, limits: DepthLimits) -> Vec<u8> {
    const HEADER_BYTES: u16 = 32;
    let mut bytes = Vec::with_capacity(usize::from(HEADER_BYTES) + 8 * frame.depth_mm.len());
    bytes.extend(b"RLFR");
    bytes.extend(1u16.to_le_bytes());
    bytes.extend(HEADER_BYTES.to_le_bytes());
    bytes.extend(frame.size_px.into_iter().flat_map(u32::to_le_bytes));
    bytes.extend([limits.near_mm, limits.far_mm].into_iter().flat_map(f64::to_le_bytes));
    bytes.extend(frame.color_rgba.as_flattened());
    bytes.extend(depth_bytes(frame));
    bytes
}

fn depth_bytes(frame: &RenderedFrame) -> impl Iterator<Item = u8> {
    frame.depth_mm.iter().flat_map(|mm| mm.to_le_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Point;
    use relief_volume::Orbit;

    #[test]
    fn ndc_matches_the_cameras_own_projection() {
        let size = [200, 100];
        for vertical_fov_deg in [30.0, 0.0] {
            let orbit =
                Orbit { azimuth_deg: 25.0, elevation_deg: 10.0, vertical_fov_deg, ..Orbit::default() };
            let shift = if vertical_fov_deg > 0.0 { [0.2, -0.1] } else { [0.0; 2] };
            let camera =
                orbit.camera(Point::new(1.0, 2.0, 3.0), 50.0).unwrap().with_lens_shift(shift).unwrap();
            let point = Point::new(12.0, -7.0, 30.0);
            let ndc = ndc_from_view(&camera, size).project_point3((camera.view_from_patient() * point).xyz);
            let (u, v, _) = camera.project(point, size).unwrap();
            assert!((ndc.x * 200.0 - u).abs() < 1e-9 && (ndc.y * 100.0 - v).abs() < 1e-9, "{ndc} {u} {v}");
        }
    }
}
