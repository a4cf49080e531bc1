//! Which picture of a view is made next: at once a quick one, then the best there is, for whoever has room.

use std::sync::Arc;
use std::time::Instant;

use super::Inner;
use crate::live::motion::Patience;
use crate::live::order::{Next, Order};
use crate::live::slot::Slot;
use relief_live::{Role, ServerMessage, SnappedPlace, StateMessage};

impl Inner {
    pub(super) fn next(&mut self, now: Instant, patience: Patience) -> Next {
        if self.slots.is_empty() {
            let end = self.idle_since + patience.linger;
            return if now >= end { Next::End } else { Next::Idle(Some(end)) };
        }
        if let Some(failure) = self.failed.filter(|failure| failure.holds(self.revision, now)) {
            return Next::Idle(failure.again);
        }
        let current = self.published.filter(|published| published.revision == self.revision);
        let still_at = self.motion.still_at(patience.still_after);
        let is_still = match current {
            // Something at once, the best there is after it.
            None if !self.motion.comes_to_rest(now, still_at, self.still_took) => false,
            Some(published) if published.is_still => return Next::Idle(None),
            _ if now < still_at => return Next::Idle(Some(still_at)),
            _ => true,
        };
        let newest = self.published.map_or(0, |published| published.number);
        let is_hungry = |slot: &Arc<Slot>| {
            let flow = slot.flow();
            // By the time that the best picture is made, there is room for it with whoever keeps up.
            flow.taken == newest && (is_still || flow.has_room())
        };
        if !self.slots.iter().any(is_hungry) {
            return Next::Full;
        }
        self.order(self.number + 1, is_still)
    }

    fn order(&self, number: u64, is_still: bool) -> Next {
        let ghost = self.preview.ghost();
        let request = match self.look.request(&self.state, self.camera, (self.carried.as_ref(), ghost)) {
            Ok(request) => request,
            Err(problem) => return Next::Failed { revision: self.revision, problem },
        };
        let snapped = ghost.map(|ghost| SnappedPlace {
            at_mm: ghost.at.xyz.to_array(),
            shift_mm: (ghost.at - ghost.from).xyz.to_array(),
        });
        let message = StateMessage { state: self.record(), volume: self.look.entry.id.clone(), snapped };
        let mut shows = Vec::new();
        let mut share = None;
        for slot in &self.slots {
            let mut flow = slot.flow();
            flow.is_shown = true;
            shows.extend(flow.echo.map(|echo| (slot.id, echo)));
            if slot.role == Role::Presenter && !slot.is_plain {
                let own = flow.pace.level().0;
                share = Some(share.map_or(own, |share: f64| share.min(own)));
            }
        }
        Next::Render(Box::new(Order {
            request,
            entry: Arc::clone(&self.look.entry),
            display: self.look.display().clone(),
            number,
            revision: self.revision,
            is_still,
            arrived: self.motion.arrived,
            shows,
            state: ServerMessage::State(message).to_text().into(),
            quality: self.look.quality,
            share: share.unwrap_or(1.0),
            keeps_size: self.look.has_overlays(),
        }))
    }
}
