//! Running: every job that is not done, series by series; while one is rendered the next is loaded
//! and the last is written.

use std::borrow::Borrow;
use std::collections::HashSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::annotations::{LastAnnotations, PreparedAnnotations};
use super::copies::Copies;
use super::error::{Failure, FailureKind, SeriesError};
use super::gate::MemoryBudget;
use super::manifest::{Job, JobKey, Shard};
use super::outputs::{Outputs, RenderedView};
use super::record::Record;
use super::sink::Sink;
use super::source::{BudgetedVolume, SeriesSource};
use crate::output_file::OutputFile;
use relief_render::{
    GpuError, Overlays, PictureWarning, RenderError, Renderer, Scene, SceneError, SceneFile, Subject,
};

/// The jobs to run, and how to run them.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where outputs go.
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
    /// Where the time went.
    pub seconds: Seconds,
}

/// Seconds of a run by activity. Loading, rendering and writing run in parallel.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seconds {
    /// Checking which jobs are done.
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

/// Why a run did not start.
#[derive(Debug)]
pub enum RunError<E> {
    /// The folder of outputs cannot be created, or the bucket cannot be reached.
    Out(std::io::Error),
    /// The renderer cannot be opened.
    Renderer(E),
}

/// How long a permanent failure of a series holds: it may be mended while a worker runs.
const BROKEN_FOR: Duration = Duration::from_secs(10);
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

/// State that all threads of a run share.
pub(super) struct RunState<'a> {
    sink: &'a Sink,
    report: &'a (dyn Fn(RunEvent<'_>) + Sync),
    annotations: LastAnnotations,
    summary: Mutex<Summary>,
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
    std::thread::scope(|scope| {
        scope.spawn(move || load_all(groups, copies, gate, &loaded, shared));
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

type Series<'a, J> = (Vec<J>, Result<Arc<BudgetedVolume<'a>>, SeriesError>);

/// The series that was loaded last, or its error.
struct Last<'a> {
    source: SeriesSource,
    series: Result<Arc<BudgetedVolume<'a>>, SeriesError>,
    at: Instant,
}

impl Last<'_> {
    /// Whether the result holds for another job. A series that cannot be read is not read again for
    /// each of its views, for a while.
    fn holds_for(&self, wanted: &SeriesSource) -> bool {
        let holds = match &self.series {
            Ok(_) => true,
            Err(error) => error.kind == FailureKind::Permanent && self.at.elapsed() < BROKEN_FOR,
        };
        holds && self.source == *wanted
    }
}

fn load_all<'a, J: Borrow<Job>>(
    groups: impl Iterator<Item = Vec<J>>,
    copies: &Copies,
    gate: &'a MemoryBudget,
    loaded: &SyncSender<Series<'a, J>>,
    shared: &RunState<'_>,
) {
    let mut last: Option<Last<'a>> = None;
    for group in groups {
        let Some(wanted) = group.first().map(|job| job.borrow().series.clone()) else { continue };
        if !last.as_ref().is_some_and(|last| last.holds_for(&wanted)) {
            // The bytes of the last series are released first: the next one may need them.
            last = None;
        }
        let Last { series, .. } = last.get_or_insert_with(|| {
            let started = Instant::now();
            let series = wanted.load(gate, copies).map(Arc::new);
            // The renderer needs the hash. It is computed here, beside the rendering of another series.
            let _ = series.as_ref().map(|loaded| loaded.volume.content_hash());
            shared.change(|summary| {
                summary.loaded += usize::from(series.is_ok());
                summary.seconds.loading += started.elapsed().as_secs_f64();
            });
            Last { source: wanted, series, at: Instant::now() }
        });
        let series = series.clone();
        if loaded.send((group, series)).is_err() {
            return; // the renderer has ended
        }
    }
}

fn render_all<'a, J: Borrow<Job>>(
    renderer: &mut Renderer,
    series: &Receiver<Series<'a, J>>,
    finished: &SyncSender<Finished<J>>,
    shared: &RunState<'_>,
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
                    return; // the writers have ended
                }
            }
            Err(error) => jobs.iter().for_each(|job| shared.fail(job.borrow(), error.clone())),
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
    jobs: Vec<J>,
    finished: &SyncSender<Finished<J>>,
    shared: &RunState<'_>,
) -> bool {
    for job in jobs {
        match render(renderer, loaded, job.borrow()) {
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
    job: &Job,
) -> Result<RenderedView, SeriesError> {
    let (volume, labels) = (&loaded.volume, loaded.labels.as_ref());
    let permanent = |error: SceneError| SeriesError::permanent(&error);
    let file = SceneFile::from_value(&job.scene).map_err(permanent)?;
    let scene: Scene = file.resolve_for(&Subject::of(volume, labels), &job.orbit).map_err(permanent)?;
    scene.expect_no_annotations().map_err(permanent)?;
    if job.products.iter().any(|product| product.is_frame()) {
        scene.expect_size_of_layout().map_err(permanent)?;
    }
    let mut request = scene.request;
    let overlays = std::mem::replace(&mut request.overlays, Arc::new(Overlays::default()));
    let frame = renderer.render(volume, &request).map_err(|error| {
        let kind = match error {
            // The file may exist on another machine, or appear later.
            RenderError::Gpu(GpuError::OutOfMemory { .. }) | RenderError::Cancelled => FailureKind::Retryable,
            RenderError::Gpu(_) => FailureKind::Retryable,
            _ => FailureKind::Permanent,
        };
        SeriesError::new(kind, &error)
    })?;
    request.overlays = overlays;
    let (grid, reference) = (volume.grid().clone(), loaded.reference.clone());
    Ok(RenderedView { frame, request, display: scene.display, grid, reference })
}

fn write_all<J: Borrow<Job>>(pictures: &Mutex<Receiver<Finished<J>>>, shared: &RunState<'_>) {
    let next = || pictures.lock().unwrap_or_else(PoisonError::into_inner).recv();
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

impl<'a> RunState<'a> {
    pub(super) fn new(sink: &'a Sink, report: &'a (dyn Fn(RunEvent<'_>) + Sync)) -> Self {
        Self { sink, report, annotations: LastAnnotations::default(), summary: Mutex::default() }
    }

    pub(super) fn into_summary(self) -> Summary {
        self.summary.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut Summary)) {
        change(&mut self.summary.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn fail(&self, job: &Job, SeriesError { kind, reason }: SeriesError) {
        let failure = Failure { job: job.job.0.clone(), name: job.name(), kind, reason };
        (self.report)(RunEvent::Failed(&failure));
        self.change(|summary| summary.failures.push(failure));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CopiesOptions, Product};
    use relief_volume::Orbit;

    #[test]
    fn a_series_that_is_broken_for_good_is_not_read_again_for_each_of_its_views() {
        let folder = tempfile::tempdir().unwrap();
        let source = |name: &str| {
            let (path, name) = (folder.path().join(name), name.to_owned());
            SeriesSource { path, uid: None, name, sha256: "0".repeat(64), labels: None }
        };
        let job = |series: &str, view: &str| {
            let (scene, orbit) = (serde_json::json!({}), Orbit::default());
            let (view, group) = (view.to_owned(), String::new());
            vec![Job::new(source(series), view, group, scene, orbit, vec![Product::Color], None)]
        };
        // Reading it again would give another error, because the folder exists by then.
        let mut groups = vec![job("b", "one"), job("a", "two"), job("a", "one")];
        let path = folder.path().join("a");
        let groups = std::iter::from_fn(|| {
            let group = groups.pop()?;
            if group[0].view == "two" {
                std::fs::create_dir(&path).unwrap();
            }
            Some(group)
        });
        let copies = Copies::new(CopiesOptions::default());
        let (sink, gate) = (Sink::Folder(folder.path().join("out")), MemoryBudget::new(1 << 20));
        let shared = RunState::new(&sink, &|_| ());
        let (send, series) = sync_channel(3);
        load_all(groups, &copies, &gate, &send, &shared);
        drop(send);
        let reasons: Vec<SeriesError> = series.iter().map(|(_, loaded)| loaded.unwrap_err()).collect();
        assert_eq!(reasons[0], reasons[1]);
        assert_eq!(reasons.len(), 3);
        let again = source("a").load(&gate, &copies).unwrap_err();
        assert!(again.kind == FailureKind::Permanent && again != reasons[0], "{again:?}");
    }
}
