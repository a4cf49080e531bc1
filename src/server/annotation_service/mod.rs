//! The annotations of a server behind its routes: [`Annotations`], the store with a snapshot of
//! each volume, edits that are stored and published in the order of the log, and what an author may
//! see.
//!
//! What it is not: routes (see `annotations` and `live`), storage (see `relief_store`) or drawing
//! (see `relief_session`). A frame of reference is a UID, which leads to a patient: no answer, log
//! line or error contains it.

mod apply;
mod follow;
mod outward;
mod ownership;
mod published;
mod refusal;
mod service;
mod shape_cache;
mod shapes;
mod snapshot;
mod snapshots;
mod visible;

pub(crate) use follow::follow;
pub(crate) use outward::{outward_event, outward_versioned};
pub(crate) use ownership::{Named, permission};
pub(crate) use published::{HistoryStep, Home, Published};
pub(crate) use refusal::{invalid, no_such_item};
pub(crate) use service::{Annotations, of};
pub(crate) use snapshots::Snapshot;
pub(crate) use visible::Visible;
