//! Volumes and appearances on the GPU: uploads, once for each content.

use super::appearance::{AppearanceKey, VisibleBricks, VolumeBricks};
use super::gradients::Gradients;
use super::request::RenderRequest;
use super::tables::Tables;
use crate::gpu::{ErrorScope, Gpu, GpuError};
use crate::texture::SLAB_BYTES;
use crate::texture::VoxelFormat;
use crate::texture::texture_3d;
use crate::texture::write_layers;
use crate::volume_plan::VolumePlan;
use relief_volume::{BrickLabels, BrickRanges, ContentHash, DistanceMap, TransferTable, Volume};

/// A volume's texture and its bricks' ranges.
pub(super) struct VolumeOnGpu {
    pub(super) hash: ContentHash,
    /// See [`relief_volume::Grid::unit_mm`].
    pub(super) unit_mm: f64,
    pub(super) view: wgpu::TextureView,
    pub(super) gradients: Gradients,
    pub(super) plan: VolumePlan,
    format: VoxelFormat,
    pub(super) bricks: VolumeBricks,
}

impl VolumeOnGpu {
    /// The value that a texel holds for an HU.
    pub(super) fn stored(&self, hu: i16) -> f32 {
        self.format.stored(hu)
    }

    /// Uploads a volume as planned for its dimensions, with its bricks if they are known.
    pub(super) fn upload(
        gpu: &Gpu,
        volume: &Volume,
        format: VoxelFormat,
        plan: VolumePlan,
        bricks: Option<VolumeBricks>,
    ) -> Result<Self, GpuError> {
        let scope = ErrorScope::open(gpu, "a volume");
        let dims = volume.grid().dims();
        let texture = texture_3d(gpu, "volume", dims, format.texture_format());
        let [nx, ny, _] = dims;
        let layers = (SLAB_BYTES / (nx * ny * 2)).max(1);
        for (i, slab) in volume.voxels_hu().chunks(layers * nx * ny).enumerate() {
            write_layers(gpu, &texture, i * layers, [nx, ny, slab.len() / (nx * ny)], &format.texels(slab));
            // Submitting frees the staging memory of the slabs before.
            gpu.queue.submit([]);
        }
        let gradients = Gradients::upload(gpu, volume, format, plan.gradient_bytes > 0);
        scope.close()?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let bricks = bricks.unwrap_or_else(|| VolumeBricks::new(volume, &plan));
        let unit_mm = volume.grid().unit_mm();
        Ok(Self { hash: volume.content_hash(), unit_mm, view, gradients, plan, format, bricks })
    }
}

/// A transfer function on the GPU, tabulated for a sample distance, and the empty space of a volume
/// under it.
pub(super) struct Appearance {
    pub(super) key: AppearanceKey,
    pub(super) tables: Tables,
    pub(super) table_buffer: wgpu::Buffer,
    pub(super) bricks: VisibleBricks,
    /// Four bricks a word.
    pub(super) distances: wgpu::Buffer,
    pub(super) bytes: u64,
    /// HU/mm of a component of 1 of the volume's gradients.
    pub(super) gradient_scale: f32,
    /// Whether most samples that are taken are likely to be visible.
    pub(super) mostly_visible: bool,
}

impl Appearance {
    /// `segments` is what occurs in the bricks of the request's label map, if it has one.
    pub(super) fn upload(
        gpu: &Gpu,
        volume: &VolumeOnGpu,
        segments: Option<&BrickLabels>,
        request: &RenderRequest,
    ) -> Result<Self, GpuError> {
        let tables = Tables::new(request);
        let map = volume.bricks.distance_map(segments, request, &tables, |hu| volume.stored(hu));
        let scope = ErrorScope::open(gpu, "a transfer function and its distance map");
        let table_buffer = upload_table(gpu, &tables.buffer());
        let distances = upload_distances(gpu, &map);
        let mostly_visible = is_mostly_visible(&volume.bricks.coarse, &tables.own, |hu| volume.stored(hu));
        let bricks = VisibleBricks::new(&map, request);
        let bytes = table_buffer.size() + distances.size();
        scope.close()?;
        Ok(Self {
            key: AppearanceKey::new(volume.hash, request),
            tables,
            table_buffer,
            bricks,
            distances,
            bytes,
            gradient_scale: volume.gradients.scale,
            mostly_visible,
        })
    }
}

/// A transfer table for shaders to read.
pub(super) fn upload_table(gpu: &Gpu, buffer: &[[f32; 4]]) -> wgpu::Buffer {
    let entries: &[u8] = bytemuck::cast_slice(buffer);
    // A uniform has room for the longest table, whatever this one's length.
    let mut table_bytes = vec![0; size_of::<[f32; 4]>() * TransferTable::MAX_ENTRIES];
    table_bytes[..entries.len()].copy_from_slice(entries);
    read_only(gpu, "transfer table", &table_bytes)
}

/// Whether most samples that rays take are likely to be visible: most bricks that show anything
/// show all they hold, and rays go on through them for more samples than they take in vain before,
/// about three.
fn is_mostly_visible(bricks: &BrickRanges, table: &TransferTable, stored: impl Fn(i16) -> f32) -> bool {
    const RUN: f32 = 4.0;
    // A thirteenth of the bricks says it as well.
    const EVERY: usize = 13;
    let (mut shown, mut whole, mut opacities) = (0u32, 0u32, 0.0);
    for (low, high) in
        bricks.ranges_hu().iter().step_by(EVERY).map(|&(low, high)| (stored(low), stored(high)))
    {
        shown += u32::from(table.is_visible(low, high));
        let ends = [table.opacity(low), table.opacity(high)];
        if ends.into_iter().all(|opacity| opacity > 0.0) {
            whole += 1;
            opacities += 0.5 * (ends[0] + ends[1]);
        }
    }
    let usual = (opacities / whole.max(1) as f32).min(0.999);
    // Samples of this opacity until 1/512 of the light is left.
    2 * whole > shown && 512f32.ln() > RUN * -(1.0 - usual).ln()
}

fn upload_distances(gpu: &Gpu, map: &DistanceMap) -> wgpu::Buffer {
    let mut bytes = map.distances.clone();
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    read_only(gpu, "brick distances", &bytes)
}

/// A buffer with these bytes, for shaders to read.
fn read_only(gpu: &Gpu, label: &str, bytes: &[u8]) -> wgpu::Buffer {
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.len() as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}
