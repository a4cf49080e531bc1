//! The thin client of a display box: frames out of a live session, poses into it.
//!
//! What it is: a connection that comes back by itself ([`run`]), the frame of the display composed from what was sent
//! ([`Composer`]), measuring ([`measure`]), sessions as files ([`journal`]), marks of state ([`Marks`]), and a window that shows
//! frames pixel for pixel (feature `window`). What it is not: the protocol, which is `live`; tracking; arguments and files, which
//! are `cli`.
//!
//! Whatever comes from the server is data to be checked: a message that is too long, a frame that is none or a connection that
//! ends is an event or an error, never a panic, and memory is bounded by [`MAX_FRAME_BYTES`]. Times are ns of the client's own
//! clock, which begins when its [`Handle`] is made.

mod address;
mod backoff;
mod compose;
mod error;
mod handle;
mod journal;
mod link;
mod marks;
mod measure;
mod outbox;
mod place;
mod restore;
mod socket;
#[cfg(feature = "window")]
mod window;

pub use address::{AddressError, ServerAddress};
pub use compose::{Composed, Composer, PictureError};
pub use error::ClientError;
pub use handle::Handle;
pub use link::{Event, LinkState, Options, Received, run};
pub use marks::{MARK_PX, Marks};
pub use outbox::MAX_QUEUED;
pub use socket::MAX_FRAME_BYTES;

pub use journal::{
    Journal, JournalEntry, JournalError, MAX_LINE_BYTES, VERSION, journal_head, journal_line, pixels_sha256,
};
pub use measure::{MeasurePlan, MeasureReport, measure};
#[cfg(feature = "window")]
pub use window::{Screen, Window, WindowError, WindowOptions};
