//! Options about DICOM archives: credentials, and the authorities to trust.

use std::path::PathBuf;

/// Credentials for archives (`dicomweb+https://...`).
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct ArchiveArguments {
    /// Log in to archives with the first line of this file, USER:PASSWORD
    #[arg(
        long,
        value_name = "FILE",
        env = "RELIEF_ARCHIVE_LOGIN_FILE",
        conflicts_with = "archive_token_file"
    )]
    archive_login_file: Option<PathBuf>,
    /// Show archives the token in the first line of this file
    #[arg(long, value_name = "FILE", env = "RELIEF_ARCHIVE_TOKEN_FILE")]
    archive_token_file: Option<PathBuf>,
    /// Trust archives with a certificate of these authorities, PEM, and no others
    #[arg(long, value_name = "FILE.pem", env = "RELIEF_ARCHIVE_CA")]
    archive_ca: Option<PathBuf>,
    /// Show archives this certificate; the file has its private key, too, PEM
    #[arg(long, value_name = "FILE.pem", env = "RELIEF_ARCHIVE_IDENTITY")]
    archive_identity: Option<PathBuf>,
}

#[cfg(feature = "archives")]
impl ArchiveArguments {
    /// The credentials for archives.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub(super) fn access(&self) -> anyhow::Result<relief_archive::ArchiveAccess> {
        use relief_archive::{ArchiveAccess, Credentials};
        let login = self.archive_login_file.as_deref().map(Credentials::login_of).transpose()?;
        let token = self.archive_token_file.as_deref().map(Credentials::token_of).transpose()?;
        Ok(ArchiveAccess {
            credentials: login.or(token),
            authorities: self.archive_ca.clone(),
            identity: self.archive_identity.clone(),
        })
    }
}
