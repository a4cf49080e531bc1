//! Failures on purpose, by which tests see that callers recover.

use std::time::Duration;

/// Injected failures, by which tests check that callers recover.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreFaults {
    /// Largest size of a SQLite file; beyond it, the disk is full.
    pub most_bytes: Option<u64>,
    /// The added time of each change.
    pub delay: Duration,
}
