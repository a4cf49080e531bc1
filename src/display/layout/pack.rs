//! Packing: pictures into frames, row by row. This runs for every live frame.

use super::{DisparityLayer, Frame, FrameContent, FrameEncoder, Layout, LayoutError, Pixels};
use crate::views::{LensPanel, Views};

/// The frame of layers whose sizes the encoder has checked.
pub(super) fn pack<const N: usize>(
    encoder: &FrameEncoder,
    size_px: [u32; 2],
    front: DisparityLayer<'_, N>,
    back: Option<DisparityLayer<'_, N>>,
) -> Result<Frame, LayoutError> {
    let layout = encoder.layout;
    match layout.info().content {
        FrameContent::Picture => Frame::new(size_px, Pixels::Rgb8(color_alone(front.color))),
        FrameContent::Depth => Err(LayoutError::NoDisparity { layout }),
        FrameContent::Views(_) => {
            pack_views(layout, &encoder.views_of(size_px, front, back)?, &encoder.panel)
        }
        FrameContent::Disparity(placement) => {
            let (width, step) = (size_px[0] as usize, placement.line_step as usize);
            let frame_px = placement.frame_px(size_px);
            let mut samples = vec![0; 3 * frame_px[0] as usize * frame_px[1] as usize];
            place(&mut samples, width, front, 0, step);
            if let Some(line) = placement.back_line(size_px[1]) {
                let back = back.ok_or(LayoutError::NoBackground { layout })?;
                place(&mut samples, width, back, line as usize, step);
            }
            if layout.has_header() {
                encoder.header.write_into_line(&mut samples[..3 * width]);
                return Frame::new(encoder.profile.frame_px(), Pixels::Rgb8(samples));
            }
            Frame::new(frame_px, Pixels::Rgb8(samples))
        }
    }
}

/// Views in the layout that they are for.
pub(super) fn pack_views(layout: Layout, views: &Views, panel: &LensPanel) -> Result<Frame, LayoutError> {
    let (size_px, found) = (views.size_px(), views.pictures().len());
    if found != layout.view_count() {
        return Err(LayoutError::ViewCount { layout, found });
    }
    layout.check_size(size_px)?;
    let arrangement = layout.arrangement().ok_or(LayoutError::ViewCount { layout, found })?;
    let pixels = arrangement.arrange(views, panel)?;
    Frame::new(arrangement.frame_px(size_px), Pixels::Rgb8(pixels.into_flattened()))
}

fn color_alone<const N: usize>(color: &[[u8; N]]) -> Vec<u8> {
    let mut samples = vec![0; 3 * color.len()];
    copy_color(&mut samples, color);
    samples
}

/// The picture on the left and its disparity on the right, on the frame lines `first`, `first` +
/// `step` and so on.
fn place<const N: usize>(
    samples: &mut [u8],
    width: usize,
    layer: DisparityLayer<'_, N>,
    first: usize,
    step: usize,
) {
    let rows = layer.color.chunks_exact(width).zip(layer.disparity.chunks_exact(width));
    let lines = samples.chunks_exact_mut(6 * width).skip(first).step_by(step);
    for (line, (color, disparity)) in lines.zip(rows) {
        let (left, right) = line.split_at_mut(3 * width);
        copy_color(left, color);
        for (gray, &d) in right.chunks_exact_mut(3).zip(disparity) {
            gray.fill(d);
        }
    }
}

/// Red, green and blue of every pixel; alpha is left out, the colour is already over the
/// background.
fn copy_color<const N: usize>(rgb: &mut [u8], color: &[[u8; N]]) {
    for (rgb, pixel) in rgb.chunks_exact_mut(3).zip(color) {
        rgb.copy_from_slice(&pixel[..3]);
    }
}
