//! Runs passes and keeps their sums, so that a picture of more passes continues where one of fewer
//! ended.

use super::medium::Medium;
use super::stage::Stage;
use super::uniform::PathUniform;
use crate::bands::{Bands, Dispatch};
use crate::error::RenderError;
use crate::gpu::{ErrorScope, Gpu, GpuError, Readback};
use crate::limits::depth_limits;
use crate::region::Region;
use crate::request::RenderRequest;
use crate::request_error::RequestError;
use crate::skipping::EmptySpaceSkipping;
use crate::uniform::FrameUniform;
use crate::upload::{Appearance, VolumeOnGpu};
use crate::watch::Watch;
use relief_volume::{ContentHash, Volume};

/// Paths of one dispatch: short enough for drivers that stop long ones and for those who wait for a
/// picture to be cancelled, long enough not to matter.
const PATHS_OF_DISPATCH: u64 = 1 << 18;

/// The path tracer of one device.
pub(crate) struct PathTracer {
    stage: Stage,
    frame: wgpu::Buffer,
    path: wgpu::Buffer,
    /// Of the last request.
    medium: Option<Medium>,
    sums: Option<Sums>,
}

/// What passes are made of.
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

/// The accumulated passes, and their request.
struct Sums {
    volume: ContentHash,
    /// Without the number of passes, which may differ between pictures that share passes.
    request: RenderRequest,
    passes: u32,
    pixels: u64,
    buffer: wgpu::Buffer,
    picture: Readback,
}

impl PathTracer {
    /// `hu_scale` is the HU of a texel value of 1.
    pub(crate) fn new(gpu: &Gpu, hu_scale: f64) -> Result<Self, GpuError> {
        let stage = Stage::new(gpu, hu_scale)?;
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
        Ok(Self { stage, frame, path, medium: None, sums: None })
    }

    /// Releases the data of a volume.
    pub(crate) fn forget(&mut self, volume: ContentHash) {
        self.medium = self.medium.take().filter(|medium| !medium.is_of(volume));
        self.sums = self.sums.take().filter(|sums| sums.volume != volume);
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
        // What failed half-way is not kept: its sums may hold half a pass.
        self.add_passes(order, &mut sums, watch)?;
        let picture = sums.picture.read(gpu, |bytes| bytemuck::cast_slice(bytes).to_vec())?;
        self.sums = Some(sums);
        Ok(picture)
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
        let groups = self.bind(order, medium, sums);
        let dispatch = Dispatch {
            gpu,
            region: Region::whole(request.size_px),
            bands,
            uniform: &self.frame,
            pipeline: &self.stage.pipeline,
            groups: &[&groups[0], &groups[1]],
        };
        let at_once = u32::try_from(PATHS_OF_DISPATCH / sums.pixels.min(bands.pixels.into()))
            .unwrap_or(u32::MAX)
            .max(1);
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

    fn bind(&self, order: PathTraceJob<'_>, medium: &Medium, sums: &Sums) -> [wgpu::BindGroup; 2] {
        let shared = vec![
            self.frame.as_entire_binding(),
            wgpu::BindingResource::TextureView(&order.on_gpu.view),
            wgpu::BindingResource::Sampler(order.sampler),
        ];
        let own = vec![
            self.path.as_entire_binding(),
            wgpu::BindingResource::TextureView(&medium.bounds),
            medium.table_buffer.as_entire_binding(),
            sums.buffer.as_entire_binding(),
            sums.picture.storage.as_entire_binding(),
        ];
        let group = |layout, resources: Vec<wgpu::BindingResource<'_>>| {
            let entries: Vec<_> = (0..)
                .zip(resources)
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            order.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("pathtrace"),
                layout,
                entries: &entries,
            })
        };
        let [first, second] = &self.stage.layouts;
        [group(first, shared), group(second, own)]
    }
}

impl Sums {
    /// Empty sums, in the buffers of old ones where they have the size.
    fn new(
        gpu: &Gpu,
        volume: ContentHash,
        request: &RenderRequest,
        old: Option<Self>,
    ) -> Result<Self, RenderError> {
        let request_of_sums = without_passes(request);
        let [width, height] = request.size_px;
        let pixels = u64::from(width) * u64::from(height);
        if let Some(old) = old.filter(|old| old.pixels == pixels) {
            return Ok(Self { volume, request: request_of_sums, passes: 0, ..old });
        }
        let limit = gpu.limits().storage_bytes;
        if pixels * 16 > limit {
            let allowed = format!("at most {} pixels in mode path-traced on this adapter", limit / 16);
            return Err(RequestError::new("size_px", &format!("{width} x {height}"), &allowed).into());
        }
        let scope = ErrorScope::open(gpu, "a path-traced picture");
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("sums of light"),
            size: pixels * 16,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
        let picture = Readback::new(gpu, "path-traced picture", pixels * 4);
        scope.close()?;
        Ok(Self { volume, request: request_of_sums, passes: 0, pixels, buffer, picture })
    }

    /// Whether more passes, or none, make this the picture of that request.
    fn can_become(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume
            && self.passes <= request.path_trace.passes
            && self.request == without_passes(request)
    }
}

/// The request but for the number of passes.
fn without_passes(request: &RenderRequest) -> RenderRequest {
    let mut request = request.clone();
    request.path_trace.passes = 0;
    request
}
