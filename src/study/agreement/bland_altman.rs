//! Bland and Altman's limits of agreement of two ways to measure the same things.
//!
//! J. M. Bland and D. G. Altman, "Measuring agreement in method comparison studies", Statistical
//! Methods in Medical Research 8, 1999: bias and standard deviation of the differences, limits at
//! 1.96 standard deviations, and approximate confidence intervals from the limits' standard error s
//! sqrt(1/n + 1.96² / (2 (n - 1))).

use super::quantile::t_95;
use super::{Figure, Undefined};

/// How two ways differ, in the values' unit. Intervals are of 95 % confidence.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct BlandAltman {
    /// The number of things that both measured.
    pub count: usize,
    /// Mean of the first less the second.
    pub bias: f64,
    /// The bias's interval.
    pub bias_ci95: [f64; 2],
    /// Standard deviation of the differences.
    pub deviation: f64,
    /// Between these lie 95 % of the differences, if they are normal.
    pub limits: [f64; 2],
    /// The lower limit's interval.
    pub lower_ci95: [f64; 2],
    /// The upper limit's interval.
    pub upper_ci95: [f64; 2],
}

/// Compares pairs of values: the first method's and the second's.
#[must_use]
pub fn bland_altman(pairs: &[[f64; 2]]) -> Figure<BlandAltman> {
    const WIDTH: f64 = 1.96;
    let count = pairs.len();
    if count < 2 {
        return Figure::Unknown(Undefined::FewPairs { found: count });
    }
    let n = count as f64;
    let differences = || pairs.iter().map(|[a, b]| a - b);
    let bias = differences().sum::<f64>() / n;
    let deviation = (differences().map(|d| (d - bias).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let t = t_95(n - 1.0);
    let around = |middle: f64, half: f64| [middle - half, middle + half];
    let limits = around(bias, WIDTH * deviation);
    let of_limit = t * deviation * (1.0 / n + WIDTH * WIDTH / (2.0 * (n - 1.0))).sqrt();
    Figure::Known(BlandAltman {
        count,
        bias,
        bias_ci95: around(bias, t * deviation / n.sqrt()),
        deviation,
        limits,
        lower_ci95: around(limits[0], of_limit),
        upper_ci95: around(limits[1], of_limit),
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::Normal;
    use super::*;

    fn known(pairs: &[[f64; 2]]) -> BlandAltman {
        match bland_altman(pairs) {
            Figure::Known(found) => found,
            Figure::Unknown(why) => panic!("{why}"),
        }
    }

    /// Peak expiratory flow of 17 people by the large and the mini Wright meter, table 1 of Bland
    /// and Altman's paper in the Lancet of 1986, who give -2.1 l/min with a standard deviation of
    /// 38.8, limits -79.7 and 75.5 (with 2 standard deviations, from these rounded), and the bias's
    /// interval from -22.0 to 17.8.
    #[test]
    fn the_flow_meters_of_1986_give_the_published_figures() {
        const FLOW: [[f64; 2]; 17] = [
            [494.0, 512.0],
            [395.0, 430.0],
            [516.0, 520.0],
            [434.0, 428.0],
            [476.0, 500.0],
            [557.0, 600.0],
            [413.0, 364.0],
            [442.0, 380.0],
            [650.0, 658.0],
            [433.0, 445.0],
            [417.0, 432.0],
            [656.0, 626.0],
            [267.0, 260.0],
            [478.0, 477.0],
            [178.0, 259.0],
            [423.0, 350.0],
            [427.0, 451.0],
        ];
        let found = known(&FLOW);
        assert!((found.bias + 2.1).abs() < 0.05 && (found.deviation - 38.8).abs() < 0.05, "{found:?}");
        assert!(
            (found.bias_ci95[0] + 22.0).abs() < 0.1 && (found.bias_ci95[1] - 17.8).abs() < 0.1,
            "{found:?}"
        );
        let two = [found.bias - 2.0 * found.deviation, found.bias + 2.0 * found.deviation];
        assert!((two[0] + 79.7).abs() < 0.15 && (two[1] - 75.5).abs() < 0.15, "{two:?}");
        assert!((found.limits[1] - found.bias - 1.96 * found.deviation).abs() < 1e-12, "{found:?}");
    }

    /// 95 of 100 intervals hold the bias that the readers were made with, and about as many the
    /// limit.
    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say() {
        let mut normal = Normal::new(11);
        let mut inside = [0; 2];
        const STUDIES: usize = 2000;
        for _ in 0..STUDIES {
            let pairs: Vec<[f64; 2]> = (0..20)
                .map(|_| {
                    let truth = 30.0 * normal.next();
                    [truth + 0.7 + 0.6 * normal.next(), truth + 0.8 * normal.next()]
                })
                .collect();
            let found = known(&pairs);
            let holds = |[low, high]: [f64; 2], value: f64| usize::from((low..=high).contains(&value));
            inside[0] += holds(found.bias_ci95, 0.7);
            inside[1] += holds(found.upper_ci95, 0.7 + 1.96); // the differences' deviation is 1
        }
        let shares = inside.map(|count| count as f64 / STUDIES as f64);
        assert!((0.935..0.965).contains(&shares[0]) && (0.925..0.97).contains(&shares[1]), "{shares:?}");
    }

    #[test]
    fn equal_pairs_have_no_width_and_one_pair_no_limits() {
        let equal = known(&[[1.5, 1.0], [7.5, 7.0], [0.5, 0.0]]);
        assert_eq!((equal.bias, equal.deviation, equal.limits), (0.5, 0.0, [0.5, 0.5]));
        for few in [&[][..], &[[1.0, 2.0]]] {
            assert_eq!(bland_altman(few), Figure::Unknown(Undefined::FewPairs { found: few.len() }));
        }
    }
}
