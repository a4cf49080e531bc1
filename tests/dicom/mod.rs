//! Series of files: codecs, order, quirks, limits, and whatever bytes may come.

mod codecs;
mod inspect;
mod limits;
mod made;
mod malformed;
mod quirks;
mod random;
mod series;
mod sharing;
