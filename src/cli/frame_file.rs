//! Files of frames and views, read whole.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::ensure;

/// The largest file that is read: more than an uncompressed frame of the largest size needs.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// The bytes of a file.
pub(crate) fn read_bounded(path: &Path) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    ensure!(bytes.len() as u64 <= MAX_FILE_BYTES, "the file is larger than 1 GiB; frames are smaller");
    Ok(bytes)
}
