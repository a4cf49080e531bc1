//! The ray-casting pipelines: one for each requested combination of mode, depth rule and shading.

use std::collections::HashMap;

use super::classification::Classification;
use super::cut::CutFaces;
use super::illumination::lighting_layout;
use super::labels::Edges;
use super::mode::Mode;
use super::request::{DepthRule, RenderRequest};
use crate::AdapterKind;
use crate::gpu::{ErrorScope, Gpu, GpuError, Shader};
use crate::table_storage::TableStorage;
use crate::texture::VoxelFormat;

/// The whole source of a stage, in parts to be joined: what stages share, then the stage's own.
pub(super) fn stage_sources(table: TableStorage, stage: &'static str) -> [&'static str; 10] {
    [
        include_str!("../../shaders/lib/frame.wgsl"),
        include_str!("../../shaders/lib/volume.wgsl"),
        include_str!("../../shaders/lib/walk.wgsl"),
        table.source(),
        include_str!("../../shaders/lib/classify.wgsl"),
        include_str!("../../shaders/lib/labels.wgsl"),
        include_str!("../../shaders/lib/passage.wgsl"),
        include_str!("../../shaders/lib/gradient.wgsl"),
        include_str!("../../shaders/lib/depth_rules.wgsl"),
        stage,
    ]
}

/// The ray caster's own source.
pub(super) const RAYCAST: &str = concat!(
    include_str!("../../shaders/lib/lights.wgsl"),
    include_str!("../../shaders/raycast/project.wgsl"),
    include_str!("../../shaders/raycast/isosurface.wgsl"),
    include_str!("../../shaders/raycast/crossing.wgsl"),
    include_str!("../../shaders/raycast/faces.wgsl"),
    include_str!("../../shaders/raycast.wgsl"),
);

/// The stage's resources by binding, in its first group; `illumination` has the second one's.
pub(super) const BINDINGS: [(u32, &str); 9] = [
    (0, "frame"),
    (1, "volume"),
    (2, "volume_sampler"),
    (3, "brick_distances"),
    (4, "transfer_table"),
    (5, "color_out"),
    (6, "depth_out"),
    (7, "gradients"),
    (8, "labels"),
];

/// Pixels along each side of a workgroup's tile.
pub(super) const WORKGROUP_SIDE: u32 = 8;

/// The constants of a specialised pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct PipelineKey {
    mode: Mode,
    depth_rule: u32,
    shaded: bool,
    cut_away: bool,
    cut_slice: bool,
    highlight: bool,
    gradient_opacity: bool,
    classification: Classification,
    placed_lights: bool,
    shadows: bool,
    occlusion: bool,
    edges: Option<Edges>,
    variant: Variant,
}

/// The constants of a specialised pipeline besides the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Variant {
    pub(super) output: Output,
    pub(super) precomputed_gradients: bool,
    /// Whether most samples are visible, so that fetching value and gradient together pays.
    pub(super) mostly_visible: bool,
}

/// The outputs of a ray besides its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Output {
    /// View depth, mm.
    Depth,
    /// The number of volume samples that the ray took, for measuring.
    SampleCount,
}

impl PipelineKey {
    pub(super) fn new(request: &RenderRequest, variant: Variant) -> Self {
        let blends = matches!(request.mode, Mode::Composite | Mode::Isosurface);
        let reflects = request.shading.needs_gradient();
        let occlusion = blends && request.illumination.occlusion.strength > 0.0;
        Self {
            mode: request.mode,
            depth_rule: if blends { request.depth.code() } else { DepthRule::FirstHit.code() },
            shaded: blends && (reflects || occlusion),
            cut_away: request.clip.sphere.is_some(),
            cut_slice: matches!(request.cut, CutFaces::Slice { .. }),
            highlight: request.shading.specular > 0.0,
            gradient_opacity: request.mode == Mode::Composite
                && request.transfer.gradient_opacity().is_some(),
            classification: request.classification,
            placed_lights: blends && reflects && !request.lights.is_empty(),
            shadows: request.casts_shadows(),
            occlusion,
            edges: request.labels.as_ref().map(|labels| labels.edges),
            variant,
        }
    }

    /// Only in mode composite: other modes fetch no gradient with a sample, and a pre-integrated
    /// sample has other positions.
    fn fetch_together(self) -> bool {
        let may = self.mode == Mode::Composite && self.classification == Classification::Sampled;
        may && self.shaded && self.variant.precomputed_gradients && self.variant.mostly_visible
    }

    /// Values of the shader's `override` constants.
    fn constants(self, format: VoxelFormat, runs: usize) -> Vec<(&'static str, f64)> {
        let flag = |on: bool| f64::from(u8::from(on));
        vec![
            ("MODE", self.mode.constant()),
            ("DEPTH_RULE", f64::from(self.depth_rule)),
            ("SHADED", flag(self.shaded)),
            ("CUT_AWAY", flag(self.cut_away)),
            ("CUT_SLICE", flag(self.cut_slice)),
            ("HIGHLIGHT", flag(self.highlight)),
            ("GRADIENT_OPACITY", flag(self.gradient_opacity)),
            ("PRE_INTEGRATED", flag(self.classification == Classification::PreIntegrated)),
            ("FETCH_TOGETHER", flag(self.fetch_together())),
            ("PLACED_LIGHTS", flag(self.placed_lights)),
            ("SHADOWS", flag(self.shadows)),
            ("OCCLUSION", flag(self.occlusion)),
            ("LABELLED", flag(self.edges.is_some())),
            ("SMOOTH_EDGES", flag(self.edges == Some(Edges::Smooth))),
            ("PRECOMPUTED_GRADIENTS", flag(self.variant.precomputed_gradients)),
            ("COUNT_SAMPLES", flag(self.variant.output == Output::SampleCount)),
            ("HU_SCALE", format.hu_scale()),
            ("RUNS", runs as f64),
        ]
    }
}

/// Pipelines by key, compiled on first use.
pub(super) struct Pipelines {
    shader: Shader,
    pub(super) bind_group_layout: wgpu::BindGroupLayout,
    pub(super) lighting_layout: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    format: VoxelFormat,
    /// Runs of tiles that the driver cuts a dispatch into.
    runs: usize,
    compiled: HashMap<PipelineKey, wgpu::ComputePipeline>,
}

impl Pipelines {
    /// `format` is that of the volumes.
    pub(super) fn new(gpu: &Gpu, format: VoxelFormat) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "the ray-casting shader");
        let table = TableStorage::of(gpu);
        let shader = Shader::new("raycast", &stage_sources(table, RAYCAST))?;
        let bind_group_layout = bind_group_layout(gpu, table);
        let lighting_layout = lighting_layout(gpu);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("raycast"),
            bind_group_layouts: &[Some(&bind_group_layout), Some(&lighting_layout)],
            immediate_size: 0,
        });
        scope.close()?;
        let runs = match gpu.description().kind {
            AdapterKind::Software => std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            _ => 1,
        };
        Ok(Self {
            shader,
            bind_group_layout,
            lighting_layout,
            layout,
            format,
            runs,
            compiled: HashMap::new(),
        })
    }

    /// The pipeline of this key.
    pub(super) fn get(&mut self, gpu: &Gpu, key: PipelineKey) -> Result<&wgpu::ComputePipeline, GpuError> {
        if !self.compiled.contains_key(&key) {
            let constants = key.constants(self.format, self.runs);
            let pipeline = self.shader.pipeline(gpu, Some(&self.layout), &constants)?;
            self.compiled.insert(key, pipeline);
        }
        Ok(&self.compiled[&key])
    }
}

/// The resources of [`BINDINGS`], in their order.
pub(super) fn binding_types(table: TableStorage) -> [wgpu::BindingType; BINDINGS.len()] {
    use wgpu::{BindingType, BufferBindingType, SamplerBindingType, TextureSampleType, TextureViewDimension};
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let texture = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: TextureViewDimension::D3,
        multisampled: false,
    };
    [
        buffer(BufferBindingType::Uniform),
        texture(TextureSampleType::Float { filterable: true }),
        BindingType::Sampler(SamplerBindingType::Filtering),
        buffer(BufferBindingType::Storage { read_only: true }),
        buffer(table.binding()),
        buffer(BufferBindingType::Storage { read_only: false }),
        buffer(BufferBindingType::Storage { read_only: false }),
        texture(TextureSampleType::Float { filterable: true }),
        texture(TextureSampleType::Uint),
    ]
}

fn bind_group_layout(gpu: &Gpu, table: TableStorage) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = BINDINGS
        .iter()
        .zip(binding_types(table))
        .map(|(&(binding, _), ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("raycast"),
        entries: &entries,
    })
}
