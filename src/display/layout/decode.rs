//! Strict decoding of frames to picture and depth. An error names every deviation from a frame that
//! an encoder could have written.

use super::{DecodedLayer, Frame, FrameContent, Layout, Pixels, Placement};
use crate::header::{Header, HeaderReading};
use crate::problem::FrameProblem;
use crate::views::{Arrangement, Views};

/// The content of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DecodedFrame {
    /// Width and height of the picture, pixels.
    pub size_px: [u32; 2],
    /// The header, for layouts with one.
    pub header: Option<Header>,
    /// Red, green, blue of every pixel; empty for `depth16`. Under a header, the top bit of blue at
    /// every other pixel of line 0 is the header's and not the picture's.
    pub color: Vec<[u8; 3]>,
    /// The depth of every pixel.
    pub depth: DecodedDepth,
    /// The background layer, for layouts that have one.
    pub back: Option<DecodedLayer>,
    /// The views, for layouts of them: `color` is empty then, `size_px` that of each.
    pub views: Option<Views>,
}

/// The depth that was in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DecodedDepth {
    /// The layout carries none.
    None,
    /// D, 255 nearest.
    Disparity(Vec<u8>),
    /// Z in 16 bits, 65535 nearest.
    Scaled16(Vec<u16>),
}

impl DecodedFrame {
    const fn empty(size_px: [u32; 2]) -> Self {
        let depth = DecodedDepth::None;
        Self { size_px, header: None, color: Vec::new(), depth, back: None, views: None }
    }

    /// The picture with its disparity, and the background layer; `None` for layouts without
    /// disparity.
    ///
    /// The header replaces the top bit of blue at every other pixel of line 0; it is restored from
    /// the pixel to the right.
    #[must_use]
    pub fn into_layers(mut self) -> Option<(DecodedLayer, Option<DecodedLayer>)> {
        let DecodedDepth::Disparity(disparity) = self.depth else { return None };
        let taken = self.header.map_or(0, |header| header.width_px() as usize);
        for pixel in (0..taken.min(self.color.len().saturating_sub(1))).step_by(2) {
            self.color[pixel][2] = self.color[pixel][2] & 0x7F | self.color[pixel + 1][2] & 0x80;
        }
        Some((DecodedLayer { color: self.color, disparity }, self.back))
    }
}

impl Layout {
    /// Takes a frame of this layout apart.
    ///
    /// # Errors
    /// Everything about the frame that this layout's encoder would not have written.
    pub fn decode(self, frame: &Frame) -> Result<DecodedFrame, Vec<FrameProblem>> {
        let found = |found, expected| Err(vec![FrameProblem::PixelFormat { found, expected }]);
        let (size_px, content) = (frame.size_px(), self.info().content);
        match (content, frame.pixels()) {
            (FrameContent::Depth, Pixels::Gray16(samples)) => {
                let depth = DecodedDepth::Scaled16(samples.clone());
                Ok(DecodedFrame { depth, ..DecodedFrame::empty(size_px) })
            }
            (FrameContent::Depth, Pixels::Rgb8(_)) => found("8-bit RGB", "16-bit grey"),
            (_, Pixels::Gray16(_)) => found("16-bit grey", "8-bit RGB"),
            (FrameContent::Picture, Pixels::Rgb8(samples)) => {
                Ok(DecodedFrame { color: rgb_pixels(samples).collect(), ..DecodedFrame::empty(size_px) })
            }
            (FrameContent::Views(arrangement), Pixels::Rgb8(samples)) => {
                decode_views(self.arrangement().unwrap_or(arrangement), size_px, samples)
                    .map_err(|problem| vec![problem])
            }
            (FrameContent::Disparity(placement), Pixels::Rgb8(samples)) => {
                decode_disparity(self, placement, size_px, samples)
            }
        }
    }
}

/// Width and height of the picture in a frame; the problem when the frame cannot be divided so.
fn picture_px(layout: Layout, placement: Placement, frame_px: [u32; 2]) -> Result<[u32; 2], FrameProblem> {
    let wrong = |expected| Err(FrameProblem::FrameSize { found_px: frame_px, expected });
    let picture_px = placement.picture_px(frame_px);
    match layout.info().frame_px {
        Some(only_px) if only_px != frame_px => wrong("3840x2160"),
        _ if !frame_px[0].is_multiple_of(2) => wrong("an even width"),
        _ if placement.frame_px(picture_px) != frame_px => wrong("an even height"),
        _ => Ok(picture_px),
    }
}

fn decode_disparity(
    layout: Layout,
    placement: Placement,
    frame_px: [u32; 2],
    samples: &[u8],
) -> Result<DecodedFrame, Vec<FrameProblem>> {
    let size_px = picture_px(layout, placement, frame_px).map_err(|problem| vec![problem])?;
    let mut problems = Vec::new();
    let header = if layout.has_header() { read_header(frame_px, samples, &mut problems) } else { None };
    problems.extend(depth_problems(layout, frame_px, samples));
    if !problems.is_empty() {
        return Err(problems);
    }
    let layer = |first: u32| {
        let lines = samples.chunks_exact(6 * size_px[0] as usize).skip(first as usize);
        unpacked(lines.step_by(placement.line_step as usize).take(size_px[1] as usize))
    };
    let (front, back) = (layer(0), placement.back_line(size_px[1]).map(layer));
    let depth = DecodedDepth::Disparity(front.disparity);
    Ok(DecodedFrame { size_px, header, color: front.color, depth, back, views: None })
}

/// The views of a frame that keeps them apart.
fn decode_views(
    arrangement: Arrangement,
    frame_px: [u32; 2],
    samples: &[u8],
) -> Result<DecodedFrame, FrameProblem> {
    match arrangement {
        Arrangement::RedCyan => {
            return Err(FrameProblem::Inseparable("an anaglyph mixes both views in every pixel"));
        }
        Arrangement::Animation => {
            return Err(FrameProblem::Inseparable("the views of a wiggle are the pictures of an animation"));
        }
        Arrangement::Lenses => {
            return Err(FrameProblem::Inseparable("a panel with lenses has thirds of pixels of every view"));
        }
        Arrangement::Tiles { .. } | Arrangement::Turns(_) => {}
    }
    let expected = "a whole number of pixels for each view";
    let views = arrangement.separate(frame_px, samples.as_chunks::<3>().0);
    let views = views.ok_or(FrameProblem::FrameSize { found_px: frame_px, expected })?;
    Ok(DecodedFrame { size_px: views.size_px(), views: Some(views), ..DecodedFrame::empty(frame_px) })
}

/// The picture in the left half of some lines and its disparity in the right one.
fn unpacked<'a>(lines: impl Iterator<Item = &'a [u8]>) -> DecodedLayer {
    let mut layer = DecodedLayer { color: Vec::new(), disparity: Vec::new() };
    for line in lines {
        let (left, right) = line.split_at(line.len() / 2);
        layer.color.extend(rgb_pixels(left));
        layer.disparity.extend(right.iter().step_by(3));
    }
    layer
}

fn read_header(frame_px: [u32; 2], samples: &[u8], problems: &mut Vec<FrameProblem>) -> Option<Header> {
    // Only the left half: a header never extends into the depth.
    let half_line = samples.get(..3 * (frame_px[0] as usize / 2)).unwrap_or_default();
    let reading = HeaderReading::of_line(half_line);
    problems.extend(reading.problems.into_iter().map(FrameProblem::Header));
    reading.header
}

/// Faults of the depth half and of the lines that must be black.
pub(crate) fn depth_problems(layout: Layout, frame_px: [u32; 2], samples: &[u8]) -> Vec<FrameProblem> {
    let Some(placement) = layout.placement() else { return Vec::new() };
    // The background layer has its disparity on the right, too.
    let step = if placement.back.is_some() { 1 } else { placement.line_step as usize };
    let mut problems: Vec<_> = gray_problem(frame_px, samples, step).into_iter().collect();
    if placement.has_black_lines() {
        problems.extend(odd_line_problem(frame_px, samples));
    }
    problems
}

/// Pixels right of the middle that are not grey, on lines 0, `step`, 2 `step`, ...
fn gray_problem(frame_px: [u32; 2], samples: &[u8], step: usize) -> Option<FrameProblem> {
    let width = frame_px[0] as usize;
    let (mut pixels, mut first) = (0, None);
    for (y, line) in samples.chunks_exact(3 * width).enumerate().step_by(step) {
        let depth = rgb_pixels(line).enumerate().skip(width / 2);
        for (x, rgb) in depth.filter(|(_, [r, g, b])| r != g || g != b) {
            pixels += 1;
            first.get_or_insert((position(x, y), rgb));
        }
    }
    first.map(|(first, rgb)| FrameProblem::DepthNotGrey { pixels, first, rgb })
}

/// Pixels on odd lines that are not black.
fn odd_line_problem(frame_px: [u32; 2], samples: &[u8]) -> Option<FrameProblem> {
    let (mut lines, mut pixels, mut first) = (0, 0, None);
    for (y, line) in samples.chunks_exact(3 * frame_px[0] as usize).enumerate().skip(1).step_by(2) {
        if line.iter().all(|&sample| sample == 0) {
            continue;
        }
        lines += 1;
        for (x, _) in rgb_pixels(line).enumerate().filter(|(_, rgb)| *rgb != [0; 3]) {
            pixels += 1;
            first.get_or_insert(position(x, y));
        }
    }
    first.map(|first| FrameProblem::OddLinesNotBlack { lines, pixels, first })
}

/// The numbers of odd and of even lines that are not all black.
pub(crate) fn odd_and_even_lines(width: usize, samples: &[u8]) -> [usize; 2] {
    let mut counts = [0; 2];
    for (y, line) in samples.chunks_exact(3 * width).enumerate() {
        counts[usize::from(y % 2 == 0)] += usize::from(line.iter().any(|&sample| sample != 0));
    }
    counts
}

fn rgb_pixels(samples: &[u8]) -> impl Iterator<Item = [u8; 3]> + '_ {
    samples.as_chunks::<3>().0.iter().copied()
}

fn position(x: usize, y: usize) -> [u32; 2] {
    [x as u32, y as u32]
}
