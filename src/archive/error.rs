//! Errors between a client and an archive.

use std::path::PathBuf;
use std::time::Duration;

/// A failed request to an archive. No message has a UID, a query or an answer of the archive.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// A file of a secret or of certificates cannot be read.
    #[error("cannot read {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        #[source]
        source: std::io::Error,
    },
    /// A file has other content than expected.
    #[error("{} must have {expected}", path.display())]
    Secret {
        /// The file.
        path: PathBuf,
        /// The content that it must have.
        expected: &'static str,
    },
    /// A file has certificates that cannot be used.
    #[error("the certificates in {} cannot be used", path.display())]
    Certificate {
        /// The file.
        path: PathBuf,
        /// The reason.
        #[source]
        source: reqwest::Error,
    },
    /// Token or password have letters that a header cannot have.
    #[error("the archive's token or password has letters that HTTP cannot send")]
    Credentials,
    /// The client cannot be made.
    #[error("cannot prepare connections to the archive")]
    Client(#[source] reqwest::Error),
    /// The archive cannot be reached, or the connection broke.
    #[error("the archive {archive} does not answer; is its address right, and does it run?")]
    Unreachable {
        /// The root of its services.
        archive: String,
        /// The reason, without the address.
        #[source]
        source: reqwest::Error,
    },
    /// The archive wants another identity.
    #[error(
        "the archive {archive} refuses access (status {status}); give --archive-login-file, --archive-token-file or --archive-identity"
    )]
    Refused {
        /// The root of its services.
        archive: String,
        /// HTTP status.
        status: u16,
    },
    /// Nothing matches.
    #[error("the archive {archive} has no such {wanted}")]
    Missing {
        /// The root of its services.
        archive: String,
        /// The missing resource.
        wanted: &'static str,
    },
    /// The archive answers with a failure.
    #[error("the archive {archive} answers with status {status}{}", hint(*status))]
    Status {
        /// The root of its services.
        archive: String,
        /// HTTP status.
        status: u16,
    },
    /// An answer is not what DICOMweb prescribes.
    #[error(
        "the archive {archive} sends {found} where {expected} is expected; is this the root of its DICOMweb services?"
    )]
    Answer {
        /// The root of its services.
        archive: String,
        /// The content of the answer.
        found: &'static str,
        /// The content that DICOMweb prescribes.
        expected: &'static str,
    },
    /// The archive has more matches than it lists.
    #[error(
        "the archive {archive} lists only {found} of {expected}; let it answer searches completely, or obey `offset`"
    )]
    Incomplete {
        /// The root of its services.
        archive: String,
        /// Matches in its answers.
        found: usize,
        /// The archive's own number of matches, where it has one.
        expected: Total,
    },
    /// An answer is larger than allowed.
    #[error("the archive {archive} sends more than {allowed} {unit}")]
    TooLarge {
        /// The root of its services.
        archive: String,
        /// The limit.
        allowed: u64,
        /// The unit of the limit.
        unit: &'static str,
    },
    /// An answer takes longer than allowed.
    #[error("the archive {archive} takes longer than {} s to answer", .longest.as_secs())]
    TooSlow {
        /// The root of its services.
        archive: String,
        /// The limit.
        longest: Duration,
    },
    /// The archive sends an object of another study, series or patient.
    #[error(
        "the archive {archive} sends an object of another {what} than the one that was requested; nothing of it is kept"
    )]
    Other {
        /// The root of its services.
        archive: String,
        /// Study, series, patient or instance.
        what: &'static str,
    },
    /// The objects cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}

/// The number of matches in an archive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Total {
    /// Instances of a series, as the archive counts them.
    Instances(u64),
    /// Unknown: the archive only announces that there are more.
    More,
}

impl std::fmt::Display for Total {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Instances(count) => write!(f, "{count} instances"),
            Self::More => f.write_str("its matches, and announces more"),
        }
    }
}

/// Advice about a status, or nothing.
fn hint(status: u16) -> &'static str {
    match status {
        300..400 => ", a redirect; redirects are not followed: give the address that it leads to",
        _ => "",
    }
}

impl ArchiveError {
    /// Whether the same request may succeed a moment later.
    pub(crate) fn is_passing(&self) -> bool {
        match self {
            Self::Unreachable { .. } => true,
            Self::Status { status, .. } => matches!(status, 408 | 425 | 429 | 500 | 502 | 503 | 504),
            _ => false,
        }
    }
}

/// The kind tells whether another try may help: not for `NotFound` and `InvalidInput`.
impl From<ArchiveError> for std::io::Error {
    fn from(error: ArchiveError) -> Self {
        use std::io::ErrorKind;
        let kind = match error {
            ArchiveError::Write(error) => return error,
            ArchiveError::Missing { .. } => ErrorKind::NotFound,
            ArchiveError::Refused { .. } => ErrorKind::PermissionDenied,
            ArchiveError::TooLarge { .. } | ArchiveError::Secret { .. } => ErrorKind::InvalidInput,
            _ => ErrorKind::Other,
        };
        Self::new(kind, error)
    }
}
