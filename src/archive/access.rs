//! The credentials for an archive, and the certificates that are accepted from it.

use std::fmt;
use std::path::{Path, PathBuf};

use relief_base::read_at_most;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Certificate, Client, ClientBuilder, Identity};

use crate::error::ArchiveError;

/// Largest file of a secret or of certificates, bytes.
const LARGEST_FILE: u64 = 1 << 20;

/// How a client is known to an archive.
#[derive(Clone, PartialEq, Eq)]
pub enum Credentials {
    /// A user and a password (RFC 7617).
    Basic {
        /// The user's name, without a colon.
        user: String,
        /// The password.
        password: String,
    },
    /// A token (RFC 6750).
    Bearer(String),
}

/// The credentials for an archive, and the certificates that are accepted from it.
#[derive(Clone, Debug, Default)]
pub struct ArchiveAccess {
    /// How the client is known; the archive takes everybody where none are given.
    pub credentials: Option<Credentials>,
    /// Trust archives with a certificate of these authorities (PEM), and no others; those of the
    /// system where none is named.
    pub authorities: Option<PathBuf>,
    /// A certificate of the client with its private key, PEM.
    pub identity: Option<PathBuf>,
}

impl Credentials {
    /// Reads `USER:PASSWORD` from the first line of a file.
    ///
    /// # Errors
    /// When it cannot be read, or has no colon.
    pub fn login_of(path: &Path) -> Result<Self, ArchiveError> {
        let line = first_line(path)?;
        let (user, password) = line
            .split_once(':')
            .ok_or_else(|| ArchiveError::Secret { path: path.to_owned(), expected: "USER:PASSWORD" })?;
        Ok(Self::Basic { user: user.to_owned(), password: password.to_owned() })
    }

    /// Reads a bearer token from the first line of a file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn token_of(path: &Path) -> Result<Self, ArchiveError> {
        first_line(path).map(Self::Bearer)
    }
}

fn first_line(path: &Path) -> Result<String, ArchiveError> {
    let text = String::from_utf8(read(path)?).ok();
    let line = text.as_deref().and_then(|text| text.lines().next()).unwrap_or_default();
    match line.is_empty() || !line.chars().all(|letter| letter.is_ascii_graphic() || letter == ' ') {
        true => Err(ArchiveError::Secret { path: path.to_owned(), expected: "one line of ASCII" }),
        false => Ok(line.to_owned()),
    }
}

fn read(path: &Path) -> Result<Vec<u8>, ArchiveError> {
    let failure = |source| ArchiveError::File { path: path.to_owned(), source };
    let bytes = read_at_most(path, LARGEST_FILE).map_err(failure)?;
    bytes.ok_or_else(|| failure(std::io::Error::other("it is larger than 1 MiB")))
}

impl ArchiveAccess {
    /// A client with this access, whose other settings `builder` has.
    pub(crate) fn client(&self, builder: ClientBuilder) -> Result<Client, ArchiveError> {
        // Another provider that is already installed serves as well.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = builder.default_headers(self.headers()?);
        if let Some(path) = &self.authorities {
            let unusable = |source| ArchiveError::Certificate { path: path.clone(), source };
            let certificates = Certificate::from_pem_bundle(&read(path)?).map_err(unusable)?;
            if certificates.is_empty() {
                return Err(ArchiveError::Secret { path: path.clone(), expected: "certificates, PEM" });
            }
            builder = builder.tls_certs_only(certificates);
        }
        if let Some(path) = &self.identity {
            let unusable = |source| ArchiveError::Certificate { path: path.clone(), source };
            builder = builder.identity(Identity::from_pem(&read(path)?).map_err(unusable)?);
        }
        builder.build().map_err(ArchiveError::Client)
    }

    fn headers(&self) -> Result<HeaderMap, ArchiveError> {
        let mut headers = HeaderMap::new();
        let value = match &self.credentials {
            None => return Ok(headers),
            Some(Credentials::Bearer(token)) => format!("Bearer {token}"),
            Some(Credentials::Basic { user, password }) => {
                let login = data_encoding::BASE64.encode(format!("{user}:{password}").as_bytes());
                format!("Basic {login}")
            }
        };
        let mut value = HeaderValue::try_from(value).map_err(|_| ArchiveError::Credentials)?;
        value.set_sensitive(true);
        headers.insert(AUTHORIZATION, value);
        Ok(headers)
    }
}

/// Secrets are not shown.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Basic { .. } => "Basic(...)",
            Self::Bearer(_) => "Bearer(...)",
        })
    }
}
