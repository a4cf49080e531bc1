//! A sheet as SVG: a file of its own, or an element of an HTML page.

use maud::{Markup, html};

use super::sheet::{Anchor, Paint, Shape, Sheet, Stroke};

/// Dots in a CSS pixel.
const DOTS_PER_PX: u32 = 2;

impl Sheet {
    /// The sheet as an SVG file on white paper.
    pub(crate) fn svg(&self) -> String {
        let [width, height] = self.size();
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox=(self.view())
                width=(width / DOTS_PER_PX) height=(height / DOTS_PER_PX)
                font-family="system-ui, Roboto, 'Noto Sans', 'Liberation Sans', sans-serif" role="img" {
                title { (self.title) }
                rect width=(width) height=(height) fill="#ffffff" {}
                "\n"
                (self.elements())
            }
        }
        .into_string()
    }

    /// The sheet as an element of a page, as wide as its place and at most as wide as the sheet.
    pub(crate) fn element(&self) -> Markup {
        let width = self.size()[0] / DOTS_PER_PX;
        html! {
            svg viewBox=(self.view()) style=(format!("max-width:{width}px")) role="img" aria-label=(self.title) {
                (self.elements())
            }
        }
    }

    fn view(&self) -> String {
        let [width, height] = self.size();
        format!("0 0 {width} {height}")
    }

    fn elements(&self) -> Markup {
        html! { @for shape in self.shapes() { (element(&shape)) "\n" } }
    }
}

/// The value of `fill` or `stroke`.
fn color(paint: Option<Paint>) -> String {
    paint.map_or_else(|| "none".to_owned(), |Paint { rgb: [r, g, b], .. }| format!("#{r:02x}{g:02x}{b:02x}"))
}

/// The value of an opacity, nothing for an opaque colour.
fn opacity(paint: Option<Paint>) -> Option<String> {
    paint.filter(|paint| paint.opacity < 1.0).map(|paint| format!("{:.2}", paint.opacity))
}

fn element(shape: &Shape) -> Markup {
    let width = |stroke: &Option<Stroke>| stroke.map(|stroke| stroke.width);
    let ink = |stroke: &Option<Stroke>| stroke.map(|stroke| stroke.paint);
    match shape {
        Shape::Path { points, fill, stroke, title } => html! {
            path fill=(color(*fill)) fill-opacity=[opacity(*fill)] stroke=(color(ink(stroke)))
                stroke-opacity=[opacity(ink(stroke))] stroke-width=[width(stroke)] d=(outline(points)) {
                @if !title.is_empty() { title { (title) } }
            }
        },
        Shape::Disc { center: [x, y], radius, fill, stroke, title } => html! {
            circle cx=(x) cy=(y) r=(radius) fill=(color(*fill)) fill-opacity=[opacity(*fill)]
                stroke=(color(ink(stroke))) stroke-width=[width(stroke)] {
                @if !title.is_empty() { title { (title) } }
            }
        },
        Shape::Text { at: [x, y], anchor, size, bold, paint, text } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            html! {
                text x=(x) y=(format!("{y:.1}")) font-size=(size) text-anchor=(anchor) fill=(color(Some(*paint)))
                    font-weight=[bold.then_some("600")] { (text) }
            }
        }
    }
}

fn outline(points: &[[f64; 2]]) -> String {
    let (ends, last) = (points.len().saturating_sub(1), points.last());
    let closed = ends > 1 && points.first() == last;
    let mut path = String::new();
    for (at, [x, y]) in points[..if closed { ends } else { points.len() }].iter().enumerate() {
        path.push_str(&format!("{}{x} {y}", if at == 0 { "M" } else { "L" }));
    }
    if closed {
        path.push('Z');
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_and_outlines_close() {
        let sheet = Sheet::new([10, 10], "x < y");
        sheet.mark(1, [50.0, 50.0], "a & \"b\"");
        let svg = sheet.svg();
        assert!(svg.contains("<title>x &lt; y</title>"), "{svg}");
        assert!(svg.contains("<title>a &amp; &quot;b&quot;</title></path>"), "{svg}");
        assert!(sheet.element().into_string().contains("aria-label=\"x &lt; y\""));
        assert_eq!(outline(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.5], [0.0, 0.0]]), "M0 0L1 0L1 1.5Z");
        assert_eq!(outline(&[[0.0, 0.0], [1.0, 0.0]]), "M0 0L1 0");
    }
}
