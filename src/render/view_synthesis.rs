//! Views of a picture and its disparity on a graphics card, with the bytes of
//! [`relief_display::synthesize`].
//!
//! One view after the other: `shaders/views/spans.wgsl` places the pixels of the layers, then
//! `shaders/views/view.wgsl` looks up what each pixel of the view shows.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use parking_lot::Mutex;
use relief_display::{
    DecodedLayer, LayoutError, Parallax, ProcessorViews, Synthesize, Views, check_layers, synthesize,
};

use crate::gpu::{AdapterChoice, ErrorScope, Gpu, GpuError, Readback, Shader, has_card};

/// The sources of both stages.
const SPANS_SOURCES: [&str; 2] =
    [include_str!("../../shaders/lib/view_layers.wgsl"), include_str!("../../shaders/views/spans.wgsl")];
const VIEW_SOURCES: [&str; 2] =
    [include_str!("../../shaders/lib/view_layers.wgsl"), include_str!("../../shaders/views/view.wgsl")];

/// Workgroups of the stages, pixels.
const SPANS_WORKGROUP: u32 = 64;
const VIEW_WORKGROUP: u32 = 8;

/// The resources of the stages by binding.
const BINDINGS: [(u32, &str); 5] = [(0, "job"), (1, "shifts"), (2, "layers"), (3, "spans"), (4, "view")];

/// The Rust mirror of `struct ViewJob`, which defines meanings and units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ViewJob {
    size_px: [u32; 2],
    reach_px: i32,
    has_back: u32,
}

/// The synthesiser on the adapter of a choice: [`AdapterChoice::Best`] takes a graphics card where
/// there is one, and the processor elsewhere.
///
/// # Errors
/// When there is no such adapter, or its driver refuses.
pub fn view_synthesizer(choice: &AdapterChoice) -> Result<Arc<dyn Synthesize>, GpuError> {
    match choice {
        AdapterChoice::Processor => Ok(Arc::new(ProcessorViews)),
        AdapterChoice::Best if !has_card() => Ok(Arc::new(ProcessorViews)),
        _ => Ok(Arc::new(ViewSynthesizer::open(choice)?)),
    }
}

/// Makes views on a graphics card; on the processor after the card has failed.
#[derive(Debug)]
pub struct ViewSynthesizer {
    gpu: Gpu,
    layout: wgpu::BindGroupLayout,
    spans: wgpu::ComputePipeline,
    view: wgpu::ComputePipeline,
    job: wgpu::Buffer,
    shifts: wgpu::Buffer,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Buffers of the newest size and number of layers.
    buffers: Option<([u32; 3], Buffers)>,
    has_failed: bool,
}

#[derive(Debug)]
struct Buffers {
    layers: wgpu::Buffer,
    view: Readback,
    bindings: wgpu::BindGroup,
}

impl ViewSynthesizer {
    /// Opens the adapter of this choice.
    ///
    /// # Errors
    /// When there is no such adapter, or its driver refuses.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let gpu = Gpu::open(choice)?;
        let scope = ErrorScope::open(&gpu, "the shaders of views");
        let layout = bind_group_layout(&gpu);
        let spans = pipeline(&gpu, &layout, "view_spans", &SPANS_SOURCES)?;
        let view = pipeline(&gpu, &layout, "synthesize_view", &VIEW_SOURCES)?;
        let buffer = |label, bytes: usize, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let job = buffer("job", size_of::<ViewJob>(), wgpu::BufferUsages::UNIFORM);
        let shifts = buffer("shifts", 256 * size_of::<i32>(), wgpu::BufferUsages::STORAGE);
        scope.close()?;
        Ok(Self { layout, spans, view, job, shifts, state: Mutex::default(), gpu })
    }

    fn draw(
        &self,
        buffers: &Buffers,
        job: ViewJob,
        shifts: &[i32; 256],
        layers: u32,
    ) -> Result<Vec<[u8; 3]>, GpuError> {
        let Gpu { device, queue, .. } = &self.gpu;
        let [width, height] = job.size_px;
        queue.write_buffer(&self.job, 0, bytemuck::bytes_of(&job));
        queue.write_buffer(&self.shifts, 0, bytemuck::cast_slice(shifts));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &buffers.bindings, &[]);
            pass.set_pipeline(&self.spans);
            pass.dispatch_workgroups(width.div_ceil(SPANS_WORKGROUP), height, layers);
            pass.set_pipeline(&self.view);
            pass.dispatch_workgroups(width.div_ceil(VIEW_WORKGROUP), height.div_ceil(VIEW_WORKGROUP), 1);
        }
        buffers.view.record(&mut encoder);
        queue.submit([encoder.finish()]);
        buffers.view.read(&self.gpu, |bytes| {
            bytes.as_chunks::<4>().0.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect()
        })
    }

    /// The buffers of layers of this size; those of the last picture where it had the same.
    fn buffers<'a>(
        &self,
        kept: &'a mut Option<([u32; 3], Buffers)>,
        key: [u32; 3],
    ) -> Result<&'a Buffers, GpuError> {
        if kept.as_ref().is_some_and(|(of, _)| *of != key) {
            *kept = None;
        }
        match kept {
            Some((_, buffers)) => Ok(buffers),
            None => Ok(&kept.insert((key, self.allocate(key)?)).1),
        }
    }

    fn allocate(&self, [width, height, layers]: [u32; 3]) -> Result<Buffers, GpuError> {
        let scope = ErrorScope::open(&self.gpu, "the layers of views");
        let pixels = u64::from(width) * u64::from(height);
        let buffer = |label, bytes, usage| {
            self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE | usage,
                mapped_at_creation: false,
            })
        };
        let of_layers = u64::from(layers) * pixels;
        let colors = buffer("layers", 4 * of_layers, wgpu::BufferUsages::COPY_DST);
        let spans = buffer("spans", 8 * of_layers, wgpu::BufferUsages::empty());
        let view = Readback::new(&self.gpu, "view", 4 * pixels);
        let buffers = [&self.job, &self.shifts, &colors, &spans, &view.storage];
        let entries: Vec<_> = BINDINGS
            .iter()
            .zip(buffers)
            .map(|(&(binding, _), buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bindings = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("views"),
            layout: &self.layout,
            entries: &entries,
        });
        scope.close()?;
        Ok(Buffers { layers: colors, view, bindings })
    }

    fn on_card(
        &self,
        state: &mut State,
        size_px: [u32; 2],
        layers: &[&DecodedLayer],
        shifts: &[[i32; 256]],
    ) -> Result<Vec<Vec<[u8; 3]>>, GpuError> {
        let count = layers.len() as u32;
        let buffers = self.buffers(&mut state.buffers, [size_px[0], size_px[1], count])?;
        let scope = ErrorScope::open(&self.gpu, "views");
        let packed: Vec<u32> = layers.iter().flat_map(|layer| packed(layer)).collect();
        self.gpu.queue.write_buffer(&buffers.layers, 0, bytemuck::cast_slice(&packed));
        let views = shifts.iter().map(|shifts| {
            let reach = shifts.iter().map(|shift| shift.unsigned_abs()).max().unwrap_or_default();
            let reach_px = reach.div_ceil(Parallax::UNIT.unsigned_abs()) as i32;
            let job = ViewJob { size_px, reach_px, has_back: u32::from(count > 1) };
            self.draw(buffers, job, shifts, count)
        });
        let views: Result<_, _> = views.collect();
        scope.close().and(views)
    }
}

impl Synthesize for ViewSynthesizer {
    fn views(
        &self,
        size_px: [u32; 2],
        front: &DecodedLayer,
        back: Option<&DecodedLayer>,
        parallax: &Parallax,
        eyes: &[f64],
    ) -> Result<Views, LayoutError> {
        check_layers(size_px, front, back, eyes.len())?;
        let mut state = self.state.lock();
        if !state.has_failed {
            let layers: Vec<_> = std::iter::once(front).chain(back).collect();
            let shifts: Vec<_> = eyes.iter().map(|&eye| parallax.shifts(eye, size_px[0])).collect();
            match self.on_card(&mut state, size_px, &layers, &shifts) {
                Ok(pictures) => return Views::new(size_px, pictures),
                Err(error) => {
                    tracing::warn!(%error, "views are made on the processor from now on");
                    *state = State { buffers: None, has_failed: true };
                }
            }
        }
        synthesize(size_px, front, back, parallax, eyes)
    }
}

/// Colour and disparity of each pixel in one number, as the shader reads them.
fn packed(layer: &DecodedLayer) -> impl Iterator<Item = u32> {
    layer.color.iter().zip(&layer.disparity).map(|([r, g, b], d)| u32::from_le_bytes([*r, *g, *b, *d]))
}

fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    entry: &'static str,
    sources: &[&str],
) -> Result<wgpu::ComputePipeline, GpuError> {
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    Shader::new(entry, sources)?.pipeline(gpu, Some(&layout), &[])
}

fn bind_group_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    use wgpu::BufferBindingType::{Storage, Uniform};
    let types = [
        Uniform,
        Storage { read_only: true },
        Storage { read_only: true },
        Storage { read_only: false },
        Storage { read_only: false },
    ];
    let entries: Vec<_> = BINDINGS
        .iter()
        .zip(types)
        .map(|(&(binding, _), ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("views"),
        entries: &entries,
    })
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::*;

    #[test]
    fn job_bindings_and_workgroups_mirror_the_shaders() {
        for (sources, workgroup) in
            [(SPANS_SOURCES, [SPANS_WORKGROUP, 1, 1]), (VIEW_SOURCES, [VIEW_WORKGROUP, VIEW_WORKGROUP, 1])]
        {
            let module = naga::front::wgsl::parse_str(&sources.join("\n")).expect("the shader parses");
            let is_job = |found: &&naga::Type| found.name.as_deref() == Some("ViewJob");
            let job = module.types.iter().map(|(_, found)| found).find(is_job).expect("ViewJob");
            let naga::TypeInner::Struct { members, span } = &job.inner else { panic!("ViewJob is a struct") };
            let members: Vec<_> = members
                .iter()
                .map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize))
                .collect();
            let mirror = [
                ("size_px", offset_of!(ViewJob, size_px)),
                ("reach_px", offset_of!(ViewJob, reach_px)),
                ("has_back", offset_of!(ViewJob, has_back)),
            ];
            assert_eq!((members.as_slice(), *span as usize), (mirror.as_slice(), size_of::<ViewJob>()));
            let mut bindings: Vec<(u32, &str)> = module
                .global_variables
                .iter()
                .filter_map(|(_, global)| Some((global.binding.as_ref()?.binding, global.name.as_deref()?)))
                .collect();
            bindings.sort_unstable();
            assert_eq!(bindings, BINDINGS);
            assert_eq!(module.entry_points[0].workgroup_size, workgroup);
        }
    }
}
