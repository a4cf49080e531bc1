//! HTTP, through `app(state)` without sockets and, where connections matter, over real ones.
//!
//! The backend here draws a sphere by its closed form, counts its renders and waits at a gate, so
//! that every answer can be foreseen and every order of events arranged. No GPU is needed.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

mod annotations;
mod annotations_apart;
mod annotations_drawn;
mod annotations_live;
mod annotations_objects;
mod annotations_structures;
mod budget;
mod dicomweb;
mod followed;
mod frames;
mod labels;
mod live;
mod live_flow;
mod live_limits;
mod live_plain;
mod live_preview;
mod live_stage;
#[path = "../dicom_objects/made.rs"]
#[allow(dead_code, reason = "other tests use the rest of it")]
mod made;
mod memory;
mod operation;
mod owners;
mod phases;
mod problems;
mod quantities;
mod slices;
mod sockets;
mod stage;
mod thumbnails;
#[path = "../dicom_objects/tools.rs"]
#[allow(dead_code, reason = "other tests use the rest of it")]
mod tools;
mod uploads;
mod views;
