//! TLS of the server: certificate, key and the authority of client certificates, read again when
//! their files change; a self-signed certificate on request.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use parking_lot::Mutex;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::{RootCertStore, ServerConfig};
use tokio_rustls::TlsAcceptor;

/// The shortest time between two checks of the files.
const INTERVAL: Duration = Duration::from_secs(2);

/// The files of a TLS server, PEM.
#[derive(Clone, Debug)]
pub struct TlsFiles {
    /// The certificate and its intermediates.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// The authorities whose client certificates are accepted.
    pub client_authority: Option<PathBuf>,
    /// Whether every client must have a certificate.
    pub requires_certificate: bool,
}

/// Why TLS cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file is missing, or is not PEM.
    #[error("cannot read PEM from {}", path.display())]
    Pem {
        /// The file.
        path: PathBuf,
        /// The reason.
        #[source]
        source: rustls::pki_types::pem::Error,
    },
    /// A file has no certificate.
    #[error("there is no certificate in {}", .0.display())]
    Empty(PathBuf),
    /// Certificate and key do not belong together, or are of an unsupported kind.
    #[error("certificate and key cannot be used")]
    Unusable(#[source] rustls::Error),
    /// The authorities of client certificates cannot be used.
    #[error("the authorities of client certificates cannot be used")]
    Authority(#[source] rustls::server::VerifierBuilderError),
    /// A self-signed certificate cannot be made.
    #[error("a self-signed certificate cannot be made")]
    SelfSigned(#[source] rcgen::Error),
    /// A self-signed certificate cannot be written.
    #[error("cannot write the self-signed certificate to {}", path.display())]
    Write {
        /// The folder.
        path: PathBuf,
        /// The reason.
        #[source]
        source: std::io::Error,
    },
}

/// TLS with the newest files.
#[derive(Debug)]
pub struct Tls {
    files: TlsFiles,
    known: Mutex<Known>,
}

#[derive(Debug)]
struct Known {
    config: Arc<ServerConfig>,
    versions: Vec<Option<SystemTime>>,
    looked: Instant,
}

impl Tls {
    /// Reads the files.
    ///
    /// # Errors
    /// When one is missing, damaged, or does not belong to the others.
    pub fn open(files: TlsFiles) -> Result<Self, TlsError> {
        let versions = versions(&files);
        let config = Arc::new(read(&files)?);
        Ok(Self { files, known: Mutex::new(Known { config, versions, looked: Instant::now() }) })
    }

    /// Accepts connections by the newest files. Files that became unusable leave the last ones in
    /// use.
    pub(super) fn acceptor(&self) -> TlsAcceptor {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        let mut known = self.known.lock();
        if known.looked.elapsed() >= INTERVAL {
            known.looked = Instant::now();
            let now = versions(&self.files);
            if now != known.versions {
                known.versions = now;
                match read(&self.files) {
                    Ok(config) => {
                        known.config = Arc::new(config);
                        tracing::info!("the certificate was read again");
                    }
                    Err(error) => {
                        tracing::error!(%error, "the certificate has changed and cannot be used; the earlier one stays");
                    }
                }
            }
        }
        TlsAcceptor::from(Arc::clone(&known.config))
    }
}

fn versions(files: &TlsFiles) -> Vec<Option<SystemTime>> {
    let paths = [Some(&files.certificate), Some(&files.key), files.client_authority.as_ref()];
    let version = |path: &PathBuf| std::fs::metadata(path).ok()?.modified().ok();
    paths.into_iter().flatten().map(version).collect()
}

fn read(files: &TlsFiles) -> Result<ServerConfig, TlsError> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ServerConfig::builder_with_provider(Arc::clone(&provider))
        .with_safe_default_protocol_versions()
        .map_err(TlsError::Unusable)?;
    let builder = match &files.client_authority {
        None => builder.with_no_client_auth(),
        Some(path) => {
            let mut roots = RootCertStore::empty();
            for certificate in certificates(path)? {
                roots.add(certificate).map_err(TlsError::Unusable)?;
            }
            let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider);
            let verifier =
                if files.requires_certificate { verifier } else { verifier.allow_unauthenticated() };
            builder.with_client_cert_verifier(verifier.build().map_err(TlsError::Authority)?)
        }
    };
    let key = PrivateKeyDer::from_pem_file(&files.key)
        .map_err(|source| TlsError::Pem { path: files.key.clone(), source })?;
    let mut config =
        builder.with_single_cert(certificates(&files.certificate)?, key).map_err(TlsError::Unusable)?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(config)
}

/// The certificates of a PEM file, at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let failure = |source| TlsError::Pem { path: path.to_owned(), source };
    let found = CertificateDer::pem_file_iter(path).map_err(failure)?;
    let found: Vec<_> = found.collect::<Result<_, _>>().map_err(failure)?;
    if found.is_empty() {
        return Err(TlsError::Empty(path.to_owned()));
    }
    Ok(found)
}

/// The common name of a verified certificate; `None` when it has none.
pub(super) fn common_name(certificate: &CertificateDer<'_>) -> Option<String> {
    let (_, parsed) = x509_parser::parse_x509_certificate(certificate).ok()?;
    let name = parsed.subject().iter_common_name().next()?.as_str().ok()?.to_owned();
    crate::annotations::check_author(&name).ok().map(|()| name)
}

/// Files of a self-signed certificate for these names in a folder; made when they are absent.
/// Clients trust it by `--ca`.
///
/// # Errors
/// When the certificate cannot be made or written.
pub fn self_signed(folder: &Path, names: Vec<String>) -> Result<TlsFiles, TlsError> {
    let [certificate, key] = ["relief-certificate.pem", "relief-key.pem"].map(|name| folder.join(name));
    if !certificate.exists() || !key.exists() {
        let made = rcgen::generate_simple_self_signed(names).map_err(TlsError::SelfSigned)?;
        let failure = |source| TlsError::Write { path: folder.to_owned(), source };
        std::fs::create_dir_all(folder).map_err(failure)?;
        private_file(&key, &made.signing_key.serialize_pem()).map_err(failure)?;
        relief_base::write_whole(&certificate, made.cert.pem().as_bytes()).map_err(failure)?;
    }
    Ok(TlsFiles { certificate, key, client_authority: None, requires_certificate: false })
}

/// The SHA-256 of the first certificate of a file, as browsers show it.
///
/// # Errors
/// When the file has no certificate.
pub fn fingerprint(path: &Path) -> Result<String, TlsError> {
    let digest = relief_base::sha256_of(&certificates(path)?[0]).to_ascii_uppercase();
    let pairs: Vec<&str> = (0..digest.len()).step_by(2).map(|at| &digest[at..at + 2]).collect();
    Ok(pairs.join(":"))
}

/// A private key is its owner's from its first byte: the temporary file is private, and stays so.
fn private_file(path: &Path, text: &str) -> std::io::Result<()> {
    use std::io::Write;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new().prefix(".relief-").tempfile_in(folder)?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_self_signed_certificate_is_made_once_and_can_be_used() {
        let folder = tempfile::tempdir().unwrap();
        let files = self_signed(folder.path(), vec!["localhost".to_owned()]).unwrap();
        let first = fingerprint(&files.certificate).unwrap();
        assert_eq!(first.len(), 95);
        let again = self_signed(folder.path(), vec!["localhost".to_owned()]).unwrap();
        assert_eq!(fingerprint(&again.certificate).unwrap(), first);
        Tls::open(files.clone()).unwrap();
        let swapped = TlsFiles { certificate: files.key.clone(), key: files.certificate, ..files };
        assert!(matches!(Tls::open(swapped), Err(TlsError::Pem { .. } | TlsError::Empty(_))));
    }
}
