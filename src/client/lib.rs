//! The thin client of a display box: frames out of a live session, poses into it.
//!
//! What it is: a connection that reconnects by itself ([`run`]), the display's frame composed from
//! received frames ([`Composer`]), measuring ([`measure()`]), recordings ([`Journal`]), marks of
//! state ([`Marks`]), and a window that shows frames pixel for pixel (feature `window`). What it is
//! not: the protocol (see `relief_live`), tracking, arguments and files.
//!
//! Input from the server is untrusted: a message that is too long, an invalid frame or a closed
//! connection is an event or an error, never a panic, and memory is bounded by [`MAX_FRAME_BYTES`].
//! Times are ns of the client's own clock, which starts with its [`Handle`].

mod access;
mod address;
mod backoff;
mod compose;
mod error;
#[cfg(feature = "window")]
mod eye_views;
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

pub use access::{Access, AccessError};
pub use address::{AddressError, ServerAddress};
pub use compose::{Composed, Composer, PictureError};
pub use error::{AnswerError, BoxedError, ClientError, ConnectError, EncryptionError, LossError, ServerText};
pub use handle::Handle;
pub use link::{Event, LinkState, Options, Received, run};
pub use marks::Marks;
pub use socket::MAX_FRAME_BYTES;

pub use journal::{
    Journal, JournalEntry, JournalError, LineError, MAX_LINE_BYTES, VERSION, journal_head, journal_line,
    pixels_sha256,
};
pub use measure::{MeasurePlan, MeasureReport, measure};
#[cfg(feature = "window")]
pub use window::{Followed, Lettering, Screen, Window, WindowError, WindowOptions};
