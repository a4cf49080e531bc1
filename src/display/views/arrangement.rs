//! How views lie in the frame of a display: the closed set. `arrange` makes the frames.

use super::grid::ViewGrid;

/// How views lie in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrangement {
    /// Beside and above each other, whole or squeezed.
    Tiles {
        /// Columns and rows.
        grid: ViewGrid,
        /// The direction in which each view is halved, so that the frame has the size of one view.
        halved: Option<Axis>,
        /// Whether the leftmost view is in the top row, in place of the bottom row.
        is_from_top: bool,
    },
    /// Two views take turns, pixel by pixel: every other line, every other column or both.
    Turns(Turns),
    /// Each third of a pixel belongs to one view: a panel with slanted lenses in front.
    Lenses,
    /// Two views in the colours of red-cyan glasses.
    RedCyan,
    /// One after the other, as an animation.
    Animation,
}

/// A direction in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// From left to right.
    Across,
    /// From top to bottom.
    Down,
}

/// The one of two views that has a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turns {
    /// Even lines have the left view.
    Lines,
    /// Even columns have the left view.
    Columns,
    /// The fields of a checkerboard that the top left one is of have the left view.
    Checkerboard,
}

impl Turns {
    /// The view, 0 or 1, that the frame shows at (x, y).
    pub(super) const fn view(self, x: usize, y: usize) -> usize {
        match self {
            Self::Lines => y % 2,
            Self::Columns => x % 2,
            Self::Checkerboard => (x + y) % 2,
        }
    }
}

impl Arrangement {
    /// Width and height of the frame of views of this size.
    pub(crate) const fn frame_px(self, [width, height]: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Tiles { grid, halved: None, .. } => {
                [width.saturating_mul(grid.columns()), height.saturating_mul(grid.rows())]
            }
            _ => [width, height],
        }
    }

    /// The direction in which views need an even size.
    pub(crate) const fn even_axis(self) -> Option<Axis> {
        match self {
            Self::Tiles { halved, .. } => halved,
            Self::Turns(Turns::Lines) => Some(Axis::Down),
            Self::Turns(Turns::Columns | Turns::Checkerboard) => Some(Axis::Across),
            _ => None,
        }
    }
}
