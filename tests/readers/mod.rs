//! Several readers: comparisons against closed forms, simulated readers and a peer, and the
//! commands that make them.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

mod agreement;
mod command;
mod normal;
