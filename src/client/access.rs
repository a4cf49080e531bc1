//! A client's credentials and trust: a token, and the authorities that it accepts.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

use super::address::ServerAddress;

/// A client's credentials, and the authorities that it accepts.
#[derive(Clone, Default)]
pub struct Access {
    token: Option<String>,
    tls: Option<Arc<ClientConfig>>,
}

/// Why a server cannot be accessed as wanted.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// The file of authorities cannot be read.
    #[error("cannot read certificates from {}", path.display())]
    Authority {
        /// The file.
        path: PathBuf,
        /// The reason.
        #[source]
        source: rustls::pki_types::pem::Error,
    },
    /// The file has no certificate, or the system knows no authority.
    #[error("there is no certificate in {0}; name one by --ca")]
    Empty(String),
    /// A certificate is damaged or of an unsupported kind.
    #[error("the certificate cannot be used")]
    Unusable(#[source] rustls::Error),
    /// An authority was named for an address that is not encrypted.
    #[error("{0} is not encrypted: --ca is for https:// and wss://")]
    NotEncrypted(ServerAddress),
}

impl Access {
    /// Access to a server with this token. An encrypted server is trusted by the authorities of the
    /// file (PEM), or else by those of the system.
    ///
    /// # Errors
    /// When the authorities cannot be used.
    pub fn new(
        server: &ServerAddress,
        token: Option<String>,
        authority: Option<&Path>,
    ) -> Result<Self, AccessError> {
        if !server.is_encrypted() {
            return match authority {
                Some(_) => Err(AccessError::NotEncrypted(server.clone())),
                None => Ok(Self { token, tls: None }),
            };
        }
        let mut roots = RootCertStore::empty();
        match authority {
            Some(path) => {
                let failure = |source| AccessError::Authority { path: path.to_owned(), source };
                for certificate in CertificateDer::pem_file_iter(path).map_err(failure)? {
                    roots.add(certificate.map_err(failure)?).map_err(AccessError::Unusable)?;
                }
            }
            None => drop(roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs)),
        }
        if roots.is_empty() {
            let found = authority.map_or("the system".to_owned(), |path| path.display().to_string());
            return Err(AccessError::Empty(found));
        }
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(AccessError::Unusable)?
            .with_root_certificates(roots)
            .with_no_client_auth();
        Ok(Self { token, tls: Some(Arc::new(config)) })
    }

    /// The value of the header `Authorization`.
    pub(super) fn authorization(&self) -> Option<String> {
        self.token.as_ref().map(|token| format!("Bearer {token}"))
    }

    /// The stream of a connection, encrypted if the server is.
    ///
    /// # Errors
    /// When the server's certificate is not trusted, or does not have its name.
    pub(super) async fn secured(&self, server: &ServerAddress, stream: TcpStream) -> std::io::Result<Stream> {
        if !server.is_encrypted() {
            return Ok(Box::new(stream));
        }
        let missing = || std::io::Error::other("no trusted authorities were given");
        let config = Arc::clone(self.tls.as_ref().ok_or_else(missing)?);
        let name = ServerName::try_from(server.target().0.to_owned()).map_err(std::io::Error::other)?;
        Ok(Box::new(TlsConnector::from(config).connect(name, stream).await?))
    }
}

/// The token is a secret.
impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let token = self.token.as_ref().map(|_| "...");
        f.debug_struct("Access").field("token", &token).field("is_encrypted", &self.tls.is_some()).finish()
    }
}

/// A connection, encrypted or not.
pub(super) type Stream = Box<dyn Both>;

/// Both directions of a connection.
pub(super) trait Both: AsyncRead + AsyncWrite + Send + Unpin {}

impl<S: AsyncRead + AsyncWrite + Send + Unpin> Both for S {}
