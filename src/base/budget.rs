//! The resources that reading bytes from outside may take: memory that it keeps, bytes that it
//! unpacks, and whether anyone still waits for the result.
//!
//! A [`Budget`] is shared by all threads of one reading. It counts and refuses; it allocates
//! nothing and stops no thread. Sizes in bytes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The limits of one reading. Clones share them.
#[derive(Clone, Debug)]
pub struct Budget(Arc<Limits>);

#[derive(Debug)]
struct Limits {
    kept: Allowance,
    unpacked: Allowance,
    is_cancelled: AtomicBool,
}

#[derive(Debug)]
struct Allowance {
    limit: u64,
    left: AtomicU64,
}

/// Why a reading was ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BudgetError {
    /// The headers, tables and data sets that were read take too much memory.
    #[error("headers and tables need more than {} MiB of memory", limit.div_ceil(1 << 20))]
    Memory {
        /// Bytes allowed.
        limit: u64,
    },
    /// Compressed data holds too much.
    #[error("compressed data unpacks to more than {} MiB", limit.div_ceil(1 << 20))]
    Unpacked {
        /// Bytes allowed.
        limit: u64,
    },
    /// The reading was cancelled: its result is no longer needed.
    #[error("the reading was cancelled")]
    Cancelled,
}

impl Budget {
    /// A budget of `kept` bytes that stay in memory beside voxels, and of `unpacked` bytes that
    /// decompression may deliver.
    #[must_use]
    pub fn new(kept: u64, unpacked: u64) -> Self {
        let allowance = |limit| Allowance { limit, left: AtomicU64::new(limit) };
        Self(Arc::new(Limits {
            kept: allowance(kept),
            unpacked: allowance(unpacked),
            is_cancelled: AtomicBool::new(false),
        }))
    }

    /// Takes bytes that stay in memory until the reading ends.
    ///
    /// # Errors
    /// When fewer are left, or the reading was cancelled.
    pub fn keep(&self, bytes: u64) -> Result<(), BudgetError> {
        self.check()?;
        self.0.kept.take(bytes).map_err(|limit| BudgetError::Memory { limit })
    }

    /// Takes bytes that decompression delivers. Call it before they are unpacked.
    ///
    /// # Errors
    /// When fewer are left, or the reading was cancelled.
    pub fn unpack(&self, bytes: u64) -> Result<(), BudgetError> {
        self.check()?;
        self.0.unpacked.take(bytes).map_err(|limit| BudgetError::Unpacked { limit })
    }

    /// Bytes that may still stay in memory.
    #[must_use]
    pub fn kept_left(&self) -> u64 {
        self.0.kept.left.load(Ordering::Relaxed)
    }

    /// Bytes that decompression may still deliver.
    #[must_use]
    pub fn unpacked_left(&self) -> u64 {
        self.0.unpacked.left.load(Ordering::Relaxed)
    }

    /// Whether the reading may go on.
    ///
    /// # Errors
    /// When it was cancelled.
    pub fn check(&self) -> Result<(), BudgetError> {
        if self.0.is_cancelled.load(Ordering::Relaxed) { Err(BudgetError::Cancelled) } else { Ok(()) }
    }

    /// Ends the reading at its next step.
    pub fn cancel(&self) {
        self.0.is_cancelled.store(true, Ordering::Relaxed);
    }
}

impl Default for Budget {
    /// 1 GiB of headers (a million slices) and 256 GiB unpacked: far beyond any study.
    fn default() -> Self {
        Self::new(1 << 30, 256 << 30)
    }
}

impl Allowance {
    /// Takes bytes; the limit where too few are left.
    fn take(&self, bytes: u64) -> Result<(), u64> {
        let taken =
            self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes));
        taken.map(drop).map_err(|_| self.limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_share_what_is_left() {
        let budget = Budget::new(10, 100);
        let other = budget.clone();
        assert_eq!(budget.keep(6), Ok(()));
        assert_eq!(other.keep(5), Err(BudgetError::Memory { limit: 10 }));
        assert_eq!(other.keep(4), Ok(()), "a refusal takes nothing");
        assert_eq!(budget.keep(1), Err(BudgetError::Memory { limit: 10 }));
        assert_eq!(other.unpack(u64::MAX), Err(BudgetError::Unpacked { limit: 100 }));
        budget.cancel();
        assert_eq!(other.unpack(1), Err(BudgetError::Cancelled));
    }
}
