//! Measures one server on this machine: rates of live frames and of requested pictures, rendered
//! and encoded in parallel as a server does it.

use std::collections::VecDeque;
use std::sync::mpsc;
use std::time::Instant;

use parking_lot::Mutex;
use serde::Serialize;

use super::plan::ServerRates;
use super::process_mib;
use crate::StudyError;
use relief_annotation::{Change, Edit, Item};
use relief_display::DisplaySettings;
use relief_live::{ColorFormat, DepthFormat, encode_color, encode_d8};
use relief_render::{RenderRequest, RenderedFrame, Renderer, Scene};
use relief_session::{FileFormat, Product, QueueConfig, RenderService, encode, moving_detail};
use relief_store::Store;
use relief_volume::Volume;

/// Angle between two frames, degrees, so that every frame differs.
const STEP_DEG: f64 = 7.0;
/// Frames before the measurement: pipelines compile, and the service learns the speed of this
/// machine.
const WARM_UP: usize = 4;
/// Moving frames per still frame.
const MOVING_FOR_STILL: usize = 5;
/// JPEG quality of a moving view on a fast connection.
const MOVING_QUALITY: u8 = 85;
/// Number of timed edits.
const EDITS: usize = 100;

/// Rates of one kind of frames.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FrameRates {
    /// Frames per second, rendered and encoded on all cores.
    pub per_s: f64,
    /// Size of the last frame; smaller than requested where the machine is too slow.
    pub size_px: [u32; 2],
    /// Mean size of an encoded frame, bytes.
    pub bytes: f64,
    /// Median time of rendering, ms.
    pub render_ms: f64,
    /// Median time of encoding on one core, ms.
    pub encode_ms: f64,
}

/// The measurements of one server.
#[derive(Clone, Debug, Serialize)]
pub struct CapacityMeasurement {
    /// Name of the adapter.
    pub adapter: String,
    /// Name of its driver.
    pub driver: String,
    /// Cores of the machine.
    pub cores: usize,
    /// Build of this program: `release` or `development`.
    pub build: &'static str,
    /// Voxels of the volume along x, y and z.
    pub dims: [usize; 3],
    /// Frames of a moving view: JPEG, and depth as disparity.
    pub moving: FrameRates,
    /// Frames of a view at rest: lossless.
    pub still: FrameRates,
    /// Pictures by request: display frames as PNG.
    pub view: FrameRates,
    /// Host memory of the voxels, MiB.
    pub voxels_mib: f64,
    /// Memory of the volume on the adapter, MiB. A software adapter uses host memory.
    pub adapter_mib: f64,
    /// Memory of the process before the volume was loaded, MiB; null where the system does not
    /// report it.
    pub base_mib: Option<f64>,
    /// Peak memory of the process, MiB; null where the system does not report it.
    pub peak_mib: Option<f64>,
    /// Edits per second of one writer in SQLite, each durable before the next.
    pub edits_per_s: f64,
}

impl CapacityMeasurement {
    pub(super) fn rates(&self) -> ServerRates {
        ServerRates {
            moving_per_s: self.moving.per_s,
            moving_bytes: self.moving.bytes,
            still_per_s: self.still.per_s,
            still_bytes: self.still.bytes,
            view_per_s: self.view.per_s,
            base_mib: self.base_mib.unwrap_or(0.0),
            volume_mib: self.voxels_mib + self.adapter_mib,
        }
    }
}

/// The parts of the measurement.
struct Bench<'a> {
    service: &'a RenderService,
    volume: &'a Volume,
    scene: &'a Scene,
    cores: usize,
}

/// Measures a server that shows `scene`; `frames` is the number of still frames.
///
/// # Errors
/// When rendering, encoding or storing fails.
pub fn measure_capacity(
    renderer: Renderer,
    volume: &Volume,
    scene: &Scene,
    frames: usize,
    base_mib: Option<f64>,
) -> anyhow::Result<CapacityMeasurement, StudyError> {
    let description = renderer.adapter().clone();
    let cores = std::thread::available_parallelism().map_or(2, std::num::NonZero::get);
    let service = RenderService::start(renderer, QueueConfig { recent_bytes: 0, ..QueueConfig::default() })?;
    let bench = Bench { service: &service, volume, scene, cores };
    let still =
        bench.frames(frames, false, &|frame| live_bytes(frame, &scene.display, ColorFormat::RgbZstd))?;
    let moving = bench.frames(MOVING_FOR_STILL * frames, true, &|frame| {
        live_bytes(frame, &scene.display, ColorFormat::Jpeg)
    })?;
    let view = bench.frames(frames, false, &|frame| {
        Ok(encode(frame, &scene.display, Product::Frame, FileFormat::Png)?.len())
    })?;
    let adapter_bytes = service.memory().used_bytes;
    service.shut_down();
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    Ok(CapacityMeasurement {
        adapter: description.name.clone(),
        driver: description.driver.clone(),
        cores,
        build: if cfg!(debug_assertions) { "development" } else { "release" },
        dims: volume.grid().dims(),
        moving,
        still,
        view,
        voxels_mib: mib((volume.grid().voxel_count() * size_of::<i16>()) as u64),
        adapter_mib: mib(adapter_bytes),
        base_mib,
        peak_mib: process_mib("VmHWM:"),
        edits_per_s: edits_per_s()?,
    })
}

type Encoder<'a> = &'a (dyn Fn(&RenderedFrame) -> Result<usize, StudyError> + Sync);

impl Bench<'_> {
    /// Renders frames one after the other, with two requests queued so that the renderer never
    /// waits, and encodes them on all cores.
    fn frames(&self, count: usize, moving: bool, encoder: Encoder<'_>) -> Result<FrameRates, StudyError> {
        for i in 0..WARM_UP {
            encoder(&self.service.render(self.volume, self.request(i, moving))?.wait()?.frame)?;
        }
        let encoded = Mutex::new(Vec::with_capacity(count));
        let (sender, receiver) = mpsc::sync_channel(2 * self.cores);
        let receiver = Mutex::new(receiver);
        let since = Instant::now();
        let mut rendering = Vec::with_capacity(count);
        let mut size_px = self.scene.request.size_px;
        std::thread::scope(|scope| -> Result<(), StudyError> {
            for _ in 0..self.cores {
                scope.spawn(|| {
                    loop {
                        let next = receiver.lock().recv();
                        let Ok(frame): Result<std::sync::Arc<RenderedFrame>, _> = next else { return };
                        let since = Instant::now();
                        let outcome = encoder(&frame).map(|bytes| (bytes, milliseconds(since)));
                        encoded.lock().push(outcome);
                    }
                });
            }
            let mut ordered = VecDeque::new();
            let mut next = WARM_UP;
            let sender = sender; // dropped at the end of this closure: the encoders end
            while rendering.len() < count {
                while ordered.len() < 2 && next < WARM_UP + count {
                    ordered.push_back(self.service.render(self.volume, self.request(next, moving))?);
                    next += 1;
                }
                let Some(ticket) = ordered.pop_front() else { break };
                let frame = ticket.wait()?.frame;
                rendering.push(frame.timings.upload_ms + frame.timings.render_ms + frame.timings.overlay_ms);
                size_px = frame.size_px;
                if sender.send(frame).is_err() {
                    break; // an encoder panicked; joining its thread reports it
                }
            }
            Ok(())
        })?;
        let per_s = count as f64 / since.elapsed().as_secs_f64();
        let encoded = encoded.into_inner();
        let encoded = encoded.into_iter().collect::<Result<Vec<_>, StudyError>>()?;
        let bytes = encoded.iter().map(|(bytes, _)| *bytes as f64).sum::<f64>() / count as f64;
        let encode_ms = median(encoded.into_iter().map(|(_, ms)| ms).collect());
        Ok(FrameRates { per_s, size_px, bytes, render_ms: median(rendering), encode_ms })
    }

    /// The request from another side, reduced as in a live session if the view moves.
    fn request(&self, i: usize, moving: bool) -> RenderRequest {
        let request = &self.scene.request;
        let camera = request.camera.orbited((i as f64 * STEP_DEG).to_radians());
        let mut request = RenderRequest { camera, ..request.clone() };
        if moving {
            request.illumination.shadows = 0.0;
            request.detail = moving_detail(&request, self.volume.grid());
            request =
                self.service.plan_moving(self.volume.content_hash(), self.volume.grid(), &request).request;
            request.size_px = request.reduced_px.take().unwrap_or(request.size_px);
        }
        request
    }
}

/// Bytes of a live frame: colour in this format, and disparity.
fn live_bytes(
    frame: &RenderedFrame,
    display: &DisplaySettings,
    color: ColorFormat,
) -> Result<usize, StudyError> {
    let size = frame.size_px.map(|side| side as usize);
    let colors = encode_color(size, &frame.color_rgba, color, MOVING_QUALITY)?;
    let picture = frame.picture()?;
    let disparity = display.encoder()?.disparity(&picture, display.limits(frame.limits)?);
    Ok(colors.len() + encode_d8(size, &disparity, DepthFormat::D8Zstd)?.len())
}

fn edits_per_s() -> Result<f64, StudyError> {
    let folder = tempfile::tempdir()?;
    let place = folder.path().join("capacity.db");
    let place = place.to_string_lossy();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(&place).await?;
        let since = Instant::now();
        for i in 0..EDITS {
            let item =
                Box::new(Item::new(&format!("item {i}"), "bench", None).map_err(std::io::Error::other)?);
            let changes = vec![Change::Create { item }];
            store.apply(&Edit { author: "bench".to_owned(), reason: String::new(), changes }).await?;
        }
        let per_s = EDITS as f64 / since.elapsed().as_secs_f64();
        store.close().await;
        Ok(per_s)
    })
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(0.0)
}
