//! Fair shares: how much of something one caller may hold at a time.
//!
//! A caller is an identity, or else a network address. Loopback addresses without an identity have
//! no limit: behind them is the machine's own user, or a proxy that stands for many.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::identity::Caller;

/// What callers hold.
pub(super) struct Shares {
    most: usize,
    held: Mutex<HashMap<String, usize>>,
}

/// One unit of a caller's share, until it is dropped.
pub(super) struct Share {
    shares: Arc<Shares>,
    key: String,
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
        let key = match (&caller.identity, caller.address) {
            (Some(identity), _) => format!("name {}", identity.name),
            (None, Some(address)) if !address.is_loopback() => format!("address {address}"),
            (None, _) => return Ok(None),
        };
        let mut held = self.held();
        let count = held.entry(key.clone()).or_default();
        if *count >= self.most {
            return Err(self.most);
        }
        *count += 1;
        Ok(Some(Share { shares: Arc::clone(self), key }))
    }

    /// The value is whole between statements, so a panic elsewhere leaves it usable.
    fn held(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut held = self.shares.held();
        if let Some(count) = held.get_mut(&self.key) {
            *count -= 1;
            if *count == 0 {
                held.remove(&self.key);
            }
        }
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
}
