//! Identities of callers and their rights.
//!
//! What it is: identities from bearer tokens, client certificates, a trusted proxy's header and the
//! sign-in of the pages; the scope that a route needs; the layer that refuses the rest. What it is
//! not: TLS (see `tls`) and the record of requests (see `audit`).
//!
//! A server without any of these means is open: everybody may do everything, and authors are names
//! that requests state. With one, each request has an identity, and the name of the identity is the
//! author of its edits.

mod admission;
mod admit;
mod caller;
mod scope;
mod sign_in;
mod sign_ins;
mod tickets;
mod token_file;
mod tokens;
mod wand;

pub use admission::{Admission, TrustedProxy};
pub use scope::Scope;
pub use token_file::{NewToken, TokenEntry, TokenFileError, add_token, read_tokens, remove_token};
pub use tokens::Tokens;

pub(crate) use admit::{admit_data, admit_page};
#[cfg(test)]
pub(crate) use caller::Proof;
pub(crate) use caller::{Caller, Identity, Peer};
pub(crate) use sign_in::{routes, ticket};
pub(crate) use sign_ins::SignIns;
pub(crate) use tickets::Tickets;
pub(crate) use wand::wand;
