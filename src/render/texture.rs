//! Textures of volumes: their formats and their content.

use crate::Gpu;
use crate::GpuLimits;
/// Bytes handed to the queue at once: staging memory stays small beside the volume.
pub(super) const SLAB_BYTES: usize = 16 << 20;

/// How voxels are stored in texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VoxelFormat {
    /// Signed normalised 16 bit: every HU is exact but -32768, which becomes -32767.
    Norm16,
    /// Half float: exact between ±2048 HU, to 2 HU up to 4095.
    Half,
}

impl VoxelFormat {
    pub(super) fn of(limits: GpuLimits) -> Self {
        if limits.norm16_textures { Self::Norm16 } else { Self::Half }
    }

    /// HU of a texel value of 1.
    pub(super) fn hu_scale(self) -> f64 {
        match self {
            Self::Norm16 => f64::from(i16::MAX),
            Self::Half => 1.0,
        }
    }

    pub(super) fn texture_format(self) -> wgpu::TextureFormat {
        match self {
            Self::Norm16 => wgpu::TextureFormat::R16Snorm,
            Self::Half => wgpu::TextureFormat::R16Float,
        }
    }

    /// The value that a texel holds for an HU. Rounding keeps the order, so it maps ranges to
    /// ranges.
    pub(super) fn stored(self, hu: i16) -> f32 {
        match self {
            Self::Norm16 => f32::from(hu.max(-i16::MAX)),
            Self::Half => half::f16::from_f32(f32::from(hu)).to_f32(),
        }
    }

    pub(super) fn texels(self, voxels_hu: &[i16]) -> std::borrow::Cow<'_, [u8]> {
        match self {
            Self::Norm16 => bytemuck::cast_slice(voxels_hu).into(),
            Self::Half => {
                let halves: Vec<half::f16> =
                    voxels_hu.iter().map(|&hu| half::f16::from_f32(f32::from(hu))).collect();
                bytemuck::cast_slice::<half::f16, u8>(&halves).to_vec().into()
            }
        }
    }
}

pub(super) fn texture_3d(
    gpu: &Gpu,
    label: &str,
    dims: [usize; 3],
    format: wgpu::TextureFormat,
) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: extent(dims),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Writes `dims[2]` whole layers from layer `first` on.
pub(super) fn write_layers(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    first: usize,
    dims: [usize; 3],
    texels: &[u8],
) {
    let row_bytes = (texels.len() / (dims[1] * dims[2])) as u32;
    let origin = wgpu::Origin3d { x: 0, y: 0, z: first as u32 };
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo { texture, mip_level: 0, origin, aspect: wgpu::TextureAspect::All },
        texels,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_bytes),
            rows_per_image: Some(dims[1] as u32),
        },
        extent(dims),
    );
}

pub(super) fn extent([width, height, depth]: [usize; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: depth as u32 }
}
