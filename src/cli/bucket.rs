//! `s3://BUCKET/PREFIX` among options, where outputs go and where series are; and copies of series
//! in buckets and archives.

use std::path::PathBuf;

use crate::archive::ArchiveArguments;
use crate::memory::parse_bytes;
use relief_batch::{Copies, CopiesOptions, CopyProgress, IsolatedReader, Location, Sink};

/// The S3 service of a bucket. Credentials are in the environment: AWS_ACCESS_KEY_ID,
/// AWS_SECRET_ACCESS_KEY, AWS_REGION.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct BucketArguments {
    /// Address of the S3 service of s3://BUCKET, where it is not AWS: https://HOST;
    /// AWS_ENDPOINT_URL says it, too
    #[arg(long, value_name = "URL")]
    s3_endpoint: Option<String>,
}

/// Copies of series in buckets and archives.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct CopiesArguments {
    #[command(flatten)]
    pub(super) bucket: BucketArguments,
    #[command(flatten)]
    pub(super) archive: ArchiveArguments,
    /// Folder for copies of series in buckets and archives, which stay there for the next time; a
    /// temporary one where left out
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Most that copies of series in buckets and archives may take together; a series that has more
    /// is refused
    #[arg(long, value_name = "BYTES", default_value = "16GiB", value_parser = parse_bytes)]
    cache_bytes: u64,
}

impl BucketArguments {
    /// The destination of outputs, by its name.
    pub(super) fn open(&self, name: &Location) -> anyhow::Result<Sink> {
        match name {
            Location::Local(folder) => Ok(Sink::Folder(folder.clone())),
            #[cfg(feature = "buckets")]
            Location::Bucket { bucket, prefix } => {
                use anyhow::Context;
                let opened = relief_batch::Bucket::open(bucket, prefix, self.s3_endpoint.as_deref());
                let opened = opened.with_context(|| format!("cannot use {name}"))?;
                Ok(Sink::Bucket(std::sync::Arc::new(opened)))
            }
            #[cfg(not(feature = "buckets"))]
            Location::Bucket { .. } => {
                anyhow::bail!(crate::features::lacks(&name.to_string(), "buckets"))
            }
            Location::Archive(_) => {
                anyhow::bail!("outputs go into a folder or a bucket, not into a DICOM archive")
            }
        }
    }
}

impl CopiesArguments {
    /// Copies that the caller reads.
    ///
    /// # Errors
    /// When a file of --archive-... cannot be read.
    pub(super) fn copies(&self) -> anyhow::Result<Copies> {
        self.copies_below(Vec::new(), None, CopyProgress::default())
    }

    /// Copies for a command that loads one series: progress is shown on stderr.
    ///
    /// # Errors
    /// As for `copies`.
    pub(super) fn copies_with_progress(&self) -> anyhow::Result<Copies> {
        let bar = crate::progress::RetrievalBar::default();
        self.copies_below(Vec::new(), None, CopyProgress::new(move |done, all| bar.report(done, all)))
    }

    /// Copies that `isolated` reads. Paths must lie below one of the roots; without roots, all are
    /// allowed.
    ///
    /// # Errors
    /// As for `copies`.
    pub(super) fn copies_below(
        &self,
        roots: Vec<Location>,
        isolated: Option<IsolatedReader>,
        progress: CopyProgress,
    ) -> anyhow::Result<Copies> {
        Ok(Copies::new(CopiesOptions {
            folder: self.cache.clone(),
            bytes: self.cache_bytes,
            endpoint: self.bucket.s3_endpoint.clone(),
            roots,
            isolated,
            #[cfg(feature = "archives")]
            archives: self.archive.access()?,
            progress,
        }))
    }
}
