//! ICC(2,1): how well single readers agree, of all the differences between the things that they
//! measured.
//!
//! Two-way random effects, absolute agreement, single rater: P. E. Shrout and J. L. Fleiss,
//! "Intraclass correlations: uses in assessing rater reliability", Psychological Bulletin 86, 1979,
//! ICC(2,1); K. O. McGraw and S. P. Wong, "Forming inferences about some intraclass correlation
//! coefficients", Psychological Methods 1, 1996, ICC(A,1), whose F method gives the interval.

use super::quantile;
use super::{Figure, Undefined};

/// An intraclass correlation with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Icc {
    /// The coefficient: 1 for readers who always agree, about 0 for readers whose values do not
    /// depend on the target.
    pub icc: f64,
    /// The ends of the interval.
    pub ci95: [f64; 2],
    /// The number of things that every rater measured.
    pub subjects: usize,
    /// The number of raters.
    pub raters: usize,
    /// Standard deviation of a single rater's values of one thing: `sqrt` of the raters' and the
    /// residual variance, in the values' unit.
    pub single_deviation: f64,
}

/// Mean squares of a two-way analysis of variance without repeats.
struct MeanSquares {
    rows: f64,
    columns: f64,
    residual: f64,
}

/// ICC(2,1) of values: one row for each subject, one column for each rater.
///
/// The interval uses Satterthwaite's degrees of freedom, and is `[1, 1]` where no rater ever
/// differs.
#[must_use]
pub fn icc_2_1(ratings: &[Vec<f64>]) -> Figure<Icc> {
    let subjects = ratings.len();
    let raters = ratings.iter().map(Vec::len).min().unwrap_or(0);
    if raters < 2 && subjects > 0 {
        return Figure::Unknown(Undefined::FewRaters { found: raters });
    }
    if subjects < 2 {
        return Figure::Unknown(Undefined::FewSubjects { found: subjects });
    }
    let MeanSquares { rows, columns, residual } = mean_squares(ratings, subjects, raters);
    let (n, k) = (subjects as f64, raters as f64);
    // Rounding leaves about 1e-16 of the largest value where there should be nothing.
    let largest = ratings.iter().flatten().fold(0.0, |most: f64, value| most.max(value.abs()));
    let nothing = (largest * 1e-12).powi(2);
    if rows + residual <= nothing {
        return Figure::Unknown(Undefined::NoSpread);
    }
    let found = |icc, ci95, variance: f64| {
        Figure::Known(Icc { icc, ci95, subjects, raters, single_deviation: variance.max(0.0).sqrt() })
    };
    if columns + residual <= nothing {
        return found(1.0, [1.0, 1.0], 0.0);
    }
    let icc = (rows - residual) / (rows + (k - 1.0) * residual + k * (columns - residual) / n);
    // McGraw and Wong's a and b, both times n (1 - icc): v does not change, and nothing is divided
    // by zero.
    let a = k * icc * columns;
    let b = (n + k * icc * (n - 1.0) - n * icc) * residual;
    let v = (a + b).powi(2) / (a * a / (k - 1.0) + b * b / ((n - 1.0) * (k - 1.0)));
    let low = rows / quantile::f(0.975, n - 1.0, v);
    let high = rows * quantile::f(0.975, v, n - 1.0);
    let bound = |rows: f64| n * (rows - residual) / (k * columns + (k * n - k - n) * residual + n * rows);
    // Infinite where few raters differ much: then the interval says nothing on that side.
    let high = if high.is_finite() { bound(high) } else { 1.0 };
    found(icc, [bound(low), high], residual + ((columns - residual) / n).max(0.0))
}

fn mean_squares(ratings: &[Vec<f64>], subjects: usize, raters: usize) -> MeanSquares {
    let (n, k) = (subjects as f64, raters as f64);
    let mean = |values: &mut dyn Iterator<Item = f64>, count: f64| values.sum::<f64>() / count;
    let of_rows: Vec<f64> = ratings.iter().map(|row| mean(&mut row[..raters].iter().copied(), k)).collect();
    let of_columns: Vec<f64> =
        (0..raters).map(|column| mean(&mut ratings.iter().map(|row| row[column]), n)).collect();
    let grand = mean(&mut of_rows.iter().copied(), n);
    let squares = |means: &[f64]| means.iter().map(|mean| (mean - grand).powi(2)).sum::<f64>();
    let residual = |row: usize, column: usize| {
        (ratings[row][column] - of_rows[row] - of_columns[column] + grand).powi(2)
    };
    let residuals: f64 = (0..subjects)
        .flat_map(|row| (0..raters).map(move |column| (row, column)))
        .map(|(r, c)| residual(r, c))
        .sum();
    MeanSquares {
        rows: squares(&of_rows) * k / (n - 1.0),
        columns: squares(&of_columns) * n / (k - 1.0),
        residual: residuals / ((n - 1.0) * (k - 1.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Normal;
    use super::*;

    fn known(rows: &[&[f64]]) -> Icc {
        let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.to_vec()).collect();
        match icc_2_1(&rows) {
            Figure::Known(icc) => icc,
            Figure::Unknown(why) => panic!("{why}"),
        }
    }

    fn unknown(rows: &[&[f64]]) -> Undefined {
        let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.to_vec()).collect();
        match icc_2_1(&rows) {
            Figure::Known(icc) => panic!("{icc:?}"),
            Figure::Unknown(why) => why,
        }
    }

    /// Six targets and four judges, table 2 of Shrout and Fleiss (1979), who give 0.29; the
    /// interval is theirs as well.
    #[test]
    fn the_example_of_shrout_and_fleiss_gives_their_coefficient() {
        let found = known(&[
            &[9.0, 2.0, 5.0, 8.0],
            &[6.0, 1.0, 3.0, 2.0],
            &[8.0, 4.0, 6.0, 8.0],
            &[7.0, 1.0, 2.0, 6.0],
            &[10.0, 5.0, 6.0, 9.0],
            &[6.0, 2.0, 4.0, 7.0],
        ]);
        assert!((found.icc - 0.289_764).abs() < 1e-6, "{found:?}");
        assert!((found.ci95[0] - 0.02).abs() < 0.005 && (found.ci95[1] - 0.76).abs() < 0.005, "{found:?}");
    }

    /// 20 subjects and 3 raters, published with the R package irr as `anxiety`: ICC(A,1) 0.198,
    /// interval -0.039 to 0.494.
    #[test]
    fn the_example_of_irr_gives_its_coefficient_and_interval() {
        const ANXIETY: [[u8; 3]; 20] = [
            [3, 3, 2],
            [3, 6, 1],
            [3, 4, 4],
            [4, 6, 4],
            [5, 2, 3],
            [5, 4, 2],
            [2, 2, 1],
            [3, 4, 6],
            [5, 3, 1],
            [2, 3, 1],
            [2, 2, 1],
            [6, 3, 2],
            [1, 3, 3],
            [5, 3, 3],
            [2, 2, 1],
            [2, 2, 1],
            [1, 1, 3],
            [2, 3, 3],
            [4, 3, 2],
            [3, 4, 2],
        ];
        let rows: Vec<Vec<f64>> = ANXIETY.iter().map(|row| row.map(f64::from).to_vec()).collect();
        let Figure::Known(found) = icc_2_1(&rows) else { panic!("no coefficient") };
        assert!((found.icc - 0.198).abs() < 5e-4, "{found:?}");
        assert!((found.ci95[0] + 0.039).abs() < 5e-4 && (found.ci95[1] - 0.494).abs() < 5e-4, "{found:?}");
    }

    /// Subjects, raters and residuals that are orthogonal have mean squares in closed form.
    #[test]
    fn orthogonal_effects_give_the_closed_form() {
        let (subject, rater, residual) = (10.0, 2.0, 0.5);
        let rows: Vec<Vec<f64>> = (0..4)
            .map(|i| {
                let [s, e] = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]][i];
                vec![s * subject + rater + e * residual, s * subject - rater - e * residual]
            })
            .collect();
        let Figure::Known(found) = icc_2_1(&rows) else { panic!("no coefficient") };
        // Sums of squares 8 subject^2, 8 rater^2, 8 residual^2, with 3, 1 and 3 degrees of freedom.
        let (msr, msc, mse) =
            (8.0 * subject * subject / 3.0, 8.0 * rater * rater, 8.0 * residual * residual / 3.0);
        let expected = (msr - mse) / (msr + mse + 2.0 * (msc - mse) / 4.0);
        assert!((found.icc - expected).abs() < 1e-12, "{found:?}, closed form {expected}");
        let single = (mse + (msc - mse) / 4.0).sqrt();
        assert!((found.single_deviation - single).abs() < 1e-12, "{found:?}, closed form {single}");
    }

    /// Readers of known variance: the coefficient is the subjects' share of the variance, and 95 of
    /// 100 intervals hold it.
    #[test]
    fn simulated_readers_have_the_coefficient_they_were_made_with() {
        let (subject, rater, residual): (f64, f64, f64) = (3.0, 1.0, 1.5);
        let truth = subject.powi(2) / (subject.powi(2) + rater.powi(2) + residual.powi(2));
        let mut normal = Normal::new(7);
        let (mut sum, mut inside) = (0.0, 0);
        const STUDIES: usize = 600;
        for _ in 0..STUDIES {
            let raters: Vec<f64> = (0..8).map(|_| rater * normal.next()).collect();
            let rows: Vec<Vec<f64>> = (0..25)
                .map(|_| {
                    let subject = subject * normal.next();
                    raters.iter().map(|rater| subject + rater + residual * normal.next()).collect()
                })
                .collect();
            let Figure::Known(found) = icc_2_1(&rows) else { panic!("no coefficient") };
            sum += found.icc;
            inside += usize::from((found.ci95[0]..=found.ci95[1]).contains(&truth));
        }
        let (mean, share) = (sum / STUDIES as f64, inside as f64 / STUDIES as f64);
        assert!((mean - truth).abs() < 0.02, "mean {mean}, truth {truth}");
        assert!((0.925..0.98).contains(&share), "{share} of the intervals hold the truth");
    }

    #[test]
    fn missing_coefficients_give_a_reason() {
        assert_eq!(unknown(&[]), Undefined::FewSubjects { found: 0 });
        assert_eq!(unknown(&[&[1.0, 2.0]]), Undefined::FewSubjects { found: 1 });
        assert_eq!(unknown(&[&[1.0], &[2.0]]), Undefined::FewRaters { found: 1 });
        assert_eq!(unknown(&[&[0.1; 3], &[0.1; 3], &[0.1; 3]]), Undefined::NoSpread);
        assert_eq!(
            unknown(&[&[0.1, 7.3], &[0.1, 7.3], &[0.1, 7.3]]),
            Undefined::NoSpread,
            "raters alone differ"
        );
        let perfect = known(&[&[0.1, 0.1, 0.1], &[0.7, 0.7, 0.7], &[123.4, 123.4, 123.4]]);
        assert_eq!((perfect.icc, perfect.ci95, perfect.single_deviation), (1.0, [1.0, 1.0], 0.0));
    }

    /// Invariant: Statistics of readers are numbers or reasons, never NaN.
    ///
    /// Against chance and against each other: negative coefficients, and no interval that is no
    /// number.
    #[test]
    fn every_interval_is_numbers_in_order() {
        let mut normal = Normal::new(3);
        for study in 0..500 {
            let (n, k) = (2 + study % 5, 2 + study % 3);
            let scale = [1e-6, 1.0, 1e5][study % 3];
            let rows: Vec<Vec<f64>> =
                (0..n).map(|_| (0..k).map(|_| scale * normal.next()).collect()).collect();
            let Figure::Known(Icc { icc, ci95: [low, high], .. }) = icc_2_1(&rows) else {
                panic!("{rows:?}")
            };
            assert!(low <= icc && icc <= high && high <= 1.0, "{low} {icc} {high}: {rows:?}");
        }
        let opposed = known(&[&[1.0, -1.0], &[-1.0, 1.0], &[0.5, -0.5]]);
        assert!(opposed.icc < -0.5 && opposed.ci95.iter().all(|bound| bound.is_finite()), "{opposed:?}");
    }
}
