//! Drawings of lines, dots and letters, written as SVG and as PNG that look the same.
//!
//! Letters are strokes of the project's own font, so no font has to be installed and every machine
//! draws the same. What it is not: a picture of a volume, or interactive. Lengths are units of the
//! drawing, x right, y down; a PNG has [`PIXELS_PER_UNIT`] pixels per unit.

use std::fmt::Write;

use anyhow::Context;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use tiny_skia::{LineCap, LineJoin, Paint, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

use relief_render::{CAPITAL, lettering};

/// For screens with small pixels, and for print.
const PIXELS_PER_UNIT: f32 = 2.0;

/// Red, green, blue.
pub(super) type Color = [u8; 3];

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pen {
    pub(super) color: Color,
    pub(super) width: f64,
    /// Lengths of a dash and of the gap after it.
    pub(super) dash: Option<[f64; 2]>,
}

impl Pen {
    pub(super) const fn solid(color: Color, width: f64) -> Self {
        Self { color, width, dash: None }
    }
}

/// Which part of a text lies at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Debug)]
struct StyledLines {
    /// Lines with round ends; one of a single point is a dot.
    lines: Vec<Vec<[f64; 2]>>,
    pen: Pen,
    /// Description for screen readers.
    label: Option<String>,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Drawing {
    size: [u16; 2],
    title: String,
    shapes: Vec<StyledLines>,
}

impl Drawing {
    pub(super) fn new(size: [u16; 2], title: &str) -> Self {
        Self { size, title: title.to_owned(), shapes: Vec::new() }
    }

    pub(super) fn line(&mut self, points: &[[f64; 2]], pen: Pen) {
        if !points.is_empty() {
            self.shapes.push(StyledLines { lines: vec![points.to_vec()], pen, label: None });
        }
    }

    pub(super) fn dot(&mut self, at: [f64; 2], radius: f64, color: Color) {
        self.line(&[at], Pen::solid(color, 2.0 * radius));
    }

    /// A line of text; `height` is that of its capitals, `at` lies on the baseline.
    pub(super) fn text(&mut self, at: [f64; 2], anchor: Anchor, height: f64, color: Color, text: &str) {
        let (segments, width) = lettering(text);
        let scale = height / CAPITAL;
        let left = match anchor {
            Anchor::Start => at[0],
            Anchor::Middle => at[0] - width * scale / 2.0,
            Anchor::End => at[0] - width * scale,
        };
        let place = |end: glam::DVec2| [left + end.x * scale, at[1] - end.y * scale];
        let mut lines: Vec<Vec<[f64; 2]>> = Vec::new();
        for [from, to] in segments.into_iter().map(|ends| ends.map(place)) {
            match lines.last_mut().filter(|line| line.last() == Some(&from)) {
                Some(line) => line.push(to),
                None => lines.push(vec![from, to]),
            }
        }
        let pen = Pen::solid(color, (height * 0.13).max(1.0));
        self.shapes.push(StyledLines { lines, pen, label: Some(text.to_owned()) });
    }

    /// The drawing as SVG.
    pub(super) fn svg(&self) -> String {
        let [width, height] = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" fill=\"none\" \
             stroke-linecap=\"round\" stroke-linejoin=\"round\">\n<title>{}</title>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n",
            escaped(&self.title)
        );
        for shape in &self.shapes {
            svg.push_str("<path");
            if let Some(label) = &shape.label {
                let _ = write!(svg, " aria-label=\"{}\"", escaped(label));
            }
            let Pen { color: [r, g, b], width, dash } = shape.pen;
            let _ = write!(svg, " stroke=\"#{r:02x}{g:02x}{b:02x}\" stroke-width=\"{width:.2}\"");
            if let Some([ink, gap]) = dash {
                let _ = write!(svg, " stroke-dasharray=\"{ink} {gap}\"");
            }
            svg.push_str(" d=\"");
            for line in &shape.lines {
                for (at, [x, y]) in line.iter().enumerate() {
                    let _ = write!(svg, "{}{x:.2} {y:.2}", if at == 0 { "M" } else { "L" });
                }
                if line.len() == 1 {
                    svg.push_str("h0"); // a dot is a line without length
                }
            }
            svg.push_str("\"/>\n");
        }
        svg + "</svg>\n"
    }

    /// The drawing as a PNG.
    pub(super) fn png(&self) -> anyhow::Result<Vec<u8>> {
        let size = self.size.map(|units| u32::from(units) * PIXELS_PER_UNIT as u32);
        let mut pixmap = Pixmap::new(size[0], size[1]).context("the drawing has no size")?;
        pixmap.fill(tiny_skia::Color::WHITE);
        let scale = Transform::from_scale(PIXELS_PER_UNIT, PIXELS_PER_UNIT);
        for shape in &self.shapes {
            let mut paint = Paint::default();
            let [r, g, b] = shape.pen.color;
            paint.set_color_rgba8(r, g, b, 255);
            let stroke = Stroke {
                width: shape.pen.width as f32,
                line_cap: LineCap::Round,
                line_join: LineJoin::Round,
                dash: shape
                    .pen
                    .dash
                    .and_then(|[ink, gap]| StrokeDash::new(vec![ink as f32, gap as f32], 0.0)),
                ..Stroke::default()
            };
            let mut path = PathBuilder::new();
            for line in &shape.lines {
                path_of(line, stroke.width, &mut path);
            }
            let Some(path) = path.finish() else { continue };
            pixmap.stroke_path(&path, &paint, &stroke, scale, None);
        }
        let opaque = pixmap.data().chunks_exact(4);
        let rgb: Vec<u8> = opaque.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        let mut file = Vec::new();
        PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::NoFilter)
            .write_image(&rgb, size[0], size[1], ExtendedColorType::Rgb8)
            .context("cannot encode a PNG")?;
        Ok(file)
    }
}

/// Adds a line to a path. A dot is a very short line: the ends are round.
fn path_of(line: &[[f64; 2]], width: f32, path: &mut PathBuilder) {
    for (at, [x, y]) in line.iter().map(|point| point.map(|c| c as f32)).enumerate() {
        if at == 0 {
            path.move_to(x, y);
        } else {
            path.line_to(x, y);
        }
        if line.len() == 1 || line == [line[0]; 2] {
            path.line_to(x + width * 1e-3, y);
        }
    }
}

/// Text as it stands between the tags of SVG and HTML, and in their attributes.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing() -> Drawing {
        let mut drawing = Drawing::new([40, 20], "A < B");
        drawing.line(&[[0.0, 10.0], [20.0, 10.0]], Pen::solid([255, 0, 0], 4.0));
        drawing.line(&[[0.0, 18.0], [40.0, 18.0]], Pen { color: [0; 3], width: 1.0, dash: Some([4.0, 6.0]) });
        drawing.dot([30.0, 10.0], 3.0, [0, 0, 255]);
        drawing.text([2.0, 7.0], Anchor::Start, 6.0, [0; 3], "i & \"j\"");
        drawing
    }

    /// The ink of a PNG lies where it was put, in its colour.
    #[test]
    fn a_png_has_its_ink_where_it_was_put() {
        let picture = image::load_from_memory(&drawing().png().unwrap()).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (80, 40));
        let at = |x: u32, y: u32| picture.get_pixel(2 * x, 2 * y).0;
        assert_eq!((at(10, 10), at(30, 10), at(39, 2)), ([255, 0, 0], [0, 0, 255], [255; 3]));
        assert_eq!((at(30, 8), at(30, 14)), ([0, 0, 255], [255; 3]), "the radius is 3");
        let dashed = (0..40).filter(|x| picture.get_pixel(2 * x, 36).0[0] < 128).count();
        assert!((14..26).contains(&dashed), "{dashed} of 40");
        let ink = picture.enumerate_pixels().filter(|(_, y, pixel)| *y < 14 && pixel.0[1] < 128).count();
        assert!((20..400).contains(&ink), "{ink} dark pixels of letters");
    }

    #[test]
    fn an_svg_says_its_texts_and_has_the_same_lines() {
        let svg = drawing().svg();
        assert!(svg.contains("<title>A &lt; B</title>"), "{svg}");
        assert!(svg.contains("aria-label=\"i &amp; &quot;j&quot;\""), "{svg}");
        assert!(
            svg.contains("stroke=\"#ff0000\" stroke-width=\"4.00\" d=\"M0.00 10.00L20.00 10.00\""),
            "{svg}"
        );
        assert!(svg.contains("M30.00 10.00h0") && svg.contains("stroke-dasharray=\"4 6\""), "{svg}");
    }
}
