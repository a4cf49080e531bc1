//! The state of a session as a few pixels of the picture.

use super::place::PicturePlace;
use relief_display::{Frame, Layout, LayoutError, Pixels};
use relief_tracking::TrackingState;

/// Side of a mark, in pixels of the picture.
pub(crate) const MARK_PX: usize = 6;
/// Distance of the marks from the picture's edges and from one another.
const MARGIN_PX: usize = 4;

/// Problems that the display shows. Nothing is drawn without a problem.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    /// State of the Wiimote's tracking, if there is one.
    pub tracking: Option<TrackingState>,
    /// Whether the connection is gone: the picture is an old one.
    pub offline: bool,
}

impl Marks {
    /// Colours of the marks, from the left.
    fn colors(self) -> impl Iterator<Item = [u8; 3]> {
        let tracking = self.tracking.and_then(|state| match state {
            TrackingState::Tracking => None,
            TrackingState::Searching => Some([0xd0, 0xa0, 0x20]),
            TrackingState::Ambiguous => Some([0xd0, 0x60, 0x20]),
            TrackingState::Lost => Some([0xc0, 0x20, 0x20]),
        });
        self.offline.then_some([0x40, 0x60, 0xd0]).into_iter().chain(tracking)
    }

    /// Draws the marks into the lower left corner of the picture's half: blue without a connection;
    /// yellow while the Wiimote is looked for, orange where it is ambiguous, red when it is lost.
    /// The header's line, depth and lines that are black by the layout are not touched.
    ///
    /// # Errors
    /// None for a frame of the layout.
    pub fn draw(self, layout: Layout, frame: Frame) -> Result<Frame, LayoutError> {
        if self.colors().next().is_none() {
            return Ok(frame);
        }
        let size_px = frame.size_px();
        let Pixels::Rgb8(mut samples) = frame.pixels().clone() else { return Ok(frame) };
        let width = size_px[0] as usize;
        let PicturePlace { columns, rows, step, .. } = PicturePlace::of(layout, size_px);
        for (at, color) in self.colors().enumerate() {
            let left = MARGIN_PX + at * (MARK_PX + MARGIN_PX);
            let top = rows.saturating_sub(MARGIN_PX + MARK_PX).max(1); // row 0 has the header
            for row in top..(top + MARK_PX).min(rows) {
                for x in left..(left + MARK_PX).min(columns) {
                    let pixel = 3 * (row * step * width + x);
                    if let Some(samples) = samples.get_mut(pixel..pixel + 3) {
                        samples.copy_from_slice(&color);
                    }
                }
            }
        }
        Frame::new(size_px, Pixels::Rgb8(samples))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(size_px: [u32; 2]) -> Frame {
        let samples = vec![90; 3 * (size_px[0] * size_px[1]) as usize];
        Frame::new(size_px, Pixels::Rgb8(samples)).unwrap()
    }

    fn changed(layout: Layout, size_px: [u32; 2], marks: Marks) -> Vec<[usize; 2]> {
        let before = gray(size_px);
        let after = marks.draw(layout, before.clone()).unwrap();
        let (Pixels::Rgb8(a), Pixels::Rgb8(b)) = (before.pixels(), after.pixels()) else { unreachable!() };
        let pixels = a.chunks(3).zip(b.chunks(3)).enumerate().filter(|(_, (a, b))| a != b);
        pixels.map(|(at, _)| [at % size_px[0] as usize, at / size_px[0] as usize]).collect()
    }

    const BAD: Marks = Marks { tracking: Some(TrackingState::Lost), offline: true };

    #[test]
    fn nothing_is_drawn_while_all_is_well() {
        let well = Marks { tracking: Some(TrackingState::Tracking), offline: false };
        for marks in [well, Marks::default()] {
            assert!(changed(Layout::Wowvx, [256, 64], marks).is_empty());
        }
    }

    /// Invariant: The client composes exactly the served PNG, and its window shows it byte for
    /// byte; state marks change neither header, depth nor black lines.
    #[test]
    fn marks_stay_in_the_picture_and_off_the_header_and_black_lines() {
        let pixels = changed(Layout::Wowvx, [256, 64], BAD);
        assert_eq!(pixels.len(), 2 * MARK_PX * MARK_PX);
        assert!(pixels.iter().all(|[x, y]| *x < 128 && *y > 0 && y % 2 == 0), "{pixels:?}");
        for layout in Layout::ALL {
            for size_px in [[256, 64], [2, 2], [16, 4], [64, 2]] {
                let pixels = changed(layout, size_px, BAD);
                let has_depth = layout.placement().is_some();
                let right = if has_depth { size_px[0] / 2 } else { size_px[0] };
                assert!(pixels.iter().all(|[x, y]| *x < right as usize && *y > 0), "{layout} {size_px:?}");
                if layout == Layout::Declipse {
                    assert!(pixels.iter().all(|[_, y]| *y < size_px[1] as usize / 2));
                }
            }
        }
    }
}
