//! Pictures of `relief track experiment`: a plot of each run, and one of all means, as SVG and PNG.
//!
//! A run's plot has the errors over the commanded position on the left (lines are means of repeats,
//! small dots single errors), with the published mean error as a dashed line on either side of
//! zero; on the right are the mean errors of all methods on a logarithmic axis, where names, line
//! samples and numbers are the legend. Units are degrees and centimetres, as in the paper's table.

use std::collections::BTreeMap;
use std::path::Path;

use crate::axis::{number, ticks};
use crate::drawing::{Anchor, Color, Drawing, Pen};
use crate::output::write_whole;
use crate::track::outcome::ExperimentReport;
use relief_tracking::PlotPoint;

const INK: Color = [0x22, 0x22, 0x22];
const PALE: Color = [0x5a, 0x5a, 0x5a];
const GRID: Color = [0xdd, 0xdd, 0xdd];
const PUBLISHED: Pen = Pen { color: [0x8a, 0x2b, 0xa8], width: 2.0, dash: Some([7.0, 5.0]) };
/// In the order of the methods; distinguishable in grey. Wide lines lie below narrow ones that are
/// close to them.
const PENS: [Pen; 5] = [
    Pen::solid([0xd2, 0x3c, 0x3c], 5.0),
    Pen::solid([0xa8, 0x66, 0x00], 1.6),
    Pen { color: [0x3f, 0x7f, 0xbf], width: 1.4, dash: Some([2.0, 3.5]) },
    Pen::solid([0x12, 0x9b, 0x7e], 5.0),
    Pen::solid([0x1a, 0x1a, 0x1a], 1.4),
];

/// Heights of capitals.
const TITLE: f64 = 13.0;
const TEXT: f64 = 9.0;
const SMALL: f64 = 8.0;

/// Most single errors of a way that are shown beside their means: eight repeats.
const MOST_DOTS: usize = 8 * 21;

/// A rectangle of the drawing.
#[derive(Clone, Copy)]
struct Area {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

/// Writes `r-x.svg`, `r-x.png` and so on, and `overview.svg`, `overview.png`.
pub(crate) fn write(folder: &Path, report: &ExperimentReport) -> anyhow::Result<()> {
    let both = |name: &str, drawing: &Drawing| -> anyhow::Result<()> {
        write_whole(&folder.join(format!("{name}.svg")), drawing.svg().as_bytes())?;
        write_whole(&folder.join(format!("{name}.png")), &drawing.png()?)
    };
    for (at, run) in report.runs.iter().enumerate() {
        let (axis, _) = axis_and_unit(run);
        both(&axis.to_lowercase().replace(' ', "-"), &plot(report, at))?;
    }
    both("overview", &overview(report))
}

/// `R x (deg)` is the axis `R x` in `deg`.
fn axis_and_unit(run: &str) -> (&str, &str) {
    run.split_once(" (").map_or((run, ""), |(axis, unit)| (axis, unit.trim_end_matches(')')))
}

/// A description of the arm's movement.
fn deed(axis: &str) -> String {
    let (kind, letter) = axis.split_once(' ').unwrap_or(("", axis));
    let letter = letter.to_uppercase();
    if kind == "R" {
        format!("turn about the sensor's {letter}")
    } else {
        format!("shift along the beacon's {letter}")
    }
}

fn setting(report: &ExperimentReport) -> String {
    let ExperimentReport { distance_mm, noise_px, repeats, true_focal_px, calibrated_focal_px, .. } = report;
    format!(
        "simulated: {distance_mm:.0} mm before the beacon, {repeats} x 21 stops, noise {noise_px} px and whole pixels, f = {true_focal_px:.1} px, \
         calibrated {calibrated_focal_px:.1} px"
    )
}

fn plot(report: &ExperimentReport, run: usize) -> Drawing {
    let (axis, unit) = axis_and_unit(report.runs[run]);
    let title = format!("{axis}: {}", deed(axis));
    let mut drawing = Drawing::new([1240, 470], &title);
    drawing.text([24.0, 34.0], Anchor::Start, TITLE, INK, &title);
    drawing.text([24.0, 56.0], Anchor::Start, SMALL, PALE, &setting(report));
    errors(&mut drawing, report, run, Area { left: 76.0, right: 600.0, top: 104.0, bottom: 408.0 });
    drawing.text(
        [640.0, 88.0],
        Anchor::Start,
        TEXT,
        INK,
        &format!("mean error (standard deviation), {unit}"),
    );
    comparison(&mut drawing, report, run, Area { left: 640.0, right: 1220.0, top: 104.0, bottom: 330.0 });
    note(&mut drawing, [640.0, 384.0]);
    drawing.line(&[[640.0, 404.0], [670.0, 404.0]], PUBLISHED);
    let text = "on the left: the published mean error, to either side of zero";
    drawing.text([680.0, 408.0], Anchor::Start, SMALL, PALE, text);
    drawing
}

fn overview(report: &ExperimentReport) -> Drawing {
    const PANEL: f64 = 206.0;
    let title = "Robot-arm experiment: the published errors (2009) and ours";
    let mut drawing = Drawing::new([680, 1150], title);
    drawing.text([24.0, 34.0], Anchor::Start, TITLE, INK, title);
    // The line is longer than this drawing is wide.
    let setting = setting(report);
    let (first, second) = setting.split_once(", f = ").unwrap_or((&setting, ""));
    drawing.text([24.0, 56.0], Anchor::Start, SMALL, PALE, first);
    drawing.text([24.0, 74.0], Anchor::Start, SMALL, PALE, &format!("f = {second}"));
    for (at, run) in report.runs.iter().enumerate() {
        let (axis, unit) = axis_and_unit(run);
        let top = 104.0 + at as f64 * PANEL;
        drawing.text(
            [24.0, top],
            Anchor::Start,
            TEXT,
            INK,
            &format!("{axis}: {}; mean error (standard deviation), {unit}", deed(axis)),
        );
        comparison(
            &mut drawing,
            report,
            at,
            Area { left: 24.0, right: 656.0, top: top + 8.0, bottom: top + 158.0 },
        );
    }
    note(&mut drawing, [24.0, 1132.0]);
    drawing
}

fn note(drawing: &mut Drawing, [x, y]: [f64; 2]) {
    drawing.line(&[[x + 3.0, y - 11.0], [x + 3.0, y + 1.0]], Pen::solid(INK, 2.0));
    let text = "the run's Cramér-Rao bound on the rms error (a mean is about 0.8 of its rms)";
    drawing.text([x + 14.0, y], Anchor::Start, SMALL, PALE, text);
}

/// Errors over the commanded position.
fn errors(drawing: &mut Drawing, report: &ExperimentReport, run: usize, area: Area) {
    let (axis, unit) = axis_and_unit(report.runs[run]);
    let published = report.paper_mean[run];
    let points = || report.ways.iter().flat_map(|way| &way.outcomes[run].points);
    let reach = points().map(|point| point.truth.abs()).fold(1e-3, f64::max) * 1.04;
    let height = points().map(|point| point.error.abs()).fold(published, f64::max) * 1.12;
    let x = |value: f64| area.left + (value / reach + 1.0) / 2.0 * (area.right - area.left);
    let y = |value: f64| area.top + (1.0 - value / height) / 2.0 * (area.bottom - area.top);
    for (values, is_x) in [(ticks(-reach, reach, 8.0), true), (ticks(-height, height, 8.0), false)] {
        let step = values.get(1).map_or(1.0, |second| second - values[0]);
        for value in &values {
            let shown = if *value == 0.0 { "0".to_owned() } else { number(*value, step) };
            let pen = Pen::solid(if *value == 0.0 { PALE } else { GRID }, 1.0);
            if is_x {
                drawing.line(&[[x(*value), area.top], [x(*value), area.bottom]], pen);
                drawing.text([x(*value), area.bottom + 18.0], Anchor::Middle, SMALL, INK, &shown);
            } else {
                drawing.line(&[[area.left, y(*value)], [area.right, y(*value)]], pen);
                drawing.text([area.left - 8.0, y(*value) + 4.0], Anchor::End, SMALL, INK, &shown);
            }
        }
    }
    let middle = f64::midpoint(area.left, area.right);
    let commanded = format!("commanded {}, {unit}", deed(axis));
    drawing.text([middle, area.bottom + 42.0], Anchor::Middle, TEXT, INK, &commanded);
    let repeats = if report.repeats > 1 { "; lines are means of repeats, dots single stops" } else { "" };
    let heading = format!("error, {unit}{repeats}");
    drawing.text([area.left - 52.0, area.top - 16.0], Anchor::Start, TEXT, INK, &heading);
    for side in [published, -published] {
        drawing.line(&[[area.left, y(side)], [area.right, y(side)]], PUBLISHED);
    }
    let shown = |point: &PlotPoint| [x(point.truth), y(point.error)];
    for (way, pen) in report.ways.iter().zip(PENS) {
        let points = &way.outcomes[run].points;
        if report.repeats > 1 {
            points.iter().take(MOST_DOTS).for_each(|point| drawing.dot(shown(point), 1.0, pen.color));
        }
    }
    for (way, pen) in report.ways.iter().zip(PENS) {
        let line: Vec<_> = means_of_stops(&way.outcomes[run].points).iter().map(shown).collect();
        drawing.line(&line, pen);
        line.iter().for_each(|at| drawing.dot(*at, pen.width / 2.0 + 1.4, pen.color));
    }
}

/// The mean error of all repeats at each stop. The same stop is the same to a thousandth of a
/// degree or centimetre.
fn means_of_stops(points: &[PlotPoint]) -> Vec<PlotPoint> {
    let mut stops: BTreeMap<i64, Vec<PlotPoint>> = BTreeMap::new();
    for point in points {
        stops.entry((point.truth * 1e3).round() as i64).or_default().push(*point);
    }
    let mean = |of: fn(&PlotPoint) -> f64, points: &[PlotPoint]| {
        points.iter().map(of).sum::<f64>() / points.len() as f64
    };
    stops
        .values()
        .map(|stop| PlotPoint { truth: mean(|p| p.truth, stop), error: mean(|p| p.error, stop) })
        .collect()
}

/// Mean errors: a row for the published values and one for each method, with name, mean and
/// standard deviation.
fn comparison(drawing: &mut Drawing, report: &ExperimentReport, run: usize, area: Area) {
    let mut rows =
        vec![("published (2009)", report.paper_mean[run], report.paper_deviation[run], None, PUBLISHED)];
    for (way, pen) in report.ways.iter().zip(PENS) {
        let outcome = &way.outcomes[run];
        rows.push((way.way, outcome.mean, outcome.deviation, Some(outcome.bound), pen));
    }
    let (plot_left, plot_right) = (area.left + 226.0, area.right - 118.0);
    let values = || rows.iter().flat_map(|row| [Some(row.1), row.3]).flatten().filter(|value| *value > 0.0);
    let low = values().fold(f64::INFINITY, f64::min).log10().floor();
    let high = values().fold(0.0, f64::max).log10().ceil().max(low + 1.0);
    let x = |value: f64| {
        plot_left + (value.max(1e-12).log10() - low).max(0.0) / (high - low) * (plot_right - plot_left)
    };
    let height = (area.bottom - area.top) / rows.len() as f64;
    for decade in low as i32..=high as i32 {
        for part in 1..=9 {
            let value = f64::from(part) * 10_f64.powi(decade);
            if x(value) <= plot_right + 0.5 {
                let color = if part == 1 { [0xb5; 3] } else { [0xec; 3] };
                drawing.line(&[[x(value), area.top], [x(value), area.bottom]], Pen::solid(color, 1.0));
            }
        }
        let (value, below) = (10_f64.powi(decade), area.bottom + 16.0);
        drawing.text([x(value), below], Anchor::Middle, SMALL, INK, &number(value, value));
    }
    for (at, (name, mean, deviation, bound, pen)) in rows.into_iter().enumerate() {
        let middle = area.top + (at as f64 + 0.5) * height;
        drawing.line(&[[area.left, middle], [area.left + 30.0, middle]], pen);
        if bound.is_some() {
            drawing.dot([area.left + 15.0, middle], pen.width / 2.0 + 1.4, pen.color);
        }
        drawing.text([area.left + 40.0, middle + TEXT / 2.0], Anchor::Start, TEXT, INK, name);
        drawing.line(&[[plot_left, middle], [x(mean), middle]], Pen::solid(pen.color, 2.0));
        drawing.dot([x(mean), middle], 5.0, pen.color);
        if let Some(bound) = bound.filter(|bound| *bound > 0.0) {
            drawing.line(&[[x(bound), middle - 6.0], [x(bound), middle + 6.0]], Pen::solid(INK, 2.0));
        }
        let text = format!("{mean:.3} ({deviation:.3})");
        drawing.text([area.right, middle + TEXT / 2.0], Anchor::End, TEXT, INK, &text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_of_a_stop_are_averaged() {
        let point = |truth, error| PlotPoint { truth, error };
        let points = [point(-1.0, 1.0), point(2.0, 4.0), point(-1.0 + 1e-9, 3.0)];
        let means = means_of_stops(&points);
        assert_eq!(means.iter().map(|mean| mean.error).collect::<Vec<_>>(), [2.0, 4.0]);
        assert!((means[0].truth + 1.0).abs() < 1e-8 && means[1].truth == 2.0);
    }

    #[test]
    fn a_run_has_its_axis_unit_and_deed() {
        assert_eq!(axis_and_unit("T z (cm)"), ("T z", "cm"));
        assert_eq!([deed("R x"), deed("T z")], ["turn about the sensor's X", "shift along the beacon's Z"]);
    }
}
