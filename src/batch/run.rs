//! Running: every job that is not done, series by series; while one is rendered the next is loaded and the last is written.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::error::{Failure, Lasting};
use super::files::write_whole;
use super::gate::Gate;
use super::manifest::{Job, JobKey, Product, Shard};
use super::record::{Record, Written};
use super::source::{Loaded, Trouble};
use crate::display::{DisplaySettings, Layout};
use crate::gpu::GpuError;
use crate::render::{RenderError, RenderedFrame, Renderer, Scene, SceneError, SceneFile};
use crate::session::{EncodingError, FileFormat, Product as Picture, encode};
use crate::volume::Volume;

/// What to run and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// The folder of outputs.
    pub out: PathBuf,
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
}

/// Pictures that wait to be written: more would only hold memory.
const WRITES_WAITING: usize = 2;

/// A picture on its way to its files.
struct Finished<'a> {
    job: &'a Job,
    frame: RenderedFrame,
    display: DisplaySettings,
    warnings: Vec<String>,
}

/// What all threads of a run see.
struct Shared<'a> {
    out: &'a Path,
    report: &'a (dyn Fn(Step<'_>) + Sync),
    summary: Mutex<Summary>,
}

/// Runs the jobs that are not done. One job that fails stops no other; `report` hears of each, from several threads.
///
/// # Errors
/// When the folder of outputs cannot be made.
pub fn run(
    renderer: &mut Renderer,
    jobs: &[Job],
    options: &Options,
    report: &(dyn Fn(Step<'_>) + Sync),
) -> std::io::Result<Summary> {
    std::fs::create_dir_all(&options.out)?;
    let shared = Shared { out: &options.out, report, summary: Mutex::default() };
    let pending = pending(jobs, options, &shared);
    let groups: Vec<&[&Job]> = pending.chunk_by(|a, b| a.series == b.series).collect();
    let gate = Gate::new(options.voxel_bytes);
    std::thread::scope(|scope| {
        // Without room: the next series is loaded while this one is rendered, and no further one.
        let (loaded, series) = sync_channel(0);
        let (finished, pictures) = sync_channel(WRITES_WAITING);
        let (gate, groups, shared) = (&gate, &groups, &shared);
        scope.spawn(move || load_all(groups, gate, &loaded));
        scope.spawn(move || write_all(&pictures, shared));
        render_all(renderer, &series, &finished, shared);
    });
    Ok(shared.summary.into_inner().unwrap_or_else(PoisonError::into_inner))
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
    wanted.into_iter().filter(is_done).collect()
}

type Series<'a> = (&'a [&'a Job], Result<Loaded<'a>, Trouble>);

fn load_all<'a>(groups: &'a [&'a [&'a Job]], gate: &'a Gate, loaded: &SyncSender<Series<'a>>) {
    for group in groups {
        let series = group[0].series.load(gate);
        if loaded.send((group, series)).is_err() {
            return; // nobody renders any more
        }
    }
}

fn render_all<'a>(
    renderer: &mut Renderer,
    series: &Receiver<Series<'a>>,
    finished: &SyncSender<Finished<'a>>,
    shared: &Shared<'_>,
) {
    for (jobs, loaded) in series {
        let loaded = match loaded {
            Ok(loaded) => loaded,
            Err(trouble) => {
                jobs.iter().for_each(|job| shared.fail(job, trouble.clone()));
                continue;
            }
        };
        shared.change(|summary| summary.loaded += 1);
        for job in jobs {
            match render(renderer, &loaded.volume, job) {
                Ok((frame, display)) => {
                    let picture = Finished { job, frame, display, warnings: loaded.warnings.clone() };
                    if finished.send(picture).is_err() {
                        return; // nobody writes any more
                    }
                }
                Err(trouble) => shared.fail(job, trouble),
            }
        }
        renderer.forget(loaded.volume.content_hash());
    }
}

fn render(
    renderer: &mut Renderer,
    volume: &Volume,
    job: &Job,
) -> Result<(RenderedFrame, DisplaySettings), Trouble> {
    let permanent = |error: SceneError| (Lasting::Permanent, error.to_string());
    let file = SceneFile::parse(job.scene.to_string().as_bytes()).map_err(permanent)?;
    let scene: Scene = file.resolve(volume.grid(), &job.orbit).map_err(permanent)?;
    scene.expect_no_annotations().map_err(permanent)?;
    if job.products.contains(&Product::Frame) {
        scene.expect_size_of_layout().map_err(permanent)?;
    }
    let frame = renderer.render(volume, &scene.request).map_err(|error| {
        let kind = match error {
            // Another machine, or this one at another time, may have what was missing.
            RenderError::Gpu(GpuError::OutOfMemory { .. }) | RenderError::Cancelled => Lasting::Retryable,
            RenderError::Gpu(_) => Lasting::Retryable,
            _ => Lasting::Permanent,
        };
        (kind, error.to_string())
    })?;
    Ok((frame, scene.display))
}

fn write_all(pictures: &Receiver<Finished<'_>>, shared: &Shared<'_>) {
    for picture in pictures {
        match write(&picture, shared.out) {
            Ok(record) => {
                shared.change(|summary| summary.done += 1);
                (shared.report)(Step::Done(picture.job, &record));
            }
            Err(trouble) => shared.fail(picture.job, trouble),
        }
    }
}

fn write(picture: &Finished<'_>, out: &Path) -> Result<Record, Trouble> {
    let Finished { job, frame, display, warnings } = picture;
    let started = Instant::now();
    let folder = out.join(&job.series.name);
    let refused =
        |error: std::io::Error| (Lasting::Retryable, format!("cannot write {}: {error}", job.name()));
    std::fs::create_dir_all(&folder).map_err(refused)?;
    let mut outputs = Vec::new();
    for product in &job.products {
        let bytes =
            bytes_of(frame, display, *product).map_err(|error| (Lasting::Permanent, error.to_string()))?;
        let name = format!("{}.{}", job.view, product.ending());
        write_whole(&folder.join(&name), &bytes).map_err(refused)?;
        outputs.push(Written::new(name, &bytes));
    }
    let timings = frame.timings;
    let record = Record {
        job: job.job.clone(),
        series: job.series.name.clone(),
        view: job.view.clone(),
        group: job.group.clone(),
        outputs,
        render_ms: timings.upload_ms + timings.render_ms + timings.overlay_ms,
        write_ms: started.elapsed().as_secs_f64() * 1e3,
        size_px: frame.size_px,
        warnings: warnings.clone(),
    };
    record.write(job, &folder).map_err(refused)?;
    Ok(record)
}

fn bytes_of(
    frame: &RenderedFrame,
    display: &DisplaySettings,
    product: Product,
) -> Result<Vec<u8>, EncodingError> {
    match product {
        Product::Frame => encode(frame, display, Picture::Frame, FileFormat::Png),
        Product::Color => {
            let alone = DisplaySettings { layout: Layout::Color, ..display.clone() };
            encode(frame, &alone, Picture::Frame, FileFormat::Png)
        }
        Product::Depth => encode(frame, display, Picture::Depth, FileFormat::Exr),
    }
}

impl Shared<'_> {
    fn change(&self, change: impl FnOnce(&mut Summary)) {
        change(&mut self.summary.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn fail(&self, job: &Job, (kind, reason): Trouble) {
        let failure = Failure { job: job.job.0.clone(), name: job.name(), kind, reason };
        (self.report)(Step::Failed(&failure));
        self.change(|summary| summary.failures.push(failure));
    }
}
