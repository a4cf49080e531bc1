//! Limits of golden files.

/// The largest file of a golden: they stay in the repository's history for ever.
pub const MAX_FILE_BYTES: u64 = 64 * 1024;

/// The largest decoded picture: a frame for the largest display.
pub(super) const MAX_DECODED_BYTES: u64 = 3840 * 2160 * 4;
