//! The file of a log in SQLite: whether it is still at its path, and who may read it.

use std::path::PathBuf;

use relief_base::FileId;

/// A file, as it was when the log was opened.
#[derive(Debug)]
pub(super) struct LogFile {
    path: PathBuf,
    id: Option<FileId>,
}

impl LogFile {
    pub(super) fn at(path: PathBuf) -> Self {
        let id = FileId::at(&path);
        Self { path, id }
    }

    /// Whether the file is at its path. SQLite writes into a file that was removed, and such changes are lost.
    pub(super) fn is_there(&self) -> bool {
        self.id.is_some() && FileId::at(&self.path) == self.id
    }

    /// Lets nobody but the owner read the file: it names people and what they have seen in a patient. Files that
    /// SQLite makes beside it later have the same mode.
    pub(super) fn keep_private(&self) -> std::io::Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            for ending in ["", "-wal", "-shm"] {
                let mut path = self.path.clone().into_os_string();
                path.push(ending);
                let private = std::fs::Permissions::from_mode(0o600);
                match std::fs::set_permissions(path, private) {
                    Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
                    _ => {}
                }
            }
        }
        Ok(())
    }
}
