//! Which connections are idle, and for how long: when all places are taken, the one that has been
//! idle the longest makes room.
//!
//! A connection is idle until the head of its first request has arrived, and between the last byte
//! of an answer and the next request. One whose request is being answered is never closed for
//! another.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// The connections that are served.
#[derive(Default)]
pub(super) struct Connections {
    known: Mutex<HashMap<u64, Arc<Activity>>>,
    /// Counts changes of any connection: the order in which they became idle.
    clock: AtomicU64,
    next: AtomicU64,
}

/// One connection.
struct Activity {
    /// Requests whose answer is not finished: at most one in HTTP/1.
    running: AtomicU64,
    /// When it became idle, on the clock of [`Connections`].
    idle_since: AtomicU64,
    close: Notify,
}

/// A connection's entry; dropping it removes the entry.
pub(super) struct Entry {
    all: Arc<Connections>,
    number: u64,
    activity: Arc<Activity>,
}

/// A request whose answer is not finished.
pub(super) struct Running {
    all: Arc<Connections>,
    activity: Arc<Activity>,
}

impl Connections {
    /// Adds a connection, which is idle.
    pub(super) fn add(self: &Arc<Self>) -> Entry {
        let activity = Arc::new(Activity {
            running: AtomicU64::new(0),
            idle_since: AtomicU64::new(self.tick()),
            close: Notify::new(),
        });
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.known().insert(number, Arc::clone(&activity));
        Entry { all: Arc::clone(self), number, activity }
    }

    /// Closes the connection that has been idle the longest; `false` when none is idle.
    pub(super) fn close_idlest(&self) -> bool {
        let mut known = self.known();
        let idle = known.iter().filter(|(_, one)| one.running.load(Ordering::Relaxed) == 0);
        let idlest = idle.min_by_key(|(_, one)| one.idle_since.load(Ordering::Relaxed));
        let Some(number) = idlest.map(|(number, _)| *number) else { return false };
        if let Some(activity) = known.remove(&number) {
            activity.close.notify_one();
        }
        true
    }

    fn tick(&self) -> u64 {
        self.clock.fetch_add(1, Ordering::Relaxed)
    }

    /// The value is whole between statements, so a panic elsewhere leaves it usable.
    fn known(&self) -> MutexGuard<'_, HashMap<u64, Arc<Activity>>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Entry {
    /// A request has arrived; its answer is finished when the result is dropped.
    pub(super) fn request(&self) -> Running {
        self.activity.running.fetch_add(1, Ordering::Relaxed);
        Running { all: Arc::clone(&self.all), activity: Arc::clone(&self.activity) }
    }

    /// Waits until the connection has to make room.
    pub(super) async fn closed(&self) {
        self.activity.close.notified().await;
    }
}

impl Drop for Entry {
    fn drop(&mut self) {
        self.all.known().remove(&self.number);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.activity.idle_since.store(self.all.tick(), Ordering::Relaxed);
        self.activity.running.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_idlest_connection_makes_room_and_a_running_one_never_does() {
        let all = Arc::new(Connections::default());
        let (first, second) = (all.add(), all.add());
        let running = first.request();
        assert!(all.close_idlest());
        second.closed().await;
        assert!(!all.close_idlest(), "the first is being answered");
        let third = all.add();
        drop(running); // the first is idle since now, the third for longer
        assert!(all.close_idlest());
        third.closed().await;
        assert!(all.close_idlest());
        first.closed().await;
        assert!(!all.close_idlest());
        drop((first, second, third));
        assert!(all.known().is_empty());
    }
}
