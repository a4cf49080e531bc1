//! Connections of callers who have not yet said who they are. They hold none of the places of
//! associations: a silent stranger delays no known caller.

use std::collections::VecDeque;
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Strangers at a time; one more ends the one that has waited the longest.
const MOST: usize = 32;
/// The longest time of a negotiation, where others come.
const PATIENCE: Duration = Duration::from_secs(10);

/// All strangers, the first one in front.
#[derive(Debug, Default)]
pub(super) struct Strangers(Mutex<Known>);

#[derive(Debug, Default)]
struct Known {
    next: u64,
    waiting: VecDeque<(u64, Instant, TcpStream)>,
}

/// A stranger, until it is dropped.
#[derive(Debug)]
pub(super) struct Stranger {
    all: Arc<Strangers>,
    number: u64,
}

impl Strangers {
    /// One more stranger. Ends those who have waited too long, and the first one where there are too many.
    pub(super) fn add(self: &Arc<Self>, stream: &TcpStream) -> std::io::Result<Stranger> {
        let stream = stream.try_clone()?;
        let mut known = self.0.lock();
        let Known { next, waiting } = &mut *known;
        while waiting.len() >= MOST || waiting.front().is_some_and(|(_, since, _)| since.elapsed() > PATIENCE)
        {
            let Some((_, _, oldest)) = waiting.pop_front() else { break };
            let _ = oldest.shutdown(Shutdown::Both); // its thread reads an end
        }
        *next += 1;
        waiting.push_back((*next, Instant::now(), stream));
        Ok(Stranger { all: Arc::clone(self), number: *next })
    }
}

impl Drop for Stranger {
    fn drop(&mut self) {
        self.all.0.lock().waiting.retain(|(number, _, _)| *number != self.number);
    }
}
