//! A work queue: jobs in a stream of NATS JetStream, taken by as many workers as there are.
//!
//! What it is: [`Queue::submit`] puts jobs into a stream, each under a subject of its own key, so
//! that no job waits there twice; [`work_queue()`] takes jobs through one durable consumer that all
//! workers share. A job leaves the stream when a worker reports that its outputs exist, or that it
//! failed permanently. A worker reports its jobs in progress at intervals; the queue redelivers the
//! jobs of one that does not. What it is not: a scheduler, or a queue of our own.
//!
//! A job may be delivered twice, because a worker may die between its last write and its report.
//! That does no harm: existing outputs are not made again, and outputs made at the same time have
//! the same bytes.

mod attempt;
mod client;
mod connect;
mod submit;
mod work;

use std::time::Duration;

use async_nats::jetstream::consumer::{AckPolicy, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};

pub use attempt::FailedAttempt;
pub use client::WorkEnd;
pub use connect::{Queue, QueueAccess};
pub use submit::Submitted;
pub use work::{WorkOptions, WorkSummary, work_queue};

/// The consumer that all workers of a stream share.
const CONSUMER: &str = "workers";
/// Jobs that all workers together may hold.
const MOST_HELD: i64 = 100_000;
/// The time for which the id of a message is remembered: no longer than it takes to send it twice
/// by mistake. A job that waits is known by its subject, and one that is done may be submitted
/// again.
const REMEMBERED: Duration = Duration::from_secs(1);

/// Errors of a queue.
#[derive(Debug, thiserror::Error)]
pub enum QueueError {
    /// A stream cannot have this name.
    #[error("{0:?} is not a valid stream name; allowed: 1 to 100 letters, digits, - and _")]
    Name(String),
    /// Credentials cannot be read.
    #[error("cannot read {what}: {source}")]
    Credentials {
        /// The name of the file; never its content.
        what: &'static str,
        /// The error of the system.
        source: std::io::Error,
    },
    /// An address that is not one of a NATS server.
    #[error(
        "cannot connect to the NATS server: the address is invalid; write nats://HOST:4222 or tls://HOST:4222"
    )]
    Address,
    /// There is no connection.
    #[error("cannot connect to the NATS server: {0}")]
    Connect(#[from] async_nats::ConnectError),
    /// The server has no JetStream, or refuses.
    #[error(
        "the NATS server refused the request: {0}; it needs JetStream (nats-server -js) and permission to use it"
    )]
    Refused(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The stream exists with another purpose.
    #[error(
        "the stream {name} exists, but it is not a job stream: {reason}; choose another name with --stream"
    )]
    Foreign {
        /// Its name.
        name: String,
        /// The setting that differs.
        reason: &'static str,
    },
    /// A job was not taken.
    #[error("the queue refused the job {name}: {source}")]
    NotTaken {
        /// Series and view.
        name: String,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// An executor or a thread cannot be started, or the outputs' place is not there.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl Queue {
    /// The stream of jobs; made where it is not there.
    async fn stream(&self) -> Result<Stream, QueueError> {
        let config = Config {
            name: self.stream.clone(),
            description: Some("views to render: relief batch".to_owned()),
            subjects: vec![format!("{}.*", self.stream)],
            retention: RetentionPolicy::WorkQueue,
            storage: StorageType::File,
            // A job that waits is not taken again.
            max_messages_per_subject: 1,
            discard: DiscardPolicy::New,
            discard_new_per_subject: true,
            duplicate_window: REMEMBERED,
            ..Config::default()
        };
        let found = self.context.get_or_create_stream(config).await;
        let stream = found.map_err(|error| QueueError::Refused(error.into()))?;
        let config = &stream.cached_info().config;
        let foreign = |reason| Err(QueueError::Foreign { name: self.stream.clone(), reason });
        if config.retention != RetentionPolicy::WorkQueue {
            return foreign("it is no work queue");
        }
        if config.subjects != [format!("{}.*", self.stream)] {
            return foreign("it has other subjects");
        }
        Ok(stream)
    }

    /// The consumer of the stream that all workers share; the first one says how long a job may go
    /// unheard of.
    async fn consumer(
        &self,
        ack_wait: Duration,
    ) -> Result<async_nats::jetstream::consumer::Consumer<pull::Config>, QueueError> {
        let config = pull::Config {
            durable_name: Some(CONSUMER.to_owned()),
            ack_policy: AckPolicy::Explicit,
            ack_wait,
            // Workers count tries themselves: a message that the server has given up on would stay
            // for ever, and unseen.
            max_deliver: -1,
            max_ack_pending: MOST_HELD,
            ..pull::Config::default()
        };
        let stream = self.stream().await?;
        let found = stream.get_or_create_consumer(CONSUMER, config).await;
        found.map_err(|error| QueueError::Refused(error.into()))
    }
}
