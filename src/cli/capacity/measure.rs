//! What one server of this machine does: the frames of live views and of requests, rendered and encoded side by side as it does it.

use relief_session::encode;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError, mpsc};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;

use super::plan::Rates;
use crate::memory::process_mib;
use relief_annotation::{Change, Edit, Item};
use relief_display::{DisplaySettings, Picture};
use relief_live::{ColorFormat, DepthFormat, encode_color, encode_d8};
use relief_render::{RenderRequest, RenderedFrame, Renderer, Scene};
use relief_session::{FileFormat, INTERACTIVE_MS, Product, QueueConfig, RenderService};
use relief_store::Store;
use relief_volume::Volume;

/// Between two frames, degrees: every frame is another one.
const STEP_DEG: f64 = 7.0;
/// Frames before those that count: pipelines compile, and the speed of this machine is learnt.
const WARM_UP: usize = 4;
/// Moving frames for each of full size.
const MOVING_FOR_STILL: usize = 5;
/// JPEG of a moving view, where the connection is quick; lossless formats have no quality.
const MOVING_QUALITY: u8 = 85;
/// Edits that are timed.
const EDITS: usize = 100;

/// What was measured of one kind of frames.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Frames {
    /// Rendered and encoded, as many at a time as there are cores.
    pub(super) per_s: f64,
    /// Of the last one; fewer than ordered where the machine is too slow for the size.
    pub(super) size_px: [u32; 2],
    /// Mean bytes.
    pub(super) bytes: f64,
    /// Median time of rendering, ms.
    pub(super) render_ms: f64,
    /// Median time of encoding on one core beside all else, ms.
    pub(super) encode_ms: f64,
}

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Measured {
    pub(super) adapter: String,
    pub(super) driver: String,
    pub(super) cores: usize,
    /// Of this program: `release` or `development`.
    pub(super) build: &'static str,
    pub(super) dims: [usize; 3],
    /// While a view moves: JPEG, and depth as disparity.
    pub(super) moving: Frames,
    /// When it stands still: lossless.
    pub(super) still: Frames,
    /// By request: the display's frame as PNG.
    pub(super) view: Frames,
    /// Voxels of the volume, and what the adapter has of it, MiB. Of a software adapter both are the machine's memory.
    pub(super) voxels_mib: f64,
    pub(super) adapter_mib: f64,
    /// Memory of the process before the volume was there, and at most, MiB; null where the system does not say.
    pub(super) base_mib: Option<f64>,
    pub(super) peak_mib: Option<f64>,
    /// Edits per second of one writer, each on the disk before the next, in SQLite.
    pub(super) edits_per_s: f64,
}

impl Measured {
    pub(super) fn rates(&self) -> Rates {
        Rates {
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

/// What is measured with.
struct Bench<'a> {
    service: &'a RenderService,
    volume: &'a Volume,
    scene: &'a Scene,
    cores: usize,
}

/// Measures with the scene's picture; `frames` of full size.
pub(super) fn measure(
    renderer: Renderer,
    volume: &Volume,
    scene: &Scene,
    frames: usize,
    base_mib: Option<f64>,
) -> anyhow::Result<Measured> {
    let description = renderer.gpu().description().clone();
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
    Ok(Measured {
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

type Encoder<'a> = &'a (dyn Fn(&RenderedFrame) -> anyhow::Result<usize> + Sync);

impl Bench<'_> {
    /// Orders frames one behind the other, two at a time so that the renderer never waits, and encodes them on as many threads as
    /// there are cores.
    fn frames(&self, count: usize, moving: bool, encoder: Encoder<'_>) -> anyhow::Result<Frames> {
        for i in 0..WARM_UP {
            encoder(&self.service.render(self.volume, self.request(i, moving))?.wait()?.frame)?;
        }
        let encoded = Mutex::new(Vec::with_capacity(count));
        let (sender, receiver) = mpsc::sync_channel(2 * self.cores);
        let receiver = Mutex::new(receiver);
        let since = Instant::now();
        let mut rendering = Vec::with_capacity(count);
        let mut size_px = self.scene.request.size_px;
        std::thread::scope(|scope| -> anyhow::Result<()> {
            for _ in 0..self.cores {
                scope.spawn(|| {
                    loop {
                        let next = receiver.lock().unwrap_or_else(PoisonError::into_inner).recv();
                        let Ok(frame): Result<std::sync::Arc<RenderedFrame>, _> = next else { return };
                        let since = Instant::now();
                        let outcome = encoder(&frame).map(|bytes| (bytes, milliseconds(since)));
                        encoded.lock().unwrap_or_else(PoisonError::into_inner).push(outcome);
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
                sender.send(frame).context("the encoders have ended")?;
            }
            Ok(())
        })?;
        let per_s = count as f64 / since.elapsed().as_secs_f64();
        let encoded = encoded.into_inner().unwrap_or_else(PoisonError::into_inner);
        let encoded = encoded.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
        let bytes = encoded.iter().map(|(bytes, _)| *bytes as f64).sum::<f64>() / count as f64;
        let encode_ms = median(encoded.into_iter().map(|(_, ms)| ms).collect());
        Ok(Frames { per_s, size_px, bytes, render_ms: median(rendering), encode_ms })
    }

    /// The picture from another side; as small as live sessions make it where the view moves.
    fn request(&self, i: usize, moving: bool) -> RenderRequest {
        let request = &self.scene.request;
        let camera = request.camera.orbited((i as f64 * STEP_DEG).to_radians());
        let mut request = RenderRequest { camera, ..request.clone() };
        if moving {
            request.illumination.shadows = 0.0;
            request = self
                .service
                .plan(self.volume.content_hash(), self.volume.grid(), &request, INTERACTIVE_MS)
                .request;
            request.size_px = request.reduced_px.take().unwrap_or(request.size_px);
        }
        request
    }
}

/// Bytes of a live frame: colour in this format, and disparity.
fn live_bytes(frame: &RenderedFrame, display: &DisplaySettings, color: ColorFormat) -> anyhow::Result<usize> {
    let size = frame.size_px.map(|side| side as usize);
    let colors = encode_color(size, &frame.color_rgba, color, MOVING_QUALITY)?;
    let picture = Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm)?;
    let disparity = display.encoder()?.disparity(&picture, display.limits(frame.limits)?);
    Ok(colors.len() + encode_d8(size, &disparity, DepthFormat::D8Zstd)?.len())
}

fn edits_per_s() -> anyhow::Result<f64> {
    let folder = tempfile::tempdir()?;
    let place = folder.path().join("capacity.db");
    let place = place.to_str().context("the temporary folder's name is no UTF-8")?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(place).await?;
        let since = Instant::now();
        for i in 0..EDITS {
            let item = Box::new(Item::new(&format!("item {i}"), "bench", None)?);
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
