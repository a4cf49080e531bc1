//! Failed attempts: records of jobs that a worker started and did not finish, beside their outputs.

use serde::{Deserialize, Serialize};

use crate::error::Failure;
use crate::manifest::Job;
use crate::sink::Sink;

/// A job that was started and is not done: it failed, or its worker was killed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailedAttempt {
    /// The job, why it is not done, and whether trying again may help.
    #[serde(flatten)]
    pub failure: Failure,
    /// The number of starts.
    pub tries: u32,
    /// The message of the queue that it came with. A job that is submitted again starts afresh.
    pub message: u64,
}

/// Largest record that is read, bytes.
const LARGEST: u64 = 1 << 20;

impl FailedAttempt {
    fn file_name(name: &str) -> String {
        format!("{name}.failed.json")
    }

    /// The record of this job, if it has one.
    #[must_use]
    pub fn read(job: &Job, sink: &Sink) -> Option<Self> {
        let bytes = sink.read(&Self::file_name(&job.name()), LARGEST).ok().flatten()?;
        let found: Self = serde_json::from_slice(&bytes).ok()?;
        (found.failure.job == job.job.0).then_some(found)
    }

    pub(super) fn write(&self, sink: &Sink) -> std::io::Result<()> {
        sink.put(&Self::file_name(&self.failure.name), serde_json::to_vec_pretty(self)?)
    }

    /// Removes the record of a job by its series and view.
    pub(super) fn remove(name: &str, sink: &Sink) -> std::io::Result<()> {
        sink.remove(&Self::file_name(name))
    }
}
