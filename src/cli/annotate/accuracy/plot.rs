//! The errors of all ways: a dot each, their median and the bar of 1 mm.

use crate::drawing::{Anchor, Color, Drawing, Pen};
use relief_study::AccuracyReport;

const SIZE: [u16; 2] = [760, 640];
const LEFT: f64 = 230.0;
const RIGHT: f64 = 730.0;
const TOP: f64 = 60.0;
const ROW: f64 = 29.0;
const INK: Color = [40, 40, 48];
const FAINT: Color = [205, 205, 212];
const MEDIAN: Color = [200, 60, 40];

/// The ends of the axis, mm; it is logarithmic, for the ways differ by a hundred.
const RANGE_MM: [f64; 2] = [0.02, 30.0];
const TICKS_MM: [f64; 6] = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0];

pub(super) fn draw(report: &AccuracyReport) -> Drawing {
    let title = format!("Error of {} landmarks, placed from {:.0} mm", report.landmarks, report.distance_mm);
    let mut drawing = Drawing::new(SIZE, &title);
    drawing.text([20.0, 30.0], Anchor::Start, 13.0, INK, &title);
    let bottom = TOP + ROW * report.ways.len() as f64;
    for mm in TICKS_MM {
        let pen = if mm == 1.0 {
            Pen { color: MEDIAN, width: 1.2, dash: Some([5.0, 5.0]) }
        } else {
            Pen::solid(FAINT, 1.0)
        };
        drawing.line(&[[x(mm), TOP - 8.0], [x(mm), bottom]], pen);
        drawing.text([x(mm), bottom + 20.0], Anchor::Middle, 9.0, INK, &format!("{mm}"));
    }
    drawing.text([f64::midpoint(LEFT, RIGHT), bottom + 42.0], Anchor::Middle, 9.0, INK, "mm");
    for (row, way) in report.ways.iter().enumerate() {
        let y = TOP + ROW * (row as f64 + 0.5);
        let color = if way.way == "ray" { [70, 120, 190] } else { [90, 150, 90] };
        let name = format!("{}, {}, {}", way.way, way.mapping, way.snap);
        drawing.text([LEFT - 12.0, y + 4.0], Anchor::End, 9.0, INK, &name);
        for (number, error) in way.errors_mm.iter().enumerate() {
            // Apart from one another, the same each time.
            let aside = (number as f64 * 0.618_034).fract() - 0.5;
            drawing.dot([x(*error), y + aside * ROW * 0.55], 1.3, color);
        }
        if way.median_mm.is_finite() {
            let at = x(way.median_mm);
            drawing.line(&[[at, y - ROW * 0.4], [at, y + ROW * 0.4]], Pen::solid(MEDIAN, 2.4));
        }
    }
    drawing
}

fn x(mm: f64) -> f64 {
    let [low, high] = RANGE_MM.map(f64::ln);
    LEFT + (RIGHT - LEFT) * ((mm.clamp(RANGE_MM[0], RANGE_MM[1]).ln() - low) / (high - low))
}
