//! Series of files: codecs, order, quirks, limits, and whatever bytes may come.

mod codecs;
mod inspect;
mod limits;
mod made;
mod malformed;
mod quirks;
mod series;
mod sharing;
