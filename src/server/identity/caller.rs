//! The caller of a request: network address, and identity if the server requires one.

use std::net::{IpAddr, SocketAddr};

use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;

use super::scope::Scope;
use crate::problem::Problem;

/// The other end of a connection.
#[derive(Clone, Debug)]
pub(crate) struct Peer {
    pub(crate) address: SocketAddr,
    /// The common name of its certificate, which TLS has verified.
    pub(crate) certificate: Option<String>,
    /// Whether the connection is encrypted.
    pub(crate) is_encrypted: bool,
}

/// A verified name and its rights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) name: String,
    pub(crate) scope: Scope,
    pub(crate) proof: Proof,
}

/// How an identity was verified.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Proof {
    /// A token with this hash; it may be revoked later.
    Token(String),
    /// A client certificate.
    Certificate,
    /// The header of a trusted proxy.
    Proxy,
}

/// The caller of a request.
#[derive(Clone, Debug, Default)]
pub(crate) struct Caller {
    /// `None` where the server is open.
    pub(crate) identity: Option<Identity>,
    /// `None` where there is no network, as in tests.
    pub(crate) address: Option<IpAddr>,
}

impl Caller {
    /// Checks that the caller may do what needs this scope.
    ///
    /// # Errors
    /// 403 with both scopes.
    pub(crate) fn may(&self, needed: Scope) -> Result<(), Problem> {
        match &self.identity {
            Some(identity) if identity.scope < needed => {
                let detail =
                    format!("this needs the scope {needed}; {:?} has {}", identity.name, identity.scope);
                Err(Problem::new(StatusCode::FORBIDDEN, "scope", detail)
                    .with("needed", needed.name())
                    .with("found", identity.scope.name()))
            }
            _ => Ok(()),
        }
    }

    /// The author of the caller's changes: the verified name, or else the stated one.
    ///
    /// # Errors
    /// 403 when both are there and differ.
    pub(crate) fn author(&self, stated: Option<String>) -> Result<Option<String>, Problem> {
        let Some(Identity { name, .. }) = &self.identity else { return Ok(stated) };
        match stated {
            Some(stated) if stated != *name => {
                let detail = format!("the author is {stated:?}, but you are signed in as {name:?}");
                Err(Problem::new(StatusCode::FORBIDDEN, "other-author", detail).with("path", "author"))
            }
            _ => Ok(Some(name.clone())),
        }
    }

    /// Whether both are the same identity.
    pub(crate) fn is_same_as(&self, other: &Self) -> bool {
        let name = |caller: &Self| caller.identity.as_ref().map(|identity| identity.name.clone());
        name(self) == name(other)
    }
}

impl<S: Sync> FromRequestParts<S> for Caller {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        Ok(parts.extensions.get::<Self>().cloned().unwrap_or_default())
    }
}
