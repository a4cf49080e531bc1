//! The renderer: takes a request to the processor or to a graphics adapter, and draws overlays.

use std::ops::ControlFlow;
use std::time::Instant;

use super::display_depth::ForViews;
use super::enlarge::enlarged;
use super::error::RenderError;
use super::for_views::{Unfinished, ViewsBeside, displayed};
use super::frame::RenderedFrame;
use super::gpu_rays::GpuRays;
use super::letters;
use super::overlay::Drawing;
use super::preparation::{Preparation, PreparedVolume};
use super::processor::{Processor, left_by_processor};
use super::request::{DepthRule, RenderRequest};
use super::skipping::EmptySpaceSkipping;
use super::store::MemoryUse;
use super::table_mark;
use super::volume_plan::VolumeLimits;
use super::watch::{Progress, Watch};
use crate::gpu::{AdapterChoice, AdapterDescription, Gpu, GpuError, StallError, adapters, has_card};
use relief_lanes::Level;
use relief_volume::{ContentHash, Volume};

/// Renders requests. Lives on one thread; a volume is prepared on first use.
pub struct Renderer {
    adapter: AdapterDescription,
    /// Casts the pictures that it can, where there is one.
    processor: Option<Processor>,
    /// Casts everything else. Beside a processor it is opened on first use.
    gpu: Option<GpuRays>,
    limits: VolumeLimits,
    band_pixels: Option<u32>,
    has_short_bands: bool,
    /// Whether it was made to fail.
    is_lost: bool,
    /// The part of the last picture's request that the processor left to a graphics adapter.
    left: Option<&'static str>,
    /// A picture that waits for the views beside it.
    unfinished: Option<Unfinished>,
}

impl Renderer {
    /// The renderer of a choice: [`AdapterChoice::Best`] takes a graphics card where there is one,
    /// and the processor elsewhere.
    ///
    /// # Errors
    /// When there is no such adapter, or it refuses the device or the shaders.
    pub fn open(choice: &AdapterChoice) -> Result<Self, RenderError> {
        match choice {
            AdapterChoice::Processor => Ok(Self::on_processor()),
            AdapterChoice::Best if !has_card() => Ok(Self::on_processor()),
            _ => Self::new(Gpu::open(choice)?),
        }
    }

    /// A renderer on this GPU.
    ///
    /// # Errors
    /// When the adapter refuses the shaders.
    pub fn new(gpu: Gpu) -> Result<Self, RenderError> {
        let adapter = gpu.description().clone();
        let gpu = GpuRays::new(gpu)?;
        let limits = gpu.volume_limits();
        Ok(Self {
            adapter,
            processor: None,
            gpu: Some(gpu),
            limits,
            band_pixels: None,
            has_short_bands: false,
            is_lost: false,
            left: None,
            unfinished: None,
        })
    }

    /// A renderer on the processor, which needs no graphics driver. Other requests fall to the best
    /// graphics adapter, where there is one.
    #[must_use]
    pub fn on_processor() -> Self {
        Self::on_processor_with(Level::widest())
    }

    /// As [`Renderer::on_processor`], with these vector instructions. Pictures have the same bytes with
    /// every set.
    #[must_use]
    pub fn on_processor_with(instructions: Level) -> Self {
        let processor = Processor::new(instructions);
        Self {
            adapter: processor.description(),
            processor: Some(processor),
            gpu: None,
            limits: VolumeLimits::of_processor(),
            band_pixels: None,
            has_short_bands: false,
            is_lost: false,
            left: None,
            unfinished: None,
        }
    }

    /// The adapter that rendered the last picture, or will render the first.
    #[must_use]
    pub fn adapter(&self) -> &AdapterDescription {
        match (&self.gpu, self.left) {
            (Some(gpu), Some(_)) => gpu.gpu().description(),
            _ => &self.adapter,
        }
    }

    /// The part of a renderer that decides the bytes of pictures, beside the build and the request:
    /// renderers of one identity make equal pictures. The number of threads and the vector
    /// instructions of a processor are not part of it; the graphics adapters that it leaves something
    /// to are.
    #[must_use]
    pub fn identity(&self) -> String {
        if self.processor.is_none() {
            return self.adapter.to_string();
        }
        let others: Vec<String> = adapters().iter().map(ToString::to_string).collect();
        format!("processor; {}", others.join("; "))
    }

    /// The part of the last picture's request that the processor left to a graphics adapter, such as
    /// `its mode`; `None` where nothing was left.
    #[must_use]
    pub fn left_by_processor(&self) -> Option<&'static str> {
        self.left
    }

    /// The GPU in use; `None` while only the processor renders.
    #[must_use]
    pub fn gpu(&self) -> Option<&Gpu> {
        self.gpu.as_ref().map(GpuRays::gpu)
    }

    /// The limits of volumes.
    #[must_use]
    pub fn volume_limits(&self) -> VolumeLimits {
        self.gpu.as_ref().filter(|_| self.processor.is_none()).map_or(self.limits, GpuRays::volume_limits)
    }

    /// Replaces what volumes may need, for those that are prepared from now on. Values beyond those
    /// of the adapter, and more than [`VolumeLimits::BRICKS`] bricks, are cut to them.
    pub fn set_volume_limits(&mut self, limits: VolumeLimits) {
        self.limits =
            if self.processor.is_some() { limits.within(VolumeLimits::of_processor()) } else { limits };
        if let Some(gpu) = &mut self.gpu {
            gpu.set_volume_limits(limits);
        }
    }

    /// The cached data.
    #[must_use]
    pub fn memory(&self) -> MemoryUse {
        let of_gpu = self.gpu.as_ref().map(GpuRays::memory);
        match &self.processor {
            None => of_gpu.unwrap_or_default(),
            Some(processor) => processor.memory(self.limits.memory_bytes).with(of_gpu.unwrap_or_default()),
        }
    }

    /// Sets the approximate number of pixels of a band, at least a whole row of tiles; a picture
    /// can be cancelled between bands. The bytes do not depend on it. By default, the ray caster on the
    /// processor asks every millisecond, bands of software adapters get the size that takes 16 ms, and
    /// others have 2^22 pixels or fewer where rays are long.
    pub fn set_band_pixels(&mut self, pixels: u32) {
        self.band_pixels = Some(pixels);
        self.apply_bands();
    }

    /// Makes bands of software adapters short, 4 ms: a picture is cancelled sooner, and takes about
    /// a fifth longer. The bytes do not depend on it.
    pub fn set_short_bands(&mut self, are_short: bool) {
        self.has_short_bands = are_short;
        self.apply_bands();
    }

    fn apply_bands(&mut self) {
        let (pixels, are_short) = (self.band_pixels, self.has_short_bands);
        if let Some(processor) = &mut self.processor {
            pixels.into_iter().for_each(|pixels| processor.set_band_pixels(pixels));
        }
        if let Some(gpu) = &mut self.gpu {
            pixels.into_iter().for_each(|pixels| gpu.set_band_pixels(pixels));
            gpu.set_short_bands(are_short);
        }
    }

    /// Renders one picture.
    ///
    /// # Errors
    /// When the request is out of range, the volume too large for the adapter, or the adapter
    /// fails.
    pub fn render(&mut self, volume: &Volume, request: &RenderRequest) -> Result<RenderedFrame, RenderError> {
        self.render_with(volume, request, EmptySpaceSkipping::On)
    }

    /// Like [`Renderer::render`]. Calls `goes_on` with the progress after every band, and after
    /// every pass of mode path-traced; it may cancel the picture. Submitted work, at most a band,
    /// is finished nevertheless. An equal request on a graphics adapter continues the picture that
    /// was cancelled last, from its rows or passes; its bytes are the same.
    ///
    /// # Errors
    /// As [`Renderer::render`], and [`RenderError::Cancelled`] when `goes_on` breaks off.
    pub fn render_watched(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, RenderError> {
        self.render_as(volume, request, EmptySpaceSkipping::On, &mut Watch::new(goes_on))
    }

    /// As [`Renderer::render`], with a say over empty-space skipping by rays. A path-traced picture
    /// has their depth, and otherwise always skips.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render_with(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
    ) -> Result<RenderedFrame, RenderError> {
        self.render_as(volume, request, skipping, &mut Watch::new(&mut |_| ControlFlow::Continue(())))
    }

    fn render_as(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let table = request.marked_table(volume);
        let volume = request.shown(volume);
        request.validate_on(volume.grid())?;
        let for_views = request.display_of_depth();
        let casts_views = request.casts_views_beside();
        let of_rays = (request.depth == DepthRule::Views).then(|| request.of_rays());
        let request = of_rays.as_ref().unwrap_or(request);
        let preparing = Instant::now();
        let drawing = Drawing::new(request, volume.grid())?;
        let preparing_ms = milliseconds(preparing);
        let mut frame = match request.reduced_px {
            None if request.blocks.is_some() && (drawing.is_some() || request.letters) => {
                let whole = RenderRequest { blocks: None, ..request.clone() };
                self.rays(volume, &whole, skipping, watch)?
            }
            None => match for_views.filter(|_| casts_views) {
                Some(for_views) => self.rays_for_views(volume, (for_views, request), skipping, watch)?,
                None => self.rays(volume, request, skipping, watch)?,
            },
            Some(size_px) => {
                let reduced = RenderRequest { size_px, reduced_px: None, blocks: None, ..request.clone() };
                let frame = self.rays(volume, &reduced, skipping, watch)?;
                let start = Instant::now();
                let mut frame = enlarged(frame, request.size_px);
                frame.timings.overlay_ms += milliseconds(start);
                frame
            }
        };
        if for_views.is_some() && frame.display_mm.is_none() {
            frame.display_mm = Some(displayed(&frame, &frame.depth_mm)); // no views beside it
        }
        if let Some(table) = table {
            table_mark::draw(&mut frame, volume.grid(), table);
        }
        if request.letters {
            letters::burn(&mut frame);
        }
        if let Some(drawing) = drawing {
            let drawn = Instant::now();
            let before = frame.display_mm.is_some().then(|| frame.depth_mm.clone());
            drawing.draw(&mut frame);
            if let Some(before) = before {
                frame.copy_overlay_depth(&before);
            }
            frame.timings.overlay_ms += preparing_ms + milliseconds(drawn);
        }
        Ok(frame)
    }

    /// The picture of a request's rays, and its depth for displays. Cancelled views beside the
    /// picture are continued by an equal request: its picture is kept.
    fn rays_for_views(
        &mut self,
        volume: &Volume,
        (for_views, request): (&ForViews, &RenderRequest),
        skipping: EmptySpaceSkipping,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let hash = volume.content_hash();
        let is_same = |kept: &mut Unfinished| {
            kept.volume == hash && kept.request == *request && kept.for_views == *for_views
        };
        let (mut frame, mut cast) = match self.unfinished.take_if(is_same) {
            Some(kept) => (kept.frame, kept.views),
            None => (self.rays(volume, request, skipping, watch)?, Vec::new()),
        };
        let start = Instant::now();
        let beside = ViewsBeside::of(for_views, request, &frame, volume.grid())?;
        for view in beside.iter().flat_map(ViewsBeside::requests).skip(cast.len()) {
            match self.rays(volume, view, skipping, watch) {
                Ok(view) => cast.push(view),
                Err(error) => {
                    if matches!(error, RenderError::Cancelled) {
                        let (request, for_views) = (request.clone(), for_views.clone());
                        self.unfinished =
                            Some(Unfinished { volume: hash, request, for_views, frame, views: cast });
                    }
                    return Err(error);
                }
            }
        }
        if let Some(beside) = beside {
            beside.complete(&mut frame, &cast);
        }
        frame.timings.views_ms = milliseconds(start);
        frame.timings.render_ms += frame.timings.views_ms;
        Ok(frame)
    }

    /// The picture of the volume without overlays.
    fn rays(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let limits = self.limits;
        let Some(processor) = &mut self.processor else {
            return self.graphics("")?.rays(volume, request, skipping, watch);
        };
        self.left = left_by_processor(volume, request);
        match self.left {
            None if self.is_lost => {
                Err(GpuError::Stalled { what: "a picture", source: StallError::Injected }.into())
            }
            None => processor.cast(volume, request, skipping, &limits, watch),
            Some(part) => self.graphics(part)?.rays(volume, request, skipping, watch),
        }
    }

    /// The graphics adapter, for a part of a request that the processor leaves to it.
    fn graphics(&mut self, part: &'static str) -> Result<&mut GpuRays, RenderError> {
        if self.gpu.is_none() {
            let opened = Gpu::open(&AdapterChoice::Best);
            let gpu = opened.map_err(|source| RenderError::BeyondProcessor { part, source })?;
            let name = gpu.description().to_string();
            tracing::info!(
                part,
                adapter = name,
                "the processor's ray caster leaves this to a graphics adapter"
            );
            let mut gpu = GpuRays::new(gpu)?;
            gpu.set_volume_limits(VolumeLimits {
                memory_bytes: self.limits.memory_bytes,
                ..gpu.volume_limits()
            });
            self.gpu = Some(gpu);
            self.apply_bands();
        }
        Ok(self.gpu.as_mut().expect("opened above"))
    }

    /// The number of volume samples that the rays of a picture take on the graphics adapter,
    /// gradients and depth refinement left out.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn count_samples(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
    ) -> Result<u64, RenderError> {
        self.graphics("counts of samples")?.count_samples(volume, request, skipping)
    }

    /// Trilinear samples per second that the driver of the graphics adapter takes of this volume
    /// when it does nothing else.
    ///
    /// # Errors
    /// When the volume is too large for the adapter, or the adapter fails.
    pub fn sampling_rate(&mut self, volume: &Volume) -> Result<f64, RenderError> {
        self.graphics("a driver's sampling rate")?.sampling_rate(volume)
    }

    /// Takes over a volume that another thread has prepared, for its first picture. It holds until
    /// another one is prepared or adopted.
    pub fn adopt(&mut self, PreparedVolume { bricks, appearance }: PreparedVolume) {
        match (&mut self.processor, &mut self.gpu) {
            (Some(processor), _) => processor.adopt(bricks, appearance),
            (None, Some(gpu)) => gpu.adopt(bricks),
            (None, None) => {}
        }
    }

    /// Prepares volumes for this renderer on another thread.
    #[must_use]
    pub fn preparation(&self) -> Preparation {
        Preparation { limits: self.volume_limits(), on_processor: self.processor.is_some() }
    }

    /// Frees all that is cached, after there was too little memory for a picture.
    pub fn release(&mut self) {
        self.unfinished = None;
        if let Some(processor) = &mut self.processor {
            processor.clear();
        }
        if let Some(gpu) = &mut self.gpu {
            gpu.release();
        }
    }

    /// Loses the device as a driver does that is reset: every later picture fails. To test what
    /// recovers from it.
    #[doc(hidden)]
    pub fn lose_device(&mut self) {
        self.is_lost = true;
        if let Some(gpu) = &self.gpu {
            gpu.lose_device();
        }
    }

    /// Frees the prepared data of a volume and of its appearances.
    pub fn forget(&mut self, volume: ContentHash) {
        self.unfinished = None;
        if let Some(processor) = &mut self.processor {
            [volume, volume.without_table()].into_iter().for_each(|shown| processor.forget(shown));
        }
        if let Some(gpu) = &mut self.gpu {
            gpu.forget(volume);
        }
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
