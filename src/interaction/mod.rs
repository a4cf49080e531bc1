//! From hands to views: what is wanted, by whatever device, and what it does to a view.
//!
//! What it is: arithmetic on [`Intent`]s. A [`ViewState`] takes one after another and says which [`crate::camera::Camera`],
//! clip plane, preset and cursor the next picture has. What it is not: it reads no device and no clock, opens no socket and
//! renders nothing; times come in as ns, pictures as [`Seen`].
//!
//! | space | definition |
//! |---|---|
//! | view axes | x right, y up, z towards the viewer, mm; the focal point is 0 |
//! | `Patient` | DICOM LPS, mm |
//! | pixels | u right, v down, centres at +0.5, of the picture's full size |

mod apply;
mod gestures;
mod grab;
mod hand;
mod intent;
mod stage;
mod view;

pub use apply::{Applied, Event};
pub use gestures::Gestures;
pub use hand::{HandOptions, HandPose, HandSample};
pub use intent::{GrabMode, Intent, IntentError, Pivot, PlacePhase};
pub use stage::{Home, Stage, StageError};
pub use view::{CursorMark, CutPlane, Seen, ViewRecord, ViewState};
