//! Effects of intents beyond the view in which they are made, and the annotations that a view
//! draws.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::LiveError;
use crate::volumes::VolumeEntry;
use relief_annotation::{Method, ShownSets};
use relief_base::{Patient, Point, Vector};
use relief_volume::Camera;

/// A change of annotations that an intent asks for. Only views that draw annotations cause effects.
#[derive(Debug)]
pub enum Effect {
    /// Take hold of the nearest point, if one is within reach.
    Take {
        /// The cursor.
        at: Point<Patient>,
        /// Largest distance, mm.
        reach_mm: f64,
    },
    /// Release the held point where it was.
    Cancel,
    /// Place the held point or the next landmark.
    Place {
        /// The cursor.
        at: Point<Patient>,
        /// The camera through which the user saw it.
        camera: Camera,
        /// How the cursor was moved there.
        method: Method,
    },
    /// Go on to the next label of the list.
    NextLabel,
    /// Undo the last edit of the author.
    Undo,
}

/// A point of an annotation that follows the cursor.
#[derive(Clone, Debug)]
pub struct HeldPoint {
    /// Name of its item.
    pub name: String,
    /// Vector from the cursor to the point, so that the point does not jump to the cursor.
    pub offset: Vector<Patient>,
    /// The place at which the point was taken.
    pub from: Point<Patient>,
}

/// The result of applying intents to a view.
#[derive(Debug)]
pub struct Outcome {
    /// Whether no frame showed the viewer's previous message: this one replaced it.
    pub replaced: bool,
    /// Effects, in the order of their intents.
    pub effects: Vec<Effect>,
    /// The state of the view when the intents were applied.
    pub context: EditContext,
    /// Why the first refused intent was refused. The intents after it were not applied.
    pub refused: Option<LiveError>,
}

/// The state of a view, for edits that were made in it.
#[derive(Clone, Debug)]
pub struct EditContext {
    /// The volume.
    pub entry: Arc<VolumeEntry>,
    /// The annotations that are drawn.
    pub shown: ShownSets,
    /// Rises when the view shows another volume or other annotations. A point that was taken in an
    /// earlier epoch is no longer held.
    pub epoch: u64,
}

/// The annotations that a view has to read before it can draw them.
#[derive(Clone, Debug)]
pub struct DrawablesWanted {
    /// The volume.
    pub entry: Arc<VolumeEntry>,
    /// The sets to draw.
    pub shown: ShownSets,
    /// The author whose private sets are drawn too.
    pub author: Option<String>,
    /// The verified names of all viewers. Only items that each of them may see are drawn.
    pub readers: BTreeSet<String>,
}
