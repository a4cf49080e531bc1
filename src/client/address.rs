//! The address of the server, as a person writes it.

use std::fmt;
use std::str::FromStr;

use tokio_tungstenite::tungstenite::http::Uri;

use relief_live::{Hello, check_view_name};

/// A server: `http://HOST:PORT`, `https://HOST:PORT`, the same with `ws` and `wss`, or `HOST:PORT`; a
/// path before `/v1` is kept, for proxies that have one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerAddress {
    is_encrypted: bool,
    host: String,
    port: u16,
    base: String,
}

/// An invalid address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// It says nothing that could be connected to.
    #[error("{0:?} is not a server address; expected http://HOST:PORT or https://HOST:PORT")]
    Malformed(String),
    /// Something else than a server.
    #[error("{0}:// is not a server address; expected http://HOST:PORT or https://HOST:PORT")]
    Scheme(String),
}

impl FromStr for ServerAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let shown = || AddressError::Malformed(text.chars().take(80).collect());
        let (scheme, rest) = text.split_once("://").unwrap_or(("http", text));
        let is_encrypted = match scheme.to_ascii_lowercase().as_str() {
            "http" | "ws" => false,
            "https" | "wss" => true,
            scheme => return Err(AddressError::Scheme(scheme.chars().take(20).collect())),
        };
        let uri: Uri = format!("http://{rest}").parse().map_err(|_| shown())?;
        let host = uri.host().filter(|host| !host.is_empty()).ok_or_else(shown)?;
        let has_more = uri.query().is_some() || uri.authority().is_some_and(|it| it.as_str().contains('@'));
        // A port that is no number is no part of the authority that `Uri` would refuse.
        let port = match uri.port() {
            Some(port) => port.as_u16(),
            None if rest.split('/').next().is_some_and(|authority| authority == host) => {
                if is_encrypted {
                    443
                } else {
                    80
                }
            }
            None => return Err(shown()),
        };
        if has_more || port == 0 {
            return Err(shown());
        }
        let base = uri.path().trim_end_matches('/').to_owned();
        Ok(Self { is_encrypted, host: host.to_owned(), port, base })
    }
}

impl ServerAddress {
    /// Host as names are looked up: an IPv6 address without brackets; and port.
    #[must_use]
    pub fn target(&self) -> (&str, u16) {
        (self.host.trim_start_matches('[').trim_end_matches(']'), self.port)
    }

    /// Whether connections are encrypted.
    #[must_use]
    pub fn is_encrypted(&self) -> bool {
        self.is_encrypted
    }

    /// Host and port, as in the header `Host`.
    #[cfg(feature = "window")]
    pub(super) fn authority(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    /// A path of the server, behind that of a proxy.
    #[cfg(feature = "window")]
    pub(super) fn path(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }

    /// The address of a live session. It names view and volume for a proxy before several servers,
    /// which cannot read the hello; a single server ignores it.
    #[must_use]
    pub fn session_url(&self, hello: &Hello) -> String {
        let Self { is_encrypted, host, port, base } = self;
        let scheme = if *is_encrypted { "wss" } else { "ws" };
        // Invalid names are refused by the server.
        let named =
            [("view", &hello.view), ("volume", &hello.volume)].into_iter().filter_map(|(key, name)| {
                name.as_ref().filter(|name| check_view_name(name).is_ok()).map(|name| format!("{key}={name}"))
            });
        let query = named.collect::<Vec<_>>().join("&");
        let mark = if query.is_empty() { "" } else { "?" };
        format!("{scheme}://{host}:{port}{base}/v1/session{mark}{query}")
    }
}

impl fmt::Display for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.is_encrypted { "https" } else { "http" };
        write!(f, "{scheme}://{}:{}{}", self.host, self.port, self.base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_as_people_write_them() {
        for (text, url) in [
            ("http://127.0.0.1:8080", "ws://127.0.0.1:8080/v1/session"),
            ("http://127.0.0.1:8080/", "ws://127.0.0.1:8080/v1/session"),
            ("ws://ct.example:81/relief/", "ws://ct.example:81/relief/v1/session"),
            ("localhost:8080", "ws://localhost:8080/v1/session"),
            ("HTTP://localhost", "ws://localhost:80/v1/session"),
            ("http://[::1]:8080", "ws://[::1]:8080/v1/session"),
            ("https://ct.example", "wss://ct.example:443/v1/session"),
            ("wss://ct.example:8443", "wss://ct.example:8443/v1/session"),
        ] {
            let address = text.parse::<ServerAddress>().unwrap();
            assert_eq!(address.session_url(&Hello::default()), url, "{text}");
        }
        assert_eq!("http://[::1]:8080".parse::<ServerAddress>().unwrap().target(), ("::1", 8080));
    }

    #[test]
    fn a_proxy_can_tell_sessions_apart_by_their_address() {
        let address: ServerAddress = "localhost:8080".parse().unwrap();
        let url = |view: Option<&str>, volume: Option<&str>| {
            let [view, volume] = [view, volume].map(|name| name.map(str::to_owned));
            let url = address.session_url(&Hello { view, volume, ..Hello::default() });
            url.strip_prefix("ws://localhost:8080/v1/session").unwrap().to_owned()
        };
        assert_eq!(url(Some("theatre-1"), Some("0a1b")), "?view=theatre-1&volume=0a1b");
        assert_eq!(url(None, Some("0a1b")), "?volume=0a1b");
        assert_eq!(url(Some("a b&c"), None), "");
    }

    #[test]
    fn invalid_addresses_are_named() {
        for bad in [
            "",
            "http://",
            "http://:80",
            "http://a:99999",
            "http://a:0",
            "http://a:b",
            "a b",
            "http://a?x=1",
            "http://u@a:1",
        ] {
            let error = bad.parse::<ServerAddress>().unwrap_err();
            assert!(matches!(error, AddressError::Malformed(_)), "{bad}: {error}");
        }
        assert!(matches!("ftp://a".parse::<ServerAddress>(), Err(AddressError::Scheme(_))));
    }
}
