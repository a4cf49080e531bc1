//! The slice pipelines, one for each blend, and the uniform that says where the slab is.
//!
//! Beside `pipelines`, whose resources they share but for that uniform. Lengths in mm.

use std::collections::HashMap;

use bytemuck::{Pod, Zeroable};

use super::labels::Edges;
use super::limits::depth_limits;
use super::mode::SlabBlend;
use super::pipelines::{BINDINGS, Output, binding_types, stage_sources};
use super::request::RenderRequest;
use super::table_storage::TableStorage;
use crate::gpu::{ErrorScope, Gpu, GpuError, Shader};
use relief_volume::Grid;

/// The stage's own source.
const SLICE: &str = include_str!("../../shaders/slice.wgsl");

/// The resource that a slice has beside those of the ray caster.
pub(super) const SLAB_BINDING: (u32, &str) = (9, "slab");

/// The places of the samples of a slab: on its plane and in pairs before and behind it, from face to
/// face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SlabSamples {
    /// Distance between neighbours, mm: at most the request's sample distance; 0 for a plane.
    pub(super) spacing_mm: f64,
    /// Samples on each side of the plane.
    pub(super) pairs: u32,
}

impl SlabSamples {
    pub(super) fn of(request: &RenderRequest) -> Self {
        // Less a little against rounding: 10 mm at 0.1 mm are 50 pairs, not 51.
        let pairs = (request.slab_mm / (2.0 * request.sample_distance_mm) - 1e-6).ceil().max(0.0);
        let spacing_mm = if pairs > 0.0 { request.slab_mm / (2.0 * pairs) } else { 0.0 };
        Self { spacing_mm, pairs: pairs as u32 }
    }
}

/// The Rust mirror of `struct Slab` in `shaders/slice.wgsl`, which defines meanings and units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SlabUniform {
    plane_t: f32,
    spacing_mm: f32,
    pairs: u32,
    padding: u32,
}

impl SlabUniform {
    /// The plane goes through the focal point; rays start at the near limit.
    fn new(request: &RenderRequest, grid: &Grid) -> Self {
        let camera = &request.camera;
        let SlabSamples { spacing_mm, pairs } = SlabSamples::of(request);
        let plane_t = camera.distance_mm() - depth_limits(camera, grid).near_mm;
        Self { plane_t: plane_t as f32, spacing_mm: spacing_mm as f32, pairs, padding: 0 }
    }
}

/// The constants of a specialised pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct SliceKey {
    blend: SlabBlend,
    output: Output,
    edges: Option<Edges>,
}

/// The pipelines of mode `slice`, compiled on first use.
pub(super) struct SlicePipelines {
    shader: Shader,
    pub(super) bind_group_layout: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    pub(super) slab: wgpu::Buffer,
    hu_scale: f64,
    compiled: HashMap<SliceKey, wgpu::ComputePipeline>,
}

impl SlicePipelines {
    /// `hu_scale` is the HU of a texel value of 1.
    pub(super) fn new(gpu: &Gpu, hu_scale: f64) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "the slice shader");
        let table = TableStorage::of(gpu);
        let shader = Shader::new("slice", &stage_sources(table, SLICE))?;
        let bind_group_layout = bind_group_layout(gpu, table);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("slice"),
            bind_group_layouts: &[Some(&bind_group_layout)],
            immediate_size: 0,
        });
        let slab = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("slab"),
            size: size_of::<SlabUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        scope.close()?;
        Ok(Self { shader, bind_group_layout, layout, slab, hu_scale, compiled: HashMap::new() })
    }

    /// The pipeline of this blend, with the slab of `request` in its uniform.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        request: &RenderRequest,
        grid: &Grid,
        blend: SlabBlend,
        output: Output,
    ) -> Result<&wgpu::ComputePipeline, GpuError> {
        gpu.queue.write_buffer(&self.slab, 0, bytemuck::bytes_of(&SlabUniform::new(request, grid)));
        let key = SliceKey { blend, output, edges: request.labels.as_ref().map(|labels| labels.edges) };
        if !self.compiled.contains_key(&key) {
            let constants = key.constants(self.hu_scale);
            let pipeline = self.shader.pipeline(gpu, Some(&self.layout), &constants)?;
            self.compiled.insert(key, pipeline);
        }
        Ok(&self.compiled[&key])
    }
}

impl SliceKey {
    /// Values of the shader's `override` constants.
    fn constants(self, hu_scale: f64) -> [(&'static str, f64); 5] {
        let blend = match self.blend {
            SlabBlend::Mean => 0.0,
            SlabBlend::Mip => 1.0,
            SlabBlend::MinIp => 2.0,
        };
        let flag = |on: bool| f64::from(u8::from(on));
        [
            ("BLEND", blend),
            ("LABELLED", flag(self.edges.is_some())),
            ("SMOOTH_EDGES", flag(self.edges == Some(Edges::Smooth))),
            ("COUNT_SAMPLES", flag(self.output == Output::SampleCount)),
            ("HU_SCALE", hu_scale),
        ]
    }
}

fn bind_group_layout(gpu: &Gpu, table: TableStorage) -> wgpu::BindGroupLayout {
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let shared = BINDINGS.iter().map(|(binding, _)| *binding).zip(binding_types(table));
    let entries: Vec<_> = shared
        .chain([(SLAB_BINDING.0, uniform)])
        .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("slice"),
        entries: &entries,
    })
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::super::pipelines::WORKGROUP_SIDE;
    use super::*;

    fn reflected() -> naga::Module {
        naga::front::wgsl::parse_str(&stage_sources(TableStorage::Uniform, SLICE).join("\n"))
            .expect("the shader parses")
    }

    #[test]
    fn slab_uniform_mirrors_the_shader() {
        let mirror = [
            ("plane_t", offset_of!(SlabUniform, plane_t) as u32),
            ("spacing_mm", offset_of!(SlabUniform, spacing_mm) as u32),
            ("pairs", offset_of!(SlabUniform, pairs) as u32),
            ("padding", offset_of!(SlabUniform, padding) as u32),
        ];
        let module = reflected();
        let (_, slab) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some("Slab")).unwrap();
        let naga::TypeInner::Struct { members, span } = &slab.inner else { panic!("Slab is a struct") };
        let shader: Vec<_> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset)).collect();
        assert_eq!(mirror, shader[..]);
        assert_eq!(size_of::<SlabUniform>(), *span as usize);
    }

    #[test]
    fn slice_bindings_and_workgroup_mirror_the_shader() {
        let module = reflected();
        let mut bindings: Vec<(u32, &str)> = module
            .global_variables
            .iter()
            .filter_map(|(_, global)| Some((global.binding?.binding, global.name.as_deref()?)))
            .collect();
        bindings.sort_unstable();
        let expected: Vec<_> = BINDINGS.into_iter().chain([SLAB_BINDING]).collect();
        assert_eq!(bindings, expected);
        assert_eq!(module.entry_points[0].workgroup_size, [WORKGROUP_SIDE, WORKGROUP_SIDE, 1]);
    }

    #[test]
    fn samples_reach_from_face_to_face_and_are_never_too_far_apart() {
        let grid = Grid::axis_aligned([10; 3], [1.0; 3], [0.0; 3]).unwrap();
        let scene = crate::SceneFile::parse(br#"{"mode": "slice"}"#).unwrap();
        let mut request = scene.resolve(&grid, &relief_volume::Orbit::default()).unwrap().request;
        for (slab_mm, sample_distance_mm, pairs, spacing_mm) in
            [(0.0, 0.5, 0, 0.0), (10.0, 0.1, 50, 0.1), (10.0, 3.0, 2, 2.5), (1.0, 5.0, 1, 0.5)]
        {
            (request.slab_mm, request.sample_distance_mm) = (slab_mm, sample_distance_mm);
            let found = SlabSamples::of(&request);
            assert_eq!(found.pairs, pairs, "{slab_mm} mm at {sample_distance_mm} mm");
            assert!((found.spacing_mm - spacing_mm).abs() < 1e-12, "{slab_mm} mm at {sample_distance_mm} mm");
        }
    }
}
