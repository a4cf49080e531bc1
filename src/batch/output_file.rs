//! A file that a job wrote: name, size and SHA-256.

use relief_base::sha256_of;
use serde::{Deserialize, Serialize};
/// A file that a job wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputFile {
    /// Its name, in the series' folder.
    pub file: String,
    /// Its SHA-256.
    pub sha256: String,
    /// Its length.
    pub bytes: u64,
}

impl OutputFile {
    pub(super) fn new(file: String, bytes: &[u8]) -> Self {
        Self { file, sha256: sha256_of(bytes), bytes: bytes.len() as u64 }
    }
}
