//! Orientation letters burnt into the edges of a slice's picture, by a font of six letters.
//!
//! White with a black rim, so that they can be read on bone and on air; at the depth of the slice's
//! plane, so that a 3D display shows them in it. Drawn on the CPU after read-back, by the renderer
//! and its f64 twin alike. Pixels; columns from the left, rows from the top.

use super::frame::RenderedFrame;
use relief_volume::EdgeLabels;

/// Columns and rows of a letter.
const GLYPH_PX: [i32; 2] = [5, 7];

/// A letter's rows from the top, the leftmost column in bit 4; empty for characters that are not
/// direction letters.
fn glyph(letter: char) -> [u8; 7] {
    match letter {
        'A' => [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'F' => [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000],
        'H' => [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'L' => [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111],
        'P' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000],
        'R' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
        _ => [0; 7],
    }
}

/// Draws the letters of the frame's camera into it.
pub(super) fn burn(frame: &mut RenderedFrame) {
    let depth_mm = frame.camera.distance_mm() as f32;
    for (label, corner, scale) in placed(&frame.camera.edge_labels(), frame.size_px) {
        for (at, letter) in (0..).zip(label.chars()) {
            let left = corner[0] + at * (GLYPH_PX[0] + 1) * scale;
            draw(frame, glyph(letter), [left, corner[1]], scale, depth_mm);
        }
    }
}

/// Labels with the place of their top left corners, a margin from the middles of the edges, and the
/// size of a dot.
fn placed(labels: &EdgeLabels, size_px: [u32; 2]) -> [(String, [i32; 2], i32); 4] {
    let [width, height] = size_px.map(|side| side as i32);
    // A letter is about a twentieth of the picture.
    let scale = (width.min(height) / 140).max(1);
    let margin = 2 * scale;
    let across = |label: &str| (label.len() as i32 * (GLYPH_PX[0] + 1) - 1) * scale;
    let down = GLYPH_PX[1] * scale;
    let middle = (height - down) / 2;
    let centered = |label: &str| (width - across(label)) / 2;
    [
        (labels.left.clone(), [margin, middle], scale),
        (labels.right.clone(), [width - margin - across(&labels.right), middle], scale),
        (labels.top.clone(), [centered(&labels.top), margin], scale),
        (labels.bottom.clone(), [centered(&labels.bottom), height - margin - down], scale),
    ]
}

/// One letter: first its rim, a dot wide, then itself.
fn draw(frame: &mut RenderedFrame, rows: [u8; 7], [left, top]: [i32; 2], scale: i32, depth_mm: f32) {
    let dots = || {
        let cells = (0..GLYPH_PX[1]).flat_map(|row| (0..GLYPH_PX[0]).map(move |column| [column, row]));
        let rows_of = (0..).zip(rows).collect::<Vec<(i32, u8)>>();
        cells.filter(move |[column, row]| {
            rows_of.iter().any(|(at, bits)| at == row && bits >> (GLYPH_PX[0] - 1 - column) & 1 == 1)
        })
    };
    for (grown, color) in [(scale, [0, 0, 0, 255]), (0, [255; 4])] {
        for [column, row] in dots() {
            let (x, y) = (left + column * scale, top + row * scale);
            for pixel_y in y - grown..y + scale + grown {
                for pixel_x in x - grown..x + scale + grown {
                    put(frame, [pixel_x, pixel_y], color, depth_mm);
                }
            }
        }
    }
}

/// Sets a pixel; pixels outside the picture are ignored.
fn put(frame: &mut RenderedFrame, at: [i32; 2], color: [u8; 4], depth_mm: f32) {
    let [Ok(x), Ok(y)] = at.map(u32::try_from) else { return };
    if x < frame.size_px[0] && y < frame.size_px[1] {
        let index = (y * frame.size_px[0] + x) as usize;
        frame.color_rgba[index] = color;
        frame.depth_mm[index] = depth_mm;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Timings;
    use relief_base::{DepthLimits, Point};
    use relief_volume::NamedPlane;

    fn burnt(plane: NamedPlane, size_px: [u32; 2]) -> RenderedFrame {
        let pixels = size_px[0] as usize * size_px[1] as usize;
        let mut frame = RenderedFrame {
            back: None,
            size_px,
            color_rgba: vec![[90; 4]; pixels],
            depth_mm: vec![f32::INFINITY; pixels],
            display_mm: None,
            camera: plane.view().camera(Point::new(0.0, 0.0, 0.0), 300.0, 100.0).unwrap(),
            limits: DepthLimits::new(200.0, 400.0).unwrap(),
            nearest_ball_mm: None,
            is_partial: false,
            timings: Timings::default(),
        };
        burn(&mut frame);
        frame
    }

    /// The dots of a part of a picture, row by row.
    fn read(frame: &RenderedFrame, [left, top]: [usize; 2]) -> [u8; 7] {
        let white = |x: usize, y: usize| frame.color_rgba[y * frame.size_px[0] as usize + x] == [255; 4];
        std::array::from_fn(|row| (0..5).fold(0, |bits, x| bits << 1 | u8::from(white(left + x, top + row))))
    }

    #[test]
    fn letters_are_at_the_edges_they_name() {
        let frame = burnt(NamedPlane::Axial, [80, 60]);
        for (letter, corner) in [('R', [2, 26]), ('L', [73, 26]), ('A', [37, 2]), ('P', [37, 51])] {
            assert_eq!(read(&frame, corner), glyph(letter), "{letter}");
        }
        let letters = frame.color_rgba.iter().zip(&frame.depth_mm).filter(|(color, _)| **color != [90; 4]);
        assert!(letters.clone().count() > 100 && letters.clone().all(|(_, depth)| *depth == 300.0));
        let rest = frame.color_rgba.iter().zip(&frame.depth_mm).filter(|(color, _)| **color == [90; 4]);
        assert!(rest.clone().all(|(_, depth)| depth.is_infinite()) && rest.count() > 4000);
    }

    #[test]
    fn a_picture_too_small_for_letters_holds_what_fits() {
        for size_px in [[1, 1], [5, 3], [3, 9]] {
            burnt(NamedPlane::Coronal, size_px);
        }
    }
}
