//! The voxels that a picture is cast through: all, or means of blocks of them.

/// The voxels that rays are cast through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Detail {
    /// All voxels.
    #[default]
    Full,
    /// Means of 2x2x2 voxels with the table left out, at two samples each: two to three times as
    /// fast on the processor. A picture with a label map and graphics adapters take all voxels.
    Coarse,
}
