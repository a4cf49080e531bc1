//! Putting jobs into a queue, each of them once.

use std::collections::VecDeque;
use std::future::IntoFuture;

use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{PublishAckFuture, PublishError};
use async_nats::jetstream::message::PublishMessage;

use super::{Queue, QueueError};
use crate::manifest::Job;

/// The outcome of submitting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Submitted {
    /// Jobs that are in the queue now and were not.
    pub sent: usize,
    /// Jobs that were there already.
    pub known: usize,
}

/// Jobs on their way whose receipt is not there yet.
const UNDER_WAY: usize = 256;

impl Queue {
    /// Puts jobs into the stream, in their order, so that those of one series come to one worker.
    /// `report` gets the number of jobs that are through.
    ///
    /// # Errors
    /// When the server refuses; the jobs before are in the queue then, and submitting again puts in
    /// the rest.
    pub async fn submit(&self, jobs: &[Job], report: &mut dyn FnMut(usize)) -> Result<Submitted, QueueError> {
        self.stream().await?;
        let (mut submitted, mut under_way) = (Submitted::default(), VecDeque::new());
        for job in jobs {
            if under_way.len() == UNDER_WAY {
                settle(&mut under_way, &mut submitted).await?;
                report(submitted.sent + submitted.known);
            }
            let payload = serde_json::to_vec(job).map_err(|error| not_taken(job, error))?;
            let message = PublishMessage::build().payload(payload.into()).message_id(&job.job.0);
            let subject = format!("{}.{}", self.stream, job.job.0);
            let receipt = self.context.send_publish(subject, message).await;
            under_way.push_back((job, receipt.map_err(|error| not_taken(job, error))?));
        }
        while !under_way.is_empty() {
            settle(&mut under_way, &mut submitted).await?;
            report(submitted.sent + submitted.known);
        }
        Ok(submitted)
    }
}

/// Waits for the oldest receipt.
async fn settle(
    under_way: &mut VecDeque<(&Job, PublishAckFuture)>,
    submitted: &mut Submitted,
) -> Result<(), QueueError> {
    let Some((job, receipt)) = under_way.pop_front() else { return Ok(()) };
    match receipt.into_future().await {
        Ok(receipt) if receipt.duplicate => submitted.known += 1,
        Ok(_) => submitted.sent += 1,
        Err(error) if waits_already(&error) => submitted.known += 1,
        Err(error) => return Err(not_taken(job, error)),
    }
    Ok(())
}

/// Whether a message was refused because its subject has one already.
fn waits_already(error: &PublishError) -> bool {
    let source = std::error::Error::source(error);
    let refusal = source.and_then(|source| source.downcast_ref::<async_nats::jetstream::Error>());
    refusal.is_some_and(|refusal| {
        refusal.error_code() == ErrorCode::STREAM_STORE_FAILED && refusal.to_string().contains("per subject")
    })
}

fn not_taken(job: &Job, error: impl std::error::Error + Send + Sync + 'static) -> QueueError {
    QueueError::NotTaken { name: job.name(), source: error.into() }
}
