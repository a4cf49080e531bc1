//! The plots of the report: errors by set and by landmark, errors from three sides, limits of
//! agreement.

use maud::Markup;
use plotters::chart::ChartBuilder;
use plotters::coord::types::RangedCoordf64;
use plotters::element::{EmptyElement, PathElement, Polygon, Rectangle};
use plotters::prelude::IntoDrawingArea;
use plotters::style::Color;
use plotters::style::text_anchor::HPos;

use crate::plot::{
    Area, Chart, INK, Label, Mark, PALE, PlotError, SERIES, SMALL, Sheet, TEXT, WARN, axes, dashed, jitter,
    minus, pen, stripes,
};
use relief_study::{BlandAltman, Comparison, Ellipsoid, Landmark, Pairing};

/// Width of a plot, dots.
const WIDTH: u32 = 2000;
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

/// The mark of a set, for the legend.
pub(super) fn key(set: usize, name: &str) -> Markup {
    let sheet = Sheet::new([28, 28], name);
    sheet.mark(set, [14.0, 14.0], "");
    sheet.element()
}

/// The greatest error and some room, mm.
fn reach(comparison: &Comparison) -> f64 {
    let placed = comparison.landmarks.iter().flat_map(|landmark| &landmark.placed).flatten();
    placed.filter_map(|placed| placed.distance_mm).fold(0.0, f64::max).max(1e-3) * 1.05
}

/// A chart of errors whose rows have names beside them.
struct Rows {
    sheet: Sheet,
    area: Area,
    chart: Chart<'static, RangedCoordf64>,
}

impl Rows {
    /// Heights and widths are dots.
    fn new(title: &str, count: usize, height: u32, names: u32, reach: f64) -> Result<Self, PlotError> {
        let sheet = Sheet::new([WIDTH, 110 + height * count as u32], title);
        let area = sheet.clone().into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin_top(20)
            .margin_right(40)
            .y_label_area_size(names)
            .x_label_area_size(90)
            .build_cartesian_2d(0.0..reach, count as f64..0.0)?;
        stripes(&mut chart, count)?;
        axes(&mut chart, "error, mm", [16, 0])?;
        Ok(Self { sheet, area, chart })
    }

    /// The height of a row's middle on the sheet, dots.
    fn middle(&self, row: usize) -> i32 {
        self.chart.backend_coord(&(0.0, row as f64 + 0.5)).1
    }
}

/// Lengths of the errors: a row for each set, with its median and 95th percentile.
pub(super) fn by_set(comparison: &Comparison) -> Result<Markup, PlotError> {
    let title = "Lengths of the errors of each set, with median and 95th percentile";
    let mut rows = Rows::new(title, comparison.readings.len(), 92, 340, reach(comparison))?;
    for (at, reading) in comparison.readings.iter().enumerate() {
        let (middle, y) = (at as f64 + 0.5, rows.middle(at));
        rows.sheet.mark(at, [36.0, f64::from(y)], "");
        Label::new(&shortened(&reading.set, 19), TEXT, INK).draw(&rows.area, [64, y])?;
        if let Some(errors) = &comparison.errors[at].errors {
            let upright = |value: f64| [-0.37, 0.37].map(|side| (value, middle + side)).to_vec();
            rows.chart.draw_series([PathElement::new(upright(errors.median_mm), pen(INK, 5))])?;
            rows.chart.draw_series([dashed(upright(errors.p95_mm), [6, 6], pen(INK, 3))])?;
        }
        rows.chart.draw_series(comparison.landmarks.iter().enumerate().filter_map(|(row, landmark)| {
            let distance = landmark.placed[at]?.distance_mm?;
            let title = format!("{}: {distance:.2} mm", label_of(comparison, landmark));
            Some(Mark { at: (distance, middle + 0.48 * jitter(row)), series: at, title })
        }))?;
    }
    Ok(rows.sheet.element())
}

/// Lengths of the errors: a row for each landmark. Of many, those with the greatest mean error;
/// returns the number of those left out.
pub(super) fn by_landmark(comparison: &Comparison) -> Result<(Markup, usize), PlotError> {
    let mut shown: Vec<&Landmark> = comparison.landmarks.iter().filter(|l| l.errors.is_some()).collect();
    let all = shown.len();
    if all > MOST_ROWS {
        let mean = |landmark: &Landmark| landmark.errors.map_or(0.0, |errors| errors.mean_mm);
        shown.sort_by(|a, b| mean(b).total_cmp(&mean(a)));
        shown.truncate(MOST_ROWS);
    }
    let title = "Lengths of the errors of each landmark";
    let mut rows = Rows::new(title, shown.len(), 40, 460, reach(comparison))?;
    for (row, landmark) in shown.iter().enumerate() {
        let middle = row as f64 + 0.5;
        let name = label_of(comparison, landmark);
        let label = shortened(&name, 30);
        Label::new(&label, TEXT, INK).anchored(HPos::Right).draw(&rows.area, [440, rows.middle(row)])?;
        let marks: Vec<Mark> = landmark
            .placed
            .iter()
            .enumerate()
            .filter_map(|(at, placed)| {
                let distance = placed.as_ref()?.distance_mm?;
                let title = format!("{}, {name}: {distance:.2} mm", comparison.readings[at].set);
                Some(Mark { at: (distance, middle), series: at, title })
            })
            .collect();
        let (low, high) = marks
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(low, high), mark| (mark.at.0.min(low), mark.at.0.max(high)));
        if low <= high {
            let span = PathElement::new([(low, middle), (high, middle)], PALE.mix(0.6).stroke_width(2));
            rows.chart.draw_series([span])?;
        }
        rows.chart.draw_series(marks)?;
    }
    Ok((rows.sheet.element(), all - shown.len()))
}

/// A square or wide chart with both axes, its title on the right above it.
fn panel(
    area: &Area,
    [x, y]: [[f64; 2]; 2],
    [across, up]: [&str; 2],
    title: &str,
) -> Result<Chart<'static, RangedCoordf64>, PlotError> {
    const LEFT: i32 = 100;
    const RIGHT: i32 = 110;
    let mut chart = ChartBuilder::on(area)
        .margin_top(72)
        .margin_right(RIGHT)
        .y_label_area_size(LEFT)
        .x_label_area_size(90)
        .build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
    axes(&mut chart, across, [6, 7])?;
    Label::new(up, TEXT, PALE).draw(area, [LEFT, 48])?;
    let right = area.dim_in_pixel().0 as i32 - RIGHT;
    Label { bold: true, ..Label::new(title, TEXT, INK).anchored(HPos::Right) }.draw(area, [right, 48])?;
    Ok(chart)
}

/// Errors from above, from the front and from the left, with the ellipses that hold 95 % of them.
pub(super) fn from_three_sides(comparison: &Comparison) -> Result<Markup, PlotError> {
    const VIEWS: [([usize; 2], &str); 3] = [([0, 1], "axial"), ([0, 2], "coronal"), ([1, 2], "sagittal")];
    let errors = |at: usize| {
        comparison
            .landmarks
            .iter()
            .filter_map(move |landmark| Some((landmark, landmark.placed[at].as_ref()?.error_mm?)))
    };
    let all = (0..comparison.readings.len()).flat_map(errors).flat_map(|(_, error)| error);
    // The ellipses of few errors are wide: they may leave the panel, the errors may not.
    let wide = comparison.errors.iter().filter_map(|of| of.ellipsoid).map(|e| e.semi_axes_mm[0]);
    let most = about_zero(all)[1];
    let reach = about_zero(wide.chain([most]).map(|size| size.min(most * 1.6)))[1];
    let sheet = Sheet::new([WIDTH, 620], "Errors along the patient's axes, from three sides");
    let areas = sheet.clone().into_drawing_area().split_evenly((1, VIEWS.len()));
    for (area, (directions, title)) in areas.iter().zip(VIEWS) {
        // As radiologists look: in the axial view P is down.
        let y = if directions[1] == 1 { [reach, -reach] } else { [-reach, reach] };
        let names = directions.map(|axis| format!("{} error, mm", ["L", "P", "S"][axis]));
        let mut chart = panel(area, [[-reach, reach], y], [&names[0], &names[1]], title)?;
        for at in 0..comparison.readings.len() {
            let color = SERIES[at % SERIES.len()];
            if let Some(ellipsoid) = &comparison.errors[at].ellipsoid {
                let mut outline = silhouette(ellipsoid, directions);
                chart.draw_series([Polygon::new(outline.clone(), color.mix(0.06))])?;
                outline.push(outline[0]);
                chart.draw_series([PathElement::new(outline, pen(color, 4))])?;
            }
            chart.draw_series(errors(at).map(|(landmark, error)| Mark {
                at: (error[directions[0]], error[directions[1]]),
                series: at,
                title: format!("{}, {}", comparison.readings[at].set, label_of(comparison, landmark)),
            }))?;
        }
        let biases = comparison.errors.iter().enumerate().filter_map(|(at, of)| Some((at, of.errors?)));
        chart.draw_series(biases.map(|(at, errors)| {
            let [x, y] = directions.map(|axis| errors.bias_mm[axis]);
            let style = pen(SERIES[at % SERIES.len()], 6);
            EmptyElement::at((x, y))
                + PathElement::new([(-18, 0), (18, 0)], style)
                + PathElement::new([(0, -18), (0, 18)], style)
        }))?;
    }
    Ok(sheet.element())
}

/// The outline of an ellipsoid along two axes: that of the matrix `sum of (semi axis)^2 direction
/// direction^T` there.
fn silhouette(ellipsoid: &Ellipsoid, axes: [usize; 2]) -> Vec<(f64, f64)> {
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
        (center[0] + across * cos, center[1] + slant * cos + up * sin)
    };
    (0..CORNERS).map(corner).collect()
}

/// Differences over means with bias and limits: a panel for each quantity of two sets.
pub(super) fn limits(pairings: &[&Pairing]) -> Result<Markup, PlotError> {
    let [first, second] = [pairings.first().map(|p| &*p.first), pairings.first().map(|p| &*p.second)];
    let title = format!("{} less {}", first.unwrap_or_default(), second.unwrap_or_default());
    let sheet = Sheet::new([WIDTH, 580], &title);
    let areas = sheet.clone().into_drawing_area().split_evenly((1, 3));
    // One scale for coordinates, which are seen side by side.
    let one_unit = pairings.iter().all(|pairing| pairing.unit == pairings[0].unit);
    let scale = |of: &[&Pairing]| {
        let limits = of.iter().filter_map(|p| p.limits.known()).flat_map(|limits| limits.limits);
        about_zero(limits.chain(of.iter().flat_map(|p| p.points.iter().map(|point| point[1]))))
    };
    for (area, pairing) in areas.iter().zip(pairings) {
        let y = if one_unit { scale(pairings) } else { scale(&[pairing]) };
        let x = around(pairing.points.iter().map(|point| point[0]));
        let Pairing { quantity, unit, .. } = pairing;
        let [across, up] = [format!("mean {quantity}, {unit}"), format!("{quantity} difference, {unit}")];
        let mut chart = panel(area, [x, y], [&across, &up], "")?;
        if let Some(limits) = pairing.limits.known() {
            draw_limits(&mut chart, limits, x)?;
            for value in [limits.limits[0], limits.limits[1], limits.bias] {
                let (right, height) = chart.backend_coord(&(x[1], value));
                let (left, top) = area.get_base_pixel();
                let text = minus(&format!("{value:.2}"));
                Label::new(&text, SMALL, PALE).draw(area, [right - left + 10, height - top])?;
            }
        }
        chart.draw_series(pairing.points.iter().map(|point| Mark {
            at: (point[0], point[1]),
            series: 0,
            title: String::new(),
        }))?;
    }
    Ok(sheet.element())
}

/// Bias and limits of agreement with the bands of their confidence, from one side to the other.
fn draw_limits(
    chart: &mut Chart<'_, RangedCoordf64>,
    of: &BlandAltman,
    [left, right]: [f64; 2],
) -> Result<(), PlotError> {
    let bands = [(of.lower_ci95, WARN), (of.upper_ci95, WARN), (of.bias_ci95, SERIES[0])];
    chart.draw_series(bands.map(|([low, high], color)| {
        Rectangle::new([(left, low), (right, high)], color.mix(0.14).filled())
    }))?;
    let across = |value: f64| vec![(left, value), (right, value)];
    chart.draw_series(of.limits.map(|limit| dashed(across(limit), [12, 8], pen(WARN, 3))))?;
    chart.draw_series([PathElement::new(across(of.bias), pen(INK, 4))])?;
    Ok(())
}

/// Limits of an axis around values: with some room, and never of no length.
fn around(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    if low > high {
        return [-1.0, 1.0];
    }
    let room = ((high - low) * 0.06).max(high.abs().max(low.abs()) * 1e-3).max(1e-3);
    [low - room, high + room]
}

/// Limits to either side of zero that hold the values.
fn about_zero(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let most = values.fold(0.0, |most: f64, value| most.max(value.abs()));
    let most = (most * 1.1).max(1e-3);
    [-most, most]
}

/// A name that is not longer than this many letters.
fn shortened(name: &str, most: usize) -> String {
    if name.chars().count() <= most {
        return name.to_owned();
    }
    name.chars().take(most - 1).chain(['\u{2026}']).collect()
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
        let expected = (0.5_f64 * (16.0 + 4.0)).sqrt();
        let right = outline.iter().map(|point| point.0).fold(f64::MIN, f64::max);
        let top = outline.iter().map(|point| point.1).fold(f64::MIN, f64::max);
        assert!((right - 1.0 - expected).abs() < 0.01 && (top - 3.0 - expected).abs() < 0.01);
        // Its long axis lies along the diagonal.
        let farthest = outline.iter().map(|p| (p.0 - 1.0).hypot(p.1 - 3.0)).fold(0.0, f64::max);
        assert!((farthest - 4.0).abs() < 0.01, "{farthest}");
        let ball = Ellipsoid { semi_axes_mm: [2.0; 3], ..turned };
        assert!(silhouette(&ball, [0, 1]).iter().all(|p| ((p.0 - 1.0).hypot(p.1 - 2.0) - 2.0).abs() < 1e-9));
    }

    #[test]
    fn axes_have_a_length_whatever_the_values() {
        for values in [&[][..], &[0.0], &[-70.0, -70.0], &[1e-9, 2e-9], &[1.0, 3.0]] {
            for [low, high] in [around(values.iter().copied()), about_zero(values.iter().copied())] {
                assert!(low < high && values.iter().all(|v| (low..=high).contains(v)), "{values:?}");
            }
        }
        assert_eq!(shortened("glabella", 5), "glab\u{2026}");
    }
}
