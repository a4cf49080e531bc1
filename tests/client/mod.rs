//! The thin client: against a stand-in server that misbehaves as asked, and against Relief's own,
//! with real pictures.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

mod command;
mod faults;
mod measuring;
mod pointer;
mod real;
mod session;
mod stand_in;
#[cfg(all(feature = "window", target_os = "linux"))]
mod window;
