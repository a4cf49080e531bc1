//! Gradients of a volume, for shading with one fetch instead of six.
//!
//! A gradient is the central difference over one voxel to both sides, in HU/mm along the patient axes, as half floats: of
//! a direction they keep 11 bits, whatever its length. Trilinear interpolation of central differences equals central
//! differences of interpolated values, so the picture is that of six fetches but for rounding.

use glam::{Mat3, Vec3};
use half::f16;
use rayon::prelude::*;

use super::uniform::patient_from_voxel_gradient;
use super::upload::{SLAB_BYTES, texture_3d, write_layers};
use crate::gpu::Gpu;
use crate::volume::Volume;

/// The gradients of a volume on the GPU.
pub(super) struct Gradients {
    pub(super) view: wgpu::TextureView,
    /// Whether there are gradients at all, and not just a texel in their place.
    pub(super) precomputed: bool,
}

impl Gradients {
    /// Computes and uploads the gradients of a volume that is to have them.
    pub(super) fn upload(gpu: &Gpu, volume: &Volume, precomputed: bool) -> Self {
        let dims = if precomputed { volume.grid().dims() } else { [1; 3] };
        let texture = texture_3d(gpu, "gradients", dims, wgpu::TextureFormat::Rgba16Float);
        if precomputed {
            fill(gpu, volume, &texture);
        }
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { view, precomputed }
    }
}

/// A gradient along x, y, z, HU/mm; the fourth component is its length.
type Texel = [f16; 4];

fn fill(gpu: &Gpu, volume: &Volume, texture: &wgpu::Texture) {
    let [nx, ny, nz] = volume.grid().dims();
    let patient_from_voxel = patient_from_voxel_gradient(volume.grid()).as_mat3();
    let layers = (SLAB_BYTES / (nx * ny * size_of::<Texel>())).max(1);
    let mut texels: Vec<Texel> = vec![[f16::ZERO; 4]; nx * ny * layers.min(nz)];
    for first in (0..nz).step_by(layers) {
        let count = layers.min(nz - first);
        let slab = &mut texels[..nx * ny * count];
        slab.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            fill_row(volume, patient_from_voxel, [row % ny, first + row / ny], out);
        });
        write_layers(gpu, texture, first, [nx, ny, count], bytemuck::cast_slice(slab));
        // Submitting frees the staging memory of the slabs before.
        gpu.queue.submit([]);
    }
}

/// The gradients of the voxels (.., j, k); differences are one-sided at the volume's faces.
fn fill_row(volume: &Volume, patient_from_voxel: Mat3, [j, k]: [usize; 2], out: &mut [Texel]) {
    let [nx, ny, nz] = volume.grid().dims();
    let row = |j: usize, k: usize| &volume.voxels_hu()[(k * ny + j) * nx..][..nx];
    let here = row(j, k);
    let (j_low, j_high) = (row(j.saturating_sub(1), k), row((j + 1).min(ny - 1), k));
    let (k_low, k_high) = (row(j, k.saturating_sub(1)), row(j, (k + 1).min(nz - 1)));
    let difference = |high: i16, low: i16| f32::from(high) - f32::from(low);
    for (i, texel) in out.iter_mut().enumerate() {
        let (i_low, i_high) = (here[i.saturating_sub(1)], here[(i + 1).min(nx - 1)]);
        let along_voxels = Vec3::new(
            difference(i_high, i_low),
            difference(j_high[i], j_low[i]),
            difference(k_high[i], k_low[i]),
        );
        let hu_per_mm = patient_from_voxel * along_voxels;
        *texel = hu_per_mm.extend(hu_per_mm.length()).to_array().map(f16::from_f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Grid;

    #[test]
    fn texels_point_up_the_slope_of_a_ramp_in_patient_axes() {
        // Anisotropic, and the slices stacked downwards: 30 HU/mm along x, -8 along z.
        let spacing = [0.5, 1.0, 2.5];
        let grid = Grid::axis_aligned([5, 4, 3], spacing, [0.0; 3]).unwrap();
        let voxels = (0..60).map(|v| (15 * (v % 5) - 20 * (v / 20)) as i16).collect();
        let volume = Volume::new(grid, voxels).unwrap();
        let mut row = [[f16::ZERO; 4]; 5];
        fill_row(&volume, patient_from_voxel_gradient(volume.grid()).as_mat3(), [1, 1], &mut row);
        let gradient = |texel: Texel| texel.map(f16::to_f32);
        assert_eq!(gradient(row[2]), [30.0, 0.0, -8.0, 31.046875]);
        assert_eq!(
            gradient(row[0]),
            [15.0, 0.0, -8.0, 17.0],
            "half as steep at the face: a one-sided difference"
        );
    }
}
