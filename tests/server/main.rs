//! HTTP, through `app(state)` without sockets and, where connections matter, over real ones.
//!
//! The backend here draws a sphere by its closed form, counts its renders and waits at a gate, so that every answer
//! can be foreseen and every order of events arranged. No GPU is needed.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod annotations;
mod annotations_drawn;
mod annotations_live;
mod annotations_structures;
mod budget;
mod dicomweb;
mod frames;
mod labels;
mod live;
mod live_flow;
mod live_plain;
mod live_stage;
mod memory;
mod operation;
mod problems;
mod slices;
mod sockets;
mod stage;
mod thumbnails;
mod uploads;
