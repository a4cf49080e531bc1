//! The path tracing stage: its sources, its bindings and its pipeline.

use crate::gpu::{ErrorScope, Gpu, GpuError};

/// The stage's sources, in the order in which they are joined.
pub(super) const PATHTRACE_SOURCES: [&str; 8] = [
    include_str!("../../../shaders/lib/frame.wgsl"),
    include_str!("../../../shaders/lib/volume.wgsl"),
    include_str!("../../../shaders/lib/path.wgsl"),
    include_str!("../../../shaders/lib/random.wgsl"),
    include_str!("../../../shaders/lib/tracking.wgsl"),
    include_str!("../../../shaders/lib/direction.wgsl"),
    include_str!("../../../shaders/lib/scatter.wgsl"),
    include_str!("../../../shaders/pathtrace.wgsl"),
];

/// The stage's resources by group and binding; group 0 is shared with the ray caster.
pub(super) const BINDINGS: [(u32, u32, &str); 8] = [
    (0, 0, "frame"),
    (0, 1, "volume"),
    (0, 2, "volume_sampler"),
    (1, 0, "path"),
    (1, 1, "brick_bounds"),
    (1, 2, "medium_table"),
    (1, 3, "sums"),
    (1, 4, "picture"),
];

/// The compiled stage.
pub(super) struct Stage {
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layouts: [wgpu::BindGroupLayout; 2],
}

impl Stage {
    /// `hu_scale` is the HU of a texel value of 1.
    pub(super) fn new(gpu: &Gpu, hu_scale: f64) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "the path tracing shader");
        let module = gpu.shader("pathtrace", &PATHTRACE_SOURCES);
        let layouts = [0, 1].map(|group| bind_group_layout(gpu, group));
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("pathtrace"),
            bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("pathtrace"),
            layout: Some(&layout),
            module: &module,
            entry_point: Some("pathtrace"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("HU_SCALE", hu_scale)],
                ..Default::default()
            },
            cache: None,
        });
        scope.close()?;
        Ok(Self { pipeline, layouts })
    }
}

fn bind_group_layout(gpu: &Gpu, group: u32) -> wgpu::BindGroupLayout {
    let of_group = BINDINGS.iter().filter(|(of, _, _)| *of == group);
    let entries: Vec<_> = of_group
        .map(|&(_, binding, name)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: binding_type(name),
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("pathtrace"),
        entries: &entries,
    })
}

fn binding_type(name: &str) -> wgpu::BindingType {
    use wgpu::{BindingType, BufferBindingType, SamplerBindingType, TextureSampleType, TextureViewDimension};
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let texture = |filterable| BindingType::Texture {
        sample_type: TextureSampleType::Float { filterable },
        view_dimension: TextureViewDimension::D3,
        multisampled: false,
    };
    match name {
        "frame" | "path" => buffer(BufferBindingType::Uniform),
        "volume" => texture(true),
        "volume_sampler" => BindingType::Sampler(SamplerBindingType::Filtering),
        "brick_bounds" => texture(false),
        "medium_table" => buffer(BufferBindingType::Storage { read_only: true }),
        _ => buffer(BufferBindingType::Storage { read_only: false }),
    }
}
