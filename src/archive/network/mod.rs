//! The DICOM network: a provider of verification (C-ECHO), storage (C-STORE) and storage commitment,
//! and a user of storage, PS3.4 annexes A, B and J.
//!
//! Associations are negotiated by dicom-ul. `message` has the commands, `receiver` the conversation,
//! `inbox` the folder in which objects are durable before they are acknowledged, `commitment` the
//! reports about them, `sender` the other direction. `strangers` and `incoming` have the limits for callers.

mod commitment;
mod inbox;
mod incoming;
mod message;
mod receiver;
mod sender;
mod strangers;

pub use inbox::{CompletedSeries, Inbox};
pub use receiver::{AllowedCaller, CallerError, Receiver, ReceiverOptions};
pub use sender::{NetworkAddress, NetworkAddressError, SendError, StoreStatus};
