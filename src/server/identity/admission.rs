//! The means by which a server recognises its callers.

use std::net::IpAddr;
use std::sync::Arc;

use axum::http::{HeaderMap, HeaderName, StatusCode, header};

use super::caller::{Caller, Identity, Peer, Proof};
use super::scope::Scope;
use super::token_file::TokenEntry;
use super::tokens::Tokens;
use crate::annotations::decoded;
use crate::problem::Problem;

/// The means by which a server recognises its callers. Without any, the server is open.
#[derive(Clone, Debug, Default)]
pub struct Admission {
    /// Bearer tokens, and sign-in to the pages by them.
    pub tokens: Option<Arc<Tokens>>,
    /// The scope of verified client certificates; their holder's name is the common name.
    pub certificates: Option<Scope>,
    /// A proxy that has verified the caller.
    pub proxy: Option<TrustedProxy>,
}

/// A proxy that names verified callers in a header, as percent-encoded UTF-8.
#[derive(Clone, Debug)]
pub struct TrustedProxy {
    /// The header, such as `X-Forwarded-User`. The proxy must remove it from requests of clients.
    pub header: HeaderName,
    /// Addresses of the proxy. The header of any other peer is ignored.
    pub addresses: Vec<IpAddr>,
    /// The scope of callers.
    pub scope: Scope,
}

impl Admission {
    /// Whether everybody may do everything.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.tokens.is_none() && self.certificates.is_none() && self.proxy.is_none()
    }

    /// The identity that a request proves by itself, without a cookie or a ticket.
    ///
    /// # Errors
    /// 401 when a token is given that is not valid.
    pub(super) fn identify(
        &self,
        headers: &HeaderMap,
        peer: Option<&Peer>,
    ) -> Result<Option<Identity>, Problem> {
        if let Some(token) = bearer(headers)
            && let Some(tokens) = &self.tokens
        {
            let entry =
                tokens.find(token).ok_or_else(|| unauthorized("the token is unknown or has expired"))?;
            return Ok(Some(entry.into()));
        }
        if let (Some(scope), Some(name)) =
            (self.certificates, peer.and_then(|peer| peer.certificate.as_deref()))
        {
            let proof = Proof::Certificate;
            return Ok(Some(Identity { name: name.to_owned(), scope, proof }));
        }
        let Some(proxy) = &self.proxy else { return Ok(None) };
        let is_trusted = peer.is_some_and(|peer| proxy.addresses.contains(&peer.address.ip()));
        let mut named = headers.get_all(&proxy.header).iter().filter(|_| is_trusted);
        let Some(value) = named.next() else { return Ok(None) };
        if named.next().is_some() {
            // One of them may come from the client, and the order is unknown.
            let detail = format!(
                "the request has several headers {}: the proxy must remove those of clients",
                proxy.header
            );
            return Err(unauthorized(&detail));
        }
        let name = value.to_str().ok().and_then(decoded);
        let name =
            name.ok_or_else(|| unauthorized("the header of the proxy is not percent-encoded UTF-8"))?;
        crate::annotations::check_author(&name)?;
        Ok(Some(Identity { name, scope: proxy.scope, proof: Proof::Proxy }))
    }

    /// The identity of a token, if it is valid.
    pub(super) fn identify_token(&self, token: &str) -> Option<Identity> {
        self.tokens.as_ref()?.find(token).map(Identity::from)
    }

    /// Whether the proof is still valid: a token may have been removed since.
    pub(crate) fn still_accepts(&self, caller: &Caller) -> bool {
        caller.identity.as_ref().is_none_or(|identity| match &identity.proof {
            Proof::Token(sha256) => {
                let entry = self.tokens.as_ref().and_then(|tokens| tokens.find_by_hash(sha256));
                entry.map(Identity::from).as_ref() == Some(identity)
            }
            Proof::Certificate | Proof::Proxy => true,
        })
    }
}

impl From<TokenEntry> for Identity {
    fn from(TokenEntry { name, scope, sha256, .. }: TokenEntry) -> Self {
        Self { name, scope, proof: Proof::Token(sha256) }
    }
}

/// The token of `Authorization: Bearer TOKEN`.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

pub(super) fn unauthorized(detail: &str) -> Problem {
    Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", detail)
}
