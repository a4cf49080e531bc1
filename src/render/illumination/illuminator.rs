//! Fills cells where none are kept, and binds them for the rays.

use super::cells::Cells;
use super::stage::{CELL_BINDINGS, CELLS_SIDE, Stage, StageKey};
use super::uniform::{IlluminationUniform, LightingUniform};
use crate::RenderError;
use crate::gpu::{ErrorScope, Gpu, GpuError};
use crate::illumination::quantity::{FillingKey, LightQuantity, TEXELS};
use crate::request::RenderRequest;
use crate::skipping::EmptySpaceSkipping;
use crate::tables::Tables;
use crate::texture::VoxelFormat;
use crate::uniform::FrameUniform;
use crate::upload::{Appearance, VolumeOnGpu, upload_table};
use relief_volume::{ContentHash, Volume};

/// Fillings kept, each of at most 16 MiB; the least recently used goes first.
const KEPT: usize = 4;

/// Cells of one dispatch: short enough for drivers that stop long ones.
const CELLS_OF_DISPATCH: usize = 1 << 18;

/// The lit volume and its lights.
#[derive(Clone, Copy)]
pub(crate) struct IlluminationJob<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) volume: &'a Volume,
    pub(crate) on_gpu: &'a VolumeOnGpu,
    pub(crate) appearance: &'a Appearance,
    pub(crate) labels: &'a wgpu::TextureView,
    pub(crate) sampler: &'a wgpu::Sampler,
    pub(crate) request: &'a RenderRequest,
}

/// Filled cells.
struct Filling {
    key: FillingKey,
    view: wgpu::TextureView,
}

/// Keeps what rays need beside the volume to light its samples.
pub(crate) struct Illuminator {
    layout: wgpu::BindGroupLayout,
    lighting: wgpu::Buffer,
    /// In the place of cells that are not looked up.
    nothing: wgpu::TextureView,
    bindings: wgpu::BindGroup,
    format: VoxelFormat,
    /// Made on first use.
    stage: Option<Stage>,
    kept: Vec<Filling>,
}

impl Illuminator {
    /// `layout` is that of the ray caster's second group; `format` is that of the volumes.
    pub(crate) fn new(
        gpu: &Gpu,
        layout: wgpu::BindGroupLayout,
        format: VoxelFormat,
    ) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "placed lights");
        let lighting = uniform_buffer(gpu, "lighting", size_of::<LightingUniform>());
        let nothing = cell_texture(gpu, [1; 3]);
        let bindings = bind(gpu, &layout, &lighting, [&nothing, &nothing]);
        scope.close()?;
        Ok(Self { layout, lighting, nothing, bindings, format, stage: None, kept: Vec::new() })
    }

    /// The ray caster's second group, for the request that was last prepared.
    pub(crate) fn bindings(&self) -> &wgpu::BindGroup {
        &self.bindings
    }

    /// Releases the cells of a volume.
    pub(crate) fn forget(&mut self, gpu: &Gpu, volume: ContentHash) {
        self.bindings = bind(gpu, &self.layout, &self.lighting, [&self.nothing, &self.nothing]);
        self.kept.retain(|filling| filling.key.volume != volume);
    }

    /// Releases all cells.
    pub(crate) fn clear(&mut self, gpu: &Gpu) {
        self.bindings = bind(gpu, &self.layout, &self.lighting, [&self.nothing, &self.nothing]);
        self.kept.clear();
    }

    /// Makes the second group fit a request, if its rays read that; says whether cells were filled.
    pub(crate) fn prepare(&mut self, order: IlluminationJob<'_>) -> Result<bool, RenderError> {
        let IlluminationJob { gpu, volume, on_gpu, request, .. } = order;
        if !request.has_own_light() {
            return Ok(false);
        }
        let grid = volume.grid();
        let cells = Cells::of(grid);
        let lighting = LightingUniform::new(request, grid, &cells);
        gpu.queue.write_buffer(&self.lighting, 0, bytemuck::bytes_of(&lighting));
        let mut filled = false;
        let mut views = [self.nothing.clone(), self.nothing.clone()];
        for (quantity, view) in LightQuantity::of(request).into_iter().zip(&mut views) {
            let Some(quantity) = quantity else { continue };
            let key = FillingKey::new(on_gpu.hash, request, quantity);
            if let Some(at) = self.kept.iter().position(|filling| filling.key == key) {
                self.kept[at..].rotate_left(1);
            } else {
                if self.kept.len() == KEPT {
                    self.kept.remove(0);
                }
                let made = self.fill(order, &cells, &key)?;
                self.kept.push(Filling { key, view: made });
                filled = true;
            }
            *view = self.kept[self.kept.len() - 1].view.clone();
        }
        let scope = ErrorScope::open(gpu, "placed lights");
        self.bindings = bind(gpu, &self.layout, &self.lighting, [&views[0], &views[1]]);
        scope.close()?;
        Ok(filled)
    }

    fn fill(
        &mut self,
        order: IlluminationJob<'_>,
        cells: &Cells,
        key: &FillingKey,
    ) -> Result<wgpu::TextureView, RenderError> {
        let IlluminationJob { gpu, volume, on_gpu, appearance, request, .. } = order;
        let stage = match &mut self.stage {
            Some(stage) => stage,
            none => none.insert(Stage::new(gpu, self.format)?),
        };
        let is_openness = matches!(key.quantity, LightQuantity::Openness { .. });
        let stage_key = StageKey::new(request, is_openness, on_gpu.gradients.precomputed);
        let pipeline = stage.get(gpu, stage_key)?;
        let steady = key.quantity.steady_request(request, volume.grid(), cells)?;
        let frame = FrameUniform::new(&steady, volume, appearance, EmptySpaceSkipping::On);
        let mut uniform =
            IlluminationUniform::new(&steady, volume.grid(), appearance.bricks.edge, cells, &key.quantity);
        let scope = ErrorScope::open(gpu, "cells of light");
        let buffers = Buffers {
            frame: uniform_buffer(gpu, "frame", size_of::<FrameUniform>()),
            illumination: uniform_buffer(gpu, "illumination", size_of::<IlluminationUniform>()),
            table: upload_table(gpu, &Tables::new(&steady).buffer()),
        };
        gpu.queue.write_buffer(&buffers.frame, 0, bytemuck::bytes_of(&frame));
        let view = cell_texture(gpu, cells.dims);
        let groups = buffers.bind(order, stage, &view);
        let [x, y, layers] = uniform.dispatch_size();
        let at_once = layers_at_once(cells.dims);
        for first in (0..layers).step_by(at_once as usize) {
            uniform.first_layer = first * CELLS_SIDE;
            gpu.queue.write_buffer(&buffers.illumination, 0, bytemuck::bytes_of(&uniform));
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &groups[0], &[]);
                pass.set_bind_group(1, &groups[1], &[]);
                pass.dispatch_workgroups(x, y, at_once.min(layers - first));
            }
            gpu.queue.submit([encoder.finish()]);
        }
        scope.close()?;
        gpu.wait("cells of light")?;
        Ok(view)
    }
}

/// Layers of workgroups of one dispatch.
fn layers_at_once([nx, ny, _]: [usize; 3]) -> u32 {
    let layers = CELLS_OF_DISPATCH / (nx * ny * CELLS_SIDE as usize).max(1);
    u32::try_from(layers).unwrap_or(u32::MAX).max(1)
}

/// The parameters of a filling besides the volume and its appearance.
struct Buffers {
    frame: wgpu::Buffer,
    illumination: wgpu::Buffer,
    table: wgpu::Buffer,
}

impl Buffers {
    fn bind(
        &self,
        order: IlluminationJob<'_>,
        stage: &Stage,
        cells: &wgpu::TextureView,
    ) -> [wgpu::BindGroup; 2] {
        let resources = [
            self.frame.as_entire_binding(),
            wgpu::BindingResource::TextureView(&order.on_gpu.view),
            wgpu::BindingResource::Sampler(order.sampler),
            order.appearance.distances.as_entire_binding(),
            self.table.as_entire_binding(),
            wgpu::BindingResource::TextureView(&order.on_gpu.gradients.view),
            wgpu::BindingResource::TextureView(order.labels),
            self.illumination.as_entire_binding(),
            wgpu::BindingResource::TextureView(cells),
        ];
        let entries = CELL_BINDINGS.iter().zip(resources);
        [0, 1].map(|group| {
            let of_group = entries.clone().filter(|((of, _, _), _)| *of as usize == group);
            let entries: Vec<_> = of_group
                .map(|(&(_, binding, _), resource)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            order.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("illuminate"),
                layout: &stage.layouts[group],
                entries: &entries,
            })
        })
    }
}

fn bind(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    lighting: &wgpu::Buffer,
    [shadows, openness]: [&wgpu::TextureView; 2],
) -> wgpu::BindGroup {
    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("lighting"),
        layout,
        entries: &[
            entry(0, lighting.as_entire_binding()),
            entry(1, wgpu::BindingResource::TextureView(shadows)),
            entry(2, wgpu::BindingResource::TextureView(openness)),
        ],
    })
}

fn uniform_buffer(gpu: &Gpu, label: &str, size: usize) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn cell_texture(gpu: &Gpu, [nx, ny, nz]: [usize; 3]) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("cells of light"),
        size: wgpu::Extent3d { width: nx as u32, height: ny as u32, depth_or_array_layers: nz as u32 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: TEXELS,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
