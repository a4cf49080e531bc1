//! A transfer function as a medium on the GPU, and the bounds of its extinction in each brick of a
//! volume.

use crate::gpu::{ErrorScope, Gpu, GpuError};
use crate::request::RenderRequest;
use crate::texture::texture_3d;
use crate::texture::write_layers;
use crate::upload::VolumeOnGpu;
use relief_volume::{ContentHash, MediumTable, TransferFunction};

/// The medium of one volume under one transfer function and density.
pub(super) struct Medium {
    volume: ContentHash,
    transfer: TransferFunction,
    density: f64,
    pub(super) table: MediumTable,
    pub(super) table_buffer: wgpu::Buffer,
    pub(super) bounds: wgpu::TextureView,
}

impl Medium {
    pub(super) fn upload(gpu: &Gpu, volume: &VolumeOnGpu, request: &RenderRequest) -> Result<Self, GpuError> {
        let density = request.path_trace.density;
        let table = MediumTable::new(&request.transfer, density, volume.unit_mm);
        let (bounds, dims) = brick_bounds(volume, &table);
        let scope = ErrorScope::open(gpu, "a medium");
        let entries: &[u8] = bytemuck::cast_slice(&table.entries);
        let table_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("medium table"),
            size: entries.len() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&table_buffer, 0, entries);
        let texture = texture_3d(gpu, "brick bounds", dims, wgpu::TextureFormat::R32Float);
        write_layers(gpu, &texture, 0, dims, bytemuck::cast_slice(&bounds));
        scope.close()?;
        let bounds = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let transfer = request.transfer.clone();
        Ok(Self { volume: volume.hash, transfer, density, table, table_buffer, bounds })
    }

    /// Whether it was made for this volume.
    pub(super) fn is_of(&self, volume: ContentHash) -> bool {
        self.volume == volume
    }

    pub(super) fn fits(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume
            && self.density == request.path_trace.density
            && self.transfer == request.transfer
    }
}

/// For each brick its largest extinction per mm, or minus its distance in bricks to the nearest one
/// that has any.
fn brick_bounds(volume: &VolumeOnGpu, table: &MediumTable) -> (Vec<f32>, [usize; 3]) {
    let largest = |low: i16, high: i16| table.largest_extinction(volume.stored(low), volume.stored(high));
    let map = volume.bricks.coarse.distance_map(|low, high| largest(low, high) > 0.0);
    let bound = |(&distance, &(low, high)): (&u8, &(i16, i16))| match distance {
        0 => largest(low, high),
        distance => -f32::from(distance),
    };
    let bounds = map.distances.iter().zip(volume.bricks.coarse.ranges_hu()).map(bound).collect();
    (bounds, map.dims)
}
