//! Reading untrusted files in a child process: an uploaded series, one from a bucket, a label map, a
//! file of annotations.
//!
//! What it is: [`IsolatedReader`] starts the program again as `relief decode-worker`, gives it the
//! file or folder and a job, and checks the answer; [`serve`] is that child. A file that makes a decoder
//! crash, hang or allocate without end costs one child, and code that it might run has no rights:
//! limits of memory, processor time and descriptors, no files but its own (Landlock), no network and
//! no programs (seccomp). What it is not: a reader of its own (see `relief_dicom`, `relief_exchange`).
//!
//! It exists on Linux alone: other systems have no such limits, and read these files in the server's
//! process.
#![cfg(target_os = "linux")]

mod child;
mod job;
mod parent;
mod reply;
mod sandbox;
mod series;
mod window;
mod wire;

pub use child::serve;
pub use job::{FoundSeries, ListedSeries, RemainingRights, SeriesChoice};
pub use parent::{IsolatedReader, IsolationError, Listing};
