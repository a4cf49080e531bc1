//! Batches: many views of many series, as jobs in a manifest, rendered by any number of workers.
//!
//! What it is: [`plan()`] finds series and writes one [`Job`] for each view of each; [`run()`]
//! renders those that are not done. A job's key is a hash of the inputs of its outputs (the
//! series' bytes, the scene, the products, this version), so that work done stays done wherever the
//! files lie, and a changed series or scene is another job. What it is not: no queue and no cluster
//! of our own; `queue` (feature `queue`) speaks to NATS and `bucket` (feature `buckets`) to S3. Workers share
//! nothing but the outputs.
//!
//! Outputs appear complete, by renaming; a record beside them, written last, has their hashes. A
//! job whose record and outputs exist is skipped. File names contain nothing about patients: a
//! series is named by its hash unless a table names it.

mod annotations;
#[cfg(feature = "buckets")]
mod bucket;
mod copies;
mod dataset;
mod error;
mod found;
mod gate;
mod isolation;
mod landmarks;
mod loading;
mod location;
mod log;
mod manifest;
mod names;
mod output_file;
mod outputs;
mod picture;
mod plan;
mod pose;
mod product;
mod query;
#[cfg(feature = "queue")]
mod queue;
mod record;
mod relocate;
mod report;
mod run;
mod run_state;
mod sink;
mod source;
mod turntable;
mod views;

pub use annotations::KeptAnnotations;
#[cfg(feature = "buckets")]
pub use bucket::Bucket;
pub use copies::{Copies, CopiesOptions, CopyProgress, Local};
pub use error::{
    AnnotationsError, Failure, FailureKind, JobError, ManifestError, PlanError, SkipReason, TableError,
    ViewError, ViewsError,
};
pub use isolation::{IsolatedReader, IsolationError};
pub use location::{Location, LocationError};
pub use log::AnnotationLog;
pub use manifest::{InvalidShard, Job, JobKey, Shard, read_manifest};
pub use plan::{Plan, Request, Root, Skipped, plan};
pub use product::{Product, ProductSet, UnknownProduct};
pub use query::{InvalidCondition, Query, SeriesFacts, UnmetCondition};
pub use record::Record;
pub use report::{REPORT, write_report};
pub use run::{Options, RunError, run};
pub use run_state::{RunEvent, Seconds, Summary};
pub use sink::Sink;
pub use source::{LabelsSource, PhaseSource, SeriesSource};
pub use turntable::{FilmChoice, FilmError, FilmWriter, turntable_capture};
pub use views::{FILMS, View, ViewSet};

#[cfg(feature = "queue")]
pub use queue::{
    FailedAttempt, Queue, QueueAccess, QueueError, Submitted, WorkEnd, WorkOptions, WorkSummary, work_queue,
};

/// Gives TLS its cryptography, for queue and bucket. Where one is installed already, it is as good.
#[cfg(any(feature = "queue", feature = "buckets"))]
fn install_cryptography() {
    let _ = rustls::crypto::ring::default_provider().install_default();
}
