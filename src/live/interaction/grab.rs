//! Holding the volume: it follows a hand from the moment of the grab.
//!
//! Everything follows from where hand and view were then, and from where the hand is now; nothing
//! is added up, so a hand that comes back brings the volume back. View axes, mm; the focal point is
//! 0.

use glam::{DQuat, DVec3};

use super::aspect::Aspect;
use super::intent::{GrabMode, Pivot};
use relief_base::{Patient, Point, Vector};

/// A hand in view space: already scaled, its axes turned into view axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hand {
    pub(super) position: DVec3,
    /// Of unit length.
    pub(super) orientation: DQuat,
}

/// A volume in a hand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grab {
    mode: GrabMode,
    pivot: Pivot,
    /// The point that stays under the hand.
    held: Point<Patient>,
    /// Its place in view at that time.
    held_in_view: DVec3,
    orientation: DQuat,
    /// The hand when it took hold.
    from: Hand,
    /// The hand now.
    now: Hand,
}

impl Grab {
    pub(super) fn new(
        aspect: &Aspect,
        cursor: Option<Point<Patient>>,
        hand: Hand,
        mode: GrabMode,
        pivot: Pivot,
    ) -> Self {
        let held = match (mode, pivot) {
            (GrabMode::Both, Pivot::Cursor) => cursor.unwrap_or(aspect.look_at),
            _ => aspect.look_at,
        };
        let held_in_view = aspect.in_view(held).xyz;
        let orientation = aspect.patient_from_view;
        Self { mode, pivot, held, held_in_view, orientation, from: hand, now: hand }
    }

    /// The same hand holding the current view, after something else has changed it.
    pub(super) fn renewed(&self, aspect: &Aspect, cursor: Option<Point<Patient>>) -> Self {
        Self::new(aspect, cursor, self.now, self.mode, self.pivot)
    }

    /// Moves the hand; gives the view's focal point and orientation.
    ///
    /// In view space a held point x moves to `Q (x - p) + p + d`: Q and d are the hand's rotation
    /// and translation, p is the held place. So `view_from_patient` is multiplied by Q on its left,
    /// and the focal point follows from the held point's place p + d.
    pub(super) fn moved(&mut self, hand: Hand) -> (Point<Patient>, DQuat) {
        self.now = hand;
        let turned = match self.mode {
            GrabMode::Move => DQuat::IDENTITY,
            GrabMode::Both | GrabMode::Rotate => hand.orientation * self.from.orientation.inverse(),
        };
        let moved = match self.mode {
            GrabMode::Rotate => DVec3::ZERO,
            GrabMode::Both | GrabMode::Move => hand.position - self.from.position,
        };
        let patient_from_view = (self.orientation * turned.inverse()).normalize();
        let place = Vector::from_xyz(patient_from_view * (self.held_in_view + moved));
        (self.held + -place, patient_from_view)
    }
}
