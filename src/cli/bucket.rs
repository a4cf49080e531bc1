//! `s3://BUCKET/PREFIX` among options: where outputs go, and where series are.

use std::path::PathBuf;

use crate::memory::parse_bytes;
use relief_batch::{Copies, CopiesOptions, IsolatedReader, Location, Sink};

/// The S3 service of a bucket. Credentials are in the environment: AWS_ACCESS_KEY_ID,
/// AWS_SECRET_ACCESS_KEY, AWS_REGION.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct BucketArguments {
    /// Address of the S3 service of s3://BUCKET, where it is not AWS: https://HOST;
    /// AWS_ENDPOINT_URL says it, too
    #[arg(long, value_name = "URL")]
    s3_endpoint: Option<String>,
}

/// Copies of series in buckets.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct CopiesArguments {
    #[command(flatten)]
    pub(super) bucket: BucketArguments,
    /// Folder for copies of series in buckets, which stay there for the next time; a temporary one
    /// where left out
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Most that copies of series in buckets may take together; a series that has more is refused
    #[arg(long, value_name = "BYTES", default_value = "16GiB", value_parser = parse_bytes)]
    cache_bytes: u64,
}

impl BucketArguments {
    /// Where outputs go, by its name.
    pub(super) fn open(&self, name: &Location) -> anyhow::Result<Sink> {
        match name {
            Location::Local(folder) => Ok(Sink::Folder(folder.clone())),
            #[cfg(feature = "cluster")]
            Location::Bucket { bucket, prefix } => {
                use anyhow::Context;
                let opened = relief_batch::Bucket::open(bucket, prefix, self.s3_endpoint.as_deref());
                let opened = opened.with_context(|| format!("cannot use {name}"))?;
                Ok(Sink::Bucket(std::sync::Arc::new(opened)))
            }
            #[cfg(not(feature = "cluster"))]
            Location::Bucket { .. } => {
                anyhow::bail!("this program was built without the feature `cluster`: no {name}")
            }
        }
    }
}

impl CopiesArguments {
    /// Copies that the caller reads.
    pub(super) fn copies(&self) -> Copies {
        self.copies_below(Vec::new(), None)
    }

    /// Copies that `isolated` reads. Paths must lie below one of the roots; without roots, all are
    /// allowed.
    pub(super) fn copies_below(&self, roots: Vec<Location>, isolated: Option<IsolatedReader>) -> Copies {
        let (folder, bytes) = (self.cache.clone(), self.cache_bytes);
        let endpoint = self.bucket.s3_endpoint.clone();
        Copies::new(CopiesOptions { folder, bytes, endpoint, roots, isolated })
    }
}
