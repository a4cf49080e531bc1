//! The cache on the adapter: volumes and their appearances, within a limit of bytes, with eviction
//! of the least recently used.
//!
//! Voxels, gradients, label maps, transfer tables and maps of empty space count towards the limit.
//! Pictures and the one medium of the path tracer do not: the request's limits bound their sizes.
//! The dimensions of a volume give its required memory, so a volume that cannot fit is refused
//! before any allocation.

use super::error::RenderError;
use super::label_maps::LabelMaps;
use super::request::RenderRequest;
use super::upload::{Appearance, VolumeOnGpu};
use crate::appearance::PreparedBricks;
use crate::gpu::Gpu;
use crate::texture::VoxelFormat;
use crate::volume_plan::VolumeLimits;
use relief_base::OutOfRange;
use relief_volume::{ContentHash, Volume};

/// Most appearances: a look for one compares it with all.
const KEPT_APPEARANCES: usize = 16;

/// The cached data on an adapter, and counts of uploads and evictions since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Cached volumes.
    pub volumes: usize,
    /// Bytes that they and their appearances take.
    pub used_bytes: u64,
    /// Bytes that they may take.
    pub limit_bytes: u64,
    /// Volumes that went up.
    pub uploads: u64,
    /// Volumes that had to go for others.
    pub evictions: u64,
}

impl MemoryUse {
    /// This and that of another adapter under the same limit.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            volumes: self.volumes + other.volumes,
            used_bytes: self.used_bytes + other.used_bytes,
            limit_bytes: self.limit_bytes,
            uploads: self.uploads + other.uploads,
            evictions: self.evictions + other.evictions,
        }
    }
}

/// Volumes and appearances, in the order of their last use.
pub(super) struct Store {
    pub(super) limits: VolumeLimits,
    format: VoxelFormat,
    volumes: Vec<VolumeOnGpu>,
    /// The next volume.
    pub(super) adopted: Option<PreparedBricks>,
    label_maps: LabelMaps,
    appearances: Vec<Appearance>,
    uploads: u64,
    evictions: u64,
}

impl Store {
    pub(super) fn new(gpu: &Gpu, format: VoxelFormat) -> Self {
        let limits = VolumeLimits::of(gpu);
        let label_maps = LabelMaps::new(gpu);
        let (volumes, appearances) = (Vec::new(), Vec::new());
        Self { limits, format, volumes, adopted: None, label_maps, appearances, uploads: 0, evictions: 0 }
    }

    /// The volume that was prepared last.
    pub(super) fn volume(&self) -> &VolumeOnGpu {
        self.volumes.last().expect("prepared before")
    }

    /// The appearance that was prepared last.
    pub(super) fn appearance(&self) -> &Appearance {
        self.appearances.last().expect("prepared before")
    }

    /// The label map of a request that was prepared last; a single texel where it has none.
    pub(super) fn labels(&self, request: &RenderRequest) -> &wgpu::TextureView {
        self.label_maps.view(request)
    }

    pub(super) fn memory(&self) -> MemoryUse {
        let volumes = self.volumes.iter().map(|volume| volume.plan.bytes()).sum::<u64>();
        MemoryUse {
            volumes: self.volumes.len(),
            used_bytes: volumes
                + self.label_maps.bytes()
                + self.appearances.iter().map(|known| known.bytes).sum::<u64>(),
            limit_bytes: self.limits.memory_bytes,
            uploads: self.uploads,
            evictions: self.evictions,
        }
    }

    /// Makes a volume and the appearance of a request the last used; says whether anything went up.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        volume: &Volume,
        request: &RenderRequest,
    ) -> Result<bool, RenderError> {
        let hash = volume.content_hash();
        let had_volume = !self.prepare_volume(gpu, volume)?;
        let had_labels = !self.prepare_labels(gpu, request)?;
        let had_appearance = move_to_end(&mut self.appearances, |known| known.key.fits(hash, request));
        if !had_appearance {
            let bytes = self.volume().plan.appearance_bytes;
            while !self.appearances.is_empty()
                && (self.appearances.len() == KEPT_APPEARANCES || self.lacks_room_for(bytes))
            {
                self.appearances.remove(0);
            }
            while self.volumes.len() > 1 && self.lacks_room_for(bytes) {
                self.evict_first();
            }
            let segments = self.label_maps.segments(request);
            let appearance = Appearance::upload(gpu, self.volume(), segments, request)?;
            self.appearances.push(appearance);
        }
        Ok(!(had_volume && had_labels && had_appearance))
    }

    /// Makes a volume the last used; says whether it went up.
    pub(super) fn prepare_volume(&mut self, gpu: &Gpu, volume: &Volume) -> Result<bool, RenderError> {
        let hash = volume.content_hash();
        if move_to_end(&mut self.volumes, |known| known.hash == hash) {
            return Ok(false);
        }
        let plan = self.limits.plan(volume.grid().dims())?;
        let evicted = self.evictions;
        while !self.volumes.is_empty() && self.lacks_room_for(plan.bytes_with_appearance()) {
            self.evict_first();
        }
        if self.evictions > evicted {
            // Dropped data is freed when the device no longer uses it.
            gpu.wait("freeing memory")?;
        }
        let adopted = self.adopted.take().and_then(|adopted| adopted.bricks_of(hash, &plan));
        self.volumes.push(VolumeOnGpu::upload(gpu, volume, self.format, plan, adopted)?);
        self.uploads += 1;
        Ok(true)
    }

    /// Makes the label map of a request on the volume that was prepared last the last used; says
    /// whether it went up.
    fn prepare_labels(&mut self, gpu: &Gpu, request: &RenderRequest) -> Result<bool, RenderError> {
        let Some(labels) = &request.labels else { return Ok(false) };
        let (volume, brick_edge) = (self.volume().hash, self.volume().plan.brick_edge);
        if self.label_maps.use_again(volume, &labels.map) {
            return Ok(false);
        }
        let bytes = labels.map.size_bytes() as u64;
        while self.lacks_room_for(bytes) && self.label_maps.drop_first() {}
        while self.volumes.len() > 1 && self.lacks_room_for(bytes) {
            self.evict_first();
        }
        if self.lacks_room_for(bytes) {
            let free = self.limits.memory_bytes.saturating_sub(self.memory().used_bytes);
            let allowed = format!("at most {free} bytes beside the volume; raise --gpu-memory");
            return Err(OutOfRange::new("labels", format!("a map of {bytes} bytes"), allowed).into());
        }
        self.label_maps.upload(gpu, volume, &labels.map, brick_edge)?;
        Ok(true)
    }

    /// Frees the data of a volume.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.volumes.retain(|known| known.hash != volume);
        self.label_maps.forget(volume);
        self.appearances.retain(|known| known.key.volume != volume);
    }

    /// Frees everything.
    pub(super) fn clear(&mut self) {
        while !self.volumes.is_empty() {
            self.evict_first();
        }
        self.appearances.clear();
    }

    fn lacks_room_for(&self, bytes: u64) -> bool {
        self.memory().used_bytes.saturating_add(bytes) > self.limits.memory_bytes
    }

    fn evict_first(&mut self) {
        let hash = self.volumes.remove(0).hash;
        self.label_maps.forget(hash);
        self.appearances.retain(|known| known.key.volume != hash);
        self.evictions += 1;
    }
}

/// Moves the first item for which `is_it` holds to the end; says whether there was one.
fn move_to_end<T>(items: &mut [T], is_it: impl Fn(&T) -> bool) -> bool {
    let found = items.iter().position(is_it);
    if let Some(i) = found {
        items[i..].rotate_left(1);
    }
    found.is_some()
}
