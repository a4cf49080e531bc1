//! The state of a run: its events, its outcome, and where its time went.

use parking_lot::Mutex;

use super::annotations::LastAnnotations;
use super::error::{Failure, SeriesError};
use super::manifest::Job;
use super::record::Record;
use super::sink::Sink;

/// An event of a job.
#[derive(Clone, Copy, Debug)]
pub enum RunEvent<'a> {
    /// It was done before.
    Skipped(&'a Job),
    /// Its outputs exist now.
    Done(&'a Job, &'a Record),
    /// It was not done.
    Failed(&'a Failure),
}

/// The outcome of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Jobs of this share.
    pub jobs: usize,
    /// Rendered now.
    pub done: usize,
    /// Done before.
    pub skipped: usize,
    /// Series that were loaded.
    pub loaded: usize,
    /// Not done.
    pub failures: Vec<Failure>,
    /// The times of its activities.
    pub seconds: Seconds,
}

/// Seconds of a run by activity. Loading, rendering and writing run in parallel.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seconds {
    /// Checking which jobs are done.
    pub looking: f64,
    /// Reading series, and preparing their volumes.
    pub loading: f64,
    /// The renderer had no series yet.
    pub waiting_for_series: f64,
    /// Volumes to the adapter, with their gradients and bricks.
    pub uploading: f64,
    /// Rays and read-back.
    pub rendering: f64,
    /// The renderer waited for pictures to be written.
    pub waiting_for_writers: f64,
    /// Drawing, encoding and writing, of all writers together.
    pub writing: f64,
}

/// State that all threads of a run share.
pub(super) struct RunState<'a> {
    pub(super) sink: &'a Sink,
    pub(super) report: &'a (dyn Fn(RunEvent<'_>) + Sync),
    pub(super) annotations: LastAnnotations,
    summary: Mutex<Summary>,
}

impl<'a> RunState<'a> {
    pub(super) fn new(sink: &'a Sink, report: &'a (dyn Fn(RunEvent<'_>) + Sync)) -> Self {
        Self { sink, report, annotations: LastAnnotations::default(), summary: Mutex::default() }
    }

    pub(super) fn into_summary(self) -> Summary {
        self.summary.into_inner()
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut Summary)) {
        change(&mut self.summary.lock());
    }

    pub(super) fn fail(&self, job: &Job, SeriesError { kind, reason }: SeriesError) {
        let failure = Failure { job: job.job.0.clone(), name: job.name(), kind, reason };
        (self.report)(RunEvent::Failed(&failure));
        self.change(|summary| summary.failures.push(failure));
    }
}
