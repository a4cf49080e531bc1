//! Values and gradients of a volume; twin of `shaders/lib/volume.wgsl`. Voxel index in; HU out.

use glam::DVec3;

use relief_volume::Volume;

/// Trilinear between voxel centres, clamped outside the outermost ones.
pub(super) fn sample_hu(volume: &Volume, p: DVec3) -> f64 {
    let dims = volume.grid().dims();
    let last = DVec3::from(dims.map(|n| (n - 1) as f64));
    let p = p.clamp(DVec3::ZERO, last);
    let base = p.floor();
    let f = p - base;
    let low = base.to_array().map(|x| x as usize);
    let high: [usize; 3] = std::array::from_fn(|axis| (low[axis] + 1).min(dims[axis] - 1));
    let corner = |x: usize, y: usize, z: usize| f64::from(volume.hu([x, y, z]));
    let along_x = |y, z| corner(low[0], y, z) * (1.0 - f.x) + corner(high[0], y, z) * f.x;
    let along_y = |z| along_x(low[1], z) * (1.0 - f.y) + along_x(high[1], z) * f.y;
    along_y(low[2]) * (1.0 - f.z) + along_y(high[2]) * f.z
}

/// Central differences over one voxel to both sides: HU per two voxels, along i, j, k. Beyond the
/// outermost voxel centres they are those of the nearest point between them.
pub(super) fn central_differences(volume: &Volume, p: DVec3) -> DVec3 {
    let last = DVec3::from(volume.grid().dims().map(|n| (n - 1) as f64));
    let p = p.clamp(DVec3::ZERO, last);
    let along = |axis: DVec3| sample_hu(volume, p + axis) - sample_hu(volume, p - axis);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}
