//! Plots of reports: charts by plotters on a [`Sheet`], written as SVG, as PNG and into HTML pages.
//!
//! Plotters scales axes, finds round values and lays charts out. The sheet is its drawing backend.
//! What it is not: a picture of a volume, or interactive. Lengths are dots: two for a CSS pixel, and
//! one for a pixel of a PNG.

mod png;
mod sheet;
mod svg;

use std::convert::Infallible;

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{DashedPathElement, Rectangle};
use plotters::prelude::{Cartesian2d, IntoFont, RGBColor, ShapeStyle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, TextStyle};

pub(crate) use sheet::{Mark, Sheet};

/// A part of a sheet, in dots from its top left corner.
pub(crate) type Area = DrawingArea<Sheet, Shift>;
/// A chart without a plotters' type for each axis.
pub(crate) type Chart<'a, X, Y = RangedCoordf64> = ChartContext<'a, Sheet, Cartesian2d<X, Y>>;
/// Why a plot could not be drawn: a chart that does not fit on its sheet.
pub(crate) type PlotError = DrawingAreaErrorKind<Infallible>;

/// The colours of plots on white paper. The style sheet of a page replaces them by its own.
pub(crate) const INK: RGBColor = RGBColor(0x1c, 0x25, 0x30);
pub(crate) const PALE: RGBColor = RGBColor(0x5b, 0x68, 0x75);
pub(crate) const RULE: RGBColor = RGBColor(0xdf, 0xe4, 0xea);
pub(crate) const STRIPE: RGBColor = RGBColor(0xf3, 0xf5, 0xf8);
pub(crate) const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);
pub(crate) const WARN: RGBColor = RGBColor(0x9a, 0x4b, 0x00);
/// Colours of series, distinguishable with a colour vision deficiency by the shapes of their marks.
pub(crate) const SERIES: [RGBColor; 8] = [
    RGBColor(0x0b, 0x62, 0xa8),
    RGBColor(0xc8, 0x50, 0x1a),
    RGBColor(0x0b, 0x8a, 0x68),
    RGBColor(0xa0, 0x3c, 0x8f),
    RGBColor(0x8a, 0x6d, 0x00),
    RGBColor(0x3d, 0x8f, 0xd1),
    RGBColor(0x6b, 0x4f, 0xc4),
    RGBColor(0x50, 0x60, 0x6f),
];

/// Sizes of letters, dots.
pub(crate) const TITLE: f64 = 36.0;
pub(crate) const TEXT: f64 = 24.0;
pub(crate) const SMALL: f64 = 22.0;

/// A line of text and its style.
#[derive(Clone, Copy)]
pub(crate) struct Label<'a> {
    pub(crate) text: &'a str,
    pub(crate) size: f64,
    pub(crate) color: RGBColor,
    /// The end of the text that lies at its place.
    pub(crate) anchor: HPos,
    pub(crate) bold: bool,
}

impl<'a> Label<'a> {
    /// A label that begins at its place.
    pub(crate) const fn new(text: &'a str, size: f64, color: RGBColor) -> Self {
        Self { text, size, color, anchor: HPos::Left, bold: false }
    }

    pub(crate) const fn anchored(self, anchor: HPos) -> Self {
        Self { anchor, ..self }
    }

    /// Draws the text, its middle at this height.
    pub(crate) fn draw(self, area: &Area, [x, y]: [i32; 2]) -> Result<(), PlotError> {
        let style = style(self.size, self.color, self.anchor, VPos::Center);
        let font = if self.bold { FontStyle::Bold } else { FontStyle::Normal };
        let style = TextStyle { font: style.font.style(font), ..style };
        area.draw(&Text::new(self.text, (x, y), style))
    }
}

fn style(size: f64, color: RGBColor, horizontal: HPos, vertical: VPos) -> TextStyle<'static> {
    let (font, color) = (("sans-serif", size).into_font(), color.to_backend_color());
    TextStyle { font, color, pos: Pos::new(horizontal, vertical) }
}

/// A line of this width, dots.
pub(crate) fn pen(color: RGBColor, width: u32) -> ShapeStyle {
    color.stroke_width(width)
}

/// A dashed line through points of a chart; lengths of dashes and gaps in dots.
pub(crate) fn dashed(
    points: Vec<(f64, f64)>,
    [dash, gap]: [i32; 2],
    style: ShapeStyle,
) -> DashedPathElement<std::vec::IntoIter<(f64, f64)>, i32> {
    DashedPathElement::new(points, dash, gap, style)
}

/// Grid, round values and the title of the axis below a chart, and beside it if it has a place for
/// values. `count` is the number of values that fit along each axis.
pub(crate) fn axes<X, Y>(chart: &mut Chart<'_, X, Y>, title: &str, count: [usize; 2]) -> Result<(), PlotError>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let number = |value: &f64| number(*value);
    let mut mesh = chart.configure_mesh();
    if count[1] == 0 {
        mesh.disable_y_mesh().disable_y_axis();
    }
    mesh.x_labels(count[0])
        .y_labels(count[1])
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .label_style(style(SMALL, PALE, HPos::Left, VPos::Top))
        .axis_desc_style(style(TEXT, PALE, HPos::Left, VPos::Top))
        .x_desc(title)
        .axis_style(RULE)
        .bold_line_style(RULE)
        .light_line_style(RULE.mix(0.0))
        .max_light_lines(1)
        .set_all_tick_mark_size(6)
        .draw()
}

/// Stripes behind every second row of a chart whose rows are one high.
pub(crate) fn stripes<X>(chart: &mut Chart<'_, X>, count: usize) -> Result<(), PlotError>
where
    X: Ranged<ValueType = f64>,
{
    let across = chart.x_range();
    let stripe = |row: usize| {
        Rectangle::new([(across.start, row as f64), (across.end, row as f64 + 1.0)], STRIPE.filled())
    };
    chart.draw_series((0..count).step_by(2).map(stripe)).map(drop)
}

/// A value of an axis, without digits that come from rounding.
fn number(value: f64) -> String {
    minus(&((value * 1e6).round() / 1e6 + 0.0).to_string())
}

/// A number with a typographic minus sign.
pub(crate) fn minus(number: &str) -> String {
    number.replace('-', "\u{2212}")
}

/// A shift in [-0.5, 0.5) for each number, always the same: equal values do not hide each other.
pub(crate) fn jitter(number: usize) -> f64 {
    (number as f64 * 0.618_034).fract() - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_axes_are_short() {
        assert_eq!(
            [0.1 + 0.2, -0.5, -0.0, 1e-12, 4.0].map(number),
            ["0.3", "\u{2212}0.5", "0", "0", "4"].map(str::to_owned)
        );
    }
}
