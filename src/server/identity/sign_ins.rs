//! Places for callers that sign in. Signing in needs no identity, so strangers may try it: few of them
//! at a time.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::caller::Caller;
use crate::shares::{Share, Shares};

/// Callers that sign in at a time.
const AT_ONCE: usize = 16;
/// The same, of one address other than loopback.
const AT_ONCE_OF_ADDRESS: usize = 4;

/// The callers that are signing in.
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
    /// A place for this caller, until it is dropped; `None` when there is none.
    pub(super) fn take(&self, caller: &Caller) -> Option<(Option<Share>, OwnedSemaphorePermit)> {
        let share = self.of_address.take(caller).ok()?;
        Some((share, Arc::clone(&self.all).try_acquire_owned().ok()?))
    }
}
