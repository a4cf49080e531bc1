//! The file of a log in SQLite: checks that it is still at its path, and sets its permissions.

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

    /// Whether the file is at its path. SQLite continues to write into a removed file, and these changes
    /// are lost.
    pub(super) fn is_there(&self) -> bool {
        self.id.is_some() && FileId::at(&self.path) == self.id
    }

    /// Lets only the owner read the file, which contains names of authors and findings about patients.
    /// Files that SQLite creates beside it later get the same permissions.
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
