//! Series of DICOM archives: of Orthanc, as Debian has it, and of stand-ins that misbehave.
//!
//! Orthanc and DCMTK are those of `scripts/setup-services`, in the folder `RELIEF_ORTHANC`.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![cfg(all(target_os = "linux", feature = "full"))]

mod faults;
mod orthanc;
mod page;
mod receive;
mod received;
mod results;
mod series;
mod stand_in;
