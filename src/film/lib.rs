//! Films: pictures in 8-bit RGB, read and written by the program ffmpeg.
//!
//! [`Ffmpeg`] is the installed program. [`FilmReader`] decodes any film that it reads, one picture
//! at a time. [`FilmWriter`] encodes without loss and then decodes the finished file again: a
//! header in the pixels of a frame does not survive a codec that changes colours. This crate knows
//! no header and no layout.

mod error;
mod ffmpeg;
mod reader;
mod writer;

pub use error::FilmError;
pub use ffmpeg::{Ffmpeg, FrameRate};
pub use reader::FilmReader;
pub use writer::{FilmCodec, FilmWriter, WrittenFilm};
