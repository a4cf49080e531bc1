//! The ray caster in lanes: rays are cast by the processor's vector instructions, without any graphics
//! driver.
//!
//! Its functions follow the shaders and have their names. They are generic over lanes: eight or
//! sixteen of 32 bits render pictures, and one of 64 bits is the reference that shaders are compared with (see
//! `reference`). [`left_by_processor`] names the part of a request that it leaves to a graphics
//! adapter.
//!
//! | here | shader |
//! |---|---|
//! | `ray` | `shaders/lib/frame.wgsl` |
//! | `field` | `shaders/lib/volume.wgsl` |
//! | `walk` | `shaders/lib/walk.wgsl` |
//! | `color` | `shaders/lib/classify.wgsl` |
//! | `sample` | `shaders/lib/gradient.wgsl` |
//! | `segments` | `shaders/lib/labels.wgsl` |
//! | `passage` | `shaders/lib/passage.wgsl` |
//! | `lights` | `shaders/lib/lights.wgsl` |
//! | `illuminate` | `shaders/illuminate.wgsl` |
//! | `composite` | `shaders/raycast.wgsl` |
//! | `crossing` | `shaders/raycast/crossing.wgsl` |
//! | `depth_rules` | `shaders/lib/depth_rules.wgsl` |
//! | `surfaces` | `shaders/raycast/isosurface.wgsl` |
//! | `project` | `shaders/raycast/project.wgsl` |
//! | `slice` | `shaders/slice.wgsl` |
//!
//! Spaces: see each module. Voxels are read in place; the cache holds ranges of bricks.

mod cast;
mod color;
mod composite;
mod crossing;
mod deal;
mod depth_rules;
mod face_zone;
mod faces;
mod field;
mod history;
mod illuminate;
mod light_cells;
mod lights;
mod passage;
mod pending;
mod prepared;
mod project;
mod ray;
mod reference;
mod sample;
mod scene;
mod segments;
mod slice;
mod surfaces;
mod tiles;
mod walk;

use relief_lanes::Level;

use super::appearance::PreparedBricks;
use super::bands::Bands;
use super::detail::Detail;
use super::error::RenderError;
use super::frame::RenderedFrame;
use super::limits::depth_limits;
use super::mode::Mode;
use super::quality::Quality;
use super::request::RenderRequest;
use super::skipping::EmptySpaceSkipping;
use super::store::MemoryUse;
use super::volume_plan::VolumeLimits;
use super::watch::Watch;
use crate::gpu::{AdapterDescription, AdapterKind};
use cast::{Order, Unfinished, Width};
use prepared::Cache;
pub(super) use prepared::PreparedAppearance;
pub use reference::render_reference;
use relief_volume::{ContentHash, Volume};

/// The renderer on the processor.
pub(super) struct Processor {
    level: Level,
    cache: Cache,
    unfinished: Option<Unfinished>,
    bands: Bands,
}

impl Processor {
    pub(super) fn new(level: Level) -> Self {
        Self { level, cache: Cache::default(), unfinished: None, bands: Bands::of_processor() }
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
        if request.detail == Detail::Coarse && request.labels.is_none() {
            let coarse = self.cache.coarse(volume);
            let usual_mm = Quality::Moving.sample_distance_mm(request, coarse.grid());
            let sample_distance_mm = request.sample_distance_mm.max(usual_mm);
            let request = RenderRequest { sample_distance_mm, ..request.clone() };
            let frame = self.cast_all(&coarse, &request, skipping, limits, watch)?;
            // Those of all voxels, which a picture at rest has.
            return Ok(RenderedFrame { limits: depth_limits(&request.camera, volume.grid()), ..frame });
        }
        self.cast_all(volume, request, skipping, limits, watch)
    }

    /// Casts a picture through all voxels of a volume.
    fn cast_all(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        limits: &VolumeLimits,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let plan = &limits.plan(volume.grid().dims())?;
        let (width, bands) = (Width::Single(self.level), self.bands);
        Order { volume, request, skipping, plan, width, bands }.cast(
            &mut self.cache,
            &mut self.unfinished,
            watch,
        )
    }

    /// Sets the size of bands: see [`super::Renderer::set_band_pixels`].
    pub(super) fn set_band_pixels(&mut self, pixels: u32) {
        self.bands = Bands::of_pixels(pixels);
    }

    /// Takes over a volume that another thread has prepared.
    pub(super) fn adopt(&mut self, bricks: PreparedBricks, appearance: Option<PreparedAppearance>) {
        self.cache.adopt(bricks, appearance);
    }

    /// Drops a volume and its appearances from the cache.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.unfinished.take_if(|unfinished| unfinished.is_of(volume));
        self.cache.forget(volume);
    }

    /// Empties the cache.
    pub(super) fn clear(&mut self) {
        self.unfinished = None;
        self.cache.clear();
    }
}

/// The part of a request that the processor's ray caster leaves to a graphics adapter, such as `its
/// mode`; `None` where it casts all.
#[must_use]
pub fn left_by_processor(volume: &Volume, request: &RenderRequest) -> Option<&'static str> {
    if request.mode == Mode::PathTraced {
        return Some("its mode");
    }
    (!field::can_read(volume.grid().dims())).then_some("the size of its volume")
}
