//! Gradients of a volume, for shading with one fetch instead of six.
//!
//! A gradient is the central difference over one voxel to both sides, in HU/mm along the patient
//! axes. Trilinear interpolation of central differences equals central differences of interpolated
//! values, so the picture is that of six fetches but for rounding. Beside a voxel's gradient lies
//! its value: where most samples are visible, one fetch of both is quicker than one of each.

use glam::{Mat3, Vec3};
use half::f16;
use rayon::prelude::*;

use crate::gpu::Gpu;
use crate::texture::SLAB_BYTES;
use crate::texture::VoxelFormat;
use crate::texture::texture_3d;
use crate::texture::write_layers;
use relief_volume::{Grid, Volume};

/// The gradients of a volume on the GPU.
pub(super) struct Gradients {
    pub(super) view: wgpu::TextureView,
    /// Whether there are gradients at all, and not just a texel in their place.
    pub(super) precomputed: bool,
    /// HU/mm of a component of 1, as shaders read it.
    pub(super) scale: f32,
}

impl Gradients {
    /// Computes and uploads the gradients of a volume that is to have them.
    pub(super) fn upload(gpu: &Gpu, volume: &Volume, format: VoxelFormat, precomputed: bool) -> Self {
        let dims = if precomputed { volume.grid().dims() } else { [1; 3] };
        let texture = texture_3d(gpu, "gradients", dims, texture_format(format));
        let scale = if precomputed { scale_for(volume, format) } else { 1.0 };
        if precomputed {
            fill(gpu, volume, (format, scale), &texture);
        }
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { view, precomputed, scale }
    }
}

/// HU/mm of a component of 1: for signed normalised texels the power of two that the steepest
/// gradient needs, so that a texel's step is far below what opacity by gradient can tell.
fn scale_for(volume: &Volume, format: VoxelFormat) -> f32 {
    match format {
        VoxelFormat::Norm16 => steepest(volume).max(1.0).log2().ceil().exp2(),
        VoxelFormat::Half => 1.0,
    }
}

/// No gradient of the volume is longer than this, HU/mm.
fn steepest(volume: &Volume) -> f32 {
    let [nx, ny, _] = volume.grid().dims();
    let voxels = volume.voxels_hu();
    // Differences over two voxels; those over one at the faces are smaller than the largest step,
    // and a step is at most as long as two.
    let largest = |stride: usize| -> f32 {
        let over = |apart: usize| {
            let later = voxels.get(apart..).unwrap_or_default();
            let pairs = voxels.par_chunks(nx * ny).zip(later.par_chunks(nx * ny));
            let of_layer = |(early, late): (&[i16], &[i16])| {
                early.iter().zip(late).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
            };
            pairs.map(of_layer).max().unwrap_or(0)
        };
        over(stride).max(over(2 * stride)).into()
    };
    let [i, j, k] = [1, nx, nx * ny].map(largest);
    let axes = patient_from_voxel_gradient(volume.grid()).as_mat3();
    (axes.x_axis * i).length() + (axes.y_axis * j).length() + (axes.z_axis * k).length()
}

fn texture_format(format: VoxelFormat) -> wgpu::TextureFormat {
    match format {
        VoxelFormat::Norm16 => wgpu::TextureFormat::Rgba16Snorm,
        VoxelFormat::Half => wgpu::TextureFormat::Rgba16Float,
    }
}

/// A gradient along x, y, z and a value, as the bits of 16-bit texels.
type Texel = [u16; 4];

/// How gradients are stored: the format, and HU/mm of a component of 1.
type Storage = (VoxelFormat, f32);

fn texel((format, scale): Storage, gradient: Vec3, hu: i16) -> Texel {
    match format {
        VoxelFormat::Norm16 => {
            let norm = |x: f32| rounded(x * (f32::from(i16::MAX) / scale));
            [norm(gradient.x), norm(gradient.y), norm(gradient.z), hu].map(i16::cast_unsigned)
        }
        VoxelFormat::Half => gradient.extend(f32::from(hu)).to_array().map(|x| f16::from_f32(x).to_bits()),
    }
}

/// As `f32::round`, which is a call where processors of 2003 have to do: a fifth of the time of all
/// gradients.
fn rounded(x: f32) -> i16 {
    let whole = x as i32;
    let rest = x - whole as f32;
    (whole + i32::from(rest >= 0.5) - i32::from(rest <= -0.5)) as i16
}

fn fill(gpu: &Gpu, volume: &Volume, storage: Storage, texture: &wgpu::Texture) {
    let [nx, ny, nz] = volume.grid().dims();
    let patient_from_voxel = patient_from_voxel_gradient(volume.grid()).as_mat3();
    let layers = (SLAB_BYTES / (nx * ny * size_of::<Texel>())).max(1);
    let mut texels: Vec<Texel> = vec![[0; 4]; nx * ny * layers.min(nz)];
    for first in (0..nz).step_by(layers) {
        let count = layers.min(nz - first);
        let slab = &mut texels[..nx * ny * count];
        slab.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            fill_row(volume, storage, patient_from_voxel, [row % ny, first + row / ny], out);
        });
        write_layers(gpu, texture, first, [nx, ny, count], bytemuck::cast_slice(slab));
        // Submitting frees the staging memory of the slabs before.
        gpu.queue.submit([]);
    }
}

/// The voxels (.., j, k); differences are one-sided at the volume's faces.
fn fill_row(
    volume: &Volume,
    storage: Storage,
    patient_from_voxel: Mat3,
    [j, k]: [usize; 2],
    out: &mut [Texel],
) {
    let [nx, ny, nz] = volume.grid().dims();
    let row = |j: usize, k: usize| &volume.voxels_hu()[(k * ny + j) * nx..][..nx];
    let here = row(j, k);
    let (j_low, j_high) = (row(j.saturating_sub(1), k), row((j + 1).min(ny - 1), k));
    let (k_low, k_high) = (row(j, k.saturating_sub(1)), row(j, (k + 1).min(nz - 1)));
    let difference = |high: i16, low: i16| f32::from(high) - f32::from(low);
    for (i, out) in out.iter_mut().enumerate() {
        let (i_low, i_high) = (here[i.saturating_sub(1)], here[(i + 1).min(nx - 1)]);
        let along_voxels = Vec3::new(
            difference(i_high, i_low),
            difference(j_high[i], j_low[i]),
            difference(k_high[i], k_low[i]),
        );
        *out = texel(storage, patient_from_voxel * along_voxels, here[i]);
    }
}

/// A gradient in HU/mm along the patient axes, of one in HU per two voxels along i, j, k: gradients
/// transform by the transpose of the points' inverse.
pub(super) fn patient_from_voxel_gradient(grid: &Grid) -> glam::DMat3 {
    grid.voxel_from_patient().linear().transpose() * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_volume::Grid;

    #[test]
    fn texels_point_up_the_slope_of_a_ramp_in_patient_axes_and_have_its_value() {
        // Anisotropic, and the slices stacked downwards: 30 HU/mm along x, -8 along z.
        let spacing = [0.5, 1.0, 2.5];
        let grid = Grid::axis_aligned([5, 4, 3], spacing, [0.0; 3]).unwrap();
        let voxels = (0..60).map(|v| (15 * (v % 5) - 20 * (v / 20)) as i16).collect();
        let volume = Volume::new(grid, voxels).unwrap();
        let mut row = [[0; 4]; 5];
        let rotation = patient_from_voxel_gradient(volume.grid()).as_mat3();
        fill_row(&volume, (VoxelFormat::Half, 1.0), rotation, [1, 1], &mut row);
        let halves = |texel: Texel| texel.map(|bits| f16::from_bits(bits).to_f32());
        assert_eq!(halves(row[2]), [30.0, 0.0, -8.0, 10.0]);
        // A one-sided difference at the face halves the gradient.
        assert_eq!(halves(row[0]), [15.0, 0.0, -8.0, -20.0]);
        let scale = scale_for(&volume, VoxelFormat::Norm16);
        fill_row(&volume, (VoxelFormat::Norm16, scale), rotation, [1, 1], &mut row);
        let [x, y, z, hu] = row[2].map(|bits| f32::from(bits.cast_signed()));
        let step = scale / 32767.0;
        assert!((x * step - 30.0).abs() <= step && (z * step + 8.0).abs() <= step && step < 0.01);
        assert_eq!((y, hu), (0.0, 10.0));
    }

    #[test]
    fn rounding_is_that_of_the_standard_library() {
        let near_halves = (-32767..=32766).flat_map(|n| {
            let half = n as f32 + 0.5;
            [half.next_down(), half, half.next_up(), n as f32]
        });
        for x in near_halves.filter(|x| x.abs() <= 32767.0) {
            assert_eq!(f32::from(rounded(x)), x.round(), "{x}");
        }
    }

    #[test]
    fn no_gradient_is_steeper_than_the_scale() {
        let grid = Grid::axis_aligned([4, 4, 4], [0.5, 1.0, 2.0], [0.0; 3]).unwrap();
        for at in 0..64 {
            let voxels: Vec<i16> = (0..64).map(|v| if v == at { i16::MAX } else { -i16::MAX }).collect();
            let volume = Volume::new(grid.clone(), voxels).unwrap();
            let storage = (VoxelFormat::Norm16, scale_for(&volume, VoxelFormat::Norm16));
            let rotation = patient_from_voxel_gradient(volume.grid()).as_mat3();
            let mut row = [[0; 4]; 4];
            for row_at in [[0, 0], [1, 1], [2, 3], [3, 3]] {
                fill_row(&volume, storage, rotation, row_at, &mut row);
                let largest = row.iter().flat_map(|texel| &texel[..3]).map(|x| x.cast_signed().abs()).max();
                assert!(largest < Some(i16::MAX), "voxel {at}: a component was cut");
            }
        }
    }
}
