//! The options of `relief serve` about who may call: tokens, certificates, a trusted proxy, TLS and
//! the audit log.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context, bail};
use relief_server::HeaderName;

use crate::token::ScopeArgument;
use relief_server::{Admission, AuditLog, Tls, TlsFiles, Tokens, TrustedProxy, fingerprint, self_signed};

/// Options of identities and of encryption.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Identity and encryption")]
pub(crate) struct IdentityArguments {
    /// Callers need a token of this file, made by `relief token add`; it is read again when it
    /// changes
    #[arg(long, value_name = "FILE", env = "RELIEF_TOKEN_FILE")]
    token_file: Option<PathBuf>,
    /// Callers may be named by a proxy at this address, which has verified them; may be given several
    /// times
    #[arg(long, value_name = "IP")]
    trusted_proxy: Vec<IpAddr>,
    /// The header in which the proxy names a caller, percent-encoded; it must remove the header from
    /// what clients send
    #[arg(long, value_name = "HEADER", default_value = "X-Forwarded-User", requires = "trusted_proxy")]
    proxy_user_header: String,
    /// The rights of callers of the proxy
    #[arg(long, value_enum, default_value_t = ScopeArgument::Annotate, requires = "trusted_proxy")]
    proxy_scope: ScopeArgument,
    /// Encrypt with this certificate (PEM, with intermediates); it is read again when it changes
    #[arg(long, value_name = "FILE.pem", requires = "tls_key")]
    tls_certificate: Option<PathBuf>,
    /// The private key of the certificate, PEM
    #[arg(long, value_name = "FILE.pem", requires = "tls_certificate")]
    tls_key: Option<PathBuf>,
    /// Encrypt with a self-signed certificate in this folder, made when it is absent; clients trust it
    /// by --ca FOLDER/relief-certificate.pem
    #[arg(long, value_name = "FOLDER", conflicts_with = "tls_certificate")]
    tls_self_signed: Option<PathBuf>,
    /// Callers may prove who they are by a certificate of these authorities, PEM; their name is its
    /// common name. Without --token-file and --trusted-proxy every client needs one
    #[arg(long, value_name = "FILE.pem")]
    tls_client_ca: Option<PathBuf>,
    /// The rights of callers with a certificate
    #[arg(long, value_enum, default_value_t = ScopeArgument::Annotate, requires = "tls_client_ca")]
    tls_client_scope: ScopeArgument,
    /// Let everybody who reaches the address do everything, beyond this machine, too
    #[arg(long, conflicts_with_all = ["token_file", "trusted_proxy", "tls_client_ca"])]
    insecure: bool,
    /// Record every request: who, when, what, and its outcome; `relief audit` checks that nothing was
    /// changed or removed
    #[arg(long, value_name = "FILE")]
    audit_log: Option<PathBuf>,
    /// Answer /healthz, /readyz and /metrics here, too: without identity, and when all connections
    /// are taken
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub(crate) probe_listen: Option<SocketAddr>,
}

impl IdentityArguments {
    /// How callers are recognised.
    ///
    /// # Errors
    /// When a file cannot be used, or when other machines can reach the address and no means to
    /// recognise callers is given.
    pub(crate) fn admission(&self, listen: SocketAddr) -> anyhow::Result<Admission> {
        let tokens = self.token_file.clone().map(Tokens::open).transpose()?;
        if tokens.as_ref().is_some_and(|tokens| tokens.count() == 0) {
            eprintln!("warning: the token file has no token yet; `relief token add` makes one");
        }
        let proxy = match self.trusted_proxy.as_slice() {
            [] => None,
            addresses => Some(TrustedProxy {
                header: HeaderName::from_str(&self.proxy_user_header)
                    .with_context(|| format!("--proxy-user-header {:?}", self.proxy_user_header))?,
                addresses: addresses.to_vec(),
                scope: self.proxy_scope.into(),
            }),
        };
        let certificates = self.tls_client_ca.as_ref().map(|_| self.tls_client_scope.into());
        let admission = Admission { tokens: tokens.map(Arc::new), certificates, proxy };
        if admission.is_open() && !listen.ip().is_loopback() && !self.insecure {
            bail!(
                "{listen} can be reached from other machines, and callers would not have to say who they are; \
                 give --token-file FILE (make tokens with `relief token add`), --tls-client-ca, --trusted-proxy, \
                 or --insecure if everybody who reaches it may do everything"
            );
        }
        Ok(admission)
    }

    /// The encryption of connections; `names` are those of the server.
    ///
    /// # Errors
    /// When a file cannot be used.
    pub(crate) fn tls(&self, names: &[String]) -> anyhow::Result<Option<Arc<Tls>>> {
        let files = match (&self.tls_certificate, &self.tls_key, &self.tls_self_signed) {
            (Some(certificate), Some(key), _) => TlsFiles {
                certificate: certificate.clone(),
                key: key.clone(),
                client_authority: None,
                requires_certificate: false,
            },
            (_, _, Some(folder)) => {
                let names = names.iter().map(|name| name.trim_matches(['[', ']']).to_owned());
                let files = self_signed(folder, names.collect())?;
                eprintln!("the certificate is {}", files.certificate.display());
                eprintln!("its SHA-256 is {}", fingerprint(&files.certificate)?);
                files
            }
            _ if self.tls_client_ca.is_some() => {
                bail!("--tls-client-ca needs --tls-certificate and --tls-key, or --tls-self-signed")
            }
            _ => return Ok(None),
        };
        let client_authority = self.tls_client_ca.clone();
        let requires_certificate = self.token_file.is_none() && self.trusted_proxy.is_empty();
        Ok(Some(Arc::new(Tls::open(TlsFiles { client_authority, requires_certificate, ..files })?)))
    }

    /// The audit log, if there is one.
    ///
    /// # Errors
    /// When it cannot be used.
    pub(crate) fn audit(&self) -> anyhow::Result<Option<AuditLog>> {
        Ok(self.audit_log.as_deref().map(AuditLog::open).transpose()?)
    }

    /// Addresses that may open any number of connections.
    pub(crate) fn unlimited(&self) -> Vec<IpAddr> {
        self.trusted_proxy.clone()
    }

    /// Says what other machines could read or do.
    pub(crate) fn warn(&self, address: SocketAddr, is_encrypted: bool) {
        if address.ip().is_loopback() {
            return;
        }
        if self.insecure {
            eprintln!(
                "warning: {address} can be reached from other machines, and everybody may do everything"
            );
        }
        if !is_encrypted && self.trusted_proxy.is_empty() {
            eprintln!(
                "warning: connections are not encrypted; give --tls-certificate or --tls-self-signed, or run behind a proxy that encrypts"
            );
        }
    }
}
