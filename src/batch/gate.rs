//! A limit of bytes that loading waits for.

use parking_lot::{Condvar, Mutex};

/// Bytes that may be held at once.
#[derive(Debug)]
pub(super) struct MemoryBudget {
    limit: u64,
    held: Mutex<u64>,
    freed: Condvar,
}

/// Bytes that are held; given back when dropped.
#[derive(Debug)]
pub(super) struct ReservedMemory<'a> {
    gate: &'a MemoryBudget,
    bytes: u64,
}

impl MemoryBudget {
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, held: Mutex::new(0), freed: Condvar::new() }
    }

    pub(super) fn limit(&self) -> u64 {
        self.limit
    }

    /// Waits until this many bytes are free. A request beyond the limit waits until all are.
    pub(super) fn hold(&self, bytes: u64) -> ReservedMemory<'_> {
        let bytes = bytes.min(self.limit);
        let mut held = self.held.lock();
        while *held + bytes > self.limit {
            self.freed.wait(&mut held);
        }
        *held += bytes;
        ReservedMemory { gate: self, bytes }
    }
}

impl ReservedMemory<'_> {
    /// Counts bytes that exist already, without waiting for room: later requests wait for them.
    pub(super) fn grow(&mut self, bytes: u64) {
        self.bytes += bytes;
        *self.gate.held.lock() += bytes;
    }

    /// Releases bytes that were not needed.
    pub(super) fn shrink(&mut self, bytes: u64) {
        let spare = self.bytes.saturating_sub(bytes);
        self.bytes -= spare;
        *self.gate.held.lock() -= spare;
        self.gate.freed.notify_all();
    }
}

impl Drop for ReservedMemory<'_> {
    fn drop(&mut self) {
        self.shrink(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_beyond_the_limit_wait_for_those_held() {
        let gate = MemoryBudget::new(100);
        let mut first = gate.hold(70);
        first.grow(50); // beyond the limit, without waiting
        first.shrink(70);
        let mut second = gate.hold(30);
        second.shrink(10);
        std::thread::scope(|scope| {
            let third = scope.spawn(|| drop(gate.hold(500))); // more than ever: waits for all
            drop(first);
            drop(second);
            third.join().unwrap();
        });
        assert_eq!(*gate.held.lock(), 0);
    }
}
