//! Quantiles of the F and t distributions, through the inverse of the incomplete beta function.

use statrs::function::beta::beta_reg;

/// Below these degrees of freedom a quantile overflows; above these it is constant.
const DEGREES: [f64; 2] = [0.01, 1e7];

/// The value that F with `over` and `under` degrees of freedom stays below with this probability.
/// Infinite where it overflows.
pub(super) fn f(probability: f64, over: f64, under: f64) -> f64 {
    let [over, under] = [over, under].map(|degrees: f64| degrees.clamp(DEGREES[0], DEGREES[1]));
    // F is a ratio of x and 1 - x, where x has the distribution beta(over/2, under/2). The search
    // is for the logarithm of their ratio, since either may be negligible beside the other.
    let share = |log_ratio: f64| 1.0 / (1.0 + (-log_ratio).exp());
    let below = |log_ratio: f64| {
        if log_ratio > 0.0 {
            1.0 - beta_reg(under / 2.0, over / 2.0, share(-log_ratio))
        } else {
            beta_reg(over / 2.0, under / 2.0, share(log_ratio))
        }
    };
    let (mut low, mut high) = (-700.0, 700.0);
    while high - low > 1e-13 * (1.0 + f64::abs(low)) {
        let middle = f64::midpoint(low, high);
        if middle <= low || middle >= high {
            break;
        }
        if below(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high).exp() * under / over
}

/// The two-sided 95 % quantile of Student's t with the given degrees of freedom.
pub(super) fn t_95(degrees: f64) -> f64 {
    f(0.95, 1.0, degrees).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of SciPy 1.17.1: `scipy.stats.f.ppf`, `scipy.stats.t.ppf(0.975, n)`.
    #[test]
    fn quantiles_are_those_of_scipy() {
        for (probability, over, under, expected) in [
            (0.975, 5.0, 4.785, 7.498_880_528_274_082),
            (0.975, 4.785, 5.0, 7.190_768_047_291_414),
            (0.975, 19.0, 39.7, 2.089_194_622_699_877),
            (0.975, 1.0, 1.0, 647.789_011_477_844_2),
            (0.975, 999.0, 3.2, 12.214_055_368_717_94),
            (0.975, 0.3, 12.0, 10.224_912_256_056_33),
            (0.025, 7.0, 9.0, 0.207_330_497_975_746),
            (0.975, 12.0, 0.05, 4.852_745_087_211_689e62),
            (0.95, 3.0, 17.0, 3.196_776_840_943_345),
            (0.95, 3.0, 1.0, 215.707_345_369_608_65),
            (0.975, 2.0, 1e6, 3.688_893_061_979_027_4),
        ] {
            let found = f(probability, over, under);
            assert!((found / expected - 1.0).abs() < 1e-10, "F({over}, {under}): {found}, SciPy {expected}");
        }
        for (degrees, expected) in [
            (1.0, 12.706_204_736_174_694),
            (2.0, 4.302_652_729_749_462),
            (19.0, 2.093_024_054_408_308_7),
            (1e5, 1.959_987_707_534_609_5),
        ] {
            assert!((t_95(degrees) / expected - 1.0).abs() < 1e-10, "t({degrees}): {}", t_95(degrees));
        }
    }

    #[test]
    fn no_degrees_of_freedom_give_nonsense() {
        for over in [1e-300, 0.01, 1.0, 1e4, f64::INFINITY] {
            for under in [1e-300, 0.01, 1.0, 1e4, f64::INFINITY] {
                let found = f(0.975, over, under);
                assert!(found >= 0.0, "F({over}, {under}) is {found}");
            }
        }
    }
}
