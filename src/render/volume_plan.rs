//! The memory of a volume on the adapter.

/// The memory of a volume on an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VolumePlan {
    /// Bytes of voxels.
    pub voxel_bytes: u64,
    /// Bytes of gradients; 0 where the volume is lit without: slower, and all but the same picture.
    pub gradient_bytes: u64,
    /// Bytes of each appearance: a transfer table and a map of empty space.
    pub appearance_bytes: u64,
    /// Edge of a brick in voxels.
    pub brick_edge: usize,
    /// Edge of the bricks that composite pictures skip by: a smaller one in small volumes.
    pub fine_brick_edge: usize,
}

impl VolumePlan {
    /// Voxels and gradients.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.voxel_bytes.saturating_add(self.gradient_bytes)
    }

    pub(super) fn bytes_with_appearance(&self) -> u64 {
        self.bytes().saturating_add(self.appearance_bytes)
    }
}
