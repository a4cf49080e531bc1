//! The tracking of Relief with its feature `ipopt`, from the same files, and nothing else of it.

#[path = "../../src/space.rs"]
pub mod space;
#[path = "../../src/tracking/mod.rs"]
pub mod tracking;
