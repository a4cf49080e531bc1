//! Tickets: random words that open one WebSocket each. They are kept in memory alone, and end with
//! the server.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use data_encoding::BASE64URL_NOPAD;
use parking_lot::Mutex;

use super::caller::Identity;
use crate::problem::Problem;

/// The lifetime of a page's ticket.
pub(super) const LIFETIME: Duration = Duration::from_secs(30);
/// Tickets at a time; the oldest makes room.
const MOST: usize = 10_000;

/// The issued tickets that were not yet redeemed.
#[derive(Default)]
pub(crate) struct Tickets(Mutex<HashMap<String, Ticket>>);

struct Ticket {
    ends: Instant,
    identity: Identity,
}

impl Tickets {
    /// A ticket for this identity, which can be redeemed for so long.
    pub(super) fn give(&self, identity: Identity, lifetime: Duration) -> Result<String, Problem> {
        let mut bits = [0u8; 32];
        getrandom::fill(&mut bits).map_err(|error| Problem::internal("drawing a random ticket", error))?;
        let ticket = BASE64URL_NOPAD.encode(&bits);
        let mut given = self.0.lock();
        given.retain(|_, ticket| Instant::now() < ticket.ends);
        if given.len() >= MOST {
            let oldest = given.iter().min_by_key(|(_, ticket)| ticket.ends).map(|(word, _)| word.clone());
            oldest.and_then(|ticket| given.remove(&ticket));
        }
        given.insert(ticket.clone(), Ticket { ends: Instant::now() + lifetime, identity });
        Ok(ticket)
    }

    /// The identity of a ticket, once.
    pub(super) fn redeem(&self, ticket: &str) -> Option<Identity> {
        let Ticket { ends, identity } = self.0.lock().remove(ticket)?;
        (Instant::now() < ends).then_some(identity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::Scope;
    use crate::identity::caller::Proof;

    #[test]
    fn a_ticket_is_redeemed_once_and_the_oldest_makes_room() {
        let tickets = Tickets::default();
        let identity = Identity { name: "anna".to_owned(), scope: Scope::View, proof: Proof::Certificate };
        let ticket = tickets.give(identity.clone(), LIFETIME).unwrap();
        assert_eq!(tickets.redeem(&ticket), Some(identity.clone()));
        assert_eq!(tickets.redeem(&ticket), None);
        let first = tickets.give(identity.clone(), LIFETIME).unwrap();
        for _ in 0..MOST {
            tickets.give(identity.clone(), LIFETIME).unwrap();
        }
        assert_eq!(tickets.0.lock().len(), MOST);
        assert_eq!(tickets.redeem(&first), None);
    }
}
