//! Publishes changes that other servers and programs make in the same log.
//!
//! What it is: [`follow`], a task that waits for notifications and reads the
//! log, and the only place where events are published: in the order of the log, each once, for all
//! authors. What it is not: the notifications themselves (see `relief_store`). A lost
//! notification does no harm, because events are always read from the last published one on.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::published::{Home, PAGE, Published};
use super::service::{Annotations, Turn};
use crate::problem::Problem;
use relief_annotation::{Event, Set};
use relief_store::{Changed, LogFilter};

/// Waits after a failure: the first, and the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Publishes what other writers add to the log, until it is dropped.
pub(crate) async fn follow(annotations: &Annotations) {
    let mut watch = annotations.store.watch();
    let mut pause = FIRST_PAUSE;
    loop {
        let heard = tokio::select! {
            heard = watch.changed() => heard.map_err(Problem::from),
            () = annotations.behind.notified() => Ok(Changed::Anything),
        };
        let outcome = match heard {
            Ok(changed) => {
                let caught_up = annotations.catch_up(changed).await;
                // Reported once until the log can be read again.
                caught_up.inspect_err(|_| annotations.behind.notify_one())
            }
            Err(problem) => Err(problem),
        };
        match outcome {
            Ok(()) => pause = FIRST_PAUSE,
            Err(problem) => {
                // Once a failure, not once a try.
                if pause == FIRST_PAUSE {
                    let cause = problem.cause().unwrap_or("the log cannot be read");
                    tracing::warn!(cause, "changes of other servers are not heard; trying again");
                }
                tokio::time::sleep(pause).await;
                pause = (pause * 2).min(LONGEST_PAUSE);
            }
        }
    }
}

impl Annotations {
    /// Waits for the right to tell.
    pub(crate) async fn turn(&self) -> Result<Turn<'_>, Problem> {
        let mut turn = self.turn.lock().await;
        if turn.is_none() {
            // New listeners read the whole state first.
            let seq = self.store.seq().await?;
            *turn = Some(seq);
            self.newest.store(seq, Ordering::Relaxed);
        }
        Ok(turn)
    }

    /// Publishes events of other writers since the last published one, and reads the sets if they
    /// may have changed.
    async fn catch_up(&self, changed: Changed) -> Result<(), Problem> {
        let mut turn = self.turn().await?;
        if changed == Changed::Anything {
            self.read_sets_anew();
            self.sets().await?;
        }
        self.tell_until(&mut turn, u64::MAX).await
    }

    /// Publishes the events between the last published one and this one.
    pub(crate) async fn tell_until(&self, turn: &mut Turn<'_>, before: u64) -> Result<(), Problem> {
        loop {
            let events = self.whole_edits(turn.unwrap_or(0), before).await?;
            if events.is_empty() {
                return Ok(());
            }
            let homes = self.homes(&events).await?;
            let sets = self.sets().await?;
            let found = events.into_iter().zip(homes).collect::<Vec<_>>();
            self.follow(&found);
            // The events of one edit are published together.
            for edit in found.chunk_by(|(a, _), (b, _)| a.edit == b.edit) {
                self.tell(turn, edit.to_vec(), Arc::clone(&sets));
            }
        }
    }

    /// Events after this one and before that one: a page of them, without the beginning of an edit
    /// that goes on beyond it, but at least one edit, however long it is.
    async fn whole_edits(&self, after: u64, before: u64) -> Result<Vec<Event>, Problem> {
        let mut events: Vec<Event> = Vec::new();
        loop {
            let after = events.last().map_or(after, |event| event.seq);
            let limit = before.saturating_sub(after + 1).min(PAGE);
            if limit == 0 {
                return Ok(events);
            }
            let page =
                self.store.log(&LogFilter { after, limit: Some(limit), ..LogFilter::default() }).await?;
            let is_last = (page.len() as u64) < limit;
            events.extend(page);
            if is_last {
                return Ok(events); // an edit comes into the log as a whole
            }
            let last = events.last().map(|event| event.edit);
            let whole = events.iter().position(|event| Some(event.edit) == last).unwrap_or(0);
            if whole > 0 {
                events.truncate(whole);
                return Ok(events);
            }
        }
    }

    /// Publishes events that follow the last published one.
    pub(crate) fn tell(&self, turn: &mut Turn<'_>, events: Vec<(Event, Home)>, sets: Arc<[Set]>) {
        // A set exists as soon as an item names it.
        if events.iter().any(|(_, home)| !sets.iter().any(|set| set.name == home.set)) {
            self.read_sets_anew();
        }
        let seq = events.last().map_or(0, |(event, _)| event.seq);
        **turn = Some(seq);
        self.newest.store(seq, Ordering::Relaxed);
        self.changes.send_modify(|changes| *changes += 1);
        let _ = self.published.send(Arc::new(Published { seq, events, sets })); // an error means that no session listens
    }
}
