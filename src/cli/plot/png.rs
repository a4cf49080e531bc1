//! A sheet as a PNG, a pixel for each dot.
//!
//! Letters are strokes of the font of Relief's pictures: no font has to be installed, and every
//! machine draws the same.

use anyhow::Context;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use relief_render::{CAPITAL, lettering};
use tiny_skia::{FillRule, LineCap, LineJoin, PathBuilder, Pixmap, Transform};

use super::sheet::{Anchor, CAPITALS, Paint, Shape, Sheet, Stroke};

impl Sheet {
    /// The sheet as a PNG file on white paper.
    ///
    /// # Errors
    /// If the sheet has no area.
    pub(crate) fn png(&self) -> anyhow::Result<Vec<u8>> {
        let [width, height] = self.size();
        let mut pixels = Pixmap::new(width, height).context("the plot has no area")?;
        pixels.fill(tiny_skia::Color::WHITE);
        for shape in self.shapes() {
            draw(&mut pixels, &shape);
        }
        let opaque = pixels.data().chunks_exact(4);
        let rgb: Vec<u8> = opaque.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        let mut file = Vec::new();
        PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::NoFilter)
            .write_image(&rgb, width, height, ExtendedColorType::Rgb8)
            .context("cannot encode a PNG")?;
        Ok(file)
    }
}

fn draw(pixels: &mut Pixmap, shape: &Shape) {
    let mut path = PathBuilder::new();
    let (fill, stroke) = match shape {
        Shape::Path { points, fill, stroke, .. } => {
            polyline(&mut path, points);
            (*fill, *stroke)
        }
        Shape::Disc { center: [x, y], radius, fill, stroke, .. } => {
            path.push_circle(*x as f32, *y as f32, *radius as f32);
            (*fill, *stroke)
        }
        Shape::Text { at, anchor, size, bold, paint, text } => {
            letters(&mut path, *at, *anchor, CAPITALS * size, text);
            let weight = if *bold { 0.14 } else { 0.095 };
            (None, Some(Stroke { paint: *paint, width: (size * weight).max(2.0) }))
        }
    };
    let Some(path) = path.finish() else { return };
    if let Some(fill) = fill {
        pixels.fill_path(&path, &ink(fill), FillRule::Winding, Transform::identity(), None);
    }
    if let Some(Stroke { paint, width }) = stroke {
        let stroke = tiny_skia::Stroke {
            width: width as f32,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..tiny_skia::Stroke::default()
        };
        pixels.stroke_path(&path, &ink(paint), &stroke, Transform::identity(), None);
    }
}

fn ink(Paint { rgb: [r, g, b], opacity }: Paint) -> tiny_skia::Paint<'static> {
    let mut paint = tiny_skia::Paint::default();
    paint.set_color_rgba8(r, g, b, (opacity * 255.0).round() as u8);
    paint
}

/// Adds a line to a path. A point is a very short line: the ends are round.
fn polyline(path: &mut PathBuilder, points: &[[f64; 2]]) {
    for (at, [x, y]) in points.iter().map(|point| point.map(|c| c as f32)).enumerate() {
        if at == 0 {
            path.move_to(x, y);
        } else {
            path.line_to(x, y);
        }
        if points.iter().all(|point| *point == points[0]) {
            path.line_to(x + 1e-3, y);
        }
    }
}

/// Adds a line of text; `at` lies on the baseline, capitals are `height` high.
fn letters(path: &mut PathBuilder, at: [f64; 2], anchor: Anchor, height: f64, text: &str) {
    let (segments, width) = lettering(text);
    let scale = height / CAPITAL;
    let left = match anchor {
        Anchor::Start => at[0],
        Anchor::Middle => at[0] - width * scale / 2.0,
        Anchor::End => at[0] - width * scale,
    };
    let place = |end: glam::DVec2| [left + end.x * scale, at[1] - end.y * scale];
    let mut line: Vec<[f64; 2]> = Vec::new();
    for [from, to] in segments.into_iter().map(|ends| ends.map(place)) {
        if line.last() != Some(&from) {
            polyline(path, &line);
            line = vec![from];
        }
        line.push(to);
    }
    polyline(path, &line);
}

#[cfg(test)]
mod tests {
    use plotters::prelude::{BLACK, BLUE, IntoDrawingArea, IntoFont, RED};
    use plotters::style::{Color, TextStyle};
    use plotters_backend::DrawingBackend;

    use super::*;

    /// The ink of a PNG lies where it was put, in its colour.
    #[test]
    fn shapes_keep_place_and_colour() {
        let mut sheet = Sheet::new([80, 40], "shapes");
        sheet.draw_line((0, 20), (40, 20), &RED.stroke_width(8)).unwrap();
        sheet.draw_circle((60, 20), 6, &BLUE, true).unwrap();
        let text = TextStyle::from(("sans-serif", 16).into_font()).color(&BLACK);
        sheet.clone().into_drawing_area().draw_text("ij", &text, (4, 2)).unwrap();
        let picture = image::load_from_memory(&sheet.png().unwrap()).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (80, 40));
        let at = |x: u32, y: u32| picture.get_pixel(x, y).0;
        assert_eq!((at(20, 20), at(60, 20), at(78, 4)), ([255, 0, 0], [0, 0, 255], [255; 3]));
        assert_eq!((at(60, 16), at(60, 28)), ([0, 0, 255], [255; 3]), "the radius is 6");
        let ink = picture.enumerate_pixels().filter(|(_, y, pixel)| *y < 15 && pixel.0[1] < 128).count();
        assert!((10..200).contains(&ink), "{ink} dark pixels of letters");
    }
}
