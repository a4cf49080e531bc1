//! DICOM archives: search (QIDO-RS), retrieval (WADO-RS) and storage (STOW-RS) by DICOMweb,
//! PS3.18; and objects that archives send by the DICOM network, PS3.7 and PS3.8.
//!
//! An [`ArchiveAddress`] names an archive, a study or a series in it, or the matches of a query. An
//! [`Archive`] is a client of one. Retrieval writes the objects as they are stored; it does not read
//! them. A [`Receiver`] is a storage provider, which puts objects into an [`Inbox`], a folder.
//!
//! Addresses and answers have UIDs, and answers have names of patients. No error and no log line
//! has any of these.

#[cfg(feature = "client")]
mod access;
mod address;
#[cfg(feature = "client")]
mod client;
#[cfg(feature = "client")]
mod error;
#[cfg(feature = "client")]
mod matches;
#[cfg(feature = "network")]
mod network;
#[cfg(feature = "client")]
mod part;
#[cfg(feature = "client")]
mod retrieve;
#[cfg(feature = "client")]
mod search;
#[cfg(feature = "client")]
mod store;

#[cfg(feature = "client")]
pub use access::{ArchiveAccess, Credentials};
pub use address::{AddressError, ArchiveAddress, SCHEME};
#[cfg(feature = "client")]
pub use client::Archive;
#[cfg(feature = "client")]
pub use error::{ArchiveError, Total};
#[cfg(feature = "network")]
pub use network::{
    AllowedCaller, CallerError, CompletedSeries, Inbox, NetworkAddress, NetworkAddressError, Receiver,
    ReceiverOptions, SendError, StoreStatus,
};
#[cfg(feature = "client")]
pub use retrieve::Retrieved;
#[cfg(feature = "client")]
pub use search::FoundSeries;
#[cfg(feature = "client")]
pub use store::{OutgoingObject, StoreOutcome};
