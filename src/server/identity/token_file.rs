//! The file of tokens: one JSON object a line, with the SHA-256 of each token.
//!
//! ```text
//! {"name":"anna","scope":"annotate","sha256":"9f86…","expires":"2027-02-20T00:00:00.000Z"}
//! ```
//!
//! A token has 256 random bits, so its plain SHA-256 cannot be inverted by trying; passwords, which
//! would need a slow hash, are no tokens.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use data_encoding::BASE64URL_NOPAD;
use serde::{Deserialize, Serialize};

use super::scope::Scope;
use relief_annotation::{Item, Timestamp};
use relief_base::{read_at_most, sha256_of, write_whole};

/// Largest file.
const MOST_BYTES: u64 = 4 << 20;
/// The beginning of every token, by which scanners for leaked secrets find it.
const PREFIX: &str = "relief_";

/// A token as the file knows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenEntry {
    /// The holder's name: the author of their changes. Unique in the file.
    pub name: String,
    /// The holder's rights.
    pub scope: Scope,
    /// SHA-256 of the token, hexadecimal.
    pub sha256: String,
    /// When it ends; never if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires: Option<Timestamp>,
}

impl TokenEntry {
    /// Whether the token is still accepted.
    #[must_use]
    pub fn is_valid_at(&self, now: Timestamp) -> bool {
        self.expires.is_none_or(|expires| now < expires)
    }
}

/// A token to make.
#[derive(Clone, Debug)]
pub struct NewToken {
    /// The holder's name.
    pub name: String,
    /// The holder's rights.
    pub scope: Scope,
    /// When it ends.
    pub expires: Option<Timestamp>,
}

/// Why a file of tokens cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenFileError {
    /// The file system refuses.
    #[error("cannot use the token file {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The reason.
        #[source]
        source: std::io::Error,
    },
    /// Too large, or no plain file.
    #[error("{} is no token file: larger than {MOST_BYTES} bytes, or not a plain file", .0.display())]
    NoTokenFile(PathBuf),
    /// A line is no entry.
    #[error("line {line} of {} is no token entry; make entries with `relief token add`", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// The reason.
        #[source]
        source: serde_json::Error,
    },
    /// Two entries of one name.
    #[error("{name:?} has a token already; remove it first with `relief token remove`")]
    Taken {
        /// The name.
        name: String,
    },
    /// No entry of this name.
    #[error("{name:?} has no token in {}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// The name cannot be an author's.
    #[error("the name {name:?} is invalid; allowed: 1 to {} characters in one line", Item::LONGEST_NAME)]
    Name {
        /// The name.
        name: String,
    },
    /// The system has no random numbers.
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
}

/// Reads all entries.
///
/// # Errors
/// When the file is absent, too large or damaged, or has two entries of one name.
pub fn read_tokens(path: &Path) -> Result<Vec<TokenEntry>, TokenFileError> {
    let bytes = read_at_most(path, MOST_BYTES)
        .map_err(|source| TokenFileError::File { path: path.to_owned(), source })?
        .ok_or_else(|| TokenFileError::NoTokenFile(path.to_owned()))?;
    let mut entries: Vec<TokenEntry> = Vec::new();
    for (index, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        let entry: TokenEntry = serde_json::from_slice(line).map_err(|source| TokenFileError::Line {
            path: path.to_owned(),
            line: index + 1,
            source,
        })?;
        if entries.iter().any(|known| known.name == entry.name) {
            return Err(TokenFileError::Taken { name: entry.name });
        }
        entries.push(entry);
    }
    Ok(entries)
}

/// Makes a token, adds its hash to the file and returns it. A missing file is created, readable by
/// its owner alone.
///
/// # Errors
/// When the name is invalid or taken, or the file cannot be read or written.
pub fn add_token(path: &Path, new: NewToken) -> Result<String, TokenFileError> {
    let characters = new.name.chars().count();
    if !(1..=Item::LONGEST_NAME).contains(&characters) || new.name.contains(char::is_control) {
        return Err(TokenFileError::Name { name: new.name });
    }
    let mut entries = match read_tokens(path) {
        Err(TokenFileError::File { source, .. }) if source.kind() == ErrorKind::NotFound => Vec::new(),
        entries => entries?,
    };
    if entries.iter().any(|known| known.name == new.name) {
        return Err(TokenFileError::Taken { name: new.name });
    }
    let mut bits = [0u8; 32];
    getrandom::fill(&mut bits).map_err(TokenFileError::Random)?;
    let token = format!("{PREFIX}{}", BASE64URL_NOPAD.encode(&bits));
    let sha256 = sha256_of(token.as_bytes());
    entries.push(TokenEntry { name: new.name, scope: new.scope, sha256, expires: new.expires });
    write(path, &entries)?;
    Ok(token)
}

/// Removes the token of this name. Servers that use the file refuse it within a second.
///
/// # Errors
/// When there is no such token, or the file cannot be read or written.
pub fn remove_token(path: &Path, name: &str) -> Result<(), TokenFileError> {
    let mut entries = read_tokens(path)?;
    let before = entries.len();
    entries.retain(|entry| entry.name != name);
    if entries.len() == before {
        return Err(TokenFileError::Unknown { path: path.to_owned(), name: name.to_owned() });
    }
    write(path, &entries)
}

fn write(path: &Path, entries: &[TokenEntry]) -> Result<(), TokenFileError> {
    let lines = entries.iter().map(|entry| serde_json::json!(entry).to_string() + "\n");
    let bytes = lines.collect::<String>();
    let written = write_whole(path, bytes.as_bytes()).and_then(|()| private(path));
    written.map_err(|source| TokenFileError::File { path: path.to_owned(), source })
}

/// The hashes reveal no token, but the names should not be readable by other users of the machine.
#[cfg(unix)]
fn private(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))
}

#[cfg(not(unix))]
fn private(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(name: &str) -> NewToken {
        NewToken { name: name.to_owned(), scope: Scope::Annotate, expires: Timestamp::from_millis(5000) }
    }

    #[test]
    fn a_token_is_kept_as_its_hash_and_removed_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        let token = add_token(&path, new("Renée")).unwrap();
        let other = add_token(&path, new("anna")).unwrap();
        assert!(token.starts_with(PREFIX) && token.len() == PREFIX.len() + 43 && token != other);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(!text.contains(&token[PREFIX.len()..]), "the token itself is not in the file");
        let entries = read_tokens(&path).unwrap();
        assert_eq!(entries[0].sha256, sha256_of(token.as_bytes()));
        assert!(entries[0].is_valid_at(Timestamp::from_millis(4999).unwrap()));
        assert!(!entries[0].is_valid_at(Timestamp::from_millis(5000).unwrap()));
        assert!(matches!(add_token(&path, new("anna")), Err(TokenFileError::Taken { .. })));
        remove_token(&path, "anna").unwrap();
        assert!(matches!(remove_token(&path, "anna"), Err(TokenFileError::Unknown { .. })));
        assert_eq!(read_tokens(&path).unwrap().len(), 1);
        assert!(matches!(add_token(&path, new("a\nb")), Err(TokenFileError::Name { .. })));
    }

    #[test]
    fn a_damaged_line_is_named_by_its_number() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        std::fs::write(&path, "\n{\"name\":1}\n").unwrap();
        assert!(matches!(read_tokens(&path), Err(TokenFileError::Line { line: 2, .. })));
        assert!(matches!(read_tokens(folder.path()), Err(TokenFileError::NoTokenFile(_))));
    }
}
