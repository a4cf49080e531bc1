//! Pictures among the outputs.

use std::io::Cursor;

use image::{DynamicImage, ImageReader, Limits};

use super::sink::Sink;
use relief_display::MAX_FRAME_SIDE_PX;

/// Largest picture that is read, bytes.
pub(super) const LARGEST_PICTURE: u64 = 1 << 30;

/// A picture among the outputs; `None` if none can be read.
pub(super) fn open(out: &Sink, name: &str) -> Option<DynamicImage> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_FRAME_SIDE_PX);
    limits.max_image_height = Some(MAX_FRAME_SIDE_PX);
    let file = Cursor::new(out.read(name, LARGEST_PICTURE).ok()??);
    let mut reader = ImageReader::new(file).with_guessed_format().ok()?;
    reader.limits(limits);
    reader.decode().ok()
}
