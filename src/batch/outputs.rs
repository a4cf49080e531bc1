//! The bytes of a job's outputs, from the picture as the rays made it: whatever is drawn over it is
//! drawn here, so that one picture serves plain and annotated outputs, off the thread that renders.

use std::borrow::Cow;
use std::sync::Arc;

use super::annotations::PreparedAnnotations;
use super::error::SeriesError;
use super::pose::ViewCamera;
use super::product::Product;
use crate::product::DEPTH_UNIT_MM;
use relief_dicom::{CaptureOptions, CapturedPicture, SeriesReference, write_capture};
use relief_display::{DisplaySettings, Frame, Layout, Pixels, encode_png};
use relief_render::{Mesh, OverlayItem, Overlays, RenderRequest, RenderedFrame, draw_overlays};
use relief_session::{EncodingError, FileFormat, Product as Picture, encode};
use relief_volume::Grid;

/// Structures that a picture of labels can tell apart.
const MOST_LABELS: usize = 255;

/// A picture as rays made it, and all that becomes of it.
pub(super) struct RenderedView {
    pub(super) frame: RenderedFrame,
    /// With the scene's own overlays.
    pub(super) request: RenderRequest,
    pub(super) display: DisplaySettings,
    pub(super) grid: Grid,
    /// The series that DICOM objects belong to.
    pub(super) reference: Option<Arc<SeriesReference>>,
}

/// The outputs of a job, each with its bytes.
pub(super) struct Outputs {
    pub(super) files: Vec<(Product, Vec<u8>)>,
    /// Warnings about omitted items.
    pub(super) warnings: Vec<String>,
    /// The structures of the labels, from 1 on.
    pub(super) structures: Vec<String>,
}

impl RenderedView {
    /// Makes all outputs. `annotations` are given if an output draws them.
    pub(super) fn outputs(
        &self,
        products: &[Product],
        annotations: Option<&PreparedAnnotations>,
    ) -> Result<Outputs, SeriesError> {
        let mut made = Outputs { files: Vec::new(), warnings: Vec::new(), structures: Vec::new() };
        let plain = self.drawn(&self.request)?;
        let mut annotated = None;
        if let Some(prepared) = annotations
            && products.iter().any(|product| product.needs_annotations() && *product != Product::Labels)
        {
            let mut request = self.request.clone();
            let drawn = prepared.drawables.draw(&mut request, &self.display, &self.grid);
            if drawn.left_out > 0 {
                let left_out = drawn.left_out;
                made.warnings
                    .push(format!("{left_out} annotations are left out; a picture has no room for more"));
            }
            annotated = Some(self.drawn(&request)?);
        }
        for product in products {
            let frame = if product.needs_annotations() { annotated.as_deref() } else { Some(&*plain) };
            let bytes = match (product, frame) {
                (Product::Frame | Product::AnnotatedFrame, Some(frame)) => {
                    encode(frame, &self.display, Picture::Frame, FileFormat::Png)
                        .map_err(SeriesError::permanent)?
                }
                (Product::Color | Product::Annotated, Some(frame)) => {
                    self.color(frame).map_err(SeriesError::permanent)?
                }
                (Product::Capture | Product::AnnotatedCapture, Some(frame)) => self.capture(frame)?,
                (Product::Depth, Some(frame)) => {
                    encode(frame, &self.display, Picture::Depth, FileFormat::Exr)
                        .map_err(SeriesError::permanent)?
                }
                (Product::DepthPng, Some(frame)) => depth_png(frame)?,
                (Product::Camera, Some(frame)) => ViewCamera::of(frame)?.to_json(),
                (Product::Labels, _) => self.labels(annotations, &mut made)?,
                (_, None) => {
                    return Err(SeriesError::permanent("a product draws annotations, and the job has none"));
                }
            };
            made.files.push((*product, bytes));
        }
        Ok(made)
    }

    /// The picture with a request's overlays.
    fn drawn(&self, request: &RenderRequest) -> Result<Cow<'_, RenderedFrame>, SeriesError> {
        if request.overlays.is_empty() {
            return Ok(Cow::Borrowed(&self.frame));
        }
        let mut frame = self.frame.clone();
        draw_overlays(&mut frame, request, &self.grid).map_err(SeriesError::permanent)?;
        Ok(Cow::Owned(frame))
    }

    fn color(&self, frame: &RenderedFrame) -> Result<Vec<u8>, EncodingError> {
        let alone = DisplaySettings { layout: Layout::Color, ..self.display.clone() };
        encode(frame, &alone, Picture::Frame, FileFormat::Png)
    }

    /// A Secondary Capture of the series' study.
    fn capture(&self, frame: &RenderedFrame) -> Result<Vec<u8>, SeriesError> {
        let series = self.reference.as_deref().ok_or_else(|| {
            SeriesError::permanent(
                "the volume is not of a DICOM series with UIDs, so an object of its picture belongs to no study",
            )
        })?;
        let picture = CapturedPicture::of_rgba(frame.size_px, &frame.color_rgba);
        write_capture(&[picture], series, &CaptureOptions::of_view()).map_err(SeriesError::permanent)
    }

    /// Every structure is drawn into an empty picture; the nearest one gets the pixel.
    fn labels(
        &self,
        annotations: Option<&PreparedAnnotations>,
        made: &mut Outputs,
    ) -> Result<Vec<u8>, SeriesError> {
        let structures = annotations.map_or(&[][..], |prepared| &prepared.structures);
        if structures.len() > MOST_LABELS {
            return Err(SeriesError::permanent(format!(
                "{} structures, allowed: at most {MOST_LABELS} in a picture of labels",
                structures.len()
            )));
        }
        let mut frame = RenderedFrame { back: None, ..self.frame.clone() };
        frame.depth_mm.fill(f32::INFINITY);
        let mut labels = vec![0u8; frame.depth_mm.len()];
        for (label, (_, shape)) in (1u8..).zip(structures) {
            let before = frame.depth_mm.clone();
            let mesh = Mesh {
                vertices: shape.vertices.clone(),
                triangles: shape.triangles.clone(),
                rgb: [1.0; 3],
                opacity: 1.0,
            };
            let items = vec![OverlayItem::Mesh(mesh)];
            let overlays = Arc::new(Overlays { items, ..Overlays::default() });
            let request = RenderRequest { overlays, ..self.request.clone() };
            draw_overlays(&mut frame, &request, &self.grid).map_err(SeriesError::permanent)?;
            let depths = before.iter().zip(&frame.depth_mm);
            labels
                .iter_mut()
                .zip(depths)
                .filter(|(_, (before, now))| now < before)
                .for_each(|(own, _)| *own = label);
        }
        made.structures = structures.iter().map(|(name, _)| name.clone()).collect();
        gray_png(self.frame.size_px, &labels).map_err(SeriesError::permanent)
    }
}

/// View depth in units of [`DEPTH_UNIT_MM`]; 0 where nothing is seen.
fn depth_png(frame: &RenderedFrame) -> Result<Vec<u8>, SeriesError> {
    let mut values = Vec::with_capacity(frame.depth_mm.len());
    for mm in &frame.depth_mm {
        let value = (f64::from(*mm) / DEPTH_UNIT_MM).round();
        match mm.is_finite() {
            false => values.push(0),
            true if (1.0..=f64::from(u16::MAX)).contains(&value) => values.push(value as u16),
            true => {
                let most = f64::from(u16::MAX) * DEPTH_UNIT_MM;
                return Err(SeriesError::permanent(format!(
                    "a depth of {mm} mm does not fit into 16 bits, allowed: {DEPTH_UNIT_MM} to {most:.1} mm; depth (EXR) has no such limit"
                )));
            }
        }
    }
    encode_png(&Frame::new(frame.size_px, Pixels::Gray16(values)).map_err(SeriesError::permanent)?)
        .map_err(SeriesError::permanent)
}

fn gray_png([width, height]: [u32; 2], samples: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(file)
}
