//! Why there is no session.

use super::address::ServerAddress;

/// Why a session could not start, or has ended.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Nothing listens at the address, or the network does not reach it.
    #[error(
        "cannot reach {server}: {reason}; is `relief serve` running there, and may this machine connect to it?"
    )]
    Unreachable {
        /// Where.
        server: ServerAddress,
        /// The error of the system.
        reason: String,
    },
    /// The server's certificate is not trusted, or the connection cannot be encrypted.
    #[error("the connection to {server} cannot be encrypted: {reason}; name its authority by --ca FILE.pem")]
    Insecure {
        /// Where.
        server: ServerAddress,
        /// The error of TLS.
        reason: String,
    },
    /// Something answers that is no Relief server, or an older one.
    #[error("{server} does not answer as a Relief server with live sessions: {reason}")]
    NotRelief {
        /// Where.
        server: ServerAddress,
        /// The unexpected answer.
        reason: String,
    },
    /// The server understood the request and refused it.
    #[error("{server} refused the session: {reason}")]
    Refused {
        /// Where.
        server: ServerAddress,
        /// Its words.
        reason: String,
        /// Whether it may be otherwise in a while.
        passing: bool,
        /// Whether the server has no volume of the requested id.
        no_volume: bool,
    },
    /// The volume of the session was removed from the server.
    #[error("the session at {server} has ended: the volume was removed{reason}")]
    Removed {
        /// Where.
        server: ServerAddress,
        /// The server's reason, after a colon; may be empty.
        reason: String,
    },
    /// The session is over, and another connection would not change that.
    #[error("the session at {server} has ended: {reason}")]
    Ended {
        /// Where.
        server: ServerAddress,
        /// Why.
        reason: String,
    },
    /// The connection ended.
    #[error("the connection to {server} was lost: {reason}")]
    Lost {
        /// Where.
        server: ServerAddress,
        /// How.
        reason: String,
    },
}

impl ClientError {
    /// Whether another attempt may succeed without a change of this client. A session that existed
    /// may come back whatever the reason: a restarted server loads its volumes first.
    #[must_use]
    pub const fn is_passing(&self, was_connected: bool) -> bool {
        match self {
            Self::Unreachable { .. } | Self::Lost { .. } => true,
            Self::Refused { passing, .. } => *passing || was_connected,
            Self::NotRelief { .. } | Self::Insecure { .. } => was_connected,
            Self::Ended { .. } | Self::Removed { .. } => false,
        }
    }

    /// Whether the volume of the session does not exist on the server, or no longer.
    pub(super) const fn has_no_volume(&self) -> bool {
        matches!(self, Self::Removed { .. } | Self::Refused { no_volume: true, .. })
    }
}

/// Shortens a server's text and removes control characters that a terminal would execute.
pub(super) fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(400).collect()
}
