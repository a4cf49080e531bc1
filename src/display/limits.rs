//! Limits of pictures and frames.

/// The largest width and height of a picture that is opened.
pub const MAX_FRAME_SIDE_PX: u32 = 16384;
