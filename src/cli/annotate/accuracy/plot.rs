//! The errors of all ways: a dot each, their median and the bar of 1 mm.

use plotters::chart::ChartBuilder;
use plotters::coord::combinators::IntoLogRange;
use plotters::element::{Circle, PathElement};
use plotters::prelude::IntoDrawingArea;
use plotters::style::Color;
use plotters::style::text_anchor::HPos;

use crate::plot::{INK, Label, PlotError, SERIES, Sheet, TEXT, TITLE, WARN, axes, dashed, jitter, pen};
use relief_study::{AccuracyReport, WayReport};

const WIDTH: u32 = 1520;
const ROW: u32 = 58;

/// The ends of the axis, mm; it is logarithmic, for the ways differ by a hundred.
const RANGE_MM: [f64; 2] = [0.02, 30.0];
/// The accuracy that placing should reach, mm.
const BAR_MM: f64 = 1.0;

pub(super) fn draw(report: &AccuracyReport) -> Result<Sheet, PlotError> {
    let title = format!("Error of {} landmarks, placed from {:.0} mm", report.landmarks, report.distance_mm);
    let rows = report.ways.len();
    let sheet = Sheet::new([WIDTH, 220 + ROW * rows as u32], &title);
    let area = sheet.clone().into_drawing_area();
    Label::new(&title, TITLE, INK).draw(&area, [40, 44])?;
    let mut chart = ChartBuilder::on(&area)
        .margin_top(100)
        .margin_right(60)
        .margin_bottom(20)
        .y_label_area_size(460)
        .x_label_area_size(84)
        .build_cartesian_2d((RANGE_MM[0]..RANGE_MM[1]).log_scale(), rows as f64..0.0)?;
    axes(&mut chart, "error, mm", [8, 0])?;
    chart.draw_series([dashed(vec![(BAR_MM, 0.0), (BAR_MM, rows as f64)], [10, 10], pen(WARN, 2))])?;
    for (row, way) in report.ways.iter().enumerate() {
        let middle = row as f64 + 0.5;
        let (_, y) = chart.backend_coord(&(BAR_MM, middle));
        let name = format!("{}, {}, {}, {}", way.pointer, way.way, way.mapping, way.snap);
        Label::new(&name, TEXT, INK).anchored(HPos::Right).draw(&area, [444, y])?;
        chart.draw_series(dots(way, middle))?;
        if way.median_mm.is_finite() {
            let median = [-0.4, 0.4].map(|side| (way.median_mm, middle + side));
            chart.draw_series([PathElement::new(median, pen(WARN, 5))])?;
        }
    }
    drop(chart);
    Ok(sheet)
}

/// The errors of a way, apart from one another across its row.
fn dots(way: &WayReport, middle: f64) -> impl Iterator<Item = Circle<(f64, f64), i32>> {
    let color = SERIES[usize::from(way.way != "ray") * 2];
    let errors = way.errors_mm.iter().map(|error| error.clamp(RANGE_MM[0], RANGE_MM[1]));
    errors
        .enumerate()
        .map(move |(at, error)| Circle::new((error, middle + 0.55 * jitter(at)), 3, color.filled()))
}
