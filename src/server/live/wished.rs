//! What wishes mean beyond the view that they are made in, and what the view itself wants.

use std::sync::Arc;

use crate::problem::Problem;
use crate::volumes::Entry;
use relief_annotation::{Method, Shown};
use relief_base::{Patient, Point, Vector};
use relief_volume::Camera;

/// What a wish means beyond the view, while annotations are drawn.
pub(super) enum Happened {
    /// What is here, if anything is, is to be taken hold of.
    Taking { at: Point<Patient>, reach_mm: f64 },
    /// What was taken hold of is let go where it was.
    Cancelled,
    /// Something was set down here.
    Placed { at: Point<Patient>, camera: Camera, method: Method },
    /// The next label is wanted.
    NextLabel,
    /// The author's last edit is to be taken back.
    Undo,
}

/// A point of an annotation that goes with the cursor.
#[derive(Clone)]
pub(super) struct Carried {
    pub(super) name: String,
    /// From the cursor to the point: it does not jump under the cursor.
    pub(super) off: Vector<Patient>,
    /// Where the point was.
    pub(super) from: Point<Patient>,
}

/// What came of wishes.
pub(super) struct Wished {
    /// Whether no picture showed the message before this one.
    pub(super) unseen: bool,
    pub(super) happened: Vec<Happened>,
    /// Where it happened, whatever the view has come to since.
    pub(super) ground: Ground,
    /// Why the first one was refused that was; what came after it was not looked at.
    pub(super) refused: Option<Problem>,
}

/// What wishes were made in.
pub(super) struct Ground {
    pub(super) entry: Arc<Entry>,
    /// The annotations that were drawn.
    pub(super) shown: Shown,
    /// What is taken hold of in one era of a view is let go in the next.
    pub(super) era: u64,
}

/// The annotations that a view wants to draw.
pub(super) struct Wanted {
    pub(super) entry: Arc<Entry>,
    pub(super) shown: Shown,
    pub(super) author: Option<String>,
}
