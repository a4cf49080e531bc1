//! The DICOM network: a provider of verification (C-ECHO) and storage (C-STORE), and a user of
//! storage, PS3.4 annexes A and B.
//!
//! Associations are negotiated by dicom-ul. `message` has the commands, `receiver` the conversation,
//! `inbox` the folder in which objects are durable before they are acknowledged, `sender` the other
//! direction.

mod inbox;
mod message;
mod receiver;
mod sender;

pub use inbox::{CompletedSeries, Inbox};
pub use receiver::{AllowedCaller, CallerError, Receiver, ReceiverOptions};
pub use sender::{NetworkAddress, NetworkAddressError, SendError, StoreStatus};
