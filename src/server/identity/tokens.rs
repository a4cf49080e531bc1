//! The tokens that a server accepts: its file, read again when it changes.

use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime};

use parking_lot::Mutex;

use super::token_file::{TokenEntry, TokenFileError, read_tokens};
use relief_annotation::Timestamp;
use relief_base::sha256_of;

/// The shortest time between two checks of the file.
const INTERVAL: Duration = Duration::from_secs(1);

/// The tokens of a file. While the file cannot be read, no token is valid, because any of them may have
/// been removed.
#[derive(Debug)]
pub struct Tokens {
    path: PathBuf,
    known: Mutex<Known>,
}

#[derive(Debug)]
struct Known {
    entries: Vec<TokenEntry>,
    version: Option<Version>,
    looked: Instant,
}

/// The properties of a file that change with its content: its time and its length.
type Version = (SystemTime, u64);

impl Tokens {
    /// Reads the file.
    ///
    /// # Errors
    /// When it is absent, damaged or too large.
    pub fn open(path: PathBuf) -> Result<Self, TokenFileError> {
        let version = version(&path);
        let entries = read_tokens(&path)?;
        Ok(Self { path, known: Mutex::new(Known { entries, version, looked: Instant::now() }) })
    }

    /// Number of tokens, expired ones among them.
    #[must_use]
    pub fn count(&self) -> usize {
        self.with_newest(<[_]>::len)
    }

    /// The entry of a token that is valid now.
    pub(super) fn find(&self, token: &str) -> Option<TokenEntry> {
        // Comparing hashes tells a client nothing about a token: it cannot choose them.
        self.find_by_hash(&sha256_of(token.as_bytes()))
    }

    /// The entry of this hash, if it is still in the file and valid.
    pub(super) fn find_by_hash(&self, sha256: &str) -> Option<TokenEntry> {
        let now = Timestamp::now();
        let found = |entries: &[TokenEntry]| {
            entries.iter().find(|entry| entry.sha256 == sha256 && entry.is_valid_at(now)).cloned()
        };
        self.with_newest(found)
    }

    fn with_newest<T>(&self, read: impl FnOnce(&[TokenEntry]) -> T) -> T {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        let mut known = self.known.lock();
        if known.looked.elapsed() >= INTERVAL {
            known.looked = Instant::now();
            let now = version(&self.path);
            if now != known.version || known.version.is_none() {
                match read_tokens(&self.path) {
                    Ok(entries) => {
                        if known.version.is_none() {
                            tracing::warn!("the token file can be read again");
                        }
                        (known.entries, known.version) = (entries, now);
                    }
                    Err(error) => {
                        if known.version.is_some() {
                            tracing::error!(
                                error = &error as &dyn std::error::Error,
                                "the token file cannot be read; no token is accepted until it can"
                            );
                        }
                        (known.entries, known.version) = (Vec::new(), None);
                    }
                }
            }
        }
        read(&known.entries)
    }
}

fn version(path: &std::path::Path) -> Option<Version> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}
