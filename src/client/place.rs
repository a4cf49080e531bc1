//! The place of the picture in a frame of a layout.

use relief_display::{Arrangement, Axis, FrameContent, Layout};

/// The part of a frame that shows colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PicturePlace {
    /// Pixels of the picture in a row of the frame, from the left.
    pub(super) columns: usize,
    /// Rows of the picture.
    pub(super) rows: usize,
    /// Rows of the frame per row of the picture, from the top.
    pub(super) step: usize,
    /// Pixels of the picture per pixel of these columns and rows: 2 where a view is halved.
    pub(super) squeeze: [f64; 2],
}

impl PicturePlace {
    /// In frames of this size.
    pub(super) fn of(layout: Layout, frame_px: [u32; 2]) -> Self {
        let [width, height] = frame_px.map(|side| side as usize);
        match layout.info().content {
            FrameContent::Disparity(placement) => {
                let [columns, rows] = placement.picture_px(frame_px).map(|side| side as usize);
                Self { columns, rows, step: placement.line_step as usize, squeeze: [1.0; 2] }
            }
            FrameContent::Picture => Self::whole(width, height),
            FrameContent::Depth => Self::whole(0, height),
            FrameContent::Views(_) => match layout.arrangement() {
                Some(Arrangement::Tiles { grid, halved, .. }) => Self {
                    squeeze: match halved {
                        None => [1.0; 2],
                        Some(Axis::Across) => [2.0, 1.0],
                        Some(Axis::Down) => [1.0, 2.0],
                    },
                    ..Self::whole(width / grid.columns() as usize, height / grid.rows() as usize)
                },
                _ => Self::whole(width, height),
            },
        }
    }

    const fn whole(columns: usize, rows: usize) -> Self {
        Self { columns, rows, step: 1, squeeze: [1.0; 2] }
    }

    /// The pixel of the picture at a place of the frame, u right and v down; `None` beside the
    /// picture.
    #[cfg(any(feature = "window", test))]
    pub(super) fn pixel(self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let v = y / self.step as f64;
        let inside = (0.0..self.columns as f64).contains(&x) && (0.0..self.rows as f64).contains(&v);
        inside.then_some([x * self.squeeze[0], v * self.squeeze[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_a_frame_are_pixels_of_its_picture() {
        for (layout, at, pixel) in [
            (Layout::Wowvx, [100.5, 400.0], Some([100.5, 200.0])),
            (Layout::Wowvx, [960.5, 400.0], None),
            (Layout::WowvxFullHeight, [100.5, 400.0], Some([100.5, 400.0])),
            (Layout::Declipse, [100.5, 539.0], Some([100.5, 539.0])),
            (Layout::Declipse, [100.5, 541.0], None),
            (Layout::Color, [1900.0, 1079.0], Some([1900.0, 1079.0])),
            (Layout::Color, [-1.0, 3.0], None),
            (Layout::Stereo, [959.5, 400.0], Some([959.5, 400.0])),
            (Layout::Stereo, [960.5, 400.0], None),
            (Layout::StereoHalf, [100.5, 400.0], Some([201.0, 400.0])),
            (Layout::TopBottomHalf, [100.5, 400.0], Some([100.5, 800.0])),
            (Layout::Columns, [1900.0, 1079.0], Some([1900.0, 1079.0])),
        ] {
            assert_eq!(PicturePlace::of(layout, [1920, 1080]).pixel(at), pixel, "{layout} {at:?}");
        }
    }
}
