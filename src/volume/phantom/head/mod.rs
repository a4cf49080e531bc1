//! The head: anatomy by signed distance fields, tissue by tissue, with the truth about it.
//!
//! It models no particular person: proportions are an adult's, courses follow textbooks, folds and
//! grain follow a seed. It is not a dose phantom, not an atlas, and not fit to train a diagnosis
//! on.
//!
//! Model space is patient space: LPS mm, origin midway between the ear canals, the Frankfort plane
//! (ear canal to lower orbital rim) at z = 0. Tissues are painted over each other from the skin
//! inwards. At an edge a voxel mixes both sides in proportion to its distance from the edge, so
//! partial volume looks as in a CT.

mod brain;
mod cavities;
mod edge;
mod face;
mod jaw;
mod landmarks;
mod skull;
mod soft;
mod teeth;
mod tissue;
mod vessels;

use glam::Vec3;
use rayon::prelude::*;

use super::facts::{PhantomFacts, Placement};
use super::noise::grain;
use super::sdf::Box3;
use edge::Edge;
use tissue::Anatomy;

/// Width, depth and height of the volume, mm.
const EXTENT_MM: [f64; 3] = [240.0, 240.0, 264.0];
/// The middle of the volume.
const CENTER_MM: [f64; 3] = [0.0, -12.0, 5.0];
/// Slices for 256 voxels across.
const SLICES: usize = 220;
/// Standard deviation of the grain, HU.
const NOISE_SIGMA_HU: f32 = 9.0;
/// Voxels along each side of a block that is culled and painted together.
const BLOCK: usize = 8;
/// The range that a CT can store.
const RANGE_HU: (f32, f32) = (-1024.0, 3071.0);

/// The place of a head of `size` voxels across.
pub(super) fn placement(size: usize) -> Placement {
    let slices = (size * SLICES + 128) / 256;
    Placement::centered([size, size, slices], EXTENT_MM, CENTER_MM)
}

/// Voxels of the head and their truth.
pub(super) fn head(
    placement: &Placement,
    seed: u64,
    report: &(dyn Fn(usize) + Sync),
) -> (Vec<i16>, PhantomFacts) {
    let anatomy = Anatomy::new(seed);
    let [nx, ny, nz] = placement.dims;
    let mut voxels = vec![0i16; nx * ny * nz];
    voxels.par_chunks_mut(nx * ny * BLOCK).enumerate().for_each(|(n, slab)| {
        paint_slab(&anatomy, placement, n * BLOCK, slab, seed);
        report(slab.len() / (nx * ny));
    });
    let facts = PhantomFacts {
        noise_sigma_hu: f64::from(NOISE_SIGMA_HU),
        gradient_hu_per_mm: None,
        materials: landmarks::materials(),
        surfaces: landmarks::surfaces(),
        landmarks: landmarks::landmarks(&anatomy),
    };
    (voxels, facts)
}

/// Labels, names and colours (sRGB bytes) of the organs.
pub(super) const ORGANS: [(u16, &str, [u8; 3]); 10] = [
    (1, "skull", [241, 229, 200]),
    (2, "mandible", [222, 203, 160]),
    (3, "cervical spine", [205, 186, 142]),
    (4, "teeth", [255, 252, 240]),
    (5, "brain", [236, 168, 150]),
    (6, "arteries", [216, 40, 34]),
    (7, "veins", [58, 92, 196]),
    (8, "eyes", [150, 205, 220]),
    (9, "muscles", [176, 74, 62]),
    (10, "airways", [130, 190, 235]),
];

/// The label of each voxel's centre, of [`ORGANS`].
pub(super) fn labels(placement: &Placement, seed: u64) -> Vec<u16> {
    let anatomy = Anatomy::new(seed);
    let [nx, ny, nz] = placement.dims;
    let mut labels = vec![0u16; nx * ny * nz];
    labels.par_chunks_mut(nx * ny * BLOCK).enumerate().for_each(|(n, slab)| {
        for_each_near(&anatomy, placement, n * BLOCK, slab.len(), |local, p, at| slab[at] = local.label(p));
    });
    labels
}

/// Calls the function with each voxel of up to [`BLOCK`] slices from slice `first` on that is not
/// all air: the tissues nearby, the voxel's centre, and its index in `voxels`.
fn for_each_near(
    anatomy: &Anatomy,
    placement: &Placement,
    first: usize,
    voxels: usize,
    mut visit: impl FnMut(&tissue::LocalAnatomy<'_>, Vec3, usize),
) {
    let [nx, ny, _] = placement.dims;
    let depth = voxels / (nx * ny);
    for y0 in (0..ny).step_by(BLOCK) {
        for x0 in (0..nx).step_by(BLOCK) {
            let (x1, y1) = ((x0 + BLOCK).min(nx), (y0 + BLOCK).min(ny));
            let low = center_of(placement, [x0, y0, first]);
            let high = center_of(placement, [x1 - 1, y1 - 1, first + depth - 1]);
            let Some(local) = anatomy.near(&Box3 { min: low, max: high }) else { continue };
            for k in 0..depth {
                for j in y0..y1 {
                    for i in x0..x1 {
                        let p = center_of(placement, [i, j, first + k]);
                        visit(&local, p, (k * ny + j) * nx + i);
                    }
                }
            }
        }
    }
}

/// Paints up to [`BLOCK`] slices from slice `first` on.
fn paint_slab(anatomy: &Anatomy, placement: &Placement, first: usize, slab: &mut [i16], seed: u64) {
    let [nx, ny, _] = placement.dims;
    let edge = Edge::of_voxels(placement.spacing_mm);
    let mut hu = vec![tissue::AIR_HU; slab.len()];
    for_each_near(anatomy, placement, first, slab.len(), |local, p, at| hu[at] = local.hu(p, edge));
    for (k, (clean, noisy)) in hu.chunks(nx * ny).zip(slab.chunks_mut(nx * ny)).enumerate() {
        let grain = grain(nx, ny, first + k, seed ^ 0x67_7261);
        for ((out, clean), grain) in noisy.iter_mut().zip(clean).zip(grain) {
            let value = (clean + NOISE_SIGMA_HU * grain).clamp(RANGE_HU.0, RANGE_HU.1).round() as i16;
            *out = value;
        }
    }
}

fn center_of(placement: &Placement, index: [usize; 3]) -> Vec3 {
    let at = [0, 1, 2].map(|axis| placement.coordinate(axis, index[axis]) as f32);
    at.into()
}
