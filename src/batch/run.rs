//! Running: every job that is not done, series by series; while one is rendered the next is loaded
//! and the last is written.

use std::borrow::Borrow;
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use parking_lot::Mutex;
use rayon::prelude::*;

use super::annotations::PreparedAnnotations;
use super::copies::Copies;
use super::error::{FailureKind, SeriesError};
use super::gate::MemoryBudget;
use super::loading::{LoadedSeries, Loading, Series, load_all};
use super::manifest::{Job, JobKey, Shard};
use super::outputs::{Outputs, RenderedView};
use super::record::Record;
use super::run_state::{RunEvent, RunState, Summary};
use super::sink::Sink;
use super::source::{BudgetedVolume, LastLook};
use crate::output_file::OutputFile;
use relief_render::{GpuError, Overlays, PictureWarning, RenderError, Renderer, Scene, Subject};

/// The jobs to run, and how to run them.
#[derive(Clone, Debug)]
pub struct Options {
    /// The destination of outputs.
    pub out: Sink,
    /// A share of the jobs.
    pub shard: Option<Shard>,
    /// Only these jobs; all if empty.
    pub only: Vec<JobKey>,
    /// Bytes of voxels in memory: of the series that is rendered and of the next one.
    pub voxel_bytes: u64,
    /// Copies of series in buckets.
    pub copies: Copies,
}

/// Why a run did not start.
#[derive(Debug)]
pub enum RunError<E> {
    /// The folder of outputs cannot be created, or the bucket cannot be reached.
    Out(std::io::Error),
    /// The renderer cannot be opened.
    Renderer(E),
}

/// Pictures that wait to be written: more would only hold memory.
const WRITES_WAITING: usize = 2;
/// Largest number of threads that draw, encode and write.
const MOST_WRITERS: usize = 4;

/// A picture on its way to its files.
struct Finished<J> {
    job: J,
    view: RenderedView,
    warnings: Vec<String>,
    picture_warning: Option<String>,
}

/// Runs the jobs that are not done, with a renderer that is opened where there are any. One job
/// that fails stops no other; `report` is called for each, from several threads.
///
/// # Errors
/// When the folder of outputs cannot be created, the bucket cannot be reached, or the renderer
/// cannot be opened.
pub fn run<E>(
    open: impl FnOnce() -> Result<Renderer, E>,
    jobs: &[Job],
    options: &Options,
    report: &(dyn Fn(RunEvent<'_>) + Sync),
) -> Result<Summary, RunError<E>> {
    options.out.prepare().map_err(RunError::Out)?;
    let shared = RunState::new(&options.out, report);
    let started = Instant::now();
    let pending = pending(jobs, options, &shared);
    shared.change(|summary| summary.seconds.looking = started.elapsed().as_secs_f64());
    if !pending.is_empty() {
        let mut renderer = open().map_err(RunError::Renderer)?;
        let groups = pending.chunk_by(|a, b| a.series == b.series).map(<[&Job]>::to_vec);
        let gate = MemoryBudget::new(options.voxel_bytes);
        render_groups(&mut renderer, groups, &options.copies, &gate, &shared);
    }
    Ok(shared.into_summary())
}

/// Renders groups of jobs of one series each as they come, until no more come. While one is
/// rendered the next is loaded and the last is written; groups of one series that come one after
/// the other share its volume.
pub(super) fn render_groups<J: Borrow<Job> + Send>(
    renderer: &mut Renderer,
    groups: impl Iterator<Item = Vec<J>> + Send,
    copies: &Copies,
    gate: &MemoryBudget,
    shared: &RunState<'_>,
) {
    let writers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(MOST_WRITERS);
    // Without room: the next series is loaded while this one is rendered, and no further one.
    let (loaded, series) = sync_channel(0);
    let (finished, pictures) = sync_channel(WRITES_WAITING);
    let pictures = &Mutex::new(pictures);
    let preparation = renderer.preparation();
    std::thread::scope(|scope| {
        let last_look = LastLook::default();
        let loading = Loading { copies, gate, preparation, shared, last_look };
        scope.spawn(move || load_all(groups, &loading, &loaded));
        for _ in 0..writers {
            scope.spawn(move || write_all::<J>(pictures, shared));
        }
        render_all(renderer, &series, &finished, shared);
        drop(finished); // ends the writers
    });
}

/// The jobs of this run that are not done.
fn pending<'a>(jobs: &'a [Job], options: &Options, shared: &RunState<'_>) -> Vec<&'a Job> {
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
            (shared.report)(RunEvent::Skipped(job));
        }
        !is_done
    };
    wanted.into_par_iter().filter(is_done).collect()
}

fn render_all<'a, J: Borrow<Job>>(
    renderer: &mut Renderer,
    series: &Receiver<Series<'a, J>>,
    finished: &SyncSender<Finished<J>>,
    shared: &RunState<'_>,
) {
    let (mut shown, mut waiting) = (None, Instant::now());
    while let Ok(series) = series.recv() {
        shared.change(|summary| summary.seconds.waiting_for_series += waiting.elapsed().as_secs_f64());
        match series {
            Ok(LoadedSeries { loaded, prepared, jobs }) => {
                let hash = loaded.volume.content_hash();
                if let Some(other) = shown.replace(hash).filter(|shown| *shown != hash) {
                    renderer.forget(other);
                }
                if let Some(prepared) = prepared {
                    renderer.adopt(prepared);
                }
                if !render_series(renderer, &loaded, jobs, finished, shared) {
                    return; // the writers have ended
                }
            }
            Err((jobs, error)) => jobs.iter().for_each(|job| shared.fail(job.borrow(), error.clone())),
        }
        waiting = Instant::now();
    }
    if let Some(last) = shown {
        renderer.forget(last);
    }
}

/// Whether the writers still run.
fn render_series<J: Borrow<Job>>(
    renderer: &mut Renderer,
    loaded: &BudgetedVolume<'_>,
    jobs: Vec<(J, Result<Scene, SeriesError>)>,
    finished: &SyncSender<Finished<J>>,
    shared: &RunState<'_>,
) -> bool {
    for (job, scene) in jobs {
        match scene.and_then(|scene| render(renderer, loaded, scene)) {
            Ok(view) => {
                let (timings, waiting) = (view.frame.timings, Instant::now());
                let picture_warning = warning_of(&view, loaded);
                let picture = Finished { job, view, warnings: loaded.warnings.clone(), picture_warning };
                if finished.send(picture).is_err() {
                    return false;
                }
                shared.change(|Summary { seconds, .. }| {
                    seconds.uploading += timings.upload_ms / 1e3;
                    seconds.rendering += timings.render_ms / 1e3;
                    seconds.waiting_for_writers += waiting.elapsed().as_secs_f64();
                });
            }
            Err(error) => shared.fail(job.borrow(), error),
        }
    }
    true
}

/// The warning about a picture that shows nothing, or has no depth.
fn warning_of(view: &RenderedView, loaded: &BudgetedVolume<'_>) -> Option<String> {
    let subject = Subject::of(&loaded.volume, loaded.labels.as_ref());
    let range_hu = loaded.volume.range_hu();
    let warning = PictureWarning::of(&view.frame, &view.display, &view.request, &subject, range_hu);
    warning.map(|warning| warning.to_string())
}

/// The picture before overlays are drawn.
fn render(
    renderer: &mut Renderer,
    loaded: &BudgetedVolume<'_>,
    scene: Scene,
) -> Result<RenderedView, SeriesError> {
    let mut request = scene.request;
    let overlays = std::mem::replace(&mut request.overlays, Arc::new(Overlays::default()));
    let frame = renderer.render(&loaded.volume, &request).map_err(|error| {
        let kind = match error {
            // The file may exist on another machine, or appear later.
            RenderError::Gpu(GpuError::OutOfMemory { .. }) | RenderError::Cancelled => FailureKind::Retryable,
            RenderError::Gpu(_) => FailureKind::Retryable,
            _ => FailureKind::Permanent,
        };
        SeriesError::new(kind, &error)
    })?;
    request.overlays = overlays;
    let (grid, reference) = (loaded.volume.grid().clone(), loaded.reference.clone());
    Ok(RenderedView { frame, request, display: scene.display, grid, reference })
}

fn write_all<J: Borrow<Job>>(pictures: &Mutex<Receiver<Finished<J>>>, shared: &RunState<'_>) {
    let next = || pictures.lock().recv();
    while let Ok(picture) = next() {
        let (job, started) = (picture.job.borrow(), Instant::now());
        let written = write(&picture, shared);
        shared.change(|summary| summary.seconds.writing += started.elapsed().as_secs_f64());
        match written {
            Ok(record) => {
                shared.change(|summary| summary.done += 1);
                (shared.report)(RunEvent::Done(job, &record));
            }
            Err(error) => shared.fail(job, error),
        }
    }
}

fn write<J: Borrow<Job>>(picture: &Finished<J>, shared: &RunState<'_>) -> Result<Record, SeriesError> {
    let Finished { job, view, warnings, picture_warning } = picture;
    let (job, started) = (job.borrow(), Instant::now());
    let refused =
        |error: std::io::Error| SeriesError::retryable(format_args!("cannot write {}: {error}", job.name()));
    let prepared: Option<Arc<PreparedAnnotations>> =
        job.annotations.as_ref().map(|kept| shared.annotations.get(kept)).transpose()?;
    let made: Outputs = view.outputs(&job.products, prepared.as_deref())?;
    let mut outputs = Vec::new();
    for (product, bytes) in made.files {
        let name = format!("{}.{}", job.view, product.ending());
        let (path, written) = (format!("{}/{name}", job.series.name), OutputFile::new(name, &bytes));
        shared.sink.put_written(&path, bytes, &written).map_err(refused)?;
        outputs.push(written);
    }
    let timings = view.frame.timings;
    let record = Record {
        job: job.job.clone(),
        series: job.series.name.clone(),
        view: job.view.clone(),
        group: job.group.clone(),
        outputs,
        structures: made.structures,
        render_ms: timings.upload_ms + timings.render_ms + timings.overlay_ms,
        write_ms: started.elapsed().as_secs_f64() * 1e3,
        size_px: view.frame.size_px,
        warnings: warnings.iter().chain(&made.warnings).cloned().collect(),
        picture_warning: picture_warning.clone(),
    };
    record.write(job, shared.sink).map_err(refused)?;
    Ok(record)
}
