//! Several servers behind nginx, with one log in PostgreSQL: real ones, started by
//! `scripts/serve-cluster` on loopback.
//!
//! Needs nginx and PostgreSQL (`scripts/setup-services`, `scripts/setup-postgres`, `.
//! scripts/env.sh`); a message names what is missing.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![cfg(target_os = "linux")]

#[cfg(feature = "full")]
mod buckets;
mod capacity;
mod compose;
mod failure;
pub(crate) mod stage;
