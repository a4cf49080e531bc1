//! A promise of a frame: a future without a runtime, and the render thread's end of it.
//!
//! Dropping the [`Ticket`] cancels the request. Dropping the [`TicketSender`] answers
//! [`ServiceError::Stopped`], so that no caller waits for a thread that has ended.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

use super::{Rendered, ServiceError};

type Outcome = Result<Rendered, ServiceError>;

#[derive(Debug, Default)]
struct Slot {
    outcome: Option<Outcome>,
    waker: Option<Waker>,
    kept: bool,
}

/// Brings the frame of one order. Await it, or block on [`Ticket::wait`].
#[derive(Debug)]
#[must_use = "an order whose ticket is dropped is not rendered, or not to its end"]
pub struct Ticket {
    slot: Arc<Mutex<Slot>>,
}

/// The render thread's end of a ticket.
#[derive(Debug)]
pub(super) struct TicketSender {
    slot: Arc<Mutex<Slot>>,
}

/// A ticket and the promise behind it.
pub(super) fn pair() -> (Ticket, TicketSender) {
    let slot = Arc::default();
    (Ticket { slot: Arc::clone(&slot) }, TicketSender { slot })
}

impl Ticket {
    /// A ticket whose frame exists already.
    pub(super) fn ready(rendered: Rendered) -> Self {
        let (ticket, promise) = pair();
        promise.keep(Ok(rendered));
        ticket
    }

    /// Blocks the calling thread until the frame is ready; not for async code.
    ///
    /// # Errors
    /// As the service answers: the backend's error, a panic in it, or its end.
    pub fn wait(self) -> Result<Rendered, ServiceError> {
        pollster::block_on(self)
    }
}

impl Future for Ticket {
    type Output = Result<Rendered, ServiceError>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let mut slot = self.slot.lock();
        if let Some(outcome) = slot.outcome.take() {
            return Poll::Ready(outcome);
        }
        slot.waker = Some(context.waker().clone());
        Poll::Pending
    }
}

impl TicketSender {
    /// Whether the ticket is still held.
    pub(super) fn is_wanted(&self) -> bool {
        Arc::strong_count(&self.slot) > 1
    }

    /// Answers the ticket.
    pub(super) fn keep(self, outcome: Outcome) {
        answer(&self.slot, outcome);
    }
}

impl Drop for TicketSender {
    fn drop(&mut self) {
        answer(&self.slot, Err(ServiceError::Stopped));
    }
}

/// The first answer counts.
fn answer(slot: &Mutex<Slot>, outcome: Outcome) {
    let waker = {
        let mut slot = slot.lock();
        if slot.kept {
            return;
        }
        slot.kept = true;
        slot.outcome = Some(outcome);
        slot.waker.take()
    };
    if let Some(waker) = waker {
        waker.wake();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_promise_is_answered() {
        let (ticket, promise) = pair();
        drop(promise);
        assert!(matches!(ticket.wait(), Err(ServiceError::Stopped)));
    }

    #[test]
    fn a_promise_knows_whether_its_caller_waits() {
        let (ticket, promise) = pair();
        assert!(promise.is_wanted());
        drop(ticket);
        assert!(!promise.is_wanted());
    }

    #[test]
    fn a_waiting_thread_is_woken() {
        let (ticket, promise) = pair();
        let waiting = std::thread::Builder::new().name("waits".into()).spawn(move || ticket.wait()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
        promise.keep(Err(ServiceError::Busy(3)));
        assert!(matches!(waiting.join().unwrap(), Err(ServiceError::Busy(3))));
    }
}
