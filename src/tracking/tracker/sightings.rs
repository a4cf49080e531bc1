//! The LEDs that one frame shows, and the pixel of each.

use crate::solve::{MAX_SEEN, Sighting};

/// Up to four sightings, without allocation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sightings {
    all: [Sighting; MAX_SEEN],
    count: usize,
}

impl Default for Sightings {
    fn default() -> Self {
        let none = Sighting { led: nalgebra::Vector3::zeros(), pixel: nalgebra::Vector2::zeros() };
        Self { all: [none; MAX_SEEN], count: 0 }
    }
}

impl Sightings {
    pub(super) fn push(&mut self, sighting: Sighting) {
        if let Some(slot) = self.all.get_mut(self.count) {
            *slot = sighting;
            self.count += 1;
        }
    }

    pub(super) fn pop(&mut self) {
        self.count = self.count.saturating_sub(1);
    }

    pub(super) fn as_slice(&self) -> &[Sighting] {
        &self.all[..self.count]
    }
}
