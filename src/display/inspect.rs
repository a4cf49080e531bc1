//! Inspection: which layout a picture has, what its header says, and everything that is wrong with
//! it.
//!
//! A strict reader of foreign pictures. [`Layout::decode`] is the decoder that returns pixels.
//!
//! The layout is recognised by the header, the frame's size, black odd lines and a grey right half.
//! A layout without a header looks like any other picture: a picture with a grey right half is
//! taken as `rgbd`, any other as `color`. The header does not distinguish the two layouts with a
//! background layer; their lines do. At a display's own frame size a missing header is a problem
//! whatever the pixels are, because the display would show plain 2D.

use std::io::Cursor;

use data_encoding::HEXUPPER;
use image::{ColorType, DynamicImage, ImageFormat, ImageReader};

use super::encode::written_layout;
use super::header::{ContentType, ExtendedPart, HeaderPart, HeaderProblem, HeaderReading};
use super::layout::{Frame, Pixels, Placement, depth_problems, odd_and_even_lines};
use super::problem::FrameProblem;
use crate::layout::error::LayoutError;
use crate::layout::table::Layout;
use crate::limits::MAX_FRAME_SIDE_PX;
use crate::views::Arrangement;

/// The most memory that decoding may take: an 8-bit RGB picture of 16384x16384 and some room.
const MAX_DECODED_BYTES: u64 = 1 << 30;

/// Frame sizes of the displays that read the header.
const DISPLAY_FRAMES_PX: [[u32; 2]; 2] = [[1920, 1080], [3840, 2160]];

const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG_SIGNATURE: &[u8] = b"\xFF\xD8\xFF";

/// PNG chunks that make viewers change pixel values.
const COLOR_CHUNKS: [&str; 5] = ["gAMA", "cHRM", "iCCP", "sRGB", "cICP"];

/// The content of a frame and its faults; `relief inspect FRAME.png --json` prints it as JSON.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct FrameReport {
    /// The layout that the frame has, or comes nearest to.
    pub layout: Layout,
    /// Width and height.
    pub frame_px: [u32; 2],
    /// H0 to H9 as 20 hexadecimal digits; `None` without a header.
    pub header_hex: Option<String>,
    /// Kind of content; `None` without a header, or when H1 is unknown.
    pub content: Option<ContentType>,
    /// H2.
    pub factor: Option<u8>,
    /// H3.
    pub offset: Option<u8>,
    /// The one of the two that the header selects.
    pub select: Option<Select>,
    /// H10 to H31 as 44 hexadecimal digits (fewer when cut); `None` without the extended part.
    pub extended_hex: Option<String>,
    /// Everything that is wrong, in the order of file, size, header, pixels.
    pub problems: Vec<FrameProblem>,
    /// The views, for layouts of them; only files say that they are such.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<ViewsReport>,
    /// The range of the frame's depth; `None` where the frame has no depth.
    #[serde(skip)]
    pub depth: Option<DepthExtent>,
}

/// Bits 7 and 6 of H4: the values that the display takes from the header instead of its own
/// settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Select {
    /// The factor.
    pub factor: bool,
    /// The offset.
    pub offset: bool,
}

/// Views that a file says it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ViewsReport {
    /// Their number.
    pub count: u32,
    /// Beside each other; 1 where all of them are in one place.
    pub columns: u32,
    /// Above each other.
    pub rows: u32,
    /// Width and height of each.
    pub size_px: [u32; 2],
}

/// The values that occur in a frame's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthExtent {
    /// The farthest value: D, or 16-bit Z for `depth16`.
    pub farthest: u16,
    /// The nearest value.
    pub nearest: u16,
    /// Different values that occur.
    pub distinct: usize,
    /// Pixels at 0: the far limit or no hit.
    pub at_far_limit: usize,
    /// Pixels in all.
    pub pixels: usize,
}

/// A file that cannot be inspected.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    /// JPEG, where no header survives.
    #[error("this is a JPEG file; 2D+Z frames are PNG, because lossy compression alters the header's bits")]
    Jpeg,
    /// Not a picture that can be a frame.
    #[error("this is not a PNG file: it begins with {0:02x?}, expected {PNG_SIGNATURE:02x?}")]
    NotPng(Vec<u8>),
    /// The first chunk is not the one with the size.
    #[error("the PNG file is damaged: it does not begin with an IHDR chunk of 13 bytes")]
    NoImageHeader,
    /// Too large; rejected before decoding.
    #[error("the picture is {}x{}; allowed: 1 to {MAX_FRAME_SIDE_PX} pixels each way", .0[0], .0[1])]
    Size([u32; 2]),
    /// The decoder gave up.
    #[error("the PNG file is damaged or cut")]
    Damaged(#[source] image::ImageError),
    /// The pixels do not fill the size.
    #[error(transparent)]
    Layout(#[from] LayoutError),
}

/// Inspects a PNG file.
///
/// # Errors
/// When the file is not a complete PNG within the size limit. The report lists the faults
/// of a readable one.
pub fn inspect_png(file: &[u8]) -> Result<FrameReport, InspectError> {
    Ok(read_png(file)?.1)
}

/// The pixels of a PNG file, and the findings of [`inspect_png`].
///
/// # Errors
/// As [`inspect_png`].
pub fn read_png(file: &[u8]) -> Result<(Frame, FrameReport), InspectError> {
    let header = PngHeader::read(file)?;
    let mut problems = header.format_problems();
    problems.extend(color_chunks(file).map(FrameProblem::ColorChunk));
    let frame = to_frame(decode(file)?, &mut problems)?;
    let views = written_layout(file).and_then(|(layout, pictures)| inspect_views(layout, pictures, &frame));
    let mut report = views.unwrap_or_else(|| inspect_frame(&frame));
    report.problems.splice(0..0, problems);
    Ok((frame, report))
}

/// Inspects the pixels of a frame.
#[must_use]
pub fn inspect_frame(frame: &Frame) -> FrameReport {
    let frame_px = frame.size_px();
    match frame.pixels() {
        Pixels::Gray16(samples) => FrameReport {
            depth: Some(DepthExtent::of(samples.iter().copied())),
            ..FrameReport::empty(Layout::Depth16, frame_px)
        },
        Pixels::Rgb8(samples) => inspect_rgb(frame_px, samples),
    }
}

/// The views of a file by its text chunk; `None` where it has none.
fn inspect_views(layout: Layout, pictures: u32, frame: &Frame) -> Option<FrameReport> {
    let frame_px = frame.size_px();
    let (count, columns, rows) = match layout.arrangement()? {
        Arrangement::Animation if pictures < 2 => return None,
        Arrangement::Animation => (pictures / 2 + 1, 1, 1),
        Arrangement::Tiles { grid, .. } => (grid.count(), grid.columns(), grid.rows()),
        _ => (layout.view_count() as u32, 1, 1),
    };
    let [width, height] = frame_px;
    let mut report = FrameReport::empty(layout, frame_px);
    report.views = Some(ViewsReport { count, columns, rows, size_px: [width / columns, height / rows] });
    if matches!(layout.arrangement(), Some(Arrangement::Tiles { .. } | Arrangement::Turns(_))) {
        report.problems.extend(layout.decode(frame).err().unwrap_or_default());
    }
    Some(report)
}

impl FrameReport {
    fn empty(layout: Layout, frame_px: [u32; 2]) -> Self {
        Self {
            layout,
            frame_px,
            header_hex: None,
            content: None,
            factor: None,
            offset: None,
            select: None,
            extended_hex: None,
            problems: Vec::new(),
            views: None,
            depth: None,
        }
    }

    /// Copies the readable fields of the header.
    fn with_header(mut self, reading: &HeaderReading) -> Self {
        if let Some([factor, offset, select]) = reading.bytes.get(2..5).and_then(|b| b.first_chunk()) {
            (self.factor, self.offset) = (Some(*factor), Some(*offset));
            self.select = Some(Select { factor: select & 0x80 != 0, offset: select & 0x40 != 0 });
        }
        self.content = reading.header.map(|header| header.content);
        let (base, extended) = reading.bytes.split_at(reading.bytes.len().min(10));
        self.header_hex = Some(HEXUPPER.encode(base));
        self.extended_hex = (!extended.is_empty()).then(|| HEXUPPER.encode(extended));
        self
    }
}

impl DepthExtent {
    fn of(values: impl Iterator<Item = u16>) -> Self {
        let mut counts = vec![0usize; 1 << 16];
        for value in values {
            counts[usize::from(value)] += 1;
        }
        let seen = || (0..=u16::MAX).zip(&counts).filter(|(_, count)| **count > 0).map(|(value, _)| value);
        Self {
            farthest: seen().next().unwrap_or(0),
            nearest: seen().next_back().unwrap_or(0),
            distinct: seen().count(),
            at_far_limit: counts[0],
            pixels: counts.iter().sum(),
        }
    }
}

fn inspect_rgb(frame_px: [u32; 2], samples: &[u8]) -> FrameReport {
    let width = frame_px[0] as usize;
    let reading = HeaderReading::of_line(&samples[..3 * width]);
    let display_frame = DISPLAY_FRAMES_PX.contains(&frame_px);
    // Any picture may begin with 0xF1 by chance; at other sizes the checksum has to agree.
    let crc_wrong =
        |problem: &HeaderProblem| matches!(problem, HeaderProblem::Crc { part: HeaderPart::Base, .. });
    let has_header = reading.is_present() && (display_frame || !reading.problems.iter().any(crc_wrong));
    let extended = reading.header.and_then(|header| header.extended).filter(|_| has_header);
    let layout = match extended {
        Some(ExtendedPart::DeclipseFull | ExtendedPart::DeclipseRemoved) => declipse_layout(width, samples),
        _ => guess_layout(frame_px, samples, has_header),
    };
    let mut report = FrameReport::empty(layout, frame_px);
    if has_header {
        report = report.with_header(&reading);
        if !display_frame {
            let expected = "1920x1080 or 3840x2160";
            report.problems.push(FrameProblem::FrameSize { found_px: frame_px, expected });
        }
    }
    if has_header || display_frame {
        report.problems.extend(reading.problems.into_iter().map(FrameProblem::Header));
    }
    // Each half of a side-by-side picture would be 8:9. No program renders that, but players scale
    // whole frames.
    let wide = u64::from(frame_px[0]) * 9 == u64::from(frame_px[1]) * 16;
    if layout == Layout::Rgbd && wide && !display_frame && !has_header {
        let expected = "1920x1080 or 3840x2160, of which this looks like a scaled copy without its header";
        report.problems.push(FrameProblem::FrameSize { found_px: frame_px, expected });
    }
    report.problems.extend(depth_problems(layout, frame_px, samples));
    report.depth = (layout != Layout::Color).then(|| disparity_extent(layout, width, samples));
    report
}

fn guess_layout(frame_px: [u32; 2], samples: &[u8], has_header: bool) -> Layout {
    let width = frame_px[0] as usize;
    let [odd, even] = odd_and_even_lines(width, samples);
    let interleaved = even > 0 && 2 * odd <= even;
    let gray_right = depth_problems(Layout::Rgbd, frame_px, samples).is_empty();
    let display_frame = DISPLAY_FRAMES_PX.contains(&frame_px);
    let for_display = has_header || display_frame && (gray_right || interleaved);
    match frame_px {
        [3840, 2160] if for_display => Layout::Wowvx4k,
        _ if for_display && interleaved => Layout::Wowvx,
        _ if for_display => Layout::WowvxFullHeight,
        _ if gray_right && width.is_multiple_of(2) && !is_gray(samples) => Layout::Rgbd,
        _ => Layout::Color,
    }
}

/// Which of the two layouts with a background: the header does not say. Where the layers take
/// turns, every other line is more alike than neighbours are.
fn declipse_layout(width: usize, samples: &[u8]) -> Layout {
    let lines: Vec<&[u8]> = samples.chunks_exact(3 * width).collect();
    let difference =
        |a: &[u8], b: &[u8]| -> u64 { a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum() };
    let apart = |step: usize| -> u64 {
        lines.iter().zip(lines.iter().skip(step)).map(|(a, b)| difference(a, b)).sum()
    };
    if apart(1) > apart(2) { Layout::DeclipseLines } else { Layout::Declipse }
}

fn is_gray(samples: &[u8]) -> bool {
    samples.as_chunks::<3>().0.iter().all(|[r, g, b]| r == g && g == b)
}

fn disparity_extent(layout: Layout, width: usize, samples: &[u8]) -> DepthExtent {
    let black = layout.placement().is_some_and(Placement::has_black_lines);
    let lines = samples.chunks_exact(3 * width).step_by(if black { 2 } else { 1 });
    DepthExtent::of(lines.flat_map(|line| line[3 * (width / 2)..].iter().step_by(3).map(|&d| u16::from(d))))
}

/// The format of samples by IHDR.
struct PngHeader {
    bit_depth: u8,
    color_type: u8,
}

impl PngHeader {
    fn read(file: &[u8]) -> Result<Self, InspectError> {
        if file.starts_with(JPEG_SIGNATURE) {
            return Err(InspectError::Jpeg);
        }
        let Some(chunks) = file.strip_prefix(PNG_SIGNATURE) else {
            return Err(InspectError::NotPng(file.iter().take(8).copied().collect()));
        };
        let header = chunks.strip_prefix(b"\0\0\0\x0DIHDR").and_then(|data| data.first_chunk::<13>());
        let Some(&[w0, w1, w2, w3, h0, h1, h2, h3, bit_depth, color_type, ..]) = header else {
            return Err(InspectError::NoImageHeader);
        };
        let size = [u32::from_be_bytes([w0, w1, w2, w3]), u32::from_be_bytes([h0, h1, h2, h3])];
        if size.iter().any(|side| !(1..=MAX_FRAME_SIDE_PX).contains(side)) {
            return Err(InspectError::Size(size));
        }
        Ok(Self { bit_depth, color_type })
    }

    /// Frames are 8-bit RGB, and 16-bit grey for `depth16`.
    fn format_problems(&self) -> Vec<FrameProblem> {
        let found = match (self.color_type, self.bit_depth) {
            (2, 8) | (0, 16) | (6, 8) => return Vec::new(), // alpha is judged by the pixels
            (3, _) => "colours of a palette",
            (2 | 6, _) => "16-bit colours",
            _ => "grey of up to 8 bits or grey with alpha",
        };
        vec![FrameProblem::PixelFormat { found, expected: "8-bit RGB, or 16-bit grey for depth16" }]
    }
}

/// The chunks of a PNG file: the name of each, and all its bytes.
fn chunks(file: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> + '_ {
    let mut rest = file.get(PNG_SIGNATURE.len()..).unwrap_or_default();
    std::iter::from_fn(move || {
        let (&[l0, l1, l2, l3, a, b, c, d], _) = rest.split_first_chunk::<8>()?;
        let length = u32::from_be_bytes([l0, l1, l2, l3]) as usize;
        let whole = length.saturating_add(12).min(rest.len()); // with length, name and CRC
        let (chunk, behind) = rest.split_at(whole);
        rest = behind;
        Some(([a, b, c, d], chunk))
    })
}

/// The chunks of [`COLOR_CHUNKS`] that a PNG file has.
fn color_chunks(file: &[u8]) -> impl Iterator<Item = &'static str> + '_ {
    chunks(file).filter_map(|(name, _)| COLOR_CHUNKS.into_iter().find(|color| color.as_bytes() == name))
}

/// The file with the chunks alone that pixels depend on. Others may be compressed, and a decoder
/// would unpack them: a profile of a few kilobytes to gigabytes.
fn pixels_only(file: &[u8]) -> Vec<u8> {
    let mut kept = PNG_SIGNATURE.to_vec();
    for (_, chunk) in
        chunks(file).filter(|(name, _)| [b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"].contains(&name))
    {
        kept.extend_from_slice(chunk);
    }
    kept
}

fn decode(file: &[u8]) -> Result<DynamicImage, InspectError> {
    let mut reader = ImageReader::with_format(Cursor::new(pixels_only(file)), ImageFormat::Png);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_FRAME_SIDE_PX);
    limits.max_image_height = Some(MAX_FRAME_SIDE_PX);
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    reader.limits(limits);
    reader.decode().map_err(InspectError::Damaged)
}

/// The pixels as a frame has them; what had to be converted has its problem already, but for alpha.
fn to_frame(image: DynamicImage, problems: &mut Vec<FrameProblem>) -> Result<Frame, InspectError> {
    let size_px = [image.width(), image.height()];
    let pixels = match image {
        DynamicImage::ImageLuma16(gray) => Pixels::Gray16(gray.into_raw()),
        other => {
            if other.color() == ColorType::Rgba8 {
                let alpha = other.as_bytes().iter().skip(3).step_by(4);
                let pixels = alpha.filter(|&&alpha| alpha != 255).count();
                problems.extend((pixels > 0).then_some(FrameProblem::Transparent { pixels }));
            }
            Pixels::Rgb8(other.into_rgb8().into_raw())
        }
    };
    Ok(Frame::new(size_px, pixels)?)
}
