//! Tests that mostly wait: servers, clients, batches, queues, databases and browsers.
//!
//! One program for all of them, because linking takes longer than most of its tests.

mod archive;
mod batch;
mod browser;
mod client;
#[cfg(feature = "full")]
mod cluster;
#[cfg(feature = "full")]
mod commands;
mod common;
#[cfg(feature = "full")]
#[path = "common/postgres.rs"]
mod postgres_server;
mod server;
mod server_command;
mod store;
