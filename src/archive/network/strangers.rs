//! Connections whose association is not negotiated yet. They do not count as associations, so silent
//! connections do not keep known callers out.

use std::collections::VecDeque;
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Most connections before negotiation. A further one closes the oldest.
const MOST: usize = 32;
/// Time for a negotiation. After it, the next connection closes this one.
const PATIENCE: Duration = Duration::from_secs(10);

/// All connections before negotiation, the oldest first.
#[derive(Debug, Default)]
pub(super) struct Strangers(Mutex<Known>);

#[derive(Debug, Default)]
struct Known {
    next: u64,
    waiting: VecDeque<(u64, Instant, TcpStream)>,
}

/// A connection before negotiation, until this is dropped.
#[derive(Debug)]
pub(super) struct Stranger {
    all: Arc<Strangers>,
    number: u64,
}

impl Strangers {
    /// Adds a connection. Closes those that exceed their time, and the oldest if there are too many.
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
