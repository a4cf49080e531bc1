//! Pictures and the numbers behind them: rendering, golden images, display formats, phantoms,
//! tracking. Bound by the processor.
//!
//! One program for all of them, because linking takes longer than most of its tests.

mod annotate_accuracy;
mod common;
mod display;
mod golden;
mod growth;
mod interaction;
mod large_volumes;
mod live_protocol;
mod phantom;
mod placing;
mod render;
mod structures;
mod track;
mod track_allocations;
mod transfer;
