//! Series of this machine, of buckets and of archives, for commands that load one.
//!
//! Files that come over the network are read in a child process where the system can isolate one.

use std::cell::RefCell;
use std::path::Path;

use anyhow::Context;

use crate::bucket::CopiesArguments;
use crate::isolation::Isolation;
use crate::serve::series::of_buckets;
use crate::source::{self, SeriesOptions};
use relief_batch::Location;
use relief_dicom::Loaded;

/// [`source::load_after`] of a path, or of a copy of the series that an address names.
pub(super) fn load_after<T>(
    path: &Path,
    copies: &CopiesArguments,
    options: &SeriesOptions,
    before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
) -> anyhow::Result<(Loaded, T)> {
    if !Location::is_remote(path) {
        return source::load_after(path, options, before);
    }
    let about = || format!("cannot load {}", Location::public_name(path));
    // A temporary folder of copies lives as long as these.
    let copies = copies.copies_with_progress()?;
    let local = copies.local(path).with_context(about)?;
    let reader = of_buckets(Isolation::DEFAULT)?;
    let (before, prepared) = (RefCell::new(Some(before)), RefCell::new(None));
    let wanted = |dims| {
        if let Some(before) = before.take() {
            prepared.replace(Some(before(dims)?));
        }
        Ok(())
    };
    let read = reader.read(local.path(), options, &wanted).with_context(about)?;
    let prepared = prepared.take().context("the dimensions of the series are unknown")?;
    let mut loaded = Loaded::of_volume(read.volume);
    loaded.identity = read.identity.unwrap_or_default();
    loaded.reference = read.reference;
    Ok((loaded, prepared))
}
