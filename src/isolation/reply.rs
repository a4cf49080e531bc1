//! Parts that the child's readers share: the path of the given file or folder, and a refusal.

use std::io::{Result, Write};

use super::job::{Answer, Refusal};
use super::wire::send;

/// The file or folder, as a path; a file is opened from its beginning.
pub(crate) const FILE: &str = "/proc/self/fd/0";

/// Tells the parent why the file cannot be read.
pub(crate) fn refuse(socket: &mut impl Write, kind: Refusal, reason: String) -> Result<()> {
    send(socket, &Answer::Refused { kind, reason })
}
