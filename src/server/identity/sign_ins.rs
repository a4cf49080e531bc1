//! Limits of simultaneous sign-ins. Signing in needs no identity, so anybody can try it.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::caller::Caller;
use crate::shares::{Share, Shares};

/// Most sign-ins at a time.
const AT_ONCE: usize = 16;
/// Most sign-ins at a time from one address; loopback addresses have no such limit.
const AT_ONCE_OF_ADDRESS: usize = 4;

/// Counts the sign-ins in progress.
pub(crate) struct SignIns {
    all: Arc<Semaphore>,
    of_address: Arc<Shares>,
}

impl Default for SignIns {
    fn default() -> Self {
        Self { all: Arc::new(Semaphore::new(AT_ONCE)), of_address: Arc::new(Shares::new(AT_ONCE_OF_ADDRESS)) }
    }
}

impl SignIns {
    /// A place for this caller, until it is dropped; `None` if all places are taken.
    pub(super) fn take(&self, caller: &Caller) -> Option<(Option<Share>, OwnedSemaphorePermit)> {
        let share = self.of_address.take(caller).ok()?;
        Some((share, Arc::clone(&self.all).try_acquire_owned().ok()?))
    }
}
