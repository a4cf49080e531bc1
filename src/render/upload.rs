//! Volumes and appearances on the GPU: uploads, once for each content.

use std::sync::Arc;

use super::classification::Classification;
use super::gradients::Gradients;
use super::labels::Labels;
use super::mode::Mode;
use super::request::RenderRequest;
use super::surface::Surface;
use super::tables::{TableSet, Tables};
use crate::gpu::{ErrorScope, Gpu, GpuError};
use crate::texture::SLAB_BYTES;
use crate::texture::VoxelFormat;
use crate::texture::texture_3d;
use crate::texture::write_layers;
use crate::volume_plan::VolumePlan;
use relief_base::{Patient, Point, Voxel};
use relief_volume::{
    BrickLabels, BrickRanges, ContentHash, DistanceMap, Grid, TransferFunction, TransferTable, Volume,
};

/// A volume's texture and its bricks' ranges.
pub(super) struct VolumeOnGpu {
    pub(super) hash: ContentHash,
    pub(super) view: wgpu::TextureView,
    pub(super) gradients: Gradients,
    pub(super) plan: VolumePlan,
    format: VoxelFormat,
    pub(super) bricks: BrickRanges,
    /// Smaller bricks for a small volume, only for composite pictures of sampled values: other ways
    /// of skipping need bricks that are longer than their steps.
    fine_bricks: Option<BrickRanges>,
}

impl VolumeOnGpu {
    /// The value that a texel holds for an HU.
    pub(super) fn stored(&self, hu: i16) -> f32 {
        self.format.stored(hu)
    }

    /// Uploads a volume as planned for its dimensions.
    pub(super) fn upload(
        gpu: &Gpu,
        volume: &Volume,
        format: VoxelFormat,
        plan: VolumePlan,
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
        let bricks = BrickRanges::new(volume, plan.brick_edge);
        let has_fine = plan.fine_brick_edge != plan.brick_edge;
        let fine_bricks = has_fine.then(|| BrickRanges::new(volume, plan.fine_brick_edge));
        Ok(Self { hash: volume.content_hash(), view, gradients, plan, format, bricks, fine_bricks })
    }
}

/// How bricks tile a volume.
#[derive(Clone, Copy, Debug)]
pub(super) struct BrickLayout {
    /// Edge of a brick in voxels.
    pub(super) edge: usize,
    /// Bricks along i, j, k.
    pub(super) dims: [usize; 3],
}

/// A transfer function on the GPU, tabulated for a sample distance, and the empty space of a volume
/// under it.
pub(super) struct Appearance {
    volume: ContentHash,
    transfer: TransferFunction,
    sample_distance_mm: f64,
    mode: Mode,
    classification: Classification,
    surfaces: Vec<Surface>,
    labels: Option<Arc<Labels>>,
    pub(super) tables: Tables,
    pub(super) table_buffer: wgpu::Buffer,
    pub(super) bricks: BrickLayout,
    /// Four bricks a word.
    pub(super) distances: wgpu::Buffer,
    /// The first and the last brick along each axis that may show something; none where nothing
    /// does.
    visible_bricks: Option<[[usize; 3]; 2]>,
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
        let map = distance_map(volume, segments, request, &tables);
        let scope = ErrorScope::open(gpu, "a transfer function and its distance map");
        let table_buffer = upload_table(gpu, &tables.buffer());
        let distances = upload_distances(gpu, &map);
        let mostly_visible = is_mostly_visible(&volume.bricks, &tables.own, |hu| volume.stored(hu));
        let bricks = BrickLayout { edge: map.edge, dims: map.dims };
        let bytes = table_buffer.size() + distances.size();
        scope.close()?;
        Ok(Self {
            volume: volume.hash,
            transfer: request.transfer.clone(),
            sample_distance_mm: request.sample_distance_mm,
            mode: request.mode,
            classification: request.classification,
            surfaces: request.surfaces.clone(),
            labels: request.labels.clone(),
            tables,
            table_buffer,
            bricks,
            distances,
            visible_bricks: map.visible_bounds(),
            bytes,
            gradient_scale: volume.gradients.scale,
            mostly_visible,
        })
    }

    /// Whether it was made for this volume.
    pub(super) fn is_of(&self, volume: ContentHash) -> bool {
        self.volume == volume
    }

    /// The corners of a box about all that may be visible; none where nothing is. A pre-integrated
    /// sample reaches into the bricks beside its own.
    pub(super) fn visible_corners(&self, grid: &Grid) -> Option<[Point<Patient>; 8]> {
        let BrickLayout { edge, dims } = self.bricks;
        let beside = usize::from(self.classification == Classification::PreIntegrated);
        self.visible_bricks.map(|[first, last]| {
            std::array::from_fn(|corner| {
                let at = |axis: usize| {
                    let (low, high) = (first[axis].saturating_sub(beside), last[axis] + beside + 1);
                    // The outermost bricks take in the outer halves of the outermost voxels.
                    match corner >> axis & 1 {
                        0 if low == 0 => -0.5,
                        0 => (low * edge) as f64,
                        _ if high >= dims[axis] => grid.dims()[axis] as f64 - 0.5,
                        _ => (high * edge) as f64,
                    }
                };
                grid.patient_from_voxel() * Point::<Voxel>::new(at(0), at(1), at(2))
            })
        })
    }

    pub(super) fn fits(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume
            && self.mode == request.mode
            && self.classification == request.classification
            && self.surfaces == request.surfaces
            && self.sample_distance_mm == request.sample_distance_mm
            && self.transfer == request.transfer
            && self.labels == request.labels
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

/// Distances to visible voxels for a request.
fn distance_map(
    volume: &VolumeOnGpu,
    segments: Option<&BrickLabels>,
    request: &RenderRequest,
    tables: &Tables,
) -> DistanceMap {
    let stored = |hu| volume.stored(hu);
    let Some(segments) = segments else {
        let shows = |low, high| tables.is_of_interest(request, stored(low), stored(high));
        let is_plain = request.mode == Mode::Composite && request.classification == Classification::Sampled;
        let fine = volume.fine_bricks.as_ref().filter(|_| is_plain);
        return fine.unwrap_or(&volume.bricks).distance_map(shows);
    };
    let sets: Vec<TableSet> = segments.sets().iter().map(|places| tables.set_of(places)).collect();
    volume.bricks.distance_map_by(|brick, low, high| {
        let set = sets[segments.of_brick()[brick] as usize];
        tables.is_of_interest_in(request, set, stored(low), stored(high))
    })
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
