//! Live views: their state, the frames that they show, and the loop that renders them. No sockets
//! and no HTTP.
//!
//! A [`View`] is shared by its viewers. Clients send poses, intents and settings, which change the
//! view at once; its render loop makes the next frame when a viewer has capacity for one. What it
//! is not: the protocol (see `relief_live`), routes, connections (see `relief_server`).

mod effect;
mod error;
mod eye_views;
mod frame;
mod ghost;
mod job;
mod motion;
mod open;
mod outside;
mod pace;
mod presentation;
mod preview;
mod preview_search;
mod render_loop;
mod steady_limits;
mod view;
mod viewer;
mod views;

pub use effect::{DrawablesWanted, EditContext, Effect, HeldPoint, Outcome};
pub use error::LiveError;
pub use eye_views::EyeViews;
pub use frame::{Echo, EncodedParts, ViewFrame, micros};
pub use motion::Delays;
pub use pace::{Pace, USUAL_QUALITY};
pub use presentation::Presentation;
pub use preview_search::search_preview;
pub use render_loop::DrawableSource;
pub use view::View;
pub use view::phases::find_phase;
pub use viewer::{Flow, Viewer};
pub use views::{OpenError, Views};
