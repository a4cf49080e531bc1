//! Fair shares between callers: how many requests one caller may have ([`Shares`]), and how many of
//! its pictures are rendered at a time ([`Turns`]).
//!
//! A caller is an identity, or else a network address. Loopback addresses without an identity have
//! no limit: behind them is the machine's own user, or a proxy that stands for many.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use parking_lot::Mutex;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::identity::Caller;

/// Pictures of one caller in the queue of the render thread: one is rendered while the next one
/// waits.
const PICTURES_AT_ONCE: usize = 2;

/// The resources that callers hold.
pub(super) struct Shares {
    most: usize,
    held: Mutex<HashMap<Arc<str>, usize>>,
}

/// One unit of a caller's share, until it is dropped.
pub(super) struct Share {
    shares: Arc<Shares>,
    key: Arc<str>,
}

impl Shares {
    pub(super) fn new(most: usize) -> Self {
        Self { most, held: Mutex::default() }
    }

    /// Takes one unit; `None` for callers without a limit.
    ///
    /// # Errors
    /// The limit, when the caller holds as many.
    pub(super) fn take(self: &Arc<Self>, caller: &Caller) -> Result<Option<Share>, usize> {
        let Some(key) = key(caller) else { return Ok(None) };
        let mut held = self.held.lock();
        let count = held.entry(Arc::clone(&key)).or_default();
        if *count >= self.most {
            return Err(self.most);
        }
        *count += 1;
        Ok(Some(Share { shares: Arc::clone(self), key }))
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut held = self.shares.held.lock();
        if let Some(count) = held.get_mut(&self.key) {
            *count -= 1;
            if *count == 0 {
                held.remove(&self.key);
            }
        }
    }
}

/// The key under which a caller's requests are counted; `None` for callers without a limit.
pub(super) fn key(caller: &Caller) -> Option<Arc<str>> {
    match (&caller.identity, caller.address) {
        (Some(identity), _) => Some(format!("name {}", identity.name).into()),
        (None, Some(address)) if !address.is_loopback() => Some(format!("address {address}").into()),
        (None, _) => None,
    }
}

/// Lets [`PICTURES_AT_ONCE`] pictures of each caller into the queue of the render thread, and the
/// others wait. So one caller cannot fill the queue.
#[derive(Default)]
pub(super) struct Turns {
    callers: Mutex<HashMap<Arc<str>, Weak<Semaphore>>>,
}

impl Turns {
    /// Waits for a turn of the caller with this [`key`]; `None` for callers without a limit.
    pub(super) async fn take(&self, key: Option<&Arc<str>>) -> Option<OwnedSemaphorePermit> {
        let turns = self.of(key?);
        turns.acquire_owned().await.ok() // it is never closed
    }

    /// The turns of a caller, which exist while one is held or waited for.
    fn of(&self, key: &Arc<str>) -> Arc<Semaphore> {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        let mut callers = self.callers.lock();
        callers.retain(|_, turns| turns.strong_count() > 0);
        let known = callers.get(key).and_then(Weak::upgrade);
        known.unwrap_or_else(|| {
            let turns = Arc::new(Semaphore::new(PICTURES_AT_ONCE));
            callers.insert(Arc::clone(key), Arc::downgrade(&turns));
            turns
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_caller_has_a_share_and_gives_it_back() {
        let shares = Arc::new(Shares::new(2));
        let caller = |address: &str| Caller { identity: None, address: Some(address.parse().unwrap()) };
        let (one, other, own) = (caller("192.0.2.1"), caller("192.0.2.2"), caller("127.0.0.1"));
        let first = shares.take(&one).unwrap();
        let _second = shares.take(&one).unwrap();
        assert!(matches!(shares.take(&one), Err(2)));
        assert!(shares.take(&other).unwrap().is_some());
        assert!((0..9).all(|_| matches!(shares.take(&own), Ok(None))));
        drop(first);
        assert!(shares.take(&one).is_ok());
    }

    /// Invariant: Pictures of one caller wait for each other, and not for those of another caller.
    #[tokio::test]
    async fn pictures_of_a_caller_take_turns() {
        let turns = Turns::default();
        let keys = ["192.0.2.1", "192.0.2.2", "::1"].map(|address| {
            let address = Some(address.parse().unwrap());
            key(&Caller { identity: None, address })
        });
        let [one, other, own] = keys.each_ref().map(Option::as_ref);
        let (first, _second) = (turns.take(one).await, turns.take(one).await);
        assert!(turns.take(other).await.is_some());
        assert!(turns.take(own).await.is_none(), "no limit");
        let mut third = std::pin::pin!(turns.take(one));
        let waited = std::future::poll_fn(|context| std::task::Poll::Ready(third.as_mut().poll(context)));
        assert!(waited.await.is_pending());
        drop(first);
        assert!(third.await.is_some());
        assert_eq!(turns.callers.lock().len(), 1, "nothing is kept of a caller that left");
    }
}
