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
    synced_beside(path, bytes)?.persist(path)?;
    Ok(())
}

/// Like [`write_whole`], but never replaces a file. If several writers create one file at the same time, one
/// of them succeeds.
///
/// # Errors
/// `AlreadyExists` when the file exists, which stays unchanged; and errors of the file system.
pub fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    synced_beside(path, bytes)?.persist_noclobber(path)?;
    Ok(())
}

/// A synced temporary file with these bytes, in the folder of `path`.
fn synced_beside(path: &Path, bytes: &[u8]) -> std::io::Result<tempfile::NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = shared_temporary().prefix(".relief-").tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    Ok(file)
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
/// The identity of a file, independent of its path: the numbers of its device and inode. On systems without
/// inodes all files have equal identities, so a removed file is detected, but a replaced one is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileId([u64; 2]);

impl FileId {
    /// The identity of the file with this metadata.
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

    /// The identity of the file at a path; `None` if there is no file.
    #[must_use]
    pub fn at(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|metadata| Self::of(&metadata))
    }
}
