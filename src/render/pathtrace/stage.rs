//! The compute stages of the path tracer: their sources, bindings and pipelines.

use crate::gpu::{ErrorScope, Gpu, GpuError, Shader};

/// The parts that distinguish a stage. Group 0 is shared with the ray caster, and both stages begin
/// with the same files and bindings.
pub(super) struct StageParts {
    /// Of the shader and of its entry point.
    name: &'static str,
    /// In the order in which they are joined.
    pub(super) sources: &'static [&'static str],
    /// The resources: group, binding and name.
    pub(super) bindings: &'static [(u32, u32, &'static str)],
}

/// Follows light paths.
pub(super) const PATHTRACE: StageParts = StageParts {
    name: "pathtrace",
    sources: &[
        include_str!("../../../shaders/lib/frame.wgsl"),
        include_str!("../../../shaders/lib/volume.wgsl"),
        include_str!("../../../shaders/lib/path.wgsl"),
        include_str!("../../../shaders/lib/random.wgsl"),
        include_str!("../../../shaders/lib/tracking.wgsl"),
        include_str!("../../../shaders/lib/direction.wgsl"),
        include_str!("../../../shaders/lib/scatter.wgsl"),
        include_str!("../../../shaders/pathtrace.wgsl"),
    ],
    bindings: &[
        (0, 0, "frame"),
        (0, 1, "volume"),
        (0, 2, "volume_sampler"),
        (1, 0, "path"),
        (1, 1, "brick_bounds"),
        (1, 2, "medium_table"),
        (1, 3, "sums"),
        (1, 4, "picture"),
        (1, 5, "odd_sums"),
    ],
};

/// Computes the guides of the denoiser.
pub(super) const GUIDES: StageParts = StageParts {
    name: "guide",
    sources: &[
        include_str!("../../../shaders/lib/frame.wgsl"),
        include_str!("../../../shaders/lib/volume.wgsl"),
        include_str!("../../../shaders/lib/path.wgsl"),
        include_str!("../../../shaders/lib/random.wgsl"),
        include_str!("../../../shaders/lib/tracking.wgsl"),
        include_str!("../../../shaders/lib/direction.wgsl"),
        include_str!("../../../shaders/lib/scatter.wgsl"),
        include_str!("../../../shaders/guides.wgsl"),
    ],
    bindings: &[
        (0, 0, "frame"),
        (0, 1, "volume"),
        (0, 2, "volume_sampler"),
        (1, 0, "path"),
        (1, 1, "brick_bounds"),
        (1, 2, "medium_table"),
        (1, 3, "guides"),
    ],
};

/// A compiled stage.
pub(super) struct Stage {
    name: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
    layouts: [wgpu::BindGroupLayout; 2],
}

impl Stage {
    /// `hu_scale` is the HU of a texel value of 1.
    pub(super) fn new(gpu: &Gpu, parts: &StageParts, hu_scale: f64) -> Result<Self, GpuError> {
        let name = parts.name;
        let scope = ErrorScope::open(gpu, "the path tracing shader");
        let shader = Shader::new(name, parts.sources)?;
        let layouts = [0, 1].map(|group| bind_group_layout(gpu, parts, group));
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
            immediate_size: 0,
        });
        scope.close()?;
        let pipeline = shader.pipeline(gpu, Some(&layout), &[("HU_SCALE", hu_scale)])?;
        Ok(Self { name, pipeline, layouts })
    }

    /// Binds the resources of both groups, in the order of their bindings.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        resources: [Vec<wgpu::BindingResource<'_>>; 2],
    ) -> [wgpu::BindGroup; 2] {
        let [first, second] = resources;
        let group = |layout, resources: Vec<wgpu::BindingResource<'_>>| {
            let entries: Vec<_> = (0..)
                .zip(resources)
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.name),
                layout,
                entries: &entries,
            })
        };
        [group(&self.layouts[0], first), group(&self.layouts[1], second)]
    }
}

fn bind_group_layout(gpu: &Gpu, parts: &StageParts, group: u32) -> wgpu::BindGroupLayout {
    let of_group = parts.bindings.iter().filter(|(of, _, _)| *of == group);
    let entries: Vec<_> = of_group
        .map(|&(_, binding, name)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: binding_type(name),
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(parts.name),
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
