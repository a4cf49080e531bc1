//! Packing: pictures into frames, row by row. This runs for every live frame.

use super::{DisparityLayer, Frame, FrameEncoder, Layout, LayoutError, Pixels};
use crate::views::{Views, anaglyph};

/// The frame of layers whose sizes the encoder has checked.
pub(super) fn pack<const N: usize>(
    encoder: &FrameEncoder,
    size_px: [u32; 2],
    front: DisparityLayer<'_, N>,
    back: Option<DisparityLayer<'_, N>>,
) -> Result<Frame, LayoutError> {
    let [width, height] = size_px;
    let side_by_side = |layer: DisparityLayer<'_, N>| side_by_side(encoder.layout, width as usize, layer);
    match encoder.layout {
        Layout::Color => Frame::new(size_px, Pixels::Rgb8(color_alone(front.color))),
        Layout::Depth16 => Err(LayoutError::NoDisparity { layout: encoder.layout }),
        Layout::Rgbd => Frame::new([2 * width, height], Pixels::Rgb8(side_by_side(front))),
        Layout::Wowvx | Layout::WowvxFullHeight | Layout::Wowvx4k => {
            with_header(encoder, width, side_by_side(front))
        }
        Layout::Declipse | Layout::DeclipseLines => {
            let back = back.ok_or(LayoutError::NoBackground { layout: encoder.layout })?;
            let mut samples = side_by_side(front);
            let behind = side_by_side(back);
            if encoder.layout == Layout::Declipse {
                samples.extend(behind);
            } else {
                let line = 6 * width as usize;
                let pairs = samples.chunks_exact(line).zip(behind.chunks_exact(line));
                samples = pairs.flat_map(|(front, back)| [front, back]).flatten().copied().collect();
            }
            with_header(encoder, width, samples)
        }
        Layout::Stereo | Layout::Views(_) | Layout::Anaglyph | Layout::Wiggle => {
            pack_views(encoder.layout, &encoder.views_of(size_px, front, back)?)
        }
    }
}

/// Views in the layout that they are for.
pub(super) fn pack_views(layout: Layout, views: &Views) -> Result<Frame, LayoutError> {
    let ([width, height], pictures) = (views.size_px(), views.pictures());
    if pictures.len() != layout.view_count() {
        return Err(LayoutError::ViewCount { layout, found: pictures.len() });
    }
    layout.check_size([width, height])?;
    let Some(grid) = layout.view_grid() else {
        return match (layout, pictures) {
            (Layout::Anaglyph, [left, right]) => {
                Frame::new([width, height], Pixels::Rgb8(anaglyph(left, right).into_flattened()))
            }
            _ => Err(LayoutError::Animation),
        };
    };
    let frame_px = [width * grid.columns(), height * grid.rows()];
    let (line, frame_line) = (3 * width as usize, 3 * frame_px[0] as usize);
    let mut samples = vec![0; frame_line * frame_px[1] as usize];
    for (view, picture) in (0..).zip(pictures) {
        let [column, row] = grid.place(view).map(|at| at as usize);
        let lines = samples.chunks_exact_mut(frame_line).skip(row * height as usize);
        for (to, from) in lines.zip(picture.as_flattened().chunks_exact(line)) {
            to[column * line..][..line].copy_from_slice(from);
        }
    }
    Frame::new(frame_px, Pixels::Rgb8(samples))
}

/// The display's frame with the header on line 0; `width` is that of the left half.
fn with_header(encoder: &FrameEncoder, width: u32, mut samples: Vec<u8>) -> Result<Frame, LayoutError> {
    encoder.header.write_into_line(&mut samples[..3 * width as usize]);
    Frame::new(encoder.profile.frame_px(), Pixels::Rgb8(samples))
}

fn color_alone<const N: usize>(color: &[[u8; N]]) -> Vec<u8> {
    let mut samples = vec![0; 3 * color.len()];
    copy_color(&mut samples, color);
    samples
}

/// The picture on the left and its disparity on the right, on every line or on every other one.
fn side_by_side<const N: usize>(layout: Layout, width: usize, layer: DisparityLayer<'_, N>) -> Vec<u8> {
    let line = 6 * width;
    let step = layout.line_step();
    let mut samples = vec![0; 2 * 3 * layer.color.len() * step];
    let rows = layer.color.chunks_exact(width).zip(layer.disparity.chunks_exact(width));
    for (lines, (color, disparity)) in samples.chunks_exact_mut(line * step).zip(rows) {
        let (left, rest) = lines.split_at_mut(3 * width);
        copy_color(left, color);
        for (gray, &d) in rest.chunks_exact_mut(3).zip(disparity) {
            gray.fill(d);
        }
    }
    samples
}

/// Red, green and blue of every pixel; alpha is left out, the colour is already over the
/// background.
fn copy_color<const N: usize>(rgb: &mut [u8], color: &[[u8; N]]) {
    for (rgb, pixel) in rgb.chunks_exact_mut(3).zip(color) {
        rgb.copy_from_slice(&pixel[..3]);
    }
}
