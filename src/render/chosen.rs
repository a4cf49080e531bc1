//! The part of a picture that is cast, where it is not all of it: blocks of 4 x 2 pixels.
//!
//! Spaces: pixels, rows from the top. Eight lanes cast a block together, sixteen cast two.

/// Width and height of a block, pixels.
pub(crate) const BLOCK_PX: [u32; 2] = [4, 2];

/// Blocks of a picture that are cast. Blocks at the right and lower edge may be cut by it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChosenBlocks {
    columns: usize,
    chosen: Vec<bool>,
}

impl ChosenBlocks {
    /// The columns and rows of blocks of a picture.
    #[must_use]
    pub fn grid(size_px: [u32; 2]) -> [usize; 2] {
        [0, 1].map(|axis| size_px[axis].div_ceil(BLOCK_PX[axis]) as usize)
    }

    /// The blocks of a picture for which `is_chosen` holds, by column and row of the block.
    #[must_use]
    pub fn where_each(size_px: [u32; 2], is_chosen: impl Fn(usize, usize) -> bool) -> Self {
        let [columns, rows] = Self::grid(size_px);
        let blocks = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        Self { columns, chosen: blocks.map(|(column, row)| is_chosen(column, row)).collect() }
    }

    /// Whether the block of a pixel (column, row) is cast; not for pixels outside the picture.
    #[must_use]
    pub fn has(&self, [column, row]: [u32; 2]) -> bool {
        let [column, row] = [(column / BLOCK_PX[0]) as usize, (row / BLOCK_PX[1]) as usize];
        column < self.columns && self.chosen.get(row * self.columns + column).copied().unwrap_or_default()
    }

    /// Whether each block is cast, in rows from the top.
    #[must_use]
    pub fn flags(&self) -> &[bool] {
        &self.chosen
    }
}
