//! Limits of files of voxels.

/// The limits of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FormatLimits {
    /// Most voxels; of several layers of a segmentation together.
    pub voxels: u64,
}

impl Default for FormatLimits {
    /// 2³¹: 1290 voxels along each side.
    fn default() -> Self {
        Self { voxels: 1 << 31 }
    }
}
