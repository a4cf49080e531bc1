//! The stage that fills cells: its sources, bindings and pipelines; and the layout by which rays
//! read them.

use std::collections::HashMap;

use crate::gpu::{ErrorScope, Gpu, GpuError, Shader};
use crate::labels::Edges;
use crate::mode::Mode;
use crate::request::RenderRequest;
use crate::table_storage::TableStorage;
use crate::texture::VoxelFormat;

/// Cells along each side of a workgroup.
pub(super) const CELLS_SIDE: u32 = 4;

/// The stage's sources, in the order in which they are joined.
pub(super) fn illuminate_sources(table: TableStorage) -> [&'static str; 10] {
    [
        include_str!("../../../shaders/lib/frame.wgsl"),
        include_str!("../../../shaders/lib/volume.wgsl"),
        include_str!("../../../shaders/lib/walk.wgsl"),
        table.source(),
        include_str!("../../../shaders/lib/classify.wgsl"),
        include_str!("../../../shaders/lib/passage.wgsl"),
        include_str!("../../../shaders/lib/labels.wgsl"),
        include_str!("../../../shaders/lib/gradient.wgsl"),
        include_str!("../../../shaders/lib/direction.wgsl"),
        include_str!("../../../shaders/illuminate.wgsl"),
    ]
}

/// The stage's resources by group and binding; group 0 has names and places of the ray caster's.
pub(super) const CELL_BINDINGS: [(u32, u32, &str); 9] = [
    (0, 0, "frame"),
    (0, 1, "volume"),
    (0, 2, "volume_sampler"),
    (0, 3, "brick_distances"),
    (0, 4, "transfer_table"),
    (0, 7, "gradients"),
    (0, 8, "labels"),
    (1, 0, "illumination"),
    (1, 1, "cells_out"),
];

/// The ray caster's second group.
pub(super) const LIGHTING_BINDINGS: [(u32, &str); 3] =
    [(0, "lighting"), (1, "shadow_cells"), (2, "open_cells")];

/// The constants of a specialised pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct StageKey {
    openness: bool,
    surfaces: bool,
    cut_away: bool,
    gradient_opacity: bool,
    edges: Option<Edges>,
    precomputed_gradients: bool,
}

impl StageKey {
    pub(super) fn new(request: &RenderRequest, openness: bool, precomputed_gradients: bool) -> Self {
        Self {
            openness,
            surfaces: request.mode == Mode::Isosurface,
            cut_away: request.clip.sphere.is_some(),
            gradient_opacity: request.transfer.gradient_opacity().is_some(),
            edges: request.labels.as_ref().map(|labels| labels.edges),
            precomputed_gradients,
        }
    }
}

/// The stage and its pipelines, compiled on first use.
pub(super) struct Stage {
    shader: Shader,
    pub(super) layouts: [wgpu::BindGroupLayout; 2],
    layout: wgpu::PipelineLayout,
    format: VoxelFormat,
    compiled: HashMap<StageKey, wgpu::ComputePipeline>,
}

impl Stage {
    /// `format` is that of the volumes.
    pub(super) fn new(gpu: &Gpu, format: VoxelFormat) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "the illumination shader");
        let table = TableStorage::of(gpu);
        let shader = Shader::new("illuminate", &illuminate_sources(table))?;
        let layouts = [0, 1].map(|group| {
            let of_group = CELL_BINDINGS.iter().filter(|(of, _, _)| *of == group);
            group_layout(gpu, "illuminate", of_group.map(|&(_, binding, name)| (binding, name)), table)
        });
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("illuminate"),
            bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
            immediate_size: 0,
        });
        scope.close()?;
        Ok(Self { shader, layouts, layout, format, compiled: HashMap::new() })
    }

    /// The pipeline of this key.
    pub(super) fn get(&mut self, gpu: &Gpu, key: StageKey) -> Result<wgpu::ComputePipeline, GpuError> {
        if let Some(known) = self.compiled.get(&key) {
            return Ok(known.clone());
        }
        let flag = |on: bool| f64::from(u8::from(on));
        let constants = [
            ("OPENNESS", flag(key.openness)),
            ("SURFACES", flag(key.surfaces)),
            ("CUT_AWAY", flag(key.cut_away)),
            ("GRADIENT_OPACITY", flag(key.gradient_opacity)),
            ("LABELLED", flag(key.edges.is_some())),
            ("SMOOTH_EDGES", flag(key.edges == Some(Edges::Smooth))),
            ("PRECOMPUTED_GRADIENTS", flag(key.precomputed_gradients)),
            ("HU_SCALE", self.format.hu_scale()),
        ];
        let pipeline = self.shader.pipeline(gpu, Some(&self.layout), &constants)?;
        self.compiled.insert(key, pipeline.clone());
        Ok(pipeline)
    }
}

/// The layout of the ray caster's second group.
pub(crate) fn lighting_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    group_layout(gpu, "lighting", LIGHTING_BINDINGS.into_iter(), TableStorage::of(gpu))
}

fn group_layout(
    gpu: &Gpu,
    label: &str,
    bindings: impl Iterator<Item = (u32, &'static str)>,
    table: TableStorage,
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = bindings
        .map(|(binding, name)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: binding_type(name, table),
            count: None,
        })
        .collect();
    gpu.device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn binding_type(name: &str, table: TableStorage) -> wgpu::BindingType {
    use wgpu::{BindingType, BufferBindingType, SamplerBindingType, TextureSampleType, TextureViewDimension};
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    match name {
        "frame" | "illumination" | "lighting" => buffer(BufferBindingType::Uniform),
        "volume_sampler" => BindingType::Sampler(SamplerBindingType::Filtering),
        "brick_distances" => buffer(BufferBindingType::Storage { read_only: true }),
        "transfer_table" => buffer(table.binding()),
        "cells_out" => BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: crate::illumination::quantity::TEXELS,
            view_dimension: TextureViewDimension::D3,
        },
        "labels" => BindingType::Texture {
            sample_type: TextureSampleType::Uint,
            view_dimension: TextureViewDimension::D3,
            multisampled: false,
        },
        _ => BindingType::Texture {
            sample_type: TextureSampleType::Float { filterable: true },
            view_dimension: TextureViewDimension::D3,
            multisampled: false,
        },
    }
}
