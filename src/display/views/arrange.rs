//! Views in the frame of a display, and out of it again.
//!
//! Places are (x, y) from the top left, pixels. The kiosk page makes the same frames in a shader;
//! `tests/browser` compares them.

use super::anaglyph::anaglyph;
use super::arrangement::{Arrangement, Axis};
use super::grid::ViewGrid;
use super::panel::LensPanel;
use super::pictures::Views;
use crate::layout::error::LayoutError;

impl Arrangement {
    /// The pixels of the frame of these views; their size and number were checked.
    ///
    /// # Errors
    /// For an animation, and for a pair that is no pair.
    pub(crate) fn arrange(self, views: &Views, panel: &LensPanel) -> Result<Vec<[u8; 3]>, LayoutError> {
        let pictures = views.pictures();
        let width = views.size_px()[0] as usize;
        match (self, pictures) {
            (Self::Tiles { grid, halved: None, is_from_top }, _) => Ok(tiled(views, grid, is_from_top)),
            (Self::Tiles { grid, halved: Some(axis), is_from_top }, _) => {
                Ok(tiled(&squeezed(views, axis)?, grid, is_from_top))
            }
            (Self::Turns(turns), [left, right]) => {
                let pixel = |at: usize| [left, right][turns.view(at % width, at / width)][at];
                Ok((0..left.len()).map(pixel).collect())
            }
            (Self::RedCyan, [left, right]) => Ok(anaglyph(left, right)),
            (Self::Lenses, _) => {
                let pixel = |at: usize| panel.views_at([at % width, at / width], pictures.len());
                let color = |at: usize| [0, 1, 2].map(|channel| pictures[pixel(at)[channel]][at][channel]);
                Ok((0..pictures[0].len()).map(color).collect())
            }
            _ => Err(LayoutError::Animation),
        }
    }

    /// The views of a frame: smaller where they were squeezed or take turns. `None` where the frame
    /// does not divide into views, and for arrangements that keep no whole pixel of a view.
    pub(crate) fn separate(self, frame_px: [u32; 2], pixels: &[[u8; 3]]) -> Option<Views> {
        let [width, height] = frame_px;
        let (size_px, pictures) = match self {
            Self::Tiles { grid, is_from_top, .. } => {
                if !width.is_multiple_of(grid.columns()) || !height.is_multiple_of(grid.rows()) {
                    return None;
                }
                let size_px = [width / grid.columns(), height / grid.rows()];
                let tile = |view| tile_of(pixels, width, size_px, place(grid, is_from_top, view));
                (size_px, (0..grid.count()).map(tile).collect())
            }
            Self::Turns(turns) => {
                let size_px = halved_size(frame_px, self.even_axis()?)?;
                let mut pictures = vec![Vec::new(); 2];
                for (at, pixel) in pixels.iter().enumerate() {
                    pictures[turns.view(at % width as usize, at / width as usize)].push(*pixel);
                }
                (size_px, pictures)
            }
            _ => return None,
        };
        Views::new(size_px, pictures).ok()
    }
}

/// Column and row of a view from the top left.
const fn place(grid: ViewGrid, is_from_top: bool, view: u32) -> [usize; 2] {
    let [column, row] = grid.place(view);
    [column as usize, if is_from_top { grid.rows() - 1 - row } else { row } as usize]
}

fn tiled(views: &Views, grid: ViewGrid, is_from_top: bool) -> Vec<[u8; 3]> {
    let [width, height] = views.size_px().map(|side| side as usize);
    let frame_width = width * grid.columns() as usize;
    let mut frame = vec![[0; 3]; frame_width * height * grid.rows() as usize];
    for (view, picture) in (0..).zip(views.pictures()) {
        let [column, row] = place(grid, is_from_top, view);
        let lines = frame.chunks_exact_mut(frame_width).skip(row * height);
        for (to, from) in lines.zip(picture.chunks_exact(width)) {
            to[column * width..][..width].copy_from_slice(from);
        }
    }
    frame
}

fn tile_of(
    pixels: &[[u8; 3]],
    frame_width: u32,
    size_px: [u32; 2],
    [column, row]: [usize; 2],
) -> Vec<[u8; 3]> {
    let [width, height] = size_px.map(|side| side as usize);
    let lines = pixels.chunks_exact(frame_width as usize).skip(row * height).take(height);
    lines.flat_map(|line| &line[column * width..][..width]).copied().collect()
}

/// Half of an even size.
fn halved_size([width, height]: [u32; 2], axis: Axis) -> Option<[u32; 2]> {
    match axis {
        Axis::Across => width.is_multiple_of(2).then_some([width / 2, height]),
        Axis::Down => height.is_multiple_of(2).then_some([width, height / 2]),
    }
}

/// Views of half the size: means of two pixels, half a step up.
fn squeezed(views: &Views, axis: Axis) -> Result<Views, LayoutError> {
    let width = views.size_px()[0] as usize;
    let mean =
        |[a, b]: [[u8; 3]; 2]| [0, 1, 2].map(|i| (u16::from(a[i]) + u16::from(b[i])).div_ceil(2) as u8);
    let squeeze = |picture: &Vec<[u8; 3]>| -> Vec<[u8; 3]> {
        match axis {
            Axis::Across => picture.as_chunks::<2>().0.iter().map(|pair| mean(*pair)).collect(),
            Axis::Down => {
                let pairs = picture.chunks_exact(2 * width).map(|lines| lines.split_at(width));
                pairs
                    .flat_map(|(above, below)| above.iter().zip(below).map(|(a, b)| mean([*a, *b])))
                    .collect()
            }
        }
    };
    let refused = LayoutError::Size { what: "a view that is halved", size_px: views.size_px() };
    let size_px = halved_size(views.size_px(), axis).ok_or(refused)?;
    Views::new(size_px, views.pictures().iter().map(squeeze).collect())
}
