//! The connection to a NATS server. It reconnects by itself; a loss is reported once.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_nats::jetstream::Context;
use async_nats::{ConnectOptions, Event, ServerAddr};

use super::QueueError;

/// Longest pause between two tries to connect again.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);
/// Largest file of a token, bytes.
const LARGEST_TOKEN: u64 = 64 << 10;

/// How to get in. Nothing of it is ever logged.
#[derive(Clone, Default)]
pub struct QueueAccess {
    /// Servers of one cluster, with commas between them: `nats://HOST:4222`, `tls://HOST:4222`, or
    /// `HOST:4222`.
    pub url: String,
    /// A file of credentials, as `nsc` writes them.
    pub credentials: Option<PathBuf>,
    /// A token.
    pub token: Option<String>,
    /// A file that has a token.
    pub token_file: Option<PathBuf>,
    /// Certificates of authorities, PEM, instead of the system's.
    pub authorities: Option<PathBuf>,
}

/// A connection to a NATS server, and the name of a stream there.
#[derive(Clone, Debug)]
pub struct Queue {
    pub(super) context: Context,
    pub(super) stream: String,
}

impl Queue {
    /// Connects. Must be called inside an executor.
    ///
    /// # Errors
    /// When the name of the stream is invalid, credentials cannot be read, or the server
    /// cannot be reached or refuses them.
    pub async fn connect(access: &QueueAccess, stream: &str) -> Result<Self, QueueError> {
        let is_good = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
        if !(1..=100).contains(&stream.len()) || !stream.chars().all(is_good) {
            return Err(QueueError::Name(stream.to_owned()));
        }
        crate::install_cryptography();
        let mut options = options(access).await?;
        let mut servers = Vec::new();
        for url in access.url.split(',') {
            let (server, secret) = server(url.trim()).ok_or(QueueError::Address)?;
            servers.push(server);
            options = match secret {
                Some(Secret::Token(token)) => options.token(token),
                Some(Secret::Password(user, password)) => options.user_and_password(user, password),
                None => options,
            };
        }
        let client = options.connect(servers).await?;
        Ok(Self { context: async_nats::jetstream::new(client), stream: stream.to_owned() })
    }

    /// Flushes pending messages and closes the connection.
    pub async fn close(self) {
        // One that is lost already has nothing to send.
        let _ = tokio::time::timeout(LONGEST_PAUSE, self.context.client().flush()).await;
        let _ = self.context.client().drain().await;
    }
}

/// The user information of an address.
#[cfg_attr(test, derive(Debug, PartialEq))]
enum Secret {
    Token(String),
    /// With the user's name before it.
    Password(String, String),
}

/// A server, and the secret of its address. The address goes without: the client writes it into its
/// log.
fn server(url: &str) -> Option<(ServerAddr, Option<Secret>)> {
    let mut url = url.parse::<ServerAddr>().ok()?.into_inner();
    let name = decoded(url.username());
    let secret = match url.password().map(decoded) {
        Some(password) => Some(Secret::Password(name, password)),
        None => (!name.is_empty()).then_some(Secret::Token(name)),
    };
    url.set_username("").and_then(|()| url.set_password(None)).ok()?;
    Some((ServerAddr::from_url(url).ok()?, secret))
}

/// A text of an address without its percent signs.
fn decoded(text: &str) -> String {
    percent_encoding::percent_decode_str(text).decode_utf8_lossy().into_owned()
}

async fn options(access: &QueueAccess) -> Result<ConnectOptions, QueueError> {
    let unreadable = |what| move |source| QueueError::Credentials { what, source };
    let is_lost = Arc::new(AtomicBool::new(false));
    let mut options = ConnectOptions::new()
        .name("relief batch")
        .reconnect_delay_callback(|tries| {
            let pause = 100 * u64::try_from(tries).unwrap_or(u64::MAX).min(50);
            Duration::from_millis(pause).min(LONGEST_PAUSE)
        })
        .event_callback(move |event| {
            match event {
                Event::Disconnected if !is_lost.swap(true, Ordering::Relaxed) => {
                    tracing::warn!(
                        "the connection to the queue is lost; work goes on, and it is tried again"
                    );
                }
                Event::Connected if is_lost.swap(false, Ordering::Relaxed) => {
                    tracing::warn!("the queue is connected again");
                }
                other => tracing::debug!("queue: {other}"),
            }
            std::future::ready(())
        });
    if let Some(file) = &access.authorities {
        std::fs::metadata(file).map_err(unreadable("the certificates"))?;
        options = options.add_root_certificates(file.clone());
    }
    if let Some(file) = &access.credentials {
        options = options.credentials_file(file).await.map_err(unreadable("the credentials"))?;
    }
    let token = match &access.token_file {
        Some(file) => Some(read_token(file).map_err(unreadable("the token"))?),
        None => access.token.clone(),
    };
    Ok(token.into_iter().fold(options, ConnectOptions::token))
}

fn read_token(file: &std::path::Path) -> std::io::Result<String> {
    if std::fs::metadata(file)?.len() > LARGEST_TOKEN {
        return Err(std::io::Error::other(format!("it is larger than {LARGEST_TOKEN} bytes")));
    }
    Ok(std::fs::read_to_string(file)?.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_go_without_their_secrets() {
        let password = Some(Secret::Password("anna".to_owned(), "p@ss%".to_owned()));
        let token = Some(Secret::Token("t0ken".to_owned()));
        for (url, expected, name) in [
            ("host", "nats://host", None),
            ("tls://host:4333", "tls://host:4333", None),
            ("nats://anna:p%40ss%25@host:1", "nats://host:1", password),
            ("nats://t0ken@host", "nats://host", token),
        ] {
            let (found, secret) = server(url).unwrap();
            assert_eq!((found.as_url_str(), secret), (expected, name), "{url}");
        }
        assert!(server("http://host").is_none() && server(":::").is_none());
        assert_eq!(decoded("%4%zz%+4%"), "%4%zz%+4%");
    }
}
