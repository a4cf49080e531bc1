//! A line of text in place of the picture, large enough to be read from three metres.

/// A line of text as shares of covered pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lettering {
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// The covered share of each pixel, 0 to 255; rows from the top.
    pub coverage: Vec<u8>,
}

/// Makes a line of text whose capitals have this height, px.
pub(crate) type LetteringFn = fn(&str, u32) -> Lettering;

/// Height of capitals as a share of the window's height: 60 px of 1080, 29 mm on a display of 42".
const CAPITALS: u32 = 18;
/// Share of the window's width that the line may take, per cent.
const WIDTH_PERCENT: u32 = 90;
/// Brightness of the ink.
const INK: u32 = 0xe0;

/// Draws a line in the middle of a black window. `lettering` makes a line whose capitals have a
/// height in pixels.
pub(super) fn draw(text: &str, lettering: LetteringFn, buffer: &mut [u32], [width, height]: [u32; 2]) {
    buffer.fill(0);
    let most = width * WIDTH_PERCENT / 100;
    let mut capitals = (height / CAPITALS).max(8);
    let mut line = lettering(text, capitals);
    while line.size_px[0] > most && capitals > 8 {
        capitals = (capitals * most / line.size_px[0]).clamp(8, capitals - 1);
        line = lettering(text, capitals);
    }
    let [columns, rows] = line.size_px;
    let (left, top) = (width.saturating_sub(columns) / 2, height.saturating_sub(rows) / 2);
    for (at, &share) in (0..).zip(&line.coverage) {
        let (x, y) = (left + at % columns, top + at / columns);
        let pixel = (y * width + x) as usize;
        if x < width && pixel < buffer.len() {
            let ink = INK * u32::from(share) / 255;
            buffer[pixel] = ink << 16 | ink << 8 | ink;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A full block, as wide as the text is long.
    fn block(text: &str, height_px: u32) -> Lettering {
        let size_px = [text.len() as u32 * height_px, height_px];
        Lettering { size_px, coverage: vec![255; (size_px[0] * size_px[1]) as usize] }
    }

    fn drawn(text: &str, size_px: [u32; 2]) -> [u32; 4] {
        let mut buffer = vec![7; (size_px[0] * size_px[1]) as usize];
        draw(text, block, &mut buffer, size_px);
        let ink = (0..).zip(&buffer).filter(|(_, pixel)| **pixel != 0);
        let places = ink.map(|(at, _)| [at % size_px[0], at / size_px[0]]);
        places.fold([u32::MAX, u32::MAX, 0, 0], |[l, t, r, b], [x, y]| {
            [l.min(x), t.min(y), r.max(x + 1), b.max(y + 1)]
        })
    }

    #[test]
    fn a_line_stands_in_the_middle_and_fits() {
        assert_eq!(drawn("abc", [1920, 1080]), [870, 510, 1050, 570]);
        let [left, top, right, bottom] = drawn(&"x".repeat(60), [1920, 1080]);
        assert!(left >= 96 && right <= 1824 && right - left > 1500, "{left} to {right}");
        assert_eq!((left + right, top + bottom), (1920, 1080));
    }

    #[test]
    fn a_window_that_is_too_small_shows_what_fits() {
        for size_px in [[1, 1], [5, 3], [40, 2]] {
            draw("waiting", block, &mut vec![0; (size_px[0] * size_px[1]) as usize], size_px);
        }
    }
}
