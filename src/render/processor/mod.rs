//! The renderer on the processor: rays are cast by vector instructions, without any graphics driver.
//!
//! It casts composite pictures; [`left_by_processor`] names the part of a request that it leaves to
//! a graphics adapter. Its functions follow the shaders and have their names. They are generic over
//! lanes: eight of 32 bits render pictures, and tests compare one of 64 bits with `reference`.
//!
//! Spaces: see each module. Voxels are read in place; the cache holds ranges of bricks.

mod color;
mod composite;
mod crossing;
mod field;
mod prepared;
mod ray;
mod tiles;
mod walk;

use std::time::Instant;

use rayon::prelude::*;
use relief_lanes::{Level, dispatch};

use super::bands::Bands;
use super::classification::Classification;
use super::error::RenderError;
use super::frame::{RenderedFrame, Timings};
use super::mode::Mode;
use super::region::Region;
use super::request::{DepthRule, RenderRequest};
use super::skipping::EmptySpaceSkipping;
use super::store::{MemoryUse, VolumeLimits};
use super::target::background;
use super::watch::Watch;
use crate::gpu::{AdapterDescription, AdapterKind};
use crate::limits::depth_limits;
use prepared::Cache;
use relief_volume::{ContentHash, Volume};
use tiles::{Job, Rows};

/// Rows of pixels that a thread takes at a time.
const ROWS: u32 = 4;

/// The renderer on the processor.
pub(super) struct Processor {
    level: Level,
    cache: Cache,
    bands: Bands,
}

#[cfg(test)]
mod tests;

impl Processor {
    pub(super) fn new() -> Self {
        Self { level: Level::widest(), cache: Cache::default(), bands: Bands::of_processor() }
    }

    /// The processor in words.
    pub(super) fn description(&self) -> AdapterDescription {
        let threads = rayon::current_num_threads();
        AdapterDescription {
            name: format!("processor, {threads} threads"),
            driver: format!("relief {}", env!("CARGO_PKG_VERSION")),
            backend: self.level.name().to_owned(),
            kind: AdapterKind::Processor,
        }
    }

    /// The size of the cache. `limit_bytes` is the limit of all volumes together; it is reported, and
    /// the cache holds at most 16 volumes and 16 appearances.
    pub(super) fn memory(&self, limit_bytes: u64) -> MemoryUse {
        MemoryUse { limit_bytes, ..self.cache.memory() }
    }

    /// Casts a picture, without overlays.
    pub(super) fn cast(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        limits: &VolumeLimits,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let start = Instant::now();
        let plan = limits.plan(volume.grid().dims())?;
        let (prepared, is_new) = self.cache.prepare(volume, request, &plan);
        let upload_ms = if is_new { milliseconds(start) } else { 0.0 };
        let start = Instant::now();
        let region = match skipping {
            EmptySpaceSkipping::Off => Region::whole(request.size_px),
            EmptySpaceSkipping::On => Region::of(request, volume.grid(), &prepared.bricks),
        };
        let [width, height] = request.size_px.map(|side| side as usize);
        let mut color_rgba = vec![background(request); width * height];
        let mut depth_mm = vec![f32::INFINITY; width * height];
        let job = Job { volume, request, prepared, skipping };
        let level = self.level;
        let cast = |first_row: u32, rows: u32| {
            let pixels = first_row as usize * width..(first_row + rows) as usize * width;
            let chunk = ROWS as usize * width;
            let colors = color_rgba[pixels.clone()].par_chunks_mut(chunk);
            let depths = depth_mm[pixels].par_chunks_mut(chunk);
            colors.zip(depths).enumerate().for_each(|(i, (color_rgba, depth_mm))| {
                let first = first_row + i as u32 * ROWS;
                dispatch(level, Rows { job, region, first, color_rgba, depth_mm });
            });
        };
        self.bands.for_rays(request.samples_of_ray(volume.grid())).each(region, cast, watch)?;
        Ok(RenderedFrame {
            size_px: request.size_px,
            color_rgba,
            depth_mm,
            back: None,
            camera: request.camera,
            limits: depth_limits(&request.camera, volume.grid()),
            nearest_ball_mm: None,
            timings: Timings { upload_ms, render_ms: milliseconds(start), overlay_ms: 0.0 },
        })
    }

    /// Makes bands short or long: see [`super::Renderer::set_short_bands`].
    pub(super) fn set_short_bands(&mut self, are_short: bool) {
        self.bands = self.bands.shortened(are_short);
    }

    /// Sets the size of bands: see [`super::Renderer::set_band_pixels`].
    pub(super) fn set_band_pixels(&mut self, pixels: u32) {
        self.bands = Bands::of_pixels(pixels);
    }

    /// Drops a volume and its appearances from the cache.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.cache.forget(volume);
    }

    /// Empties the cache.
    pub(super) fn clear(&mut self) {
        self.cache.clear();
    }
}

/// The part of a request that the processor's ray caster leaves to a graphics adapter, such as `its
/// mode`; `None` where it casts all.
#[must_use]
pub fn left_by_processor(volume: &Volume, request: &RenderRequest) -> Option<&'static str> {
    let has_rule = matches!(request.depth, DepthRule::Threshold { .. } | DepthRule::FirstHit);
    [
        (request.mode != Mode::Composite, "its mode"),
        (request.classification != Classification::Sampled, "its classification"),
        (!has_rule, "its depth rule"),
        (request.labels.is_some(), "its segments"),
        (request.has_own_light(), "its lights"),
        (request.transfer.gradient_opacity().is_some(), "its opacity by gradient"),
        (!field::can_read(volume.grid().dims()), "the size of its volume"),
    ]
    .into_iter()
    .find_map(|(is_beyond, part)| is_beyond.then_some(part))
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
