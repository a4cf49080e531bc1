//! Options of batches for series in buckets and archives: copies, and the process that reads them.

use crate::bucket::CopiesArguments;
use crate::isolation::Isolation;
use relief_batch::{Copies, CopyProgress, Location};

/// Series in buckets and archives.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct BucketSeriesArguments {
    #[command(flatten)]
    pub(super) copies: CopiesArguments,
    /// Where series of buckets and archives are read: in a child process without rights to files,
    /// network and programs, or in this process
    #[arg(long, value_enum, default_value_t = Isolation::DEFAULT)]
    isolation: Isolation,
}

impl BucketSeriesArguments {
    /// Copies of series in buckets. A path must lie below one of the roots; without roots, all are
    /// allowed.
    ///
    /// # Errors
    /// When this system cannot isolate.
    pub(super) fn copies_below(&self, roots: Vec<Location>) -> anyhow::Result<Copies> {
        let isolated = match self.isolation {
            Isolation::Off => None,
            #[cfg(target_os = "linux")]
            Isolation::On => {
                use anyhow::Context;
                let reader = relief_batch::IsolatedReader::of_this_program();
                Some(reader.context("series of buckets cannot be read in a child process; --isolation off reads them in this process")?)
            }
            #[cfg(not(target_os = "linux"))]
            Isolation::On => anyhow::bail!(crate::isolation::NEEDS_LINUX),
        };
        self.copies.copies_below(roots, isolated, CopyProgress::default())
    }
}
