//! Views between rendered ones: each is made of its two neighbours.
//!
//! Both neighbours are warped to the place of the view (see `warp`) and mixed pixel by pixel: the nearer one counts more, and
//! each counts for as much of the pixel as it covers. So what one of them does not see is what the other one sees. On real
//! series a choice between them where their surfaces differ, and less weight for pixels at the edges of surfaces, were each 1 to
//! 3 dB farther from rendered views. What neither sees is filled as in views of a single picture.

use rayon::prelude::*;

use super::parallax::Parallax;
use super::pictures::{Views, check_size};
use super::warp::{LinePiece, Row, Span, UNIT, cut, place, synthesize};
use crate::layout::DecodedLayer;
use crate::layout::error::LayoutError;

/// Weights of the neighbours add up to this.
const WHOLE: i64 = 1 << 10;

/// A rendered view: its eye, colour and disparity.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyView {
    /// The place of the eye, eye separations to the right of the middle.
    pub eye: f64,
    /// Colour and disparity, D of the same limits for all views.
    pub layer: DecodedLayer,
}

/// The views for these eyes, made of rendered views; views at the place of a rendered one are equal to it.
///
/// # Errors
/// When there is no rendered view, one does not fill the size, or there are too many views.
pub fn interpolate(
    size_px: [u32; 2],
    keys: &[KeyView],
    parallax: &Parallax,
    eyes: &[f64],
) -> Result<Views, LayoutError> {
    let Some(first) = keys.first() else { return Err(LayoutError::ViewPixels { count: 0, size_px }) };
    check_size(size_px, eyes.len())?;
    let expected = size_px[0] as usize * size_px[1] as usize;
    let counts = keys.iter().flat_map(|key| [key.layer.color.len(), key.layer.disparity.len()]);
    if let Some(found) = counts.into_iter().find(|found| *found != expected) {
        return Err(LayoutError::PixelCount { what: "a rendered view", size_px, found, expected });
    }
    let mut order: Vec<&KeyView> = keys.iter().collect();
    order.sort_by(|a, b| a.eye.total_cmp(&b.eye));
    let view = |eye: f64| {
        let after = order.partition_point(|key| key.eye < eye);
        let right = order.get(after).copied();
        let left = after.checked_sub(1).and_then(|before| order.get(before)).copied();
        match (left, right) {
            (_, Some(key)) if key.eye == eye => Ok(key.layer.color.clone()),
            (Some(left), Some(right)) => between(size_px, [left, right], parallax, eye),
            (only, other) => one(size_px, only.or(other).unwrap_or(first), parallax, eye),
        }
    };
    Views::new(size_px, eyes.iter().map(|eye| view(*eye)).collect::<Result<_, _>>()?)
}

/// A view of a single neighbour.
fn one(size_px: [u32; 2], key: &KeyView, parallax: &Parallax, eye: f64) -> Result<Vec<[u8; 3]>, LayoutError> {
    let views = synthesize(size_px, &key.layer, None, parallax, &[eye - key.eye])?;
    Ok(views.pictures()[0].clone())
}

fn between(
    size_px: [u32; 2],
    keys: [&KeyView; 2],
    parallax: &Parallax,
    eye: f64,
) -> Result<Vec<[u8; 3]>, LayoutError> {
    let width = size_px[0] as usize;
    let share = (eye - keys[0].eye) / (keys[1].eye - keys[0].eye);
    let to_right = (share * WHOLE as f64).round() as i64;
    let shares = [(WHOLE - to_right).max(1), to_right.max(1)];
    let nearest = keys[usize::from(to_right * 2 > WHOLE)];
    let mut picture = one(size_px, nearest, parallax, eye)?;
    let shifts = keys.map(|key| parallax.shifts(eye - key.eye, size_px[0]));
    picture.par_chunks_exact_mut(width).enumerate().for_each_init(Scratch::default, |scratch, (y, out)| {
        let [left, right] = [0, 1].map(|side: usize| {
            let mut line = std::mem::take(&mut scratch.lines[side]);
            line.draw(&Row::of(&keys[side].layer, y, width), &shifts[side], scratch);
            line
        });
        for (x, out) in out.iter_mut().enumerate() {
            if let Some(color) = merged([&left, &right], shares, x) {
                *out = color;
            }
        }
        scratch.lines = [left, right];
    });
    Ok(picture)
}

/// The colour that the two neighbours give a pixel; `None` where neither sees it.
fn merged(lines: [&Line; 2], shares: [i64; 2], x: usize) -> Option<[u8; 3]> {
    let half = i64::from(UNIT) / 2;
    let weights = [0, 1].map(|side: usize| if lines[side].weights[x] >= half { shares[side] } else { 0 });
    if weights == [0, 0] {
        return None;
    }
    let total: i64 = (0..2).map(|side| weights[side] * lines[side].weights[x]).sum();
    Some(std::array::from_fn(|channel| {
        let sum: i64 = (0..2).map(|side| weights[side] * lines[side].colors[x][channel]).sum();
        ((2 * sum + total) / (2 * total)) as u8
    }))
}

/// Buffers, reused from line to line.
#[derive(Default)]
struct Scratch {
    spans: Vec<Span>,
    active: Vec<Span>,
    pieces: Vec<LinePiece>,
    lines: [Line; 2],
}

/// Sums over the width of each pixel of a line.
#[derive(Default)]
struct Line {
    weights: Vec<i64>,
    colors: Vec<[i64; 3]>,
}

impl Line {
    fn draw(&mut self, row: &Row<'_>, shifts: &[i32; 256], scratch: &mut Scratch) {
        let width = row.color.len();
        place(row.disparity, shifts, &mut scratch.spans);
        cut(&scratch.spans, &mut scratch.active, width, &mut scratch.pieces);
        self.weights.clear();
        self.weights.resize(width, 0);
        self.colors.clear();
        self.colors.resize(width, [0; 3]);
        let mut from = 0;
        for piece in &scratch.pieces {
            if let Some(pixel) = piece.pixel {
                self.add(row, pixel, from, piece.to);
            }
            from = piece.to;
        }
    }

    fn add(&mut self, row: &Row<'_>, pixel: usize, from: i32, to: i32) {
        let mut x = from;
        while x < to {
            let at = x / UNIT;
            let until = ((at + 1) * UNIT).min(to);
            let weight = i64::from(until - x);
            let at = at as usize;
            self.weights[at] += weight;
            for (sum, channel) in self.colors[at].iter_mut().zip(row.color[pixel]) {
                *sum += weight * i64::from(channel);
            }
            x = until;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{DisplayProfile, ProfileName};

    const SIZE: [u32; 2] = [96, 4];
    const WALL: u8 = 108;
    const PLATE: u8 = 148;

    fn parallax() -> Parallax {
        Parallax::new(&DisplayProfile::named(ProfileName::Philips42), 255, 128, 2000)
    }

    /// A striped wall far away, and a bright plate before it, as the eye sees them.
    fn scene(eye: f64) -> KeyView {
        let parallax = parallax();
        let [wall, plate] = [WALL, PLATE]
            .map(|d| parallax.shift_px(relief_base::Disparity(f64::from(d)), eye).round() as i32);
        let mut layer = DecodedLayer { color: Vec::new(), disparity: Vec::new() };
        for _ in 0..SIZE[1] {
            for x in 0..SIZE[0] as i32 {
                let is_plate = (30..50).contains(&(x - plate));
                let stripe = if (x - wall).rem_euclid(7) < 3 { 60 } else { 110 };
                layer.color.push(if is_plate { [250, 240, 20] } else { [stripe, 20, stripe] });
                layer.disparity.push(if is_plate { PLATE } else { WALL });
            }
        }
        KeyView { eye, layer }
    }

    /// The eye at which the surfaces have moved by this number of pixels, in opposite directions.
    fn eye_at(pixels: f64) -> f64 {
        pixels / parallax().shift_px(relief_base::Disparity(f64::from(PLATE)), 1.0).abs()
    }

    #[test]
    fn a_view_between_two_shows_what_only_one_of_them_sees() {
        let (left, eye, right) = (scene(0.0), eye_at(2.0), scene(eye_at(6.0)));
        let truth = scene(eye).layer.color;
        let found = interpolate(SIZE, &[left.clone(), right], &parallax(), &[eye]).unwrap();
        let single = interpolate(SIZE, std::slice::from_ref(&left), &parallax(), &[eye]).unwrap();
        let wrong =
            |picture: &[[u8; 3]]| picture[8..88].iter().zip(&truth[8..88]).filter(|(a, b)| a != b).count();
        let moved = left.layer.color[8..88].iter().zip(&truth[8..88]).filter(|(a, b)| a != b).count();
        assert!(moved > 10, "the scene moves: {moved}");
        assert_eq!(wrong(&found.pictures()[0]), 0);
        assert!(wrong(&single.pictures()[0]) > 0, "one picture does not see what is behind the plate");
    }

    #[test]
    fn rendered_views_come_back_unchanged_and_wrong_sizes_are_refused() {
        let keys = [scene(-1.0), scene(0.5)];
        let found = interpolate(SIZE, &keys, &parallax(), &[-1.0, 0.5]).unwrap();
        assert_eq!(found.pictures(), [keys[0].layer.color.clone(), keys[1].layer.color.clone()]);
        assert!(interpolate(SIZE, &[], &parallax(), &[0.0]).is_err());
        let mut short = keys;
        short[1].layer.disparity.pop();
        assert!(interpolate(SIZE, &short, &parallax(), &[0.0]).is_err());
    }
}
