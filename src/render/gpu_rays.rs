//! The renderer on a graphics adapter: owns the device, caches uploads, casts rays and reads the
//! picture back.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::bands::{Bands, Dispatch};
use super::error::RenderError;
use super::frame::{BackLayer, RenderedFrame, Timings};
use super::illumination::{self, Illumination, Illuminator};
use super::mode::Mode;
use super::pathtrace::{PathTraceJob, PathTracer};
use super::pipelines::{Output, PipelineKey, Pipelines, Variant};
use super::region::Region;
use super::request::RenderRequest;
use super::skipping::EmptySpaceSkipping;
use super::slices::SlicePipelines;
use super::store::{MemoryUse, Store};
use super::target::{CastKey, CastOptions, Target, Unfinished, background, layers};
use super::uniform::FrameUniform;
use super::volume_plan::VolumeLimits;
use super::watch::Watch;
use crate::appearance::PreparedBricks;
use crate::gpu::{ErrorScope, Gpu, Readback};
use crate::limits::depth_limits;
use crate::texture::VoxelFormat;
use relief_volume::{ContentHash, Volume};

/// Casts the rays of requests on one GPU. Lives on one thread; a volume goes up on first use.
pub(super) struct GpuRays {
    gpu: Gpu,
    format: VoxelFormat,
    bands: Bands,
    store: Store,
    pipelines: Pipelines,
    slices: SlicePipelines,
    sampler: wgpu::Sampler,
    uniform: wgpu::Buffer,
    target: Option<Target>,
    /// The last picture that was cancelled.
    unfinished: Option<Unfinished>,
    illuminator: Illuminator,
    /// Made on first use: its shader is slow to compile.
    path_tracer: Option<PathTracer>,
}

impl GpuRays {
    /// A renderer on this GPU.
    ///
    /// # Errors
    /// When the adapter refuses the shaders.
    pub(super) fn new(gpu: Gpu) -> Result<Self, RenderError> {
        let format = VoxelFormat::of(gpu.limits());
        let pipelines = Pipelines::new(&gpu, format)?;
        let slices = SlicePipelines::new(&gpu, format.hu_scale())?;
        let illuminator = Illuminator::new(&gpu, pipelines.lighting_layout.clone(), format)?;
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("trilinear"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let uniform = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: size_of::<FrameUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let store = Store::new(&gpu, format);
        let bands = Bands::of(gpu.description().kind);
        Ok(Self {
            gpu,
            format,
            bands,
            store,
            pipelines,
            slices,
            sampler,
            uniform,
            target: None,
            unfinished: None,
            illuminator,
            path_tracer: None,
        })
    }

    /// The GPU in use.
    pub(super) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The limits of volumes.
    pub(super) fn volume_limits(&self) -> VolumeLimits {
        self.store.limits
    }

    /// Replaces what volumes may need, for those that go up from now on. Values beyond those of the
    /// adapter, and more than [`VolumeLimits::BRICKS`] bricks, are cut to them.
    pub(super) fn set_volume_limits(&mut self, limits: VolumeLimits) {
        self.store.limits = limits.within(VolumeLimits::of(&self.gpu));
    }

    /// Takes over a volume that another thread has prepared.
    pub(super) fn adopt(&mut self, bricks: PreparedBricks) {
        self.store.adopted = Some(bricks);
    }

    /// The cached data on the adapter.
    pub(super) fn memory(&self) -> MemoryUse {
        self.store.memory()
    }

    /// Sets the approximate number of pixels of a band, at least a whole row of tiles; a picture
    /// can be cancelled between bands. The bytes do not depend on it. By default, bands of software
    /// adapters get the size that takes 16 ms, and others have 2^22 pixels or fewer where rays are
    /// long.
    pub(super) fn set_band_pixels(&mut self, pixels: u32) {
        self.bands = Bands::of_pixels(pixels);
    }

    /// Makes bands of software adapters short, 4 ms: a picture is cancelled sooner, and takes about
    /// a fifth longer. The bytes do not depend on it.
    pub(super) fn set_short_bands(&mut self, are_short: bool) {
        self.bands = self.bands.shortened(are_short);
    }

    /// The picture of mode path-traced, of a volume that was cast before.
    fn trace_paths(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        watch: &mut Watch<'_>,
    ) -> Result<Vec<[u8; 4]>, RenderError> {
        let tracer = match &mut self.path_tracer {
            Some(tracer) => tracer,
            none => none.insert(PathTracer::new(&self.gpu, self.format.hu_scale())?),
        };
        // Both went up for its depth.
        let (on_gpu, appearance) = (self.store.volume(), self.store.appearance());
        let (gpu, sampler, bands) = (&self.gpu, &self.sampler, self.bands);
        tracer.render(PathTraceJob { gpu, volume, on_gpu, appearance, sampler, request, bands }, watch)
    }

    /// The picture of the volume without overlays.
    pub(super) fn rays(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        if request.mode != Mode::PathTraced {
            return self.cast_frame(volume, request, skipping, watch);
        }
        // Its depth is that of the composite picture.
        let (lights, illumination) = (Vec::new(), Illumination::default());
        let cast = RenderRequest { mode: Mode::Composite, lights, illumination, ..request.clone() };
        let mut frame = self.cast_frame(volume, &cast, skipping, watch)?;
        let start = Instant::now();
        frame.color_rgba = self.trace_paths(volume, request, watch)?;
        frame.timings.render_ms += milliseconds(start);
        Ok(frame)
    }

    fn cast_frame(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let (start, upload_ms) =
            self.cast(volume, request, CastOptions { skipping, output: Output::Depth }, watch)?;
        let region = self.target.as_ref().expect("cast has made one").region;
        let (size_px, empty) = (request.size_px, background(request));
        let pixels = |bytes: &[u8]| region.spread(bytemuck::cast_slice(bytes), size_px, empty, |pixel| pixel);
        let depths =
            |bytes: &[u8]| region.spread(bytemuck::cast_slice(bytes), size_px, f32::INFINITY, depth_mm_of);
        let mut color_rgba: Vec<[u8; 4]> = self.read(|target| &target.color, pixels)?;
        let mut depth_mm = self.read(|target| &target.depth, depths)?;
        // Layers come one after the other, the first one first.
        let front_pixels = color_rgba.len() / layers(request);
        let back = request.has_back_layer().then(|| BackLayer {
            color_rgba: color_rgba.split_off(front_pixels),
            depth_mm: depth_mm.split_off(front_pixels),
        });
        Ok(RenderedFrame {
            size_px: request.size_px,
            color_rgba,
            depth_mm,
            display_mm: None,
            back,
            camera: request.camera,
            limits: depth_limits(&request.camera, volume.grid()),
            nearest_ball_mm: None,
            is_partial: false,
            timings: Timings { upload_ms, render_ms: milliseconds(start), ..Timings::default() },
        })
    }

    /// The number of volume samples that the rays of a picture take, gradients and depth refinement
    /// left out.
    ///
    /// # Errors
    /// As [`GpuRays::rays`].
    pub(super) fn count_samples(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        skipping: EmptySpaceSkipping,
    ) -> Result<u64, RenderError> {
        let options = CastOptions { skipping, output: Output::SampleCount };
        self.cast(
            request.shown(volume),
            request,
            options,
            &mut Watch::new(&mut |_| ControlFlow::Continue(())),
        )?;
        let region = self.target.as_ref().expect("cast has made one").region;
        let sum = |bytes: &[u8]| {
            let counts = region.spread(bytemuck::cast_slice(bytes), request.size_px, 0.0, |count: f32| count);
            counts.into_iter().map(f64::from).sum()
        };
        let total: f64 = self.read(|target| &target.depth, sum)?;
        Ok(total as u64)
    }

    /// Brings a buffer of the last cast back. One that failed may stay mapped: the next picture
    /// gets new ones.
    fn read<T>(
        &mut self,
        buffer: impl FnOnce(&Target) -> &Readback,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, RenderError> {
        let target = self.target.as_ref().expect("cast has made one");
        let outcome = buffer(target).read(&self.gpu, read);
        if outcome.is_err() {
            self.target = None;
        }
        Ok(outcome?)
    }

    /// Trilinear samples per second that the driver takes of this volume when it does nothing else.
    ///
    /// # Errors
    /// When the volume is too large for the adapter, or the adapter fails.
    pub(super) fn sampling_rate(&mut self, volume: &Volume) -> Result<f64, RenderError> {
        self.store.prepare_volume(&self.gpu, volume)?;
        Ok(super::calibrate::sampling_rate(&self.gpu, &self.store.volume().view, &self.sampler)?)
    }

    /// Frees all that is cached on the adapter, after it had too little memory for a picture.
    pub(super) fn release(&mut self) {
        self.store.clear();
        self.illuminator.clear(&self.gpu);
        (self.target, self.unfinished, self.path_tracer) = (None, None, None);
    }

    /// Loses the device as a driver does that is reset: every later picture fails. To test what
    /// recovers from it.
    pub(super) fn lose_device(&self) {
        self.gpu.device.destroy();
    }

    /// Frees the data of a volume: its voxels and its appearances.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        [volume, volume.without_table()].into_iter().for_each(|shown| self.forget_shown(shown));
    }

    fn forget_shown(&mut self, volume: ContentHash) {
        self.store.forget(volume);
        self.unfinished = self.unfinished.take().filter(|unfinished| unfinished.key.volume != volume);
        self.illuminator.forget(&self.gpu, volume);
        if let Some(tracer) = &mut self.path_tracer {
            tracer.forget(volume);
        }
    }

    /// Uploads missing data and submits the rays; returns the start of the render and the upload's
    /// time in ms.
    fn cast(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        options: CastOptions,
        watch: &mut Watch<'_>,
    ) -> Result<(Instant, f64), RenderError> {
        request.validate_on(volume.grid())?;
        let start = Instant::now();
        let uploaded = self.store.prepare(&self.gpu, volume, request)? | self.illuminate(volume, request)?;
        let upload_ms = if uploaded { milliseconds(start) } else { 0.0 };
        let (mut rows, spent) = self.make_target(volume.content_hash(), request, options)?;
        let start = Instant::now().checked_sub(spent).unwrap_or_else(Instant::now);
        let outcome = self.submit(volume, request, options, &mut rows, watch);
        if matches!(outcome, Err(RenderError::Cancelled)) {
            let key = CastKey { volume: volume.content_hash(), request: request.clone(), options };
            let unfinished = |target| Unfinished { key, target, rows, spent: start.elapsed() };
            self.unfinished = self.target.take().map(unfinished);
        }
        outcome?;
        Ok((start, upload_ms))
    }

    /// Prepares the light of a request whose volume and appearance are uploaded; says whether that
    /// took filling cells.
    fn illuminate(&mut self, volume: &Volume, request: &RenderRequest) -> Result<bool, RenderError> {
        let (on_gpu, appearance) = (self.store.volume(), self.store.appearance());
        let (gpu, sampler, labels) = (&self.gpu, &self.sampler, self.store.labels(request));
        let order =
            illumination::IlluminationJob { gpu, volume, on_gpu, appearance, labels, sampler, request };
        self.illuminator.prepare(order)
    }

    /// Makes the target of a picture. Returns the number of rows of its region that are rendered, and
    /// the time that they took.
    fn make_target(
        &mut self,
        volume: ContentHash,
        request: &RenderRequest,
        options: CastOptions,
    ) -> Result<(u32, Duration), RenderError> {
        let is_same = |unfinished: &mut Unfinished| unfinished.key.is_of(volume, request, options);
        if let Some(unfinished) = self.unfinished.take_if(is_same) {
            self.target = Some(unfinished.target);
            return Ok((unfinished.rows, unfinished.spent));
        }
        if !self.target.as_ref().is_some_and(|target| target.fits(request)) {
            self.target = None; // frees the old one first
            self.target = Some(Target::new(&self.gpu, request)?);
        }
        Ok((0, Duration::ZERO))
    }

    /// Records and submits the rays, band after band, and their read-back.
    fn submit(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        CastOptions { skipping, output }: CastOptions,
        rows: &mut u32,
        watch: &mut Watch<'_>,
    ) -> Result<(), RenderError> {
        let appearance = self.store.appearance();
        let region = match (request.mode, skipping) {
            (Mode::Slice(_), _) | (_, EmptySpaceSkipping::Off) => Region::whole(request.size_px),
            _ => Region::of(request, volume.grid(), &appearance.bricks),
        };
        self.target.as_mut().expect("made before").region = region;
        let target = self.target.as_ref().expect("made before");
        let uniform = FrameUniform::new(request, volume, appearance, skipping);
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let pipeline = match request.mode {
            Mode::Slice(blend) => self.slices.prepare(&self.gpu, request, volume.grid(), blend, output)?,
            _ => {
                let precomputed_gradients = self.store.volume().gradients.precomputed;
                let mostly_visible = appearance.mostly_visible;
                let variant = Variant { output, precomputed_gradients, mostly_visible };
                self.pipelines.get(&self.gpu, PipelineKey::new(request, variant))?
            }
        };
        let pipeline = pipeline.clone();
        let scope = ErrorScope::open(&self.gpu, "a frame");
        let bindings = self.bind(request, target);
        scope.close()?;
        let dispatch = Dispatch {
            gpu: &self.gpu,
            region,
            bands: self.bands.for_rays(request.samples_of_ray(volume.grid())),
            uniform: &self.uniform,
            pipeline: &pipeline,
            groups: match request.mode {
                Mode::Slice(_) => &[&bindings],
                _ => &[&bindings, self.illuminator.bindings()],
            },
        };
        let read_back = |encoder: &mut wgpu::CommandEncoder| {
            target.color.record(encoder);
            target.depth.record(encoder);
        };
        dispatch.submit(Some(rows), read_back, watch)
    }

    fn bind(&self, request: &RenderRequest, target: &Target) -> wgpu::BindGroup {
        let (volume, appearance) = (self.store.volume(), self.store.appearance());
        let shared = [
            self.uniform.as_entire_binding(),
            wgpu::BindingResource::TextureView(&volume.view),
            wgpu::BindingResource::Sampler(&self.sampler),
            appearance.distances.as_entire_binding(),
            appearance.table_buffer.as_entire_binding(),
            target.color.storage.as_entire_binding(),
            target.depth.storage.as_entire_binding(),
            wgpu::BindingResource::TextureView(&volume.gradients.view),
            wgpu::BindingResource::TextureView(self.store.labels(request)),
        ];
        let (layout, slab) = match request.mode {
            Mode::Slice(_) => (&self.slices.bind_group_layout, Some(self.slices.slab.as_entire_binding())),
            _ => (&self.pipelines.bind_group_layout, None),
        };
        let entries: Vec<_> = (0..)
            .zip(shared.into_iter().chain(slab))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raycast"),
            layout,
            entries: &entries,
        })
    }
}

/// The shader cannot write an infinity portably; it writes the largest power of two for a miss.
fn depth_mm_of(written: f32) -> f32 {
    if written > 1e38 { f32::INFINITY } else { written }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
