//! (to come)

pub mod write;
