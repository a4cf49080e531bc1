//! `relief bench`: how fast this machine renders a scene, against what its driver could do.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;

use crate::adapter::AdapterArguments;
use crate::bucket::CopiesArguments;
use crate::capacity::{self, CapacityArguments};
use crate::output::{milliseconds, print_json, say};
use crate::scene::SceneArguments;
use crate::series::SeriesArguments;
use crate::source::SeriesOptions;
use relief_render::{
    Clip, ClipPlane, EmptySpaceSkipping, RenderError, RenderRequest, RenderedFrame, Renderer, Subject,
};
use relief_study::process_mib;
use relief_volume::{TransferFunction, Volume};

/// Measure frame times and samples per second of a scene.
///
/// Each frame turns the camera about the up axis, so that nothing is reused; times include
/// read-back. On a graphics adapter, the share compares the samples per second with the driver's
/// filtering rate.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief bench --series head --preset bone
  relief bench --capacity                        how many viewers and views per hour this machine carries
  relief bench --series chest --scene scene.json --frames 20 --json")]
pub(super) struct BenchArguments {
    /// CT series: a folder, a file, a DICOMDIR or a zip; or a volume in HU as .nii, .nii.gz or
    /// .nrrd
    #[arg(long, value_name = "PATH", required_unless_present = "capacity")]
    series: Option<PathBuf>,
    /// Segments of the series: a label map as .nii, .nii.gz, .nrrd or .seg.nrrd, or a DICOM
    /// segmentation
    #[arg(long, value_name = "FILE", requires = "series")]
    labels: Option<PathBuf>,
    #[command(flatten)]
    options: SeriesOptions,
    #[command(flatten)]
    copies: CopiesArguments,
    #[command(flatten)]
    capacity: CapacityArguments,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Frames that are measured, after one that is not
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Angle from frame to frame
    #[arg(long, value_name = "DEG", default_value_t = 20.0, allow_negative_numbers = true)]
    orbit_deg: f64,
    /// Take every sample, also in empty space
    #[arg(long)]
    no_skipping: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The measurements; the README documents the JSON form.
#[derive(Debug, serde::Serialize)]
struct BenchReport {
    adapter: String,
    driver: String,
    size_px: [u32; 2],
    frames: u32,
    median_ms: f64,
    min_ms: f64,
    overlay_ms: f64,
    /// `None` where the processor's own ray caster renders: it has no driver, and counts nothing.
    #[serde(flatten)]
    samples: Option<SampleRates>,
    load_ms: f64,
    upload_ms: f64,
    first_frame_ms: f64,
    /// Preparing another transfer function: its table, the map of empty space, their upload.
    transfer_change_ms: f64,
    /// The same for another clip plane.
    clip_change_ms: f64,
    peak_rss_mib: Option<f64>,
    /// Memory held after the measured frames, less that after the first.
    rss_growth_mib: Option<f64>,
}

pub(super) fn run(arguments: BenchArguments) -> anyhow::Result<ExitCode> {
    let BenchArguments {
        series,
        labels,
        options,
        copies,
        capacity,
        scene,
        adapter,
        frames,
        orbit_deg,
        no_skipping,
        json,
    } = arguments;
    let series = series.map(|series| SeriesArguments { series, labels, options, copies });
    if capacity.capacity {
        let frames = frames as usize;
        let order =
            capacity::CapacityRun { series: series.as_ref(), scene: &scene, adapter: &adapter, frames, json };
        return capacity::run(&capacity, &order);
    }
    let Some(series) = series else { bail!("there is no --series") };
    let scene_file = scene.read()?;
    let start = Instant::now();
    let (loaded, (mut renderer, open_ms)) = series.load_after(|dims| {
        let start = Instant::now();
        Ok((adapter.open_renderer_for(dims)?, milliseconds(start)))
    })?;
    let load_ms = milliseconds(start) - open_ms;
    let labels = series.load_labels(loaded.volume.grid())?;
    let scene = scene_file.resolve_for(&Subject::of(&loaded.volume, labels.as_ref()), &scene.orbit())?;
    scene.expect_no_annotations()?;
    let turntable = Turntable { frames, step: orbit_deg.to_radians() };
    let skipping = if no_skipping { EmptySpaceSkipping::Off } else { EmptySpaceSkipping::On };
    let mut bench = Bench { renderer: &mut renderer, volume: &loaded.volume, skipping };
    let report = bench.measure(&scene.request, turntable, load_ms)?;
    if json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

/// Views of a request around its up axis.
#[derive(Clone, Copy)]
struct Turntable {
    frames: u32,
    /// Radians from frame to frame.
    step: f64,
}

impl Turntable {
    /// The request as frame `i` sees it; frame 0 is the request itself.
    fn frame(self, request: &RenderRequest, i: i32) -> RenderRequest {
        RenderRequest { camera: request.camera.orbited(f64::from(i) * self.step), ..request.clone() }
    }

    fn measured(self, request: &RenderRequest) -> impl Iterator<Item = RenderRequest> {
        (1..).take(self.frames as usize).map(move |i| self.frame(request, i))
    }
}

/// The parts of the measurement.
struct Bench<'a> {
    renderer: &'a mut Renderer,
    volume: &'a Volume,
    skipping: EmptySpaceSkipping,
}

impl Bench<'_> {
    fn measure(
        &mut self,
        request: &RenderRequest,
        turntable: Turntable,
        load_ms: f64,
    ) -> anyhow::Result<BenchReport> {
        let start = Instant::now();
        let first = self.render(&turntable.frame(request, -1))?;
        let first_frame_ms = milliseconds(start);
        let rss_before = process_mib("VmRSS:");
        let (mut times, mut overlay_times) = (Vec::new(), Vec::new());
        for request in turntable.measured(request) {
            let start = Instant::now();
            overlay_times.push(self.render(&request)?.timings.overlay_ms);
            times.push(milliseconds(start));
        }
        let rss_growth_mib = process_mib("VmRSS:").zip(rss_before).map(|(after, before)| after - before);
        times.sort_by(f64::total_cmp);
        overlay_times.sort_by(f64::total_cmp);
        let [median_ms, overlay_ms] = [&times, &overlay_times].map(|sorted| sorted[sorted.len() / 2]);
        let samples = match self.renderer.gpu() {
            Some(_) => Some(self.sample_rates(request, turntable, median_ms)?),
            None => None,
        };
        let (transfer_change_ms, clip_change_ms) = self.changes(request)?;
        let adapter = self.renderer.adapter();
        Ok(BenchReport {
            adapter: adapter.name.clone(),
            driver: adapter.driver.clone(),
            size_px: request.size_px,
            frames: turntable.frames,
            median_ms,
            min_ms: times[0],
            overlay_ms,
            samples,
            load_ms,
            upload_ms: first.timings.upload_ms,
            first_frame_ms,
            transfer_change_ms,
            clip_change_ms,
            peak_rss_mib: process_mib("VmHWM:"),
            rss_growth_mib,
        })
    }

    fn render(&mut self, request: &RenderRequest) -> Result<RenderedFrame, RenderError> {
        self.renderer.render_with(self.volume, request, self.skipping)
    }

    /// Counted apart, so that counting costs no time, and in a few frames of many.
    fn sample_rates(
        &mut self,
        request: &RenderRequest,
        turntable: Turntable,
        median_ms: f64,
    ) -> anyhow::Result<SampleRates> {
        let frames = turntable.frames.min(COUNTED_FRAMES);
        let mut samples = 0;
        for request in (Turntable { frames, ..turntable }).measured(request) {
            samples += self.renderer.count_samples(self.volume, &request, self.skipping)?;
        }
        let samples_per_frame = samples / u64::from(frames);
        let samples_per_s = samples_per_frame as f64 / (median_ms / 1e3);
        let driver_samples_per_s = self.renderer.sampling_rate(self.volume)?;
        let share = samples_per_s / driver_samples_per_s;
        Ok(SampleRates { samples_per_frame, samples_per_s, driver_samples_per_s, share })
    }

    /// Preparation, in ms, of another transfer function and of another clip plane: medians of a
    /// few.
    fn changes(&mut self, request: &RenderRequest) -> anyhow::Result<(f64, f64)> {
        let mut transfer_ms = Vec::new();
        let mut clip_ms = Vec::new();
        for i in 1..=CHANGES {
            let unit_mm = request.transfer.opacity_unit_mm() * (1.0 + f64::from(i) / 100.0);
            let transfer = TransferFunction::new(request.transfer.points().to_vec(), unit_mm)?;
            transfer_ms.push(self.render(&RenderRequest { transfer, ..request.clone() })?.timings.upload_ms);
            let mut clip = request.clip.clone();
            clip.planes.truncate(Clip::MAX_PLANES - 1);
            let toward = (request.camera.look_at() - request.camera.eye()) * (1.0 - f64::from(i) / 100.0);
            let point = request.camera.eye() + toward;
            clip.planes.push(ClipPlane { point, normal: toward });
            clip_ms.push(self.render(&RenderRequest { clip, ..request.clone() })?.timings.upload_ms);
        }
        let median = |mut times: Vec<f64>| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        };
        Ok((median(transfer_ms), median(clip_ms)))
    }
}

/// Volume samples of a graphics adapter.
#[derive(Debug, serde::Serialize)]
struct SampleRates {
    samples_per_frame: u64,
    samples_per_s: f64,
    /// The speed of the driver alone.
    driver_samples_per_s: f64,
    share: f64,
}

/// Frames whose samples are counted.
const COUNTED_FRAMES: u32 = 20;

/// Transfer functions and clip planes that are tried.
const CHANGES: u32 = 5;

fn print(report: &BenchReport) {
    let BenchReport { size_px: [width, height], frames, .. } = report;
    say!("{} ({})", report.adapter, report.driver);
    say!(
        "{width}x{height}, {frames} frames: median {:.1} ms ({:.1} frames/s), fastest {:.1} ms",
        report.median_ms,
        1e3 / report.median_ms,
        report.min_ms
    );
    if let Some(samples) = &report.samples {
        say!(
            "samples: {:.2} million per frame, {:.0} million/s, {:.0} % of the driver's {:.0} million/s",
            samples.samples_per_frame as f64 / 1e6,
            samples.samples_per_s / 1e6,
            samples.share * 100.0,
            samples.driver_samples_per_s / 1e6
        );
    }
    if let Some(growth) = report.rss_growth_mib {
        say!("memory grew by {growth:.2} MiB over these frames");
    }
    if report.overlay_ms > 0.0 {
        say!("of which overlays: median {:.1} ms", report.overlay_ms);
    }
    say!(
        "load {:.0} ms, upload {:.0} ms, first frame {:.0} ms, peak memory {}",
        report.load_ms,
        report.upload_ms,
        report.first_frame_ms,
        report.peak_rss_mib.map_or_else(|| "unknown".to_owned(), |mib| format!("{mib:.0} MiB"))
    );
    say!(
        "another transfer function {:.1} ms, another clip plane {:.1} ms before the frame",
        report.transfer_change_ms,
        report.clip_change_ms
    );
}
