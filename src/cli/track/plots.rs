//! Pictures of `relief track experiment`: a plot of each run, and one of all means, as SVG and PNG.
//!
//! A run's plot has the errors over the commanded position on the left (lines are means of repeats,
//! small dots single errors), with the published mean error as a dashed line on either side of
//! zero; on the right are the mean errors of all methods on a logarithmic axis, where names, line
//! samples and numbers are the legend. Units are degrees and centimetres, as in the paper's table.

use std::collections::BTreeMap;
use std::path::Path;

use plotters::chart::ChartBuilder;
use plotters::coord::combinators::IntoLogRange;
use plotters::coord::types::RangedCoordf64;
use plotters::element::{Circle, PathElement};
use plotters::prelude::{IntoDrawingArea, RGBColor};
use plotters::style::Color;
use plotters::style::text_anchor::HPos;

use crate::output::write_whole;
use crate::plot::{Area, Chart, INK, Label, PALE, PlotError, SMALL, Sheet, TEXT, TITLE, axes, dashed, pen};
use crate::track::outcome::ExperimentReport;
use relief_tracking::PlotPoint;

/// How the line of a method looks, dots.
#[derive(Clone, Copy)]
struct Pen {
    color: RGBColor,
    width: u32,
    /// Lengths of a dash and of the gap after it.
    dash: Option<[i32; 2]>,
}

impl Pen {
    const fn solid(color: RGBColor, width: u32) -> Self {
        Self { color, width, dash: None }
    }

    const fn dashed(color: RGBColor, width: u32, dash: [i32; 2]) -> Self {
        Self { color, width, dash: Some(dash) }
    }
}

const PUBLISHED: Pen = Pen::dashed(RGBColor(0x8a, 0x2b, 0xa8), 4, [14, 10]);
/// In the order of the methods; distinguishable in grey. Wide lines lie below narrow ones that are
/// close to them.
const PENS: [Pen; 5] = [
    Pen::solid(RGBColor(0xd2, 0x3c, 0x3c), 10),
    Pen::solid(RGBColor(0xa8, 0x66, 0x00), 3),
    Pen::dashed(RGBColor(0x3f, 0x7f, 0xbf), 3, [4, 7]),
    Pen::solid(RGBColor(0x12, 0x9b, 0x7e), 10),
    Pen::solid(RGBColor(0x1a, 0x1a, 0x1a), 3),
];

/// Most single errors of a method that are shown beside their means: eight repeats.
const MOST_DOTS: usize = 8 * 21;

/// Writes `r-x.svg`, `r-x.png` and so on, and `overview.svg`, `overview.png`.
pub(crate) fn write(folder: &Path, report: &ExperimentReport) -> anyhow::Result<()> {
    let both = |name: &str, sheet: &Sheet| -> anyhow::Result<()> {
        write_whole(&folder.join(format!("{name}.svg")), sheet.svg().as_bytes())?;
        write_whole(&folder.join(format!("{name}.png")), &sheet.png()?)
    };
    for (at, run) in report.runs.iter().enumerate() {
        let (axis, _) = axis_and_unit(run);
        both(&axis.to_lowercase().replace(' ', "-"), &plot(report, at)?)?;
    }
    both("overview", &overview(report)?)
}

/// `R x (deg)` is the axis `R x` in `deg`.
fn axis_and_unit(run: &str) -> (&str, &str) {
    run.split_once(" (").map_or((run, ""), |(axis, unit)| (axis, unit.trim_end_matches(')')))
}

/// A description of the arm's movement.
fn movement(axis: &str) -> String {
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

fn plot(report: &ExperimentReport, run: usize) -> Result<Sheet, PlotError> {
    let (axis, unit) = axis_and_unit(report.runs[run]);
    let title = format!("{axis}: {}", movement(axis));
    let sheet = Sheet::new([2480, 940], &title);
    let area = sheet.clone().into_drawing_area();
    Label::new(&title, TITLE, INK).draw(&area, [48, 56])?;
    Label::new(&setting(report), SMALL, PALE).draw(&area, [48, 104])?;
    let (left, right) = area.split_horizontally(1240);
    errors(&left, report, run)?;
    let heading = format!("mean error (standard deviation), {unit}");
    Label::new(&heading, TEXT, INK).draw(&right, [40, 168])?;
    comparison(&right.margin(200, 260, 40, 40), report, run)?;
    note(&right, [40, 760])?;
    sample(&right, [40, 808], PUBLISHED)?;
    let text = "on the left: the published mean error, to either side of zero";
    Label::new(text, SMALL, PALE).draw(&right, [120, 808])?;
    Ok(sheet)
}

fn overview(report: &ExperimentReport) -> Result<Sheet, PlotError> {
    const PANEL: i32 = 412;
    let title = "Robot-arm experiment: the published errors (2009) and ours";
    let height = 208 + PANEL * report.runs.len() as i32 + 32;
    let sheet = Sheet::new([1360, height as u32], title);
    let area = sheet.clone().into_drawing_area();
    Label::new(title, TITLE, INK).draw(&area, [48, 56])?;
    // The line is longer than this sheet is wide.
    let setting = setting(report);
    let (first, second) = setting.split_once(", f = ").unwrap_or((&setting, ""));
    Label::new(first, SMALL, PALE).draw(&area, [48, 104])?;
    Label::new(&format!("f = {second}"), SMALL, PALE).draw(&area, [48, 140])?;
    for (at, run) in report.runs.iter().enumerate() {
        let (axis, unit) = axis_and_unit(run);
        let top = 200 + at as i32 * PANEL;
        let heading = format!("{axis}: {}; mean error (standard deviation), {unit}", movement(axis));
        Label::new(&heading, TEXT, INK).draw(&area, [48, top])?;
        comparison(&area.margin(top + 20, height - top - 360, 48, 48), report, at)?;
    }
    note(&area, [48, height - 36])?;
    Ok(sheet)
}

fn note(area: &Area, [x, y]: [i32; 2]) -> Result<(), PlotError> {
    area.draw(&PathElement::new([(x + 6, y - 14), (x + 6, y + 14)], pen(INK, 4)))?;
    let text = "the run's Cramér-Rao bound on the rms error (a mean is about 0.8 of its rms)";
    Label::new(text, SMALL, PALE).draw(area, [x + 28, y])
}

/// A sample of a method's line, 60 dots long.
fn sample(area: &Area, [x, y]: [i32; 2], of: Pen) -> Result<(), PlotError> {
    let (style, ends) = (pen(of.color, of.width), [x, x + 60]);
    let Some([dash, gap]) = of.dash else {
        return area.draw(&PathElement::new(ends.map(|x| (x, y)), style));
    };
    let starts = (ends[0]..ends[1]).step_by((dash + gap) as usize);
    starts
        .map(|start| [(start, y), ((start + dash).min(ends[1]), y)])
        .try_for_each(|dash| area.draw(&PathElement::new(dash, style)))
}

/// Errors over the commanded position.
fn errors(area: &Area, report: &ExperimentReport, run: usize) -> Result<(), PlotError> {
    let (axis, unit) = axis_and_unit(report.runs[run]);
    let published = report.paper_mean[run];
    let points = || report.ways.iter().flat_map(|way| &way.outcomes[run].points);
    let reach = points().map(|point| point.truth.abs()).fold(1e-3, f64::max) * 1.04;
    let height = points().map(|point| point.error.abs()).fold(published, f64::max) * 1.12;
    let mut chart = ChartBuilder::on(area)
        .margin_top(208)
        .margin_right(40)
        .margin_bottom(30)
        .y_label_area_size(140)
        .x_label_area_size(90)
        .build_cartesian_2d(-reach..reach, -height..height)?;
    axes(&mut chart, &format!("commanded {}, {unit}", movement(axis)), [9, 9])?;
    let repeats = if report.repeats > 1 { "; lines are means of repeats, dots single stops" } else { "" };
    Label::new(&format!("error, {unit}{repeats}"), TEXT, INK).draw(area, [48, 168])?;
    chart.draw_series([PathElement::new([(-reach, 0.0), (reach, 0.0)], pen(PALE, 2))])?;
    for side in [published, -published] {
        draw_line(&mut chart, vec![(-reach, side), (reach, side)], PUBLISHED)?;
    }
    let place = |point: &PlotPoint| (point.truth, point.error);
    if report.repeats > 1 {
        for (way, of) in report.ways.iter().zip(PENS) {
            let single = way.outcomes[run].points.iter().take(MOST_DOTS);
            chart.draw_series(single.map(|point| Circle::new(place(point), 2, of.color.filled())))?;
        }
    }
    for (way, of) in report.ways.iter().zip(PENS) {
        let means: Vec<_> = means_of_stops(&way.outcomes[run].points).iter().map(place).collect();
        draw_line(&mut chart, means.clone(), of)?;
        let radius = of.width as i32 / 2 + 3;
        chart.draw_series(means.into_iter().map(|at| Circle::new(at, radius, of.color.filled())))?;
    }
    Ok(())
}

fn draw_line(
    chart: &mut Chart<'_, RangedCoordf64>,
    points: Vec<(f64, f64)>,
    of: Pen,
) -> Result<(), PlotError> {
    let style = pen(of.color, of.width);
    match of.dash {
        Some(dash) => chart.draw_series([dashed(points, dash, style)]).map(drop),
        None => chart.draw_series([PathElement::new(points, style)]).map(drop),
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

/// A row of the comparison of methods.
struct Row<'a> {
    name: &'a str,
    mean: f64,
    deviation: f64,
    /// The Cramér-Rao bound; the published values have none.
    bound: Option<f64>,
    pen: Pen,
}

/// Mean errors: a row for the published values and one for each method, with name, mean and
/// standard deviation.
fn comparison(area: &Area, report: &ExperimentReport, run: usize) -> Result<(), PlotError> {
    let (mean, deviation) = (report.paper_mean[run], report.paper_deviation[run]);
    let mut rows = vec![Row { name: "published (2009)", mean, deviation, bound: None, pen: PUBLISHED }];
    for (way, pen) in report.ways.iter().zip(PENS) {
        let outcome = &way.outcomes[run];
        let (mean, deviation) = (outcome.mean, outcome.deviation);
        rows.push(Row { name: way.way, mean, deviation, bound: Some(outcome.bound), pen });
    }
    let values = || rows.iter().flat_map(|row| [Some(row.mean), row.bound]).flatten().filter(|v| *v > 0.0);
    let low = 10_f64.powf(values().fold(f64::INFINITY, f64::min).log10().floor());
    let high = 10_f64.powf(values().fold(0.0, f64::max).log10().ceil()).max(low * 10.0);
    let mut chart = ChartBuilder::on(area)
        .y_label_area_size(452)
        .margin_right(236)
        .x_label_area_size(50)
        .build_cartesian_2d((low * 0.999..high * 1.001).log_scale(), rows.len() as f64..0.0)?;
    axes(&mut chart, "", [10, 0])?;
    let right = area.dim_in_pixel().0 as i32;
    for (at, Row { name, mean, deviation, bound, pen: of }) in rows.into_iter().enumerate() {
        let middle = at as f64 + 0.5;
        let y = chart.backend_coord(&(low, middle)).1 - area.get_base_pixel().1;
        sample(area, [0, y], of)?;
        if bound.is_some() {
            area.draw(&Circle::new((30, y), of.width as i32 / 2 + 3, of.color.filled()))?;
        }
        Label::new(name, TEXT, INK).draw(area, [80, y])?;
        chart.draw_series([PathElement::new([(low, middle), (mean, middle)], pen(of.color, 4))])?;
        chart.draw_series([Circle::new((mean, middle), 10, of.color.filled())])?;
        if let Some(bound) = bound.filter(|bound| *bound > 0.0) {
            let upright = [-0.25, 0.25].map(|side| (bound, middle + side));
            chart.draw_series([PathElement::new(upright, pen(INK, 4))])?;
        }
        let text = format!("{mean:.3} ({deviation:.3})");
        Label::new(&text, TEXT, INK).anchored(HPos::Right).draw(area, [right, y])?;
    }
    Ok(())
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
    fn a_run_names_its_axis_unit_and_movement() {
        assert_eq!(axis_and_unit("T z (cm)"), ("T z", "cm"));
        assert_eq!(
            [movement("R x"), movement("T z")],
            ["turn about the sensor's X", "shift along the beacon's Z"]
        );
    }
}
