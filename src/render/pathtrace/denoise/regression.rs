//! Weighted linear regression in square windows, and the mean of the fits of all windows.
//!
//! Sums over windows run along columns and rows, in f64: the time does not depend on the size of a
//! window. The picture is cut into bands of fixed height, so that rounding does not depend on threads.

use std::ops::Range;

use rayon::prelude::*;

use super::features::{FEATURES, Pixel, TARGETS};

/// Pixels from the middle of a window to its sides.
const RADIUS: usize = 6;
/// Rows of a band.
const BAND_ROWS: usize = 64;
/// Added to the variance of each feature: what varies less explains nothing.
const RIDGE: f64 = 1e-4;
/// Windows of less weight are empty.
const NO_WEIGHT: f64 = 1e-9;

/// Products of two features.
const SQUARES: usize = FEATURES * (FEATURES + 1) / 2;
// Sums over a window: its weight, then features, their products, targets, and features by targets.
const FEATURES_AT: usize = 1;
const SQUARES_AT: usize = FEATURES_AT + FEATURES;
const TARGETS_AT: usize = SQUARES_AT + SQUARES;
const CROSS_AT: usize = TARGETS_AT + TARGETS;
const MOMENTS: usize = CROSS_AT + FEATURES * TARGETS;
/// For each target its constant and its factors of the features; last, the weight of the window.
const FIT: usize = TARGETS * (1 + FEATURES) + 1;

/// Light of each pixel, by the even and by the odd passes, as fitted.
pub(super) fn fitted(pixels: &[Pixel], width: usize) -> Vec<[[f32; 3]; 2]> {
    let height = pixels.len() / width.max(1);
    let bands = height.div_ceil(BAND_ROWS);
    let of_band = |index: usize| {
        let rows = index * BAND_ROWS..((index + 1) * BAND_ROWS).min(height);
        // Fits of windows that reach into the band.
        let around = rows.start.saturating_sub(RADIUS)..(rows.end + RADIUS).min(height);
        let mut fits = vec![[0f32; FIT]; around.len() * width];
        let moments = |row: usize, column: usize| moments(&pixels[row * width + column]);
        each_window(around.clone(), 0..height, width, moments, |row, column, sums| {
            fits[(row - around.start) * width + column] = fit(sums);
        });
        let mut light = vec![[[0f32; 3]; 2]; rows.len() * width];
        let fit_at = |row: usize, column: usize| fits[(row - around.start) * width + column].map(f64::from);
        each_window(rows.clone(), around.clone(), width, fit_at, |row, column, sums| {
            light[(row - rows.start) * width + column] = predicted(&pixels[row * width + column], sums);
        });
        light
    };
    let bands: Vec<_> = (0..bands).into_par_iter().map(of_band).collect();
    bands.concat()
}

/// Calls `each` with the sum of `value` over the window around each pixel of `rows`. Windows end at the
/// edges of the picture, and at the ends of `available` rows.
fn each_window<const N: usize>(
    rows: Range<usize>,
    available: Range<usize>,
    width: usize,
    value: impl Fn(usize, usize) -> [f64; N],
    mut each: impl FnMut(usize, usize, &[f64; N]),
) {
    let mut columns = vec![[0f64; N]; width];
    let add_row = |columns: &mut [[f64; N]], row: usize, sign: f64| {
        for (column, sums) in columns.iter_mut().enumerate() {
            add(sums, &value(row, column), sign);
        }
    };
    let first = rows.start.saturating_sub(RADIUS).max(available.start);
    for row in first..(rows.start + RADIUS).min(available.end) {
        add_row(&mut columns, row, 1.0);
    }
    for row in rows {
        if row + RADIUS < available.end {
            add_row(&mut columns, row + RADIUS, 1.0);
        }
        let mut window = [0f64; N];
        columns.iter().take(RADIUS).for_each(|column| add(&mut window, column, 1.0));
        for column in 0..width {
            if let Some(entering) = columns.get(column + RADIUS) {
                add(&mut window, entering, 1.0);
            }
            each(row, column, &window);
            if let Some(leaving) = column.checked_sub(RADIUS) {
                add(&mut window, &columns[leaving], -1.0);
            }
        }
        if let Some(leaving) = row.checked_sub(RADIUS).filter(|row| *row >= available.start) {
            add_row(&mut columns, leaving, -1.0);
        }
    }
}

fn add<const N: usize>(sums: &mut [f64; N], values: &[f64; N], sign: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += sign * value);
}

/// The contribution of a pixel to the sums of a window.
fn moments(pixel: &Pixel) -> [f64; MOMENTS] {
    let mut moments = [0f64; MOMENTS];
    if pixel.coverage == 0.0 {
        return moments;
    }
    let weight = f64::from(pixel.coverage);
    let (features, targets) = (pixel.features.map(f64::from), pixel.targets.map(f64::from));
    moments[0] = weight;
    let mut square = SQUARES_AT;
    for (i, feature) in features.iter().enumerate() {
        let weighted = weight * feature;
        moments[FEATURES_AT + i] = weighted;
        for other in &features[..=i] {
            moments[square] = weighted * other;
            square += 1;
        }
        for (j, target) in targets.iter().enumerate() {
            moments[CROSS_AT + i * TARGETS + j] = weighted * target;
        }
    }
    for (j, target) in targets.iter().enumerate() {
        moments[TARGETS_AT + j] = weight * target;
    }
    moments
}

/// The regression of a window, times its weight.
fn fit(sums: &[f64; MOMENTS]) -> [f32; FIT] {
    let mut fit = [0f32; FIT];
    let weight = sums[0];
    if weight < NO_WEIGHT {
        return fit;
    }
    let feature = |i: usize| sums[FEATURES_AT + i] / weight;
    let target = |j: usize| sums[TARGETS_AT + j] / weight;
    let mut covariance = [[0f64; FEATURES]; FEATURES];
    let mut square = SQUARES_AT;
    for (i, row) in covariance.iter_mut().enumerate() {
        for (j, entry) in row[..=i].iter_mut().enumerate() {
            *entry = sums[square] / weight - feature(i) * feature(j);
            square += 1;
        }
        row[i] = row[i].max(0.0) + RIDGE;
    }
    let root = cholesky(covariance);
    for j in 0..TARGETS {
        let right: [f64; FEATURES] =
            std::array::from_fn(|i| sums[CROSS_AT + i * TARGETS + j] / weight - feature(i) * target(j));
        let factors = solved(&root, right);
        let explained: f64 = (0..FEATURES).map(|i| factors[i] * feature(i)).sum();
        let at = j * (1 + FEATURES);
        fit[at] = ((target(j) - explained) * weight) as f32;
        for (i, factor) in factors.iter().enumerate() {
            fit[at + 1 + i] = (factor * weight) as f32;
        }
    }
    fit[FIT - 1] = weight as f32;
    fit
}

/// Light of a pixel by the sum of the fits of the windows that hold it.
fn predicted(pixel: &Pixel, sums: &[f64; FIT]) -> [[f32; 3]; 2] {
    let weight = sums[FIT - 1];
    if weight < NO_WEIGHT || pixel.coverage == 0.0 {
        return [[0.0; 3]; 2];
    }
    let light = |j: usize| {
        let fit = &sums[j * (1 + FEATURES)..][..1 + FEATURES];
        let terms =
            fit[1..].iter().zip(&pixel.features).map(|(factor, feature)| factor * f64::from(*feature));
        let per_collision = (fit[0] + terms.sum::<f64>()) / weight;
        // A fit can be negative; light cannot.
        (per_collision.max(0.0) * f64::from(pixel.coverage)) as f32
    };
    [[light(0), light(1), light(2)], [light(3), light(4), light(5)]]
}

/// The lower triangle L of a positive definite matrix L Lᵀ, of which the lower triangle is read.
fn cholesky(mut matrix: [[f64; FEATURES]; FEATURES]) -> [[f64; FEATURES]; FEATURES] {
    for i in 0..FEATURES {
        for j in 0..=i {
            let products: f64 = (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum();
            let rest = matrix[i][j] - products;
            // Rounding must not make the root of a number below zero.
            matrix[i][j] = if i == j { rest.max(RIDGE * 1e-3).sqrt() } else { rest / matrix[j][j] };
        }
    }
    matrix
}

/// The solution x of L Lᵀ x = `right`.
fn solved(root: &[[f64; FEATURES]; FEATURES], right: [f64; FEATURES]) -> [f64; FEATURES] {
    let mut x = right;
    for i in 0..FEATURES {
        let products: f64 = (0..i).map(|k| root[i][k] * x[k]).sum();
        x[i] = (x[i] - products) / root[i][i];
    }
    for i in (0..FEATURES).rev() {
        let products: f64 = (i + 1..FEATURES).map(|k| root[k][i] * x[k]).sum();
        x[i] = (x[i] - products) / root[i][i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_hold_the_pixels_around_their_middle() {
        let (width, height) = (23, 40);
        let value = |row: usize, column: usize| [(row * 100 + column) as f64, 1.0];
        for rows in [0..height, 5..17, 38..40] {
            let mut count = 0;
            each_window(rows.clone(), 0..height, width, value, |row, column, sums| {
                let mut expected = [0.0; 2];
                for r in row.saturating_sub(RADIUS)..(row + RADIUS + 1).min(height) {
                    for c in column.saturating_sub(RADIUS)..(column + RADIUS + 1).min(width) {
                        add(&mut expected, &value(r, c), 1.0);
                    }
                }
                assert_eq!(*sums, expected, "{row}, {column}");
                count += 1;
            });
            assert_eq!(count, rows.len() * width);
        }
    }

    #[test]
    fn light_that_is_linear_in_its_guides_is_fitted_exactly() {
        let (width, height) = (50, 150);
        let pixel = |at: usize| {
            let (x, y) = ((at % width) as f32 / 10.0, (at / width) as f32 / 10.0);
            let mut pixel = Pixel { coverage: 0.5 + 0.5 * (x * y).sin().abs(), ..Pixel::default() };
            pixel.features = std::array::from_fn(|i| {
                (x * (1.0 + i as f32 * 0.3)).sin() + (y * (0.7 + i as f32 * 0.2)).cos()
            });
            pixel.targets =
                std::array::from_fn(|j| 3.0 + 0.4 * pixel.features[j] - 0.2 * pixel.features[j + 5]);
            pixel
        };
        let pixels: Vec<Pixel> = (0..width * height).map(pixel).collect();
        let found = fitted(&pixels, width);
        let apart = pixels.iter().zip(&found).flat_map(|(pixel, halves)| {
            (0..TARGETS).map(|j| (halves[j / 3][j % 3] - pixel.targets[j] * pixel.coverage).abs())
        });
        let worst = apart.fold(0f32, f32::max);
        // The ridge takes a little off each factor.
        assert!(worst < 5e-3, "{worst}");
    }
}
