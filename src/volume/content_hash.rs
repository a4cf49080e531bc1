//! Identity by content: the hash of a volume, and that of its voxels alone.

use sha2::{Digest, Sha256};

use super::Grid;

/// SHA-256 of a volume's dimensions, placement and voxels: its identity everywhere (uploads, HTTP
/// ids, caches).
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct ContentHash(pub [u8; 32]);

impl ContentHash {
    /// The identity of a volume without its table.
    #[must_use]
    pub fn without_table(&self) -> Self {
        Self(Sha256::new().chain_update(self.0).chain_update("without table").finalize().into())
    }

    /// The identity of the coarse form of a volume.
    #[must_use]
    pub fn coarse(&self) -> Self {
        Self(Sha256::new().chain_update(self.0).chain_update("coarse").finalize().into())
    }

    /// The identity of a phase of a series whose voxels are those of another phase.
    #[must_use]
    pub fn of_phase(&self, number: usize) -> Self {
        let number = (number as u64).to_le_bytes();
        Self(Sha256::new().chain_update(self.0).chain_update("phase").chain_update(number).finalize().into())
    }

    /// The first 16 hexadecimal digits: what ids show.
    #[must_use]
    pub fn short(&self) -> String {
        data_encoding::HEXLOWER.encode(&self.0[..8])
    }
}

impl std::fmt::Debug for ContentHash {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ContentHash({}…)", self.short())
    }
}

/// Computes a [`ContentHash`] while voxels arrive.
#[derive(Clone, Debug)]
pub struct ContentHasher(Sha256);

impl ContentHasher {
    /// The hasher of a volume on this grid, before its first voxel.
    #[must_use]
    pub fn new(grid: &Grid) -> Self {
        let mut hasher = Sha256::new();
        for n in grid.dims() {
            hasher.update((n as u64).to_le_bytes());
        }
        for column in grid.patient_from_voxel().affine.to_cols_array() {
            hasher.update(column.to_le_bytes());
        }
        Self(hasher)
    }

    /// The next voxels, HU, x fastest, then y, then z.
    pub fn update(&mut self, voxels_hu: &[i16]) {
        update_with_voxels(&mut self.0, voxels_hu);
    }

    /// The hash, after the last voxel.
    #[must_use]
    pub fn finish(self) -> ContentHash {
        ContentHash(self.0.finalize().into())
    }
}

/// SHA-256 of the voxels, as little-endian 16-bit values in their order, without the geometry.
/// Equal stacks have equal hashes, wherever they lie.
pub fn stack_sha256(voxels_hu: &[i16]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    update_with_voxels(&mut hasher, voxels_hu);
    hasher.finalize().into()
}

fn update_with_voxels(hasher: &mut Sha256, voxels_hu: &[i16]) {
    if cfg!(target_endian = "little") {
        hasher.update(bytemuck::cast_slice::<i16, u8>(voxels_hu));
    } else {
        voxels_hu.iter().for_each(|hu| hasher.update(hu.to_le_bytes()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Volume;

    #[test]
    fn voxels_in_parts_have_the_hash_of_the_whole() {
        let grid = Grid::axis_aligned([5, 3, 2], [1.0, 1.0, 2.0], [0.0; 3]).unwrap();
        let voxels: Vec<i16> = (-10..20).collect();
        let mut hasher = ContentHasher::new(&grid);
        voxels.chunks(7).for_each(|part| hasher.update(part));
        let hashed = Volume::hashed(grid.clone(), voxels.clone(), hasher).unwrap();
        assert_eq!(hashed.content_hash(), Volume::new(grid, voxels).unwrap().content_hash());
    }
}
