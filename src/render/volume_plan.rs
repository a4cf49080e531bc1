//! The memory of a volume on the adapter, and the limits that it is held against.

use super::error::RenderError;
use crate::gpu::{AdapterKind, Gpu};
use relief_volume::TransferTable;

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

    /// The edges of its bricks, and of the fine ones.
    pub(super) fn brick_edges(&self) -> [usize; 2] {
        [self.brick_edge, self.fine_brick_edge]
    }

    pub(super) fn bytes_with_appearance(&self) -> u64 {
        self.bytes().saturating_add(self.appearance_bytes)
    }
}

/// Bytes of a transfer table: a uniform has room for the longest.
const TABLE_BYTES: u64 = (size_of::<[f32; 4]>() * TransferTable::MAX_ENTRIES) as u64;

/// The limits of volumes on an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VolumeLimits {
    /// Most voxels along a side.
    pub side: usize,
    /// Most bytes of one texture.
    pub texture_bytes: u64,
    /// Most bytes of all volumes together.
    pub memory_bytes: u64,
    /// Most bytes of one volume's gradients; larger volumes are lit without.
    pub gradient_bytes: u64,
    /// Most bricks of one volume; larger volumes have larger bricks.
    pub bricks: u64,
}

impl VolumeLimits {
    /// Default limit of all volumes together, bytes.
    pub const MEMORY_BYTES: u64 = 4 << 30;
    /// Default limit of the gradients of one volume, bytes: 2^27 voxels.
    pub const GRADIENT_BYTES: u64 = 1 << 30;
    /// Bricks are numbered in 32-bit floats, which tell whole numbers apart up to here.
    pub const BRICKS: u64 = 1 << 24;
    /// Bytes of a texture that software drivers take; they do not tell, and Mesa's refuses more.
    const SOFTWARE_TEXTURE_BYTES: u64 = 2 << 30;
    /// Edge of a brick in voxels. Smaller bricks skip more closely but take longer to map.
    const BRICK_EDGE: usize = 4;
    /// As many bricks are mapped in no time: a volume that has no more of smaller ones has those
    /// too. Its voxels are large beside its samples, and so are bricks of four.
    const QUICK_BRICKS: u64 = 1 << 20;

    /// The limits of the processor's ray caster: places of voxels have 31 bits, and it has no
    /// gradients.
    pub(super) fn of_processor() -> Self {
        Self {
            side: i32::MAX as usize,
            texture_bytes: 2 * i32::MAX as u64,
            memory_bytes: Self::MEMORY_BYTES,
            gradient_bytes: 0,
            bricks: Self::BRICKS,
        }
    }

    /// These limits, cut to those of an adapter but for the bytes of all volumes and of gradients.
    pub(super) fn within(self, most: Self) -> Self {
        Self {
            side: self.side.min(most.side),
            texture_bytes: self.texture_bytes.min(most.texture_bytes),
            bricks: self.bricks.min(most.bricks),
            ..self
        }
    }

    pub(super) fn of(gpu: &Gpu) -> Self {
        let is_software = gpu.description().kind == AdapterKind::Software;
        Self {
            texture_bytes: if is_software { Self::SOFTWARE_TEXTURE_BYTES } else { u64::MAX },
            side: gpu.limits().texture_3d_side as usize,
            memory_bytes: Self::MEMORY_BYTES,
            gradient_bytes: Self::GRADIENT_BYTES,
            bricks: Self::BRICKS,
        }
    }

    /// The memory of a volume of these dimensions.
    ///
    /// # Errors
    /// When a side is longer or a texture larger than the adapter supports, or the voxels
    /// alone exceed the memory limit; with the required and the available memory, and the factor of
    /// a downsampled volume that fits.
    pub fn plan(&self, dims: [usize; 3]) -> Result<VolumePlan, RenderError> {
        let longest = dims.into_iter().max().unwrap_or(0);
        if longest > self.side {
            let factor = longest.div_ceil(self.side);
            return Err(RenderError::VolumeTooLarge { dims, limit: self.side, factor });
        }
        let plan = self.without_gradients(dims);
        let factor = |fits: &dyn Fn(VolumePlan) -> bool| {
            let smaller = |factor: usize| self.without_gradients(dims.map(|side| side.div_ceil(factor)));
            (2..=longest).find(|&factor| fits(smaller(factor)))
        };
        let (needed, available) = (plan.voxel_bytes, self.texture_bytes);
        if needed > available {
            let factor = factor(&|smaller| smaller.voxel_bytes <= available).unwrap_or(longest);
            return Err(RenderError::VolumeOverTexture { dims, needed, available, factor });
        }
        let (needed, available) = (plan.bytes_with_appearance(), self.memory_bytes);
        if needed > available {
            let factor = factor(&|smaller| smaller.bytes_with_appearance() <= available);
            return Err(RenderError::VolumeOverMemory { dims, needed, available, factor });
        }
        let gradient_bytes = plan.voxel_bytes.saturating_mul(4);
        let lit = VolumePlan { gradient_bytes, ..plan };
        let most = self.gradient_bytes.min(self.texture_bytes);
        let fits = gradient_bytes <= most && lit.bytes_with_appearance() <= available;
        Ok(if fits { lit } else { plan })
    }

    fn without_gradients(&self, dims: [usize; 3]) -> VolumePlan {
        let product = |sides: [usize; 3]| sides.iter().fold(1u64, |n, &side| n.saturating_mul(side as u64));
        let bricks = |edge: usize| product(dims.map(|side| side.div_ceil(edge)));
        let edges = std::iter::successors(Some(Self::BRICK_EDGE), |edge| Some(edge * 2));
        let brick_edge = edges.take(28).find(|&edge| bricks(edge) <= self.bricks).unwrap_or(1 << 30);
        let quick = Self::QUICK_BRICKS.min(self.bricks);
        let fine_brick_edge = [1, 2].into_iter().find(|&edge| bricks(edge) <= quick).unwrap_or(brick_edge);
        VolumePlan {
            voxel_bytes: product(dims).saturating_mul(2),
            gradient_bytes: 0,
            appearance_bytes: TABLE_BYTES + bricks(fine_brick_edge).next_multiple_of(4),
            brick_edge,
            fine_brick_edge,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: VolumeLimits = VolumeLimits {
        side: 4096,
        texture_bytes: u64::MAX,
        memory_bytes: 4 << 30,
        gradient_bytes: VolumeLimits::GRADIENT_BYTES,
        bricks: VolumeLimits::BRICKS,
    };

    #[test]
    fn gradients_come_along_where_they_fit() {
        let plan = LIMITS.plan([512, 512, 300]).unwrap();
        assert_eq!((plan.voxel_bytes, plan.gradient_bytes, plan.brick_edge), (157_286_400, 629_145_600, 4));
        assert_eq!(plan.appearance_bytes, 65_536 + 128 * 128 * 75);
        let narrow = VolumeLimits { memory_bytes: plan.bytes_with_appearance() - 1, ..LIMITS };
        assert_eq!(narrow.plan([512, 512, 300]).unwrap().gradient_bytes, 0);
        assert_eq!(LIMITS.plan([512, 512, 1000]).unwrap().gradient_bytes, 0, "2 GiB of gradients");
    }

    #[test]
    fn bricks_are_as_small_as_their_numbers_allow() {
        let limits = VolumeLimits { memory_bytes: u64::MAX, ..LIMITS };
        for (dims, edge, fine) in [
            ([1; 3], 4, 1),
            ([100; 3], 4, 1),
            ([102; 3], 4, 2),
            ([202; 3], 4, 2),
            ([204; 3], 4, 4),
            ([1024; 3], 4, 4),
            ([1025, 1024, 1024], 8, 8),
            ([2048, 2048, 2000], 8, 8),
            ([4096; 3], 16, 16),
        ] {
            let plan = limits.plan(dims).unwrap();
            assert_eq!((plan.brick_edge, plan.fine_brick_edge), (edge, fine), "{dims:?}");
        }
    }

    #[test]
    fn a_volume_too_large_is_refused_with_needed_free_and_fitting_sizes() {
        let message = LIMITS.plan([2048, 2048, 2000]).unwrap_err().to_string();
        // 2 bytes a voxel, 256 x 256 x 250 bricks, 4096 entries of 16 bytes.
        let needed = 2048u64 * 2048 * 2000 * 2 + 256 * 256 * 250 + 65_536;
        for part in
            [needed.to_string(), (4u64 << 30).to_string(), "--downsample 2".into(), "--gpu-memory".into()]
        {
            assert!(message.contains(&part), "{message:?} lacks {part}");
        }
        let roomy = VolumeLimits { memory_bytes: needed, ..LIMITS };
        assert_eq!(roomy.plan([2048, 2048, 2000]).unwrap().gradient_bytes, 0);
        let usual = VolumeLimits { side: 2048, ..roomy };
        assert!(usual.plan([2048, 2048, 2000]).is_ok());
        let message = usual.plan([2049, 10, 10]).unwrap_err().to_string();
        assert!(
            message.contains("at most 2048 along a side") && message.contains("--downsample 2"),
            "{message}"
        );
        assert!(LIMITS.plan([usize::MAX; 3]).is_err());
        let software = VolumeLimits { texture_bytes: 2 << 30, ..roomy };
        let message = software.plan([2048, 2048, 2000]).unwrap_err().to_string();
        for part in ["needs 16777216000 bytes", "2147483648 are available in one texture", "--downsample 2"] {
            assert!(message.contains(part), "{message:?} lacks {part}");
        }
        assert!(software.plan([1024; 3]).is_ok());
        let tiny = VolumeLimits { memory_bytes: 10, ..LIMITS };
        let message = tiny.plan([4; 3]).unwrap_err().to_string();
        assert!(!message.contains("--downsample"), "nothing fits into 10 bytes: {message}");
    }
}
