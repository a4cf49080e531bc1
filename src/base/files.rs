//! Files: written whole or not at all, read within a limit, identified by their SHA-256.

use std::io::{Read, Write};
use std::path::Path;

use data_encoding::HEXLOWER;
use sha2::{Digest, Sha256};

/// Writes a file so that it appears whole or not at all: a temporary beside it, synced, then
/// renamed.
///
/// # Errors
/// When the file system refuses; there is no new file then, and an earlier one stays.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = shared_temporary().prefix(".relief-").tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Writes a new file, so that it appears whole or not at all. Of several writers at once, one succeeds.
///
/// # Errors
/// When the file exists (`AlreadyExists`), which stays as it is; and when the file system refuses.
pub fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = shared_temporary().prefix(".relief-").tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist_noclobber(path)?;
    Ok(())
}

/// Temporary files are private to their owner. One that becomes a result is no more private than
/// the umask says.
#[must_use]
pub fn shared_temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

/// Reads a file that is expected to be small; `None` where it is larger, or no plain file.
///
/// # Errors
/// When the file system refuses.
pub fn read_at_most(path: &Path, largest: u64) -> std::io::Result<Option<Vec<u8>>> {
    if !std::fs::metadata(path)?.is_file() {
        return Ok(None); // a device or a pipe may have no end
    }
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(largest.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= largest).then_some(bytes))
}

/// SHA-256 of bytes, as 64 lower-case hexadecimal digits.
#[must_use]
pub fn sha256_of(bytes: &[u8]) -> String {
    HEXLOWER.encode(&Sha256::digest(bytes))
}

/// SHA-256 of a file's content, as 64 lower-case hexadecimal digits.
///
/// # Errors
/// When the file cannot be read.
pub fn sha256_of_file(path: &Path) -> std::io::Result<String> {
    let mut file = std::fs::File::open(path)?;
    let (mut hasher, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match file.read(&mut part)? {
            0 => return Ok(HEXLOWER.encode(&hasher.finalize())),
            read => hasher.update(&part[..read]),
        }
    }
}
/// What tells one file from another, whatever its path: device and number of the file. Where the system has no
/// such numbers, all files are equal: one that was removed is noticed, one that was replaced is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileId([u64; 2]);

impl FileId {
    /// Of the file with these properties.
    #[must_use]
    pub fn of(metadata: &std::fs::Metadata) -> Self {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            Self([metadata.dev(), metadata.ino()])
        }
        #[cfg(not(unix))]
        {
            let _ = metadata;
            Self([0; 2])
        }
    }

    /// Of the file at a path; `None` where there is none.
    #[must_use]
    pub fn at(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|metadata| Self::of(&metadata))
    }
}
