//! Depth of a film without flicker.
//!
//! A network sees one picture at a time, so that its estimate of a thing that stands still wavers.
//! [`Steady`] keeps what the last picture had wherever the picture has not changed. It also fits
//! the scale of each estimate to the one before, because a network measures every picture anew.

use image::RgbImage;
use image::imageops::thumbnail;

use crate::closeness::Closeness;

/// Share of a new estimate where nothing changed.
const LEAST_NEW: f32 = 0.15;
/// Change of colour from which an estimate is taken as it is, bytes (largest of three channels).
const CHANGED: f32 = 24.0;
/// Pixels to each side over which colours are averaged before they are compared, so that noise of
/// single pixels is no change.
const AVERAGED_PX: u32 = 4;
/// Mean change of colour of a cut, bytes: another scene begins, and nothing is kept.
const CUT: f32 = 48.0;
/// Scales outside of this are no drift of a network, and are not corrected.
const SCALES: std::ops::RangeInclusive<f32> = 0.7..=1.4;

/// The state between the pictures of one film.
#[derive(Debug, Default)]
pub struct Steady {
    last: Option<Last>,
}

/// The last picture: its size, its averaged colours, and its steadied estimate.
#[derive(Debug)]
struct Last {
    size_px: [u32; 2],
    colors: RgbImage,
    values: Vec<f32>,
}

impl Steady {
    /// The estimate of the next picture, steadied by those before it. A picture of another size
    /// begins anew.
    #[must_use]
    pub fn next(&mut self, picture: &RgbImage, estimate: Closeness) -> Closeness {
        let size_px = estimate.size_px();
        let colors = averaged(picture);
        let values = match self.last.take() {
            Some(last) if last.size_px == size_px && picture.dimensions() == size_px.into() => {
                blended(&last, &colors, &estimate)
            }
            _ => estimate.values().to_vec(),
        };
        self.last = Some(Last { size_px, colors, values: values.clone() });
        Closeness::new(size_px, values).unwrap_or(estimate)
    }
}

/// The picture, smaller: mean colours of squares.
fn averaged(picture: &RgbImage) -> RgbImage {
    let side = |side: u32| side.div_ceil(AVERAGED_PX).max(1);
    thumbnail(picture, side(picture.width()), side(picture.height()))
}

fn blended(last: &Last, colors: &RgbImage, estimate: &Closeness) -> Vec<f32> {
    let of_square = |(before, now): (&image::Rgb<u8>, &image::Rgb<u8>)| {
        before.0.iter().zip(now.0).map(|(before, now)| before.abs_diff(now)).max().unwrap_or(0)
    };
    let squares: Vec<u8> = last.colors.pixels().zip(colors.pixels()).map(of_square).collect();
    let mean = squares.iter().map(|change| f64::from(*change)).sum::<f64>() / squares.len() as f64;
    if mean > f64::from(CUT) {
        return estimate.values().to_vec();
    }
    let [width, height] = estimate.size_px();
    let square = |x: u32, y: u32| {
        let place = |at: u32, side: u32, squares: u32| {
            (u64::from(at) * u64::from(squares) / u64::from(side)) as usize
        };
        squares[place(y, height, colors.height()) * colors.width() as usize + place(x, width, colors.width())]
    };
    let changes: Vec<u8> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| square(x, y)).collect();
    let scale = scale_between(&changes, &last.values, estimate.values());
    let value = |((change, kept), new): ((&u8, &f32), &f32)| {
        let share = LEAST_NEW + (1.0 - LEAST_NEW) * (f32::from(*change) / CHANGED).min(1.0);
        kept + share * (new * scale - kept)
    };
    changes.iter().zip(&last.values).zip(estimate.values()).map(value).collect()
}

/// The factor that fits a new estimate to the last one by least squares, where nothing changed.
fn scale_between(changes: &[u8], kept: &[f32], new: &[f32]) -> f32 {
    let still =
        changes.iter().zip(kept).zip(new).filter(|((change, _), _)| f32::from(**change) < CHANGED / 4.0);
    let (mut product, mut square) = (0.0, 0.0);
    for ((_, kept), new) in still {
        product += f64::from(*kept) * f64::from(*new);
        square += f64::from(*new) * f64::from(*new);
    }
    let scale = if square > 0.0 { (product / square) as f32 } else { 1.0 };
    if SCALES.contains(&scale) { scale } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(seed: u32, index: u32, truth: f32) -> f32 {
        let bits =
            (index.wrapping_mul(2_654_435_761) ^ seed.wrapping_mul(40_503)).wrapping_mul(2_246_822_519);
        truth + 0.1 * ((bits >> 8) as f32 / (1 << 24) as f32 - 0.5)
    }

    fn wavering(seed: u32) -> Closeness {
        let scale = if seed.is_multiple_of(2) { 1.0 } else { 0.9 };
        let values =
            (0..400).map(|index| scale * noisy(seed, index, (index % 20) as f32 / 25.0 + 0.05)).collect();
        Closeness::new([20, 20], values).unwrap()
    }

    #[test]
    fn a_still_film_does_not_flicker() {
        let picture = RgbImage::from_fn(20, 20, |x, y| image::Rgb([(x * 12) as u8, (y * 12) as u8, 60]));
        let mut steady = Steady::default();
        let films = |steady: &mut Steady| {
            (0..40).map(|seed| steady.next(&picture, wavering(seed))).collect::<Vec<_>>()
        };
        let found = films(&mut steady);
        let flicker = |frames: &[Closeness]| {
            let pairs = frames.windows(2).skip(10);
            let of = |pair: &[Closeness]| {
                pair[0].values().iter().zip(pair[1].values()).map(|(a, b)| (a - b).abs()).sum::<f32>()
            };
            pairs.map(of).sum::<f32>()
        };
        let plain: Vec<_> = (0..40).map(wavering).collect();
        assert!(flicker(&found) < 0.2 * flicker(&plain), "{} of {}", flicker(&found), flicker(&plain));
    }

    #[test]
    fn a_cut_keeps_nothing() {
        let [dark, bright] = [10, 220].map(|grey| RgbImage::from_pixel(20, 20, image::Rgb([grey; 3])));
        let mut steady = Steady::default();
        let _ = steady.next(&dark, Closeness::new([20, 20], vec![0.9; 400]).unwrap());
        let after = Closeness::new([20, 20], vec![0.2; 400]).unwrap();
        assert_eq!(steady.next(&bright, after.clone()), after);
    }

    #[test]
    fn a_thing_that_moves_brings_its_depth_at_once() {
        let picture =
            |at: u32| RgbImage::from_fn(20, 20, |x, _| image::Rgb(if x == at { [250; 3] } else { [10; 3] }));
        let depth = |at: usize| {
            Closeness::new([20, 20], (0..400).map(|i| if i % 20 == at { 0.9 } else { 0.1 }).collect())
                .unwrap()
        };
        let mut steady = Steady::default();
        let _ = steady.next(&picture(4), depth(4));
        let next = steady.next(&picture(9), depth(9));
        assert!(
            (next.values()[9] - 0.9).abs() < 0.05 && (next.values()[4] - 0.1).abs() < 0.05,
            "{:?}",
            &next.values()[..20]
        );
    }
}
