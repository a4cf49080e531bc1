//! The plots of the report: errors by set and by landmark, errors from three sides, limits of
//! agreement.

use maud::Markup;

use super::svg::{Anchor, Panel, SERIES, Svg, about_zero, around, minus, shortened};
use relief_study::{Comparison, Ellipsoid, Landmark, Pairing};

const WIDTH: f64 = 1000.0;
/// Most rows of the plot by landmark: those with the greatest errors are shown.
const MOST_ROWS: usize = 60;

/// A landmark's name, with its list or patient where the name is ambiguous.
pub(super) fn label(several_cases: bool, case: usize, list: &str, name: &str) -> String {
    let list = if list.is_empty() { String::new() } else { format!(" ({list})") };
    if several_cases { format!("{case}: {name}{list}") } else { format!("{name}{list}") }
}

pub(super) fn label_of(comparison: &Comparison, landmark: &Landmark) -> String {
    label(comparison.cases > 1, landmark.case, &landmark.list, &landmark.name)
}

fn distances(comparison: &Comparison) -> impl Iterator<Item = f64> {
    comparison.landmarks.iter().flat_map(|l| &l.placed).flatten().filter_map(|placed| placed.distance_mm)
}

/// Lengths of the errors: a row for each set, with its median and 95th percentile.
pub(super) fn by_set(comparison: &Comparison) -> Markup {
    const ROW: f64 = 46.0;
    let sets = comparison.readings.len();
    let bottom = 16.0 + ROW * sets as f64;
    let mut svg = Svg::new([WIDTH, bottom + 46.0]);
    let reach = distances(comparison).fold(0.0, f64::max).max(1e-3) * 1.05;
    let panel = Panel { area: [170.0, 16.0, WIDTH - 20.0, bottom], x: [0.0, reach], y: [sets as f64, 0.0] };
    rows(&mut svg, &panel, sets);
    for (at, reading) in comparison.readings.iter().enumerate() {
        let middle = panel.place([0.0, at as f64 + 0.5])[1];
        svg.mark(at, [18.0, middle], "");
        svg.text("name", [32.0, middle + 4.0], Anchor::Start, &shortened(&reading.set, 19));
        if let Some(errors) = &comparison.errors[at].errors {
            for (value, class) in [(errors.median_mm, "median"), (errors.p95_mm, "p95")] {
                let x = panel.place([value, 0.0])[0];
                svg.line(class, &[[x, middle - 17.0], [x, middle + 17.0]]);
            }
        }
        for (row, landmark) in comparison.landmarks.iter().enumerate() {
            let Some(distance) = landmark.placed[at].and_then(|placed| placed.distance_mm) else { continue };
            // Spread over the row's height, the same way every time, so that equal errors do not
            // hide each other.
            let shift = (row as f64 * 0.618_034).fract() - 0.5;
            let place = [panel.place([distance, 0.0])[0], middle + 22.0 * shift];
            svg.mark(at, place, &format!("{}: {distance:.2} mm", label_of(comparison, landmark)));
        }
    }
    svg.finish("Lengths of the errors of each set, with median and 95th percentile")
}

/// Lengths of the errors: a row for each landmark. Of many, those with the greatest mean error;
/// says how many are left out.
pub(super) fn by_landmark(comparison: &Comparison) -> (Markup, usize) {
    const ROW: f64 = 20.0;
    let mut shown: Vec<&Landmark> = comparison.landmarks.iter().filter(|l| l.errors.is_some()).collect();
    let all = shown.len();
    if all > MOST_ROWS {
        let mean = |landmark: &Landmark| landmark.errors.map_or(0.0, |errors| errors.mean_mm);
        shown.sort_by(|a, b| mean(b).total_cmp(&mean(a)));
        shown.truncate(MOST_ROWS);
    }
    let bottom = 12.0 + ROW * shown.len() as f64;
    let mut svg = Svg::new([WIDTH, bottom + 46.0]);
    let reach = distances(comparison).fold(0.0, f64::max).max(1e-3) * 1.05;
    let panel =
        Panel { area: [230.0, 12.0, WIDTH - 20.0, bottom], x: [0.0, reach], y: [shown.len() as f64, 0.0] };
    rows(&mut svg, &panel, shown.len());
    for (row, landmark) in shown.iter().enumerate() {
        let middle = panel.place([0.0, row as f64 + 0.5])[1];
        let name = label_of(comparison, landmark);
        svg.text("name", [220.0, middle + 4.0], Anchor::End, &shortened(&name, 30));
        let placed: Vec<(usize, f64)> = landmark
            .placed
            .iter()
            .enumerate()
            .filter_map(|(at, placed)| Some((at, placed.as_ref()?.distance_mm?)))
            .collect();
        let [low, high] =
            placed.iter().fold([f64::INFINITY, 0.0], |[low, high], (_, d)| [d.min(low), d.max(high)]);
        svg.line("span", &[panel.place([low, row as f64 + 0.5]), panel.place([high, row as f64 + 0.5])]);
        for (at, distance) in placed {
            let title = format!("{}, {name}: {distance:.2} mm", comparison.readings[at].set);
            svg.mark(at, [panel.place([distance, 0.0])[0], middle], &title);
        }
    }
    (svg.finish("Lengths of the errors of each landmark"), all - shown.len())
}

/// Ground, stripes for rows, numbers below.
fn rows(svg: &mut Svg, panel: &Panel, count: usize) {
    let [left, _, right, _] = panel.area;
    svg.rectangle("ground", panel.area);
    for row in (0..count).step_by(2) {
        let [above, below] = [row, row + 1].map(|row| panel.place([0.0, row as f64])[1]);
        svg.rectangle("stripe", [left, above, right, below]);
    }
    svg.x_axis(panel, "error, mm");
}

/// Errors from above, from the front and from the left, with the ellipses that hold 95 % of them.
pub(super) fn from_three_sides(comparison: &Comparison) -> Markup {
    const SIDE: f64 = 262.0;
    const VIEWS: [([usize; 2], &str); 3] = [([0, 1], "axial"), ([0, 2], "coronal"), ([1, 2], "sagittal")];
    let errors = |at: usize| {
        comparison
            .landmarks
            .iter()
            .filter_map(move |landmark| Some((landmark, landmark.placed[at].as_ref()?.error_mm?)))
    };
    let all = || (0..comparison.readings.len()).flat_map(errors).flat_map(|(_, error)| error);
    // The ellipses of few errors are wide: they may leave the panel, the errors may not.
    let wide = comparison.errors.iter().filter_map(|of| of.ellipsoid).map(|e| e.semi_axes_mm[0]);
    let most = about_zero(all())[1];
    let reach = about_zero(wide.chain([most]).map(|size| size.min(most * 1.6)))[1];
    let mut svg = Svg::new([WIDTH, SIDE + 84.0]);
    for (view, (axes, title)) in VIEWS.into_iter().enumerate() {
        let left = 60.0 + view as f64 * 330.0;
        // As radiologists look: in the axial view P is down.
        let down = axes[1] == 1;
        let y = if down { [reach, -reach] } else { [-reach, reach] };
        let panel = Panel { area: [left, 36.0, left + SIDE, 36.0 + SIDE], x: [-reach, reach], y };
        let names = axes.map(|axis| ["L", "P", "S"][axis]);
        svg.axes(&panel, &format!("{} error, mm", names[0]), &format!("{} error, mm", names[1]));
        svg.text("caption", [left + SIDE, 28.0], Anchor::End, title);
        for at in 0..comparison.readings.len() {
            if let Some(ellipsoid) = &comparison.errors[at].ellipsoid {
                let outline: Vec<_> =
                    silhouette(ellipsoid, axes).into_iter().map(|p| panel.place(p)).collect();
                svg.polygon(&format!("ellipse s{}", at % SERIES), &outline);
            }
            for (landmark, error) in errors(at) {
                let title = format!("{}, {}", comparison.readings[at].set, label_of(comparison, landmark));
                svg.mark(at, panel.place(axes.map(|axis| error[axis])), &title);
            }
        }
        for at in 0..comparison.readings.len() {
            if let Some(errors) = &comparison.errors[at].errors {
                let [x, y] = panel.place(axes.map(|axis| errors.bias_mm[axis]));
                let class = format!("bias s{}", at % SERIES);
                svg.line(&class, &[[x - 9.0, y], [x + 9.0, y]]);
                svg.line(&class, &[[x, y - 9.0], [x, y + 9.0]]);
            }
        }
    }
    svg.finish("Errors along the patient's axes, from three sides")
}

/// The outline of an ellipsoid along two axes: that of the matrix `sum of (semi axis)^2 direction
/// direction^T` there.
fn silhouette(ellipsoid: &Ellipsoid, axes: [usize; 2]) -> Vec<[f64; 2]> {
    const CORNERS: usize = 72;
    let shape = |a: usize, b: usize| -> f64 {
        let of = |(axis, direction): (&f64, &[f64; 3])| axis * axis * direction[a] * direction[b];
        ellipsoid.semi_axes_mm.iter().zip(&ellipsoid.directions).map(of).sum()
    };
    let [x, y] = axes;
    // Cholesky: a circle under this triangle is the ellipse.
    let across = shape(x, x).max(0.0).sqrt();
    let slant = if across > 0.0 { shape(x, y) / across } else { 0.0 };
    let up = (shape(y, y) - slant * slant).max(0.0).sqrt();
    let center = axes.map(|axis| ellipsoid.center_mm[axis]);
    let corner = |at: usize| {
        let (sin, cos) = (at as f64 / CORNERS as f64 * std::f64::consts::TAU).sin_cos();
        [center[0] + across * cos, center[1] + slant * cos + up * sin]
    };
    (0..CORNERS).map(corner).collect()
}

/// Differences over means with bias and limits: a panel for each quantity of two sets.
pub(super) fn limits(pairings: &[&Pairing]) -> Markup {
    const HEIGHT: f64 = 210.0;
    let panels = pairings.len().max(1);
    let mut svg = Svg::new([WIDTH, HEIGHT + 84.0]);
    // One scale for coordinates, which are seen side by side.
    let one_unit = pairings.iter().all(|pairing| pairing.unit == pairings[0].unit);
    let scale = |of: &[&Pairing]| {
        let limits = of.iter().filter_map(|p| p.limits.known()).flat_map(|limits| limits.limits);
        about_zero(limits.chain(of.iter().flat_map(|p| p.points.iter().map(|point| point[1]))))
    };
    for (at, pairing) in pairings.iter().enumerate() {
        let left = 50.0 + at as f64 * 325.0;
        let y = if one_unit { scale(pairings) } else { scale(&[pairing]) };
        let x = around(pairing.points.iter().map(|point| point[0]));
        let right = if panels > 1 { left + 250.0 } else { left + 560.0 };
        let panel = Panel { area: [left, 36.0, right, 36.0 + HEIGHT], x, y };
        let Pairing { quantity, unit, .. } = pairing;
        svg.axes(&panel, &format!("mean {quantity}, {unit}"), &format!("{quantity} difference, {unit}"));
        if let Some(limits) = pairing.limits.known() {
            let band = |ci: [f64; 2]| {
                let [[left, bottom], [right, top]] =
                    [[x[0], ci[0]], [x[1], ci[1]]].map(|corner| panel.place(corner));
                [left, top, right, bottom]
            };
            svg.rectangle("limit-band", band(limits.lower_ci95));
            svg.rectangle("limit-band", band(limits.upper_ci95));
            svg.rectangle("bias-band", band(limits.bias_ci95));
            for (value, class) in
                [(limits.limits[0], "limit"), (limits.limits[1], "limit"), (limits.bias, "mean")]
            {
                svg.line(class, &[panel.place([x[0], value]), panel.place([x[1], value])]);
                let place = panel.place([x[1], value]);
                svg.text(
                    "value",
                    [place[0] + 4.0, place[1] + 4.0],
                    Anchor::Start,
                    &minus(&format!("{value:.2}")),
                );
            }
        }
        for point in &pairing.points {
            svg.mark(0, panel.place(*point), "");
        }
    }
    let [first, second] = [pairings.first().map(|p| &*p.first), pairings.first().map(|p| &*p.second)];
    svg.finish(&format!("{} less {}", first.unwrap_or_default(), second.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a ball the silhouette is a circle; of a turned ellipsoid its extent along an axis is the
    /// root of the matrix's entry.
    #[test]
    fn silhouettes_reach_as_far_as_the_ellipsoid() {
        let s = std::f64::consts::FRAC_1_SQRT_2;
        let turned = Ellipsoid {
            center_mm: [1.0, 2.0, 3.0],
            semi_axes_mm: [4.0, 2.0, 1.0],
            directions: [[s, 0.0, s], [-s, 0.0, s], [0.0, 1.0, 0.0]],
        };
        let outline = silhouette(&turned, [0, 2]);
        let most = |axis: usize| outline.iter().map(|point| point[axis]).fold(f64::MIN, f64::max);
        let expected = (0.5_f64 * (16.0 + 4.0)).sqrt();
        assert!((most(0) - 1.0 - expected).abs() < 0.01 && (most(1) - 3.0 - expected).abs() < 0.01);
        // Its long axis lies along the diagonal.
        let farthest = outline.iter().map(|p| (p[0] - 1.0).hypot(p[1] - 3.0)).fold(0.0, f64::max);
        assert!((farthest - 4.0).abs() < 0.01, "{farthest}");
        let ball = Ellipsoid { semi_axes_mm: [2.0; 3], ..turned };
        assert!(
            silhouette(&ball, [0, 1]).iter().all(|p| ((p[0] - 1.0).hypot(p[1] - 2.0) - 2.0).abs() < 1e-9)
        );
    }
}
