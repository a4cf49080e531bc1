//! Progress of discovering and loading.

use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
/// The current step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Reading the headers of files.
    Headers,
    /// Decoding slices.
    Slices,
}

/// The progress of a stage. Calls come from several threads, and may overtake each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The unit of the count.
    pub stage: Stage,
    /// Finished ones.
    pub done: usize,
    /// All of them.
    pub total: usize,
}

impl Progress {
    /// A function that counts one more as done.
    pub(super) fn counter<'a>(
        stage: Stage,
        total: usize,
        report: &'a (dyn Fn(Self) + Sync),
    ) -> impl Fn() + Sync + 'a {
        let done = AtomicUsize::new(0);
        move || report(Self { stage, done: done.fetch_add(1, Ordering::Relaxed) + 1, total })
    }
}
