//! Where the picture lies in a frame of a layout.

use relief_display::{FrameContent, Layout};

/// The part of a frame that shows colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PicturePlace {
    /// Pixels of the picture in a row of the frame, from the left.
    pub(super) columns: usize,
    /// Rows of the picture.
    pub(super) rows: usize,
    /// Rows of the frame per row of the picture, from the top.
    pub(super) step: usize,
}

impl PicturePlace {
    /// In frames of this size.
    pub(super) fn of(layout: Layout, frame_px: [u32; 2]) -> Self {
        let [width, height] = frame_px.map(|side| side as usize);
        match layout.info().content {
            FrameContent::Disparity(placement) => {
                let [columns, rows] = placement.picture_px(frame_px).map(|side| side as usize);
                Self { columns, rows, step: placement.line_step as usize }
            }
            FrameContent::Picture => Self { columns: width, rows: height, step: 1 },
            FrameContent::Depth => Self { columns: 0, rows: height, step: 1 },
            FrameContent::Views => Self { columns: width / 2, rows: height, step: 1 },
        }
    }

    /// The pixel of the picture at a place of the frame, u right and v down; `None` beside the
    /// picture.
    #[cfg(any(feature = "window", test))]
    pub(super) fn pixel(self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let v = y / self.step as f64;
        let inside = (0.0..self.columns as f64).contains(&x) && (0.0..self.rows as f64).contains(&v);
        inside.then_some([x, v])
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
        ] {
            assert_eq!(PicturePlace::of(layout, [1920, 1080]).pixel(at), pixel, "{layout} {at:?}");
        }
    }
}
