//! Plots as SVG inside an HTML page: real text, colours from the page's style sheet, marks with
//! tooltips.
//!
//! Unlike `cli::drawing` it makes no PNG and needs no font of its own: a browser draws it. Lengths
//! are CSS pixels.

use maud::{Markup, html};

use super::super::super::axis::{number, ticks};

/// Number of distinguishable marks and colours: the style sheet has `s0` to `s7`.
pub(super) const SERIES: usize = 8;

/// A drawing under construction.
pub(super) struct Svg {
    size: [f64; 2],
    elements: Vec<Markup>,
}

/// Where a text lies.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A rectangle with two axes.
#[derive(Clone, Copy)]
pub(super) struct Panel {
    /// Left, top, right, bottom.
    pub(super) area: [f64; 4],
    /// Least and greatest value from left to right.
    pub(super) x: [f64; 2],
    /// Least and greatest value from bottom to top.
    pub(super) y: [f64; 2],
}

impl Svg {
    pub(super) const fn new(size: [f64; 2]) -> Self {
        Self { size, elements: Vec::new() }
    }

    pub(super) fn line(&mut self, class: &str, points: &[[f64; 2]]) {
        self.elements.push(html! { polyline class=(class) points=(joined(points)) {} });
    }

    pub(super) fn polygon(&mut self, class: &str, points: &[[f64; 2]]) {
        self.elements.push(html! { polygon class=(class) points=(joined(points)) {} });
    }

    pub(super) fn rectangle(&mut self, class: &str, [left, top, right, bottom]: [f64; 4]) {
        let [left, top, width, height] =
            [left, top, (right - left).max(0.0), (bottom - top).max(0.0)].map(tenths);
        self.elements.push(html! { rect class=(class) x=(left) y=(top) width=(width) height=(height) {} });
    }

    /// A line of text; `[x, y]` lies on the baseline.
    pub(super) fn text(&mut self, class: &str, at: [f64; 2], anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let [x, y] = at.map(tenths);
        self.elements.push(html! { text class=(class) x=(x) y=(y) text-anchor=(anchor) { (text) } });
    }

    /// A mark of a series, with `title` as its tooltip. Series differ in shape and in colour.
    pub(super) fn mark(&mut self, series: usize, [x, y]: [f64; 2], title: &str) {
        let class = format!("mark s{}", series % SERIES);
        let path = match series % 4 {
            0 => format!("M{:.1} {y:.1}a3.6 3.6 0 1 0 7.2 0a3.6 3.6 0 1 0 -7.2 0z", x - 3.6),
            1 => format!("M{x:.1} {:.1}l4.3 7.4h-8.6z", y - 4.9),
            2 => format!("M{:.1} {:.1}h6.4v6.4h-6.4z", x - 3.2, y - 3.2),
            _ => format!("M{x:.1} {:.1}l4.5 4.5l-4.5 4.5l-4.5 -4.5z", y - 4.5),
        };
        self.elements.push(html! {
            path class=(class) d=(path) { @if !title.is_empty() { title { (title) } } }
        });
    }

    /// The background and both axes of a panel: grid, numbers, titles.
    pub(super) fn axes(&mut self, panel: &Panel, x_title: &str, y_title: &str) {
        let [left, top, right, bottom] = panel.area;
        self.rectangle("ground", panel.area);
        self.x_axis(panel, x_title);
        for (value, shown) in values(panel.y, bottom - top, 42.0) {
            let y = panel.place([0.0, value])[1];
            self.line(if value == 0.0 { "zero" } else { "grid" }, &[[left, y], [right, y]]);
            self.text("tick", [left - 7.0, y + 4.0], Anchor::End, &shown);
        }
        self.text("axis", [left, top - 8.0], Anchor::Start, y_title);
    }

    /// The axis below a panel.
    pub(super) fn x_axis(&mut self, panel: &Panel, title: &str) {
        let [left, top, right, bottom] = panel.area;
        for (value, shown) in values(panel.x, right - left, 62.0) {
            let x = panel.place([value, 0.0])[0];
            self.line(if value == 0.0 { "zero" } else { "grid" }, &[[x, top], [x, bottom]]);
            self.text("tick", [x, bottom + 16.0], Anchor::Middle, &shown);
        }
        self.text("axis", [f64::midpoint(left, right), bottom + 35.0], Anchor::Middle, title);
    }

    /// The element; `label` describes it to screen readers.
    pub(super) fn finish(self, label: &str) -> Markup {
        let [width, height] = self.size;
        html! {
            svg viewBox=(format!("0 0 {width:.0} {height:.0}")) style=(format!("max-width:{width:.0}px"))
                role="img" aria-label=(label) {
                @for element in &self.elements { (element) "\n" }
            }
        }
    }
}

/// Points of an outline, as SVG writes them.
fn joined(points: &[[f64; 2]]) -> String {
    let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    points.join(" ")
}

fn tenths(length: f64) -> String {
    format!("{length:.1}")
}

impl Panel {
    /// Where values lie; those beyond an axis on the panel's edge.
    pub(super) fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, right, bottom] = self.area;
        let share = |value: f64, [low, high]: [f64; 2]| ((value - low) / (high - low)).clamp(0.0, 1.0);
        [left + share(x, self.x) * (right - left), bottom - share(y, self.y) * (bottom - top)]
    }
}

/// Round values of an axis of this length, at least this far apart, as text.
fn values([first, last]: [f64; 2], length: f64, apart: f64) -> impl Iterator<Item = (f64, String)> {
    let values = ticks(first.min(last), first.max(last), (length / apart).max(2.0));
    let step = values.get(1).map_or(1.0, |second| second - values[0]);
    values
        .into_iter()
        .map(move |value| (value, if value == 0.0 { "0".to_owned() } else { minus(&number(value, step)) }))
}

/// Limits of an axis around values: with some room, and never of no length.
pub(super) fn around(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    if low > high {
        return [-1.0, 1.0];
    }
    let room = ((high - low) * 0.06).max(high.abs().max(low.abs()) * 1e-3).max(1e-3);
    [low - room, high + room]
}

/// Limits to either side of zero that hold the values.
pub(super) fn about_zero(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let most = values.fold(0.0, |most: f64, value| most.max(value.abs()));
    let most = (most * 1.1).max(1e-3);
    [-most, most]
}

/// A number with a real minus sign.
pub(super) fn minus(number: &str) -> String {
    number.replace('-', "\u{2212}")
}

/// A name that is not longer than this many letters.
pub(super) fn shortened(name: &str, most: usize) -> String {
    if name.chars().count() <= most {
        return name.to_owned();
    }
    name.chars().take(most - 1).chain(['\u{2026}']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_their_place_and_stay_in_the_panel() {
        let panel = Panel { area: [10.0, 20.0, 110.0, 70.0], x: [-1.0, 1.0], y: [0.0, 10.0] };
        assert_eq!(panel.place([0.0, 5.0]), [60.0, 45.0]);
        assert_eq!(panel.place([9.0, -9.0]), [110.0, 70.0]);
    }

    #[test]
    fn axes_have_a_length_whatever_the_values() {
        for values in [&[][..], &[0.0], &[-70.0, -70.0], &[1e-9, 2e-9], &[1.0, 3.0]] {
            let [low, high] = around(values.iter().copied());
            assert!(low < high && values.iter().all(|value| (low..=high).contains(value)), "{values:?}");
            let [low, high] = about_zero(values.iter().copied());
            assert!(low < high && values.iter().all(|value| (low..=high).contains(value)), "{values:?}");
            assert!((2..40).contains(&ticks(low, high, 4.0).len()), "{values:?}");
        }
    }

    #[test]
    fn names_are_escaped_and_shortened() {
        let mut svg = Svg::new([10.0, 10.0]);
        svg.text("tick", [0.0, 0.0], Anchor::Start, "<script>");
        svg.mark(1, [0.0, 0.0], "a & \"b\"");
        let svg = svg.finish("x < y").into_string();
        assert!(
            svg.contains("&lt;script&gt;") && svg.contains("<title>a &amp; &quot;b&quot;</title></path>"),
            "{svg}"
        );
        assert!(svg.contains("aria-label=\"x &lt; y\""), "{svg}");
        assert_eq!(shortened("glabella", 5), "glab\u{2026}");
    }
}
