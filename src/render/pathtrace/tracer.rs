//! Runs passes and keeps their sums, so that a picture of more passes continues where one of fewer
//! ended.

use super::denoise::{NoisyPicture, denoised, display_referred};
use super::medium::Medium;
use super::stage::{GUIDES, PATHTRACE, Stage};
use super::sums::Sums;
use super::uniform::PathUniform;
use crate::bands::{Bands, Dispatch};
use crate::error::RenderError;
use crate::gpu::{ErrorScope, Gpu, GpuError, Readback};
use crate::limits::depth_limits;
use crate::region::Region;
use crate::request::RenderRequest;
use crate::skipping::EmptySpaceSkipping;
use crate::uniform::FrameUniform;
use crate::upload::{Appearance, VolumeOnGpu};
use crate::watch::Watch;
use relief_volume::{ContentHash, Volume};

/// Collisions of one dispatch: short enough for drivers that stop long ones and for those who wait for a
/// picture to be cancelled, long enough not to matter.
const COLLISIONS_OF_DISPATCH: u64 = 1 << 18;

/// Marches of a pixel's guides, about: nine rays, each with a shadow or two.
const GUIDE_MARCHES: f64 = 24.0;

/// The path tracer of one device.
pub(crate) struct PathTracer {
    stage: Stage,
    /// Made on first use.
    guide_stage: Option<Stage>,
    hu_scale: f64,
    frame: wgpu::Buffer,
    path: wgpu::Buffer,
    /// Of the last request.
    medium: Option<Medium>,
    sums: Option<Sums>,
}

/// The inputs of passes.
#[derive(Clone, Copy)]
pub(crate) struct PathTraceJob<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) volume: &'a Volume,
    pub(crate) on_gpu: &'a VolumeOnGpu,
    /// Of the composite picture, whose depth this one has.
    pub(crate) appearance: &'a Appearance,
    pub(crate) sampler: &'a wgpu::Sampler,
    pub(crate) request: &'a RenderRequest,
    pub(crate) bands: Bands,
}

impl PathTracer {
    /// `hu_scale` is the HU of a texel value of 1.
    pub(crate) fn new(gpu: &Gpu, hu_scale: f64) -> Result<Self, GpuError> {
        let stage = Stage::new(gpu, &PATHTRACE, hu_scale)?;
        let scope = ErrorScope::open(gpu, "the path tracer");
        let uniform = |label, size: usize| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let (frame, path) =
            (uniform("frame", size_of::<FrameUniform>()), uniform("path", size_of::<PathUniform>()));
        scope.close()?;
        Ok(Self { stage, guide_stage: None, hu_scale, frame, path, medium: None, sums: None })
    }

    /// Releases the data of a volume.
    pub(crate) fn forget(&mut self, volume: ContentHash) {
        self.medium = self.medium.take().filter(|medium| !medium.is_of(volume));
        self.sums = self.sums.take().filter(|sums| !sums.is_of(volume));
    }

    /// The picture of a request: rows from the top, sRGB and coverage.
    pub(crate) fn render(
        &mut self,
        order: PathTraceJob<'_>,
        watch: &mut Watch<'_>,
    ) -> Result<Vec<[u8; 4]>, RenderError> {
        let PathTraceJob { gpu, on_gpu, request, .. } = order;
        if !self.medium.as_ref().is_some_and(|medium| medium.fits(on_gpu.hash, request)) {
            self.medium = None; // frees the old one first
            self.medium = Some(Medium::upload(gpu, on_gpu, request)?);
        }
        let mut sums = match self.sums.take() {
            Some(sums) if sums.can_become(on_gpu.hash, request) => sums,
            other => Sums::new(gpu, on_gpu.hash, request, other)?,
        };
        // A result that failed half-way is not kept: its sums may hold half a pass.
        self.add_passes(order, &mut sums, watch)?;
        let mut picture: Vec<[u8; 4]> =
            sums.picture.read(gpu, |bytes| bytemuck::cast_slice(bytes).to_vec())?;
        let denoised = request.path_trace.denoise.then(|| self.denoise(order, &mut sums, watch));
        // The passes are whole, even if the denoiser was cancelled.
        self.sums = Some(sums);
        if let Some(denoised) = denoised {
            picture = denoised?;
        }
        Ok(picture)
    }

    /// The finished picture without its noise.
    fn denoise(
        &mut self,
        order: PathTraceJob<'_>,
        sums: &mut Sums,
        watch: &mut Watch<'_>,
    ) -> Result<Vec<[u8; 4]>, RenderError> {
        let PathTraceJob { gpu, request, .. } = order;
        if sums.guides.is_none() {
            let buffer = sums.guide_buffer(gpu, request)?;
            self.make_guides(order, &buffer, watch)?;
            sums.guides = Some(buffer);
        }
        let guides = sums.guides.as_ref().expect("made before");
        let pixels = |bytes: &[u8]| bytemuck::pod_collect_to_vec(bytes);
        let noisy = NoisyPicture {
            size_px: request.size_px,
            passes: sums.passes,
            all: Readback::once(gpu, "sums of light", &sums.all, pixels)?,
            odd: Readback::once(gpu, "sums of odd passes", &sums.odd, pixels)?,
            guides: Readback::once(gpu, "guides", guides, bytemuck::pod_collect_to_vec)?,
        };
        Ok(display_referred(&denoised(&noisy), request))
    }

    fn make_guides(
        &mut self,
        order: PathTraceJob<'_>,
        guides: &wgpu::Buffer,
        watch: &mut Watch<'_>,
    ) -> Result<(), RenderError> {
        let PathTraceJob { gpu, volume, request, bands, .. } = order;
        let stage = match &mut self.guide_stage {
            Some(stage) => stage,
            none => none.insert(Stage::new(gpu, &GUIDES, self.hu_scale)?),
        };
        let medium = self.medium.as_ref().expect("uploaded before");
        let [first, mut second] = shared_resources(order, &self.frame, &self.path, medium);
        second.push(guides.as_entire_binding());
        let groups = stage.bind(gpu, [first, second]);
        let dispatch = Dispatch {
            gpu,
            region: Region::whole(request.size_px),
            bands: bands.for_rays(GUIDE_MARCHES * request.samples_of_ray(volume.grid())),
            uniform: &self.frame,
            pipeline: &stage.pipeline,
            groups: &[&groups[0], &groups[1]],
        };
        dispatch.submit(None, |_| (), watch)?;
        Ok(gpu.wait("the guides of the denoiser")?)
    }

    fn add_passes(
        &self,
        order: PathTraceJob<'_>,
        sums: &mut Sums,
        watch: &mut Watch<'_>,
    ) -> Result<(), RenderError> {
        let PathTraceJob { gpu, volume, request, bands, .. } = order;
        let medium = self.medium.as_ref().expect("uploaded before");
        let near_mm = depth_limits(&request.camera, volume.grid()).near_mm;
        let mut uniform = PathUniform::new(request, near_mm, &medium.table, order.on_gpu.plan.brick_edge);
        let frame = FrameUniform::new(request, volume, order.appearance, EmptySpaceSkipping::On);
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&frame));
        let [first, mut second] = shared_resources(order, &self.frame, &self.path, medium);
        second.extend([&sums.all, &sums.picture.storage, &sums.odd].map(wgpu::Buffer::as_entire_binding));
        let groups = self.stage.bind(gpu, [first, second]);
        let dispatch = Dispatch {
            gpu,
            region: Region::whole(request.size_px),
            bands,
            uniform: &self.frame,
            pipeline: &self.stage.pipeline,
            groups: &[&groups[0], &groups[1]],
        };
        let collisions = sums.pixels.min(bands.pixels.into()) * u64::from(request.path_trace.scatterings);
        let at_once = u32::try_from(COLLISIONS_OF_DISPATCH / collisions).unwrap_or(u32::MAX).max(1);
        let wanted = request.path_trace.passes;
        watch.continues(sums.passes);
        loop {
            // A picture that has all its passes is written out again: its settings may have come
            // back.
            (uniform.first_pass, uniform.passes) = (sums.passes, at_once.min(wanted - sums.passes));
            gpu.queue.write_buffer(&self.path, 0, bytemuck::bytes_of(&uniform));
            let passes = sums.passes + uniform.passes;
            let done = passes == wanted;
            let read_back = |encoder: &mut wgpu::CommandEncoder| {
                if done {
                    sums.picture.record(encoder);
                }
            };
            dispatch.submit(None, read_back, watch)?;
            gpu.wait("a pass of paths")?;
            sums.passes = passes;
            watch.passes_done(passes)?;
            if done {
                return Ok(());
            }
        }
    }
}

/// The resources that both stages begin with, by group.
fn shared_resources<'a>(
    order: PathTraceJob<'a>,
    frame: &'a wgpu::Buffer,
    path: &'a wgpu::Buffer,
    medium: &'a Medium,
) -> [Vec<wgpu::BindingResource<'a>>; 2] {
    let of_volume = vec![
        frame.as_entire_binding(),
        wgpu::BindingResource::TextureView(&order.on_gpu.view),
        wgpu::BindingResource::Sampler(order.sampler),
    ];
    let of_path = vec![
        path.as_entire_binding(),
        wgpu::BindingResource::TextureView(&medium.bounds),
        medium.table_buffer.as_entire_binding(),
    ];
    [of_volume, of_path]
}
