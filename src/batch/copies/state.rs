//! The folder of copies, and the buckets and archives that were opened.

use std::collections::HashMap;
use std::io::{Error, ErrorKind};
use std::path::Path;
use std::sync::Arc;

use super::shelf::CopyFolder;

/// What is opened once and shared by all users of the copies.
#[derive(Debug, Default)]
pub(super) struct State {
    shelf: Option<Arc<CopyFolder>>,
    #[cfg(feature = "buckets")]
    pub(super) buckets: HashMap<String, Arc<crate::bucket::Bucket>>,
    #[cfg(feature = "archives")]
    pub(super) archives: HashMap<String, Arc<relief_archive::Archive>>,
}

impl State {
    pub(super) fn shelf(&mut self, folder: Option<&Path>) -> std::io::Result<Arc<CopyFolder>> {
        if let Some(shelf) = &self.shelf {
            return Ok(Arc::clone(shelf));
        }
        let opened = Arc::new(CopyFolder::open(folder)?);
        self.shelf = Some(Arc::clone(&opened));
        Ok(opened)
    }
}

/// A failure of this machine's folder says nothing about the series: a later try may succeed.
pub(super) fn of_this_machine(error: Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::InvalidInput => Error::other(error),
        _ => error,
    }
}
