//! Packing: pictures into frames, row by row. This runs for every live frame.

use super::{DecodedLayer, Frame, FrameEncoder, Layout, LayoutError, Picture, Pixels};
use crate::display::views::{Views, anaglyph};
use crate::units::{DepthLimits, ViewDepth};

/// The frame of a picture whose size the encoder has checked.
pub(super) fn pack(
    encoder: &FrameEncoder,
    picture: &Picture<'_>,
    limits: DepthLimits,
) -> Result<Frame, LayoutError> {
    let [width, height] = picture.size_px();
    match encoder.layout {
        Layout::Color => Frame::new([width, height], Pixels::Rgb8(color_alone(picture))),
        Layout::Depth16 => Frame::new([width, height], Pixels::Gray16(depth_alone(picture, limits))),
        Layout::Rgbd => Frame::new([2 * width, height], Pixels::Rgb8(side_by_side(encoder, picture, limits))),
        Layout::Wowvx | Layout::WowvxFullHeight | Layout::Wowvx4k => {
            with_header(encoder, width, side_by_side(encoder, picture, limits))
        }
        Layout::Declipse | Layout::DeclipseLines => {
            let back = picture.back().ok_or(LayoutError::NoBackground { layout: encoder.layout })?;
            let mut samples = side_by_side(encoder, picture, limits);
            let behind = side_by_side(encoder, &back, limits);
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
            pack_views(encoder.layout, &encoder.views(picture, limits)?)
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

/// A picture as a display receives it: its colour, and this depth as bytes of disparity.
pub(super) fn layer(
    encoder: &FrameEncoder,
    picture: &Picture<'_>,
    depth_mm: &[f32],
    limits: DepthLimits,
) -> DecodedLayer {
    DecodedLayer {
        color: picture.color().iter().map(|[r, g, b, _]| [*r, *g, *b]).collect(),
        disparity: depth_mm.iter().map(|&mm| disparity_byte(encoder, mm, limits)).collect(),
    }
}

fn disparity_byte(encoder: &FrameEncoder, mm: f32, limits: DepthLimits) -> u8 {
    encoder.profile.disparity(limits.scaled(ViewDepth(mm))).to_byte()
}

/// The display's frame with the header on line 0; `width` is that of the left half.
fn with_header(encoder: &FrameEncoder, width: u32, mut samples: Vec<u8>) -> Result<Frame, LayoutError> {
    encoder.header.write_into_line(&mut samples[..3 * width as usize]);
    Frame::new(encoder.profile.frame_px(), Pixels::Rgb8(samples))
}

fn color_alone(picture: &Picture<'_>) -> Vec<u8> {
    let mut samples = vec![0; 3 * picture.color().len()];
    copy_color(&mut samples, picture.color());
    samples
}

/// Z in 16 bits, 65535 nearest, 0 farthest or missed.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Z is 0..=1")]
fn depth_alone(picture: &Picture<'_>, limits: DepthLimits) -> Vec<u16> {
    let gray = |&mm: &f32| ((1.0 - limits.scaled(ViewDepth(mm)).0) * 65535.0).round() as u16;
    picture.depth_mm().iter().map(gray).collect()
}

/// The picture on the left and its disparity on the right, on every line or on every other one.
fn side_by_side(encoder: &FrameEncoder, picture: &Picture<'_>, limits: DepthLimits) -> Vec<u8> {
    let [width, height] = picture.size_px().map(|side| side as usize);
    let line = 6 * width;
    let step = encoder.layout.line_step();
    let mut samples = vec![0; line * height * step];
    let rows = picture.color().chunks_exact(width).zip(picture.depth_mm().chunks_exact(width));
    for (lines, (color, depth_mm)) in samples.chunks_exact_mut(line * step).zip(rows) {
        let (left, rest) = lines.split_at_mut(3 * width);
        copy_color(left, color);
        for (gray, &mm) in rest.chunks_exact_mut(3).zip(depth_mm) {
            gray.fill(disparity_byte(encoder, mm, limits));
        }
    }
    samples
}

/// Red, green and blue of every pixel; alpha is left out, the colour is already over the background.
fn copy_color(rgb: &mut [u8], color: &[[u8; 4]]) {
    for (rgb, [r, g, b, _]) in rgb.chunks_exact_mut(3).zip(color) {
        rgb.copy_from_slice(&[*r, *g, *b]);
    }
}
