//! The next frame of a view: first a quick one, then one of full quality, while a
//! viewer has capacity.

use std::sync::Arc;
use std::time::Instant;

use super::Inner;
use super::phases::RESTS_AFTER;
use crate::live::job::{FrameJob, NextStep};
use crate::live::motion::Delays;
use crate::live::steady_limits::Activity;
use crate::live::viewer::Viewer;
use relief_live::{Role, SnappedPlace, StateMessage};

impl Inner {
    pub(super) fn next(&mut self, now: Instant, patience: Delays) -> NextStep {
        if self.viewers.is_empty() {
            let end = self.idle_since + patience.linger;
            return if now >= end { NextStep::End } else { NextStep::Idle(Some(end)) };
        }
        if let Some(failure) = self.failed.filter(|failure| failure.blocks(self.revision, now)) {
            return NextStep::Idle(failure.again);
        }
        let current = self.published.filter(|published| published.revision == self.revision);
        let still_at = self.motion.still_at(patience.still_after);
        let is_still = match current {
            // A quick frame first, the full-quality one after it.
            None if !self.motion.comes_to_rest(now, still_at, self.still_took) => false,
            Some(published) if published.is_still => return NextStep::Idle(None),
            _ if now < still_at => return NextStep::Idle(Some(still_at)),
            _ => true,
        };
        let newest = self.published.map_or(0, |published| published.number);
        let has_capacity = |viewer: &Arc<Viewer>| {
            let flow = viewer.flow();
            // By the time a full-quality frame is rendered, a viewer that keeps up has capacity for
            // it.
            flow.taken == newest && (is_still || flow.has_capacity())
        };
        if !self.viewers.iter().any(has_capacity) {
            return NextStep::Full;
        }
        self.job(self.number + 1, is_still, now)
    }

    fn job(&self, number: u64, is_still: bool, now: Instant) -> NextStep {
        let ghost = self.preview.ghost();
        let request = match self.presentation.request(&self.state, self.camera, self.held.as_ref(), ghost) {
            Ok(request) => request,
            Err(error) => return NextStep::Failed { revision: self.revision, error },
        };
        let snapped = ghost.map(|ghost| SnappedPlace {
            at_mm: ghost.at.xyz.to_array(),
            shift_mm: (ghost.at - ghost.from).xyz.to_array(),
        });
        let volume = self.presentation.entry.id.clone();
        let phases_per_s = self.presentation.play;
        let state = StateMessage { state: self.record(), volume, phases_per_s, snapped, outside: None };
        let plays = phases_per_s.is_some() && now.saturating_duration_since(self.moved) > RESTS_AFTER;
        let mut shows = Vec::new();
        let mut share = None;
        for viewer in &self.viewers {
            let mut flow = viewer.flow();
            flow.is_shown = true;
            shows.extend(flow.echo.map(|echo| (viewer.id, echo)));
            if viewer.role == Role::Presenter && !viewer.is_plain {
                let own = flow.pace.level().0;
                share = Some(share.map_or(own, |share: f64| share.min(own)));
            }
        }
        let cursor_mm = self.state.cursor().map(|cursor| cursor.xyz.to_array());
        NextStep::Render(Box::new(FrameJob {
            request,
            entry: Arc::clone(&self.presentation.entry),
            display: self.presentation.display().with_cursor(cursor_mm),
            number,
            revision: self.revision,
            audience: self.audience,
            is_still,
            activity: Activity::of(is_still, self.state.is_placing(), plays),
            arrived: self.motion.arrived,
            shows,
            state,
            quality: self.presentation.quality,
            share: share.unwrap_or(1.0),
            keeps_size: self.presentation.has_overlays(),
        }))
    }
}
