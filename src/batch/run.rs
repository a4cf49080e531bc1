//! Running: every job that is not done, series by series; while one is rendered the next is loaded and the last is written.

use std::borrow::Borrow;
use std::collections::HashSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use super::annotations::{Readied, ReadiedLast};
use super::error::{Failure, Lasting};
use super::gate::Gate;
use super::manifest::{Job, JobKey, Shard};
use super::outputs::{Outputs, Sight};
use super::record::{Record, Written};
use super::sink::Sink;
use super::source::{Loaded, SeriesSource, Trouble};
use crate::gpu::GpuError;
use crate::render::{Overlays, RenderError, Renderer, Scene, SceneError, SceneFile};
use crate::volume::Volume;

/// What to run and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where outputs go.
    pub out: Sink,
    /// A share of the jobs.
    pub shard: Option<Shard>,
    /// These jobs alone; all where it is empty.
    pub only: Vec<JobKey>,
    /// Bytes of voxels in memory: of the series that is rendered and of the next one.
    pub voxel_bytes: u64,
}

/// What has just happened to a job.
#[derive(Clone, Copy, Debug)]
pub enum Step<'a> {
    /// It was done before.
    Skipped(&'a Job),
    /// Its outputs are there now.
    Done(&'a Job, &'a Record),
    /// It was not done.
    Failed(&'a Failure),
}

/// What came of a run.
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
    /// Where the time went.
    pub seconds: Seconds,
}

/// Seconds of a run, by what was done. Loading, rendering and writing go on at the same time.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seconds {
    /// Looking for what is done already.
    pub looking: f64,
    /// Reading series.
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

/// Why a run did not begin.
#[derive(Debug)]
pub enum RunError<E> {
    /// The folder of outputs cannot be made, or the bucket not be reached.
    Out(std::io::Error),
    /// There is no renderer.
    Renderer(E),
}

/// Pictures that wait to be written: more would only hold memory.
const WRITES_WAITING: usize = 2;
/// Most threads that draw, encode and write.
const MOST_WRITERS: usize = 4;

/// A picture on its way to its files.
struct Finished<J> {
    job: J,
    sight: Sight,
    warnings: Vec<String>,
}

/// What all threads of a run see.
pub(super) struct Shared<'a> {
    sink: &'a Sink,
    report: &'a (dyn Fn(Step<'_>) + Sync),
    annotations: ReadiedLast,
    summary: Mutex<Summary>,
}

/// Runs the jobs that are not done, with a renderer that is opened where there are any. One job that fails stops no other;
/// `report` hears of each, from several threads.
///
/// # Errors
/// When the folder of outputs cannot be made, the bucket not be reached, or the renderer not be opened.
pub fn run<E>(
    open: impl FnOnce() -> Result<Renderer, E>,
    jobs: &[Job],
    options: &Options,
    report: &(dyn Fn(Step<'_>) + Sync),
) -> Result<Summary, RunError<E>> {
    options.out.prepare().map_err(RunError::Out)?;
    let shared = Shared::new(&options.out, report);
    let started = Instant::now();
    let pending = pending(jobs, options, &shared);
    shared.change(|summary| summary.seconds.looking = started.elapsed().as_secs_f64());
    if !pending.is_empty() {
        let mut renderer = open().map_err(RunError::Renderer)?;
        let groups = pending.chunk_by(|a, b| a.series == b.series).map(<[&Job]>::to_vec);
        render_groups(&mut renderer, groups, &Gate::new(options.voxel_bytes), &shared);
    }
    Ok(shared.into_summary())
}

/// Renders groups of jobs of one series each as they come, until no more come. While one is rendered the next is loaded and the
/// last is written; groups of one series that come one after the other share its volume.
pub(super) fn render_groups<J: Borrow<Job> + Send>(
    renderer: &mut Renderer,
    groups: impl Iterator<Item = Vec<J>> + Send,
    gate: &Gate,
    shared: &Shared<'_>,
) {
    let writers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(MOST_WRITERS);
    // Without room: the next series is loaded while this one is rendered, and no further one.
    let (loaded, series) = sync_channel(0);
    let (finished, pictures) = sync_channel(WRITES_WAITING);
    let pictures = &Mutex::new(pictures);
    std::thread::scope(|scope| {
        scope.spawn(move || load_all(groups, gate, &loaded, shared));
        for _ in 0..writers {
            scope.spawn(move || write_all::<J>(pictures, shared));
        }
        render_all(renderer, &series, &finished, shared);
        drop(finished); // ends the writers
    });
}

/// The jobs of this run that are not done.
fn pending<'a>(jobs: &'a [Job], options: &Options, shared: &Shared<'_>) -> Vec<&'a Job> {
    let only: HashSet<&JobKey> = options.only.iter().collect();
    let is_wanted = |job: &&Job| {
        options.shard.is_none_or(|shard| shard.has(job)) && (only.is_empty() || only.contains(&job.job))
    };
    let wanted: Vec<&Job> = jobs.iter().filter(is_wanted).collect();
    shared.change(|summary| summary.jobs = wanted.len());
    let is_done = |job: &&Job| {
        let is_done = Record::of_done(job, &options.out).is_some();
        if is_done {
            shared.change(|summary| summary.skipped += 1);
            (shared.report)(Step::Skipped(job));
        }
        !is_done
    };
    wanted.into_par_iter().filter(is_done).collect()
}

type Series<'a, J> = (Vec<J>, Result<Arc<Loaded<'a>>, Trouble>);

fn load_all<'a, J: Borrow<Job>>(
    groups: impl Iterator<Item = Vec<J>>,
    gate: &'a Gate,
    loaded: &SyncSender<Series<'a, J>>,
    shared: &Shared<'_>,
) {
    let mut last: Option<(SeriesSource, Arc<Loaded<'a>>)> = None;
    for group in groups {
        let Some(wanted) = group.first().map(|job| job.borrow().series.clone()) else { continue };
        let series = match last.take() {
            Some((source, volume)) if source == wanted => Ok(volume),
            // What the last one held is given back first: the next one may need it.
            other => {
                drop(other);
                let started = Instant::now();
                let volume = wanted.load(gate).map(Arc::new);
                // The renderer asks for it: known here, it need not wait for it there.
                let _ = volume.as_ref().map(|loaded| loaded.volume.content_hash());
                shared.change(|summary| {
                    summary.loaded += usize::from(volume.is_ok());
                    summary.seconds.loading += started.elapsed().as_secs_f64();
                });
                volume
            }
        };
        last = series.as_ref().ok().map(|volume| (wanted, Arc::clone(volume)));
        if loaded.send((group, series)).is_err() {
            return; // nobody renders any more
        }
    }
}

fn render_all<'a, J: Borrow<Job>>(
    renderer: &mut Renderer,
    series: &Receiver<Series<'a, J>>,
    finished: &SyncSender<Finished<J>>,
    shared: &Shared<'_>,
) {
    let (mut shown, mut waiting) = (None, Instant::now());
    while let Ok((jobs, loaded)) = series.recv() {
        shared.change(|summary| summary.seconds.waiting_for_series += waiting.elapsed().as_secs_f64());
        match loaded {
            Ok(loaded) => {
                let hash = loaded.volume.content_hash();
                if let Some(other) = shown.replace(hash).filter(|shown| *shown != hash) {
                    renderer.forget(other);
                }
                if !render_series(renderer, &loaded, jobs, finished, shared) {
                    return; // nobody writes any more
                }
            }
            Err(trouble) => jobs.iter().for_each(|job| shared.fail(job.borrow(), trouble.clone())),
        }
        waiting = Instant::now();
    }
    if let Some(last) = shown {
        renderer.forget(last);
    }
}

/// Whether somebody writes what is rendered.
fn render_series<J: Borrow<Job>>(
    renderer: &mut Renderer,
    loaded: &Loaded<'_>,
    jobs: Vec<J>,
    finished: &SyncSender<Finished<J>>,
    shared: &Shared<'_>,
) -> bool {
    for job in jobs {
        match render(renderer, &loaded.volume, job.borrow()) {
            Ok(sight) => {
                let (timings, waiting) = (sight.frame.timings, Instant::now());
                let picture = Finished { job, sight, warnings: loaded.warnings.clone() };
                if finished.send(picture).is_err() {
                    return false;
                }
                shared.change(|Summary { seconds, .. }| {
                    seconds.uploading += timings.upload_ms / 1e3;
                    seconds.rendering += timings.render_ms / 1e3;
                    seconds.waiting_for_writers += waiting.elapsed().as_secs_f64();
                });
            }
            Err(trouble) => shared.fail(job.borrow(), trouble),
        }
    }
    true
}

/// The picture as rays make it, without what is drawn over it.
fn render(renderer: &mut Renderer, volume: &Volume, job: &Job) -> Result<Sight, Trouble> {
    let permanent = |error: SceneError| (Lasting::Permanent, error.to_string());
    let file = SceneFile::parse(job.scene.to_string().as_bytes()).map_err(permanent)?;
    let scene: Scene = file.resolve(volume.grid(), &job.orbit).map_err(permanent)?;
    scene.expect_no_annotations().map_err(permanent)?;
    if job.products.iter().any(|product| product.is_frame()) {
        scene.expect_size_of_layout().map_err(permanent)?;
    }
    let mut request = scene.request;
    let overlays = std::mem::replace(&mut request.overlays, Arc::new(Overlays::default()));
    let frame = renderer.render(volume, &request).map_err(|error| {
        let kind = match error {
            // Another machine, or this one at another time, may have what was missing.
            RenderError::Gpu(GpuError::OutOfMemory { .. }) | RenderError::Cancelled => Lasting::Retryable,
            RenderError::Gpu(_) => Lasting::Retryable,
            _ => Lasting::Permanent,
        };
        (kind, error.to_string())
    })?;
    request.overlays = overlays;
    Ok(Sight { frame, request, display: scene.display, grid: volume.grid().clone() })
}

fn write_all<J: Borrow<Job>>(pictures: &Mutex<Receiver<Finished<J>>>, shared: &Shared<'_>) {
    let next = || pictures.lock().unwrap_or_else(PoisonError::into_inner).recv();
    while let Ok(picture) = next() {
        let (job, started) = (picture.job.borrow(), Instant::now());
        let written = write(&picture, shared);
        shared.change(|summary| summary.seconds.writing += started.elapsed().as_secs_f64());
        match written {
            Ok(record) => {
                shared.change(|summary| summary.done += 1);
                (shared.report)(Step::Done(job, &record));
            }
            Err(trouble) => shared.fail(job, trouble),
        }
    }
}

fn write<J: Borrow<Job>>(picture: &Finished<J>, shared: &Shared<'_>) -> Result<Record, Trouble> {
    let Finished { job, sight, warnings } = picture;
    let (job, started) = (job.borrow(), Instant::now());
    let refused =
        |error: std::io::Error| (Lasting::Retryable, format!("cannot write {}: {error}", job.name()));
    let readied: Option<Arc<Readied>> =
        job.annotations.as_ref().map(|kept| shared.annotations.get(kept)).transpose()?;
    let made: Outputs = sight.outputs(&job.products, readied.as_deref())?;
    let mut outputs = Vec::new();
    for (product, bytes) in &made.files {
        let name = format!("{}.{}", job.view, product.ending());
        shared.sink.put(&format!("{}/{name}", job.series.name), bytes).map_err(refused)?;
        outputs.push(Written::new(name, bytes));
    }
    let timings = sight.frame.timings;
    let record = Record {
        job: job.job.clone(),
        series: job.series.name.clone(),
        view: job.view.clone(),
        group: job.group.clone(),
        outputs,
        structures: made.structures,
        render_ms: timings.upload_ms + timings.render_ms + timings.overlay_ms,
        write_ms: started.elapsed().as_secs_f64() * 1e3,
        size_px: sight.frame.size_px,
        warnings: warnings.iter().chain(&made.warnings).cloned().collect(),
    };
    record.write(job, shared.sink).map_err(refused)?;
    Ok(record)
}

impl<'a> Shared<'a> {
    pub(super) fn new(sink: &'a Sink, report: &'a (dyn Fn(Step<'_>) + Sync)) -> Self {
        Self { sink, report, annotations: ReadiedLast::default(), summary: Mutex::default() }
    }

    pub(super) fn into_summary(self) -> Summary {
        self.summary.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut Summary)) {
        change(&mut self.summary.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn fail(&self, job: &Job, (kind, reason): Trouble) {
        let failure = Failure { job: job.job.0.clone(), name: job.name(), kind, reason };
        (self.report)(Step::Failed(&failure));
        self.change(|summary| summary.failures.push(failure));
    }
}
