//! A bucket of an S3 service: outputs as objects, and series that lie there (see `read`).
//!
//! A put is complete or absent. Every object carries the SHA-256 of its bytes, which the service
//! verifies and stores as metadata, so an existing output is recognised without reading it.
//!
//! Called from threads without an executor, as rendering and writing are; never from inside one.

mod read;

use std::io::{Error, ErrorKind};
use std::time::Duration;

use bytes::Bytes;
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::path::Path;
use object_store::{
    Attribute, Attributes, GetOptions, GetResult, ObjectStore, ObjectStoreExt, PutMode, PutOptions,
    RetryConfig,
};
use tokio::runtime::Runtime;

use crate::output_file::OutputFile;
pub(super) use read::Object;
use relief_base::sha256_of;

/// The metadata key of an object's hash.
const SHA256: Attribute = Attribute::Metadata(std::borrow::Cow::Borrowed("sha256"));
/// Time for which a request is repeated. A longer failure fails the job, which can be run again.
const PATIENCE: Duration = Duration::from_secs(60);

/// A bucket, and the common prefix of its objects' names.
#[derive(Debug)]
pub struct Bucket {
    store: AmazonS3,
    prefix: Path,
    runtime: Runtime,
}

impl Bucket {
    /// Opens a bucket with the credentials, the region and the endpoint that the environment has in
    /// `AWS_...`; `endpoint` goes before the environment's. Nothing is sent yet.
    ///
    /// # Errors
    /// When these contradict each other, or an endpoint is no URL.
    pub fn open(bucket: &str, prefix: &str, endpoint: Option<&str>) -> std::io::Result<Self> {
        super::install_cryptography();
        let mut builder = AmazonS3Builder::from_env()
            .with_bucket_name(bucket)
            .with_checksum_algorithm(Checksum::SHA256)
            .with_retry(RetryConfig { retry_timeout: PATIENCE, ..RetryConfig::default() });
        if let Some(endpoint) = endpoint {
            builder = builder.with_config(AmazonS3ConfigKey::S3Endpoint, endpoint);
        }
        let chosen = [AmazonS3ConfigKey::S3Endpoint, AmazonS3ConfigKey::Endpoint];
        let chosen = chosen.iter().find_map(|key| builder.get_config_value(key));
        // Without TLS only if the configured endpoint begins with http://.
        builder = builder.with_allow_http(chosen.is_some_and(|endpoint| endpoint.starts_with("http://")));
        let store = builder.build().map_err(Error::other)?;
        let prefix = Path::parse(prefix).map_err(Error::other)?;
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        Ok(Self { store, prefix, runtime })
    }

    fn path(&self, name: &str) -> Path {
        name.split('/').fold(self.prefix.clone(), Path::join)
    }

    /// Requests an object that need not exist. With write-only credentials the service answers
    /// "access denied", which is sufficient.
    pub(super) fn check(&self) -> std::io::Result<()> {
        let Err(error) = self.runtime.block_on(self.store.get(&self.path("report.html"))) else {
            return Ok(());
        };
        let says = |code: &str| format!("{error:?}").contains(code);
        match &error {
            object_store::Error::NotFound { .. } if !says("NoSuchBucket") => Ok(()),
            object_store::Error::PermissionDenied { .. } if says("AccessDenied") => Ok(()),
            _ => Err(io_error(error)),
        }
    }

    /// Writes an object; its hash is computed where it is not known.
    pub(super) fn put(&self, name: &str, bytes: Bytes, sha256: Option<&str>) -> std::io::Result<()> {
        self.put_as(PutMode::Overwrite, name, bytes, sha256).map_err(io_error)
    }

    /// With `If-None-Match: *`, one of several concurrent writers succeeds.
    pub(super) fn put_new(&self, name: &str, bytes: Bytes) -> std::io::Result<bool> {
        match self.put_as(PutMode::Create, name, bytes, None) {
            Ok(()) => Ok(true),
            Err(object_store::Error::AlreadyExists { .. }) => Ok(false),
            Err(error) => Err(io_error(error)),
        }
    }

    fn put_as(
        &self,
        mode: PutMode,
        name: &str,
        bytes: Bytes,
        sha256: Option<&str>,
    ) -> Result<(), object_store::Error> {
        let sha256 = sha256.map_or_else(|| sha256_of(&bytes), str::to_owned);
        let mut attributes = Attributes::new();
        attributes.insert(SHA256, sha256.into());
        attributes.insert(Attribute::ContentType, content_type(name).into());
        let options = PutOptions { mode, attributes, ..PutOptions::default() };
        let path = self.path(name);
        let put = self.store.put_opts(&path, bytes.into(), options);
        self.runtime.block_on(put).map(|_| ())
    }

    pub(super) fn read(&self, name: &str, largest: u64) -> std::io::Result<Option<Vec<u8>>> {
        let read = self.runtime.block_on(async {
            let found = self.store.get(&self.path(name)).await?;
            if found.meta.size > largest {
                return Ok(None);
            }
            found.bytes().await.map(|bytes| Some(bytes.to_vec()))
        });
        match read {
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            read => read.map_err(io_error),
        }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.head(&self.path(name)).is_ok()
    }

    fn head(&self, path: &Path) -> Result<GetResult, object_store::Error> {
        let options = GetOptions { head: true, ..GetOptions::default() };
        self.runtime.block_on(self.store.get_opts(path, options))
    }

    /// By the object's metadata; an object of another program, without it, is read.
    pub(super) fn holds(&self, name: &str, written: &OutputFile) -> bool {
        let Ok(GetResult { meta, attributes, .. }) = self.head(&self.path(name)) else { return false };
        if meta.size != written.bytes {
            return false;
        }
        match attributes.get(&SHA256) {
            Some(found) => found.as_ref() == written.sha256,
            None => {
                let read = self.read(name, written.bytes).ok().flatten();
                read.is_some_and(|bytes| sha256_of(&bytes) == written.sha256)
            }
        }
    }

    #[cfg(feature = "queue")]
    pub(super) fn remove(&self, name: &str) -> std::io::Result<()> {
        match self.runtime.block_on(self.store.delete(&self.path(name))) {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(io_error(error)),
        }
    }
}

fn io_error(error: object_store::Error) -> Error {
    let kind = match &error {
        object_store::Error::NotFound { .. } => ErrorKind::NotFound,
        object_store::Error::PermissionDenied { .. } | object_store::Error::Unauthenticated { .. } => {
            ErrorKind::PermissionDenied
        }
        _ => ErrorKind::Other,
    };
    Error::new(kind, error)
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, ending)| ending) {
        Some("png") => "image/png",
        Some("mp4") => "video/mp4",
        Some("json") => "application/json",
        Some("jsonl" | "txt") => "text/plain; charset=utf-8",
        Some("exr") => "image/x-exr",
        Some("html") => "text/html; charset=utf-8",
        _ => "application/octet-stream",
    }
}
