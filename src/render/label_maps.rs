//! Label maps on the GPU: a texture of places in the list of segments, and the segments of each
//! brick.

use super::request::RenderRequest;
use crate::gpu::{ErrorScope, Gpu, GpuError};
use crate::texture::SLAB_BYTES;
use crate::texture::texture_3d;
use crate::texture::write_layers;
use relief_volume::{BrickLabels, ContentHash, LabelMap, SegmentIndices};

/// Label maps kept on the GPU; the least recently used goes first.
const KEPT: usize = 4;

/// A label map's texture and its bricks' segments.
struct LabelsOnGpu {
    volume: ContentHash,
    map: ContentHash,
    view: wgpu::TextureView,
    bricks: BrickLabels,
    bytes: u64,
}

/// The label maps that went up, the one used last at the end.
pub(super) struct LabelMaps {
    kept: Vec<LabelsOnGpu>,
    /// A single texel, for requests without labels.
    none: wgpu::TextureView,
}

impl LabelMaps {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let texel = texture_3d(gpu, "no labels", [1; 3], wgpu::TextureFormat::R8Uint);
        Self { kept: Vec::new(), none: texel.create_view(&wgpu::TextureViewDescriptor::default()) }
    }

    /// Makes the map of a volume the last used, if it is here.
    pub(super) fn use_again(&mut self, volume: ContentHash, map: &LabelMap) -> bool {
        let map = map.content_hash();
        let found = self.kept.iter().position(|known| known.volume == volume && known.map == map);
        if let Some(at) = found {
            self.kept[at..].rotate_left(1);
        }
        found.is_some()
    }

    /// Drops the least recently used map; says whether there was one.
    pub(super) fn drop_first(&mut self) -> bool {
        let has_one = !self.kept.is_empty();
        if has_one {
            self.kept.remove(0);
        }
        has_one
    }

    /// Bytes of all maps.
    pub(super) fn bytes(&self) -> u64 {
        self.kept.iter().map(|known| known.bytes).sum()
    }

    /// Puts a map last. The volume is within the adapter's limits, the map on its grid, and its
    /// bricks have this edge.
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        volume: ContentHash,
        map: &LabelMap,
        brick_edge: usize,
    ) -> Result<(), GpuError> {
        if self.kept.len() == KEPT {
            self.kept.remove(0);
        }
        let scope = ErrorScope::open(gpu, "a label map");
        let view = upload(gpu, map);
        scope.close()?;
        let (bricks, bytes) = (BrickLabels::new(map, brick_edge), map.size_bytes() as u64);
        self.kept.push(LabelsOnGpu { volume, map: map.content_hash(), view, bricks, bytes });
        Ok(())
    }

    /// The texture of a request whose map went up last.
    pub(super) fn view(&self, request: &RenderRequest) -> &wgpu::TextureView {
        self.last(request).map_or(&self.none, |labels| &labels.view)
    }

    /// The segments in the bricks of a request whose map went up last.
    pub(super) fn segments(&self, request: &RenderRequest) -> Option<&BrickLabels> {
        self.last(request).map(|labels| &labels.bricks)
    }

    fn last(&self, request: &RenderRequest) -> Option<&LabelsOnGpu> {
        self.kept.last().filter(|_| request.labels.is_some())
    }

    /// Frees the maps of a volume.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.kept.retain(|known| known.volume != volume);
    }
}

fn upload(gpu: &Gpu, map: &LabelMap) -> wgpu::TextureView {
    let (format, texels, texel_bytes): (_, &[u8], _) = match map.places() {
        SegmentIndices::Bytes(places) => (wgpu::TextureFormat::R8Uint, places, 1),
        SegmentIndices::Words(places) => (wgpu::TextureFormat::R16Uint, bytemuck::cast_slice(places), 2),
    };
    let dims = map.grid().dims();
    let texture = texture_3d(gpu, "labels", dims, format);
    let layer_bytes = dims[0] * dims[1] * texel_bytes;
    let layers = (SLAB_BYTES / layer_bytes).max(1);
    for (i, slab) in texels.chunks(layers * layer_bytes).enumerate() {
        write_layers(gpu, &texture, i * layers, [dims[0], dims[1], slab.len() / layer_bytes], slab);
        // Submitting frees the staging memory of the slabs before.
        gpu.queue.submit([]);
    }
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
