//! Which connections are idle, and for how long: when all places are taken, the one that has been
//! idle the longest makes room.
//!
//! A connection is idle until the head of its first request has arrived, and between the last byte
//! of an answer and the next request. One whose request is being answered is never closed for
//! another.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
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
    address: IpAddr,
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
    pub(super) fn add(self: &Arc<Self>, address: IpAddr) -> Entry {
        let activity = Arc::new(Activity {
            address,
            running: AtomicU64::new(0),
            idle_since: AtomicU64::new(self.tick()),
            close: Notify::new(),
        });
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.known.lock().insert(number, Arc::clone(&activity));
        Entry { all: Arc::clone(self), number, activity }
    }

    /// Number of connections of an address.
    pub(super) fn count_of(&self, address: IpAddr) -> usize {
        self.known.lock().values().filter(|one| one.address == address).count()
    }

    /// Closes the connection that has been idle the longest, of this address if one is given;
    /// `false` when none is idle.
    pub(super) fn close_idlest(&self, address: Option<IpAddr>) -> bool {
        let mut known = self.known.lock();
        let of_address = |one: &Activity| address.is_none_or(|address| one.address == address);
        let idle =
            known.iter().filter(|(_, one)| one.running.load(Ordering::Relaxed) == 0 && of_address(one));
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
        self.all.known.lock().remove(&self.number);
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
        let [own, other]: [IpAddr; 2] = ["192.0.2.1", "192.0.2.2"].map(|text| text.parse().unwrap());
        let (first, second) = (all.add(own), all.add(own));
        let running = first.request();
        assert!(all.close_idlest(None));
        second.closed().await;
        assert!(!all.close_idlest(None), "the first is being answered");
        let third = all.add(own);
        drop(running); // the first is idle since now, the third for longer
        assert!(all.close_idlest(None));
        third.closed().await;
        assert!(all.close_idlest(None));
        first.closed().await;
        assert!(!all.close_idlest(None));
        let of_other = all.add(other);
        assert_eq!((all.count_of(own), all.count_of(other)), (0, 1));
        assert!(!all.close_idlest(Some(own)));
        assert!(all.close_idlest(Some(other)));
        of_other.closed().await;
        drop((first, second, third, of_other));
        assert!(all.known.lock().is_empty());
    }
}
