//! What other servers and programs change in the same log, told here as what is changed here.
//!
//! What it is: [`Server::follow_annotations`], a task that hears of changes and reads them, and the one place where events are told: in
//! the order of the log, each once, whoever made them. What it is not: the hearing itself (see `store`). A word that is missed is made
//! up for by the next one, since events are always read from the last one on that was told.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::sync::MutexGuard;
use tokio::task::JoinHandle;

use super::apply::PAGE;
use super::{Annotations, Home, Published};
use crate::problem::Problem;
use crate::state::Server;
use relief_annotation::{Event, Set};
use relief_store::{Changed, LogFilter};

/// Waits after a failure: the first, and the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// The right to tell: the last event of the log that was told; `None` before the log was looked at.
pub(super) type Turn<'a> = MutexGuard<'a, Option<u64>>;

impl Server {
    /// Begins to tell live sessions what other programs change in the log of annotations: all that comes after this call, until the
    /// task is aborted. Where there is no log, there is nothing to do.
    pub async fn follow_annotations(self: &Arc<Self>) -> JoinHandle<()> {
        if let Some(annotations) = &self.annotations {
            // Where the log cannot be read just now, it is told from when it can.
            drop(annotations.turn().await);
        }
        let server = Arc::clone(self);
        tokio::spawn(async move {
            if let Some(annotations) = &server.annotations {
                tokio::join!(follow(annotations), look_again(&server, annotations));
            }
        })
    }
}

/// Views look again whoever was the first to see that something changed: of sets that may be a request for a list.
async fn look_again(server: &Server, annotations: &Annotations) {
    let mut changes = annotations.changes.subscribe();
    while changes.changed().await.is_ok() {
        server.live.views.wake();
    }
}

async fn follow(annotations: &Annotations) {
    let mut watch = annotations.store.watch();
    let mut pause = FIRST_PAUSE;
    loop {
        let heard = tokio::select! {
            heard = watch.changed() => heard.map_err(Problem::from),
            () = annotations.behind.notified() => Ok(Changed::Anything),
        };
        let told = match heard {
            Ok(changed) => {
                let told = annotations.catch_up(changed).await;
                // What was heard is not said again.
                told.inspect_err(|_| annotations.behind.notify_one())
            }
            Err(problem) => Err(problem),
        };
        match told {
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
    pub(super) async fn turn(&self) -> Result<Turn<'_>, Problem> {
        let mut turn = self.turn.lock().await;
        if turn.is_none() {
            // Whoever listens from now on asks for the whole first.
            let seq = self.store.seq().await?;
            *turn = Some(seq);
            self.newest.store(seq, Ordering::Relaxed);
        }
        Ok(turn)
    }

    /// Tells what others have added since the last event that was told, and looks at the sets where they may be others.
    async fn catch_up(&self, changed: Changed) -> Result<(), Problem> {
        let mut turn = self.turn().await?;
        if changed == Changed::Anything {
            self.read_sets_anew();
            self.sets().await?;
        }
        self.tell_until(&mut turn, u64::MAX).await
    }

    /// Tells what is in the log after the last event that was told and before this one.
    pub(super) async fn tell_until(&self, turn: &mut Turn<'_>, before: u64) -> Result<(), Problem> {
        loop {
            let events = self.whole_edits(turn.unwrap_or(0), before).await?;
            if events.is_empty() {
                return Ok(());
            }
            let homes = self.homes(&events).await?;
            let sets = self.sets().await?;
            let found = events.into_iter().zip(homes).collect::<Vec<_>>();
            self.follow(&found);
            // Those of one edit are told together.
            for edit in found.chunk_by(|(a, _), (b, _)| a.edit == b.edit) {
                self.tell(turn, edit.to_vec(), Arc::clone(&sets));
            }
        }
    }

    /// Events after this one and before that one: a page of them, without the beginning of an edit that goes on beyond it, but at
    /// least one edit, however long it is.
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

    /// Tells events that follow the last one that was told.
    pub(super) fn tell(&self, turn: &mut Turn<'_>, events: Vec<(Event, Home)>, sets: Arc<[Set]>) {
        // A set is there as soon as an item names it.
        if events.iter().any(|(_, home)| !sets.iter().any(|set| set.name == home.set)) {
            self.read_sets_anew();
        }
        let seq = events.last().map_or(0, |(event, _)| event.seq);
        **turn = Some(seq);
        self.newest.store(seq, Ordering::Relaxed);
        self.changes.send_modify(|changes| *changes += 1);
        let _ = self.told.send(Arc::new(Published { seq, events, sets })); // nobody may listen
    }
}
