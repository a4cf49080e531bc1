//! Depth of plain pictures, estimated by a neural network.
//!
//! [`DepthNetwork`] estimates one picture: the built-in network, which was trained on renders of
//! volumes, or a file in the layouts of MiDaS and Depth Anything. [`Steady`] removes flicker
//! between the pictures of a film. The result is a [`Closeness`]: 0 for the background, 1 for the
//! nearest surface, without unit. This crate knows neither volumes nor displays.

mod closeness;
mod error;
mod joint;
mod network;
mod steady;

pub use closeness::Closeness;
pub use error::{BoxedError, EstimateError};
pub use network::{DepthNetwork, MAX_NETWORK_BYTES};
pub use steady::Steady;
