//! The live core (render service to come) and the encoding of its frames.

mod encode;

pub use encode::{EncodingError, FileFormat, Product, encode};
