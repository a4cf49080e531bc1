//! Instruments: the orientation cube and the scale bar. They keep their place in the picture and
//! stand at the depth of the focal point, which a 3D display shows at its screen: nothing to strain
//! the eyes. The volume never hides them.
//!
//! Pixels of the picture; depth is view depth in mm.

use glam::{DVec2, DVec3};

use super::font::{CAPITAL, glyph};
use super::layers::Rank;
use super::lens::Lens;
use super::primitive::{Primitive, PrimitiveForm};
use super::shape::{Stroke, Triangle};
use super::text::{Style, Typesetter, contrast, usual_height_px};

/// The cube's side as a share of the picture's smaller side, and its least, px.
const CUBE_SHARE: f64 = 0.12;
const LEAST_CUBE_PX: f64 = 28.0;

/// Half the diagonal of a cube, in half sides, and a little.
const CUBE_REACH: f64 = 1.8;

/// Height of the cube's letters, in half sides.
const LETTER: f64 = 1.15;

/// How much of a face must be towards the viewer for it to be drawn, and for its letter to be read.
const SEEN: f64 = 0.03;
const READ: f64 = 0.3;

const LETTER_RGB: [f64; 3] = [0.07, 0.07, 0.1];
const BAR_RGB: [f64; 3] = [1.0; 3];

/// The longest scale bar as a share of the picture's width.
const BAR_SHARE: f64 = 0.25;

/// Height of a caption's capitals as a share of those of labels, and their least, px.
const CAPTION_SHARE: f64 = 0.55;
const LEAST_CAPTION_PX: u32 = 8;

/// Shorter lengths are written in µm.
const LEAST_MM: f64 = 0.1;

/// A length for people: in mm, or in µm where it is less than a tenth of a millimetre.
#[must_use]
pub fn length_words(mm: f64) -> String {
    if mm == 0.0 || mm.abs() >= LEAST_MM {
        return format!("{mm:.1} mm");
    }
    let um = 1000.0 * mm;
    let decimals = (2.0 - um.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{um:.decimals$} µm")
}

/// A face of the cube: its outward and upward patient directions, and its colour.
struct Face {
    letter: char,
    outwards: DVec3,
    up: DVec3,
    rgb: [f64; 3],
}

/// Letters are those of DICOM: left, right, anterior, posterior, head, feet; opposite faces have
/// one colour.
const FACES: [Face; 6] = [
    Face { letter: 'L', outwards: DVec3::X, up: DVec3::Z, rgb: [0.95, 0.62, 0.55] },
    Face { letter: 'R', outwards: DVec3::NEG_X, up: DVec3::Z, rgb: [0.95, 0.62, 0.55] },
    Face { letter: 'P', outwards: DVec3::Y, up: DVec3::Z, rgb: [0.65, 0.88, 0.6] },
    Face { letter: 'A', outwards: DVec3::NEG_Y, up: DVec3::Z, rgb: [0.65, 0.88, 0.6] },
    Face { letter: 'H', outwards: DVec3::Z, up: DVec3::Y, rgb: [0.6, 0.75, 1.0] },
    Face { letter: 'F', outwards: DVec3::NEG_Z, up: DVec3::NEG_Y, rgb: [0.6, 0.75, 1.0] },
];

/// A cube that turns with the patient, in the lower right corner.
pub(super) fn orientation_cube(lens: &Lens, out: &mut Vec<Primitive>) {
    let side = (lens.size_px.min_element() * CUBE_SHARE).max(LEAST_CUBE_PX);
    let half = side / 2.0;
    let middle = lens.size_px - half * (CUBE_REACH + 0.3);
    let cube = Cube { lens, middle, half, mm_per_px: lens.mm_per_px(lens.focal_mm) };
    FACES.iter().for_each(|face| cube.face(face, out));
}

struct Cube<'a> {
    lens: &'a Lens,
    middle: DVec2,
    half: f64,
    mm_per_px: f64,
}

impl Cube<'_> {
    /// Pixel and depth of a place of the cube: a patient direction from its middle, in half sides.
    fn place(&self, direction: DVec3) -> (DVec2, f64) {
        let DVec3 { x, y, z } = self.lens.turn(direction) * self.half;
        let depth_mm = (self.lens.focal_mm - z * self.mm_per_px).max(self.lens.focal_mm / 2.0);
        (self.middle + DVec2::new(x, -y), depth_mm)
    }

    fn face(&self, face: &Face, out: &mut Vec<Primitive>) {
        let Face { letter, outwards, up, rgb } = *face;
        let towards = self.lens.turn(outwards).z;
        if towards < SEEN {
            return;
        }
        let right = up.cross(outwards);
        let corners = [-right - up, right - up, right + up, -right + up].map(|across| outwards + across);
        let lit = rgb.map(|channel| channel * (0.55 + 0.45 * towards));
        let places = corners.map(|corner| self.place(corner));
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]].map(|half| half.map(|i: usize| places[i])) {
            let triangle = Triangle::flat(self.lens, [a.0, b.0, c.0], [a.1, b.1, c.1]);
            out.extend(triangle.map(|triangle| instrument(PrimitiveForm::Triangle(triangle), lit)));
        }
        let border = (self.half / 14.0).max(1.0);
        for i in 0..4 {
            self.stroke([corners[i], corners[(i + 1) % 4]].map(|corner| corner * 1.01), border, out);
        }
        if towards >= READ {
            let glyph = glyph(letter);
            let scale = LETTER / CAPITAL;
            let at = |end: DVec2| {
                let across = (end - DVec2::new(glyph.width(), CAPITAL) / 2.0) * scale;
                outwards * 1.03 + right * across.x + up * across.y
            };
            for ends in &glyph.segments {
                self.stroke(ends.map(at), (self.half * 0.16).max(1.3), out);
            }
        }
    }

    fn stroke(&self, ends: [DVec3; 2], width_px: f64, out: &mut Vec<Primitive>) {
        let [a, b] = ends.map(|end| self.place(end));
        let stroke = Stroke::flat(self.lens, [a.0, b.0], [a.1, b.1], width_px);
        out.push(instrument(PrimitiveForm::Stroke(stroke), LETTER_RGB));
    }
}

/// A bar of a round length in the lower left corner: true at the depth of the focal point
/// (everywhere, in a parallel projection).
pub(super) fn scale_bar(lens: &Lens, typesetter: &mut Typesetter, out: &mut Vec<Primitive>) {
    let mm_per_px = lens.mm_per_px(lens.focal_mm);
    let length_mm = round_length(lens.size_px.x * BAR_SHARE * mm_per_px);
    let height_px = usual_height_px(lens.size_px.y);
    let unit = f64::from(height_px);
    // An even width around a whole row: sharp edges.
    let left = DVec2::new(unit, (lens.size_px.y - unit).round());
    let right = left + DVec2::X * length_mm / mm_per_px;
    let tick = DVec2::new(0.0, -0.45 * unit);
    let (width, rim) = (2.0 * (unit / 16.0).round().max(1.0), 2.0 * (unit / 10.0).max(1.5));
    for (width, rgb) in [(width, BAR_RGB), (width + rim, contrast(BAR_RGB))] {
        for ends in [[left, right], [left, left + tick], [right, right + tick]] {
            let stroke = Stroke::flat(lens, ends, [lens.focal_mm; 2], width);
            out.push(instrument(PrimitiveForm::Stroke(stroke), rgb));
        }
    }
    let text = if length_mm < LEAST_MM {
        format!("{} µm", (length_mm * 1000.0).round())
    } else {
        format!("{length_mm} mm")
    };
    let half_text = Typesetter::size_px(&text, height_px).x / 2.0;
    let middle =
        DVec2::new((left.x + right.x).max(left.x * 2.0 + half_text * 2.0) / 2.0, left.y - 1.2 * unit);
    let style = Style { height_px, rgb: BAR_RGB, rank: Rank::Instrument, shown_mm: None };
    typesetter.set(&text, middle, lens.focal_mm, style, out);
}

/// A line of text in the upper left corner, smaller than labels; in small letters where it is long.
pub(super) fn caption(text: &str, lens: &Lens, typesetter: &mut Typesetter, out: &mut Vec<Primitive>) {
    let unit = usual_height_px(lens.size_px.y);
    let room = lens.size_px.x - 2.0 * f64::from(unit);
    let wanted = (f64::from(unit) * CAPTION_SHARE).round().max(f64::from(LEAST_CAPTION_PX)) as u32;
    let fits = |height_px: &u32| Typesetter::size_px(text, *height_px).x <= room;
    let height_px = (LEAST_CAPTION_PX..=wanted).rev().find(fits).unwrap_or(LEAST_CAPTION_PX);
    let size = Typesetter::size_px(text, height_px);
    let middle = DVec2::splat(f64::from(unit)) + size / 2.0;
    let style = Style { height_px, rgb: BAR_RGB, rank: Rank::Instrument, shown_mm: None };
    typesetter.set(text, middle, lens.focal_mm, style, out);
}

fn instrument(shape: PrimitiveForm, rgb: [f64; 3]) -> Primitive {
    let rgb = rgb.map(|channel| (channel * 255.0) as f32);
    Primitive { shape, rgb, opacity: 1.0, rank: Rank::Instrument, shown_mm: None }
}

/// The largest of 1, 2 and 5 times a power of ten that is at most this.
fn round_length(most: f64) -> f64 {
    let power = 10f64.powi(most.log10().floor() as i32);
    let step = [5.0, 2.0].into_iter().find(|step| step * power <= most).unwrap_or(1.0);
    step * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round_and_the_largest_that_fit() {
        for (most, length, text) in [
            (99.0, 50.0, "50"),
            (100.0, 100.0, "100"),
            (19.9, 10.0, "10"),
            (3.7, 2.0, "2"),
            (0.26, 0.2, "0.2"),
            (0.07, 0.05, "0.05"),
            (2600.0, 2000.0, "2000"),
        ] {
            assert_eq!(round_length(most), length);
            assert_eq!(round_length(most).to_string(), text);
        }
    }

    #[test]
    fn short_lengths_are_in_micrometres() {
        for (mm, words) in
            [(12.34, "12.3 mm"), (0.1, "0.1 mm"), (0.0351, "35.1 µm"), (0.000_5, "0.500 µm"), (0.0, "0.0 mm")]
        {
            assert_eq!(length_words(mm), words);
        }
    }

    #[test]
    fn letters_are_read_from_outside_with_their_own_up() {
        for Face { letter, outwards, up, .. } in FACES {
            assert_eq!(outwards.dot(up), 0.0, "{letter}");
            // Seen from outside, right is where up x outwards points: the way back is along
            // `outwards`.
            assert_eq!(up.cross(outwards).cross(up), outwards, "{letter}");
        }
    }
}
