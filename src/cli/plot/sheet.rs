//! The drawing backend that plotters draws charts on: a list of shapes.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use plotters::element::{Drawable, PointCollection};
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontStyle,
};
use relief_render::{CAPITAL, lettering};

use super::{PAPER, SERIES};

/// Height of capitals in a text of size 1.
pub(super) const CAPITALS: f64 = 0.72;

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// A shape on the sheet. Coordinates are dots, x right, y down.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// An outline, filled if it is closed and has a fill.
    Path {
        points: Vec<[f64; 2]>,
        fill: Option<Paint>,
        stroke: Option<Stroke>,
        title: String,
    },
    Disc {
        center: [f64; 2],
        radius: f64,
        fill: Option<Paint>,
        stroke: Option<Stroke>,
        title: String,
    },
    /// A line of text; `at` lies on the baseline.
    Text {
        at: [f64; 2],
        anchor: Anchor,
        size: f64,
        bold: bool,
        paint: Paint,
        text: String,
    },
}

/// A colour with its opacity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paint {
    pub(super) rgb: [u8; 3],
    pub(super) opacity: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke {
    pub(super) paint: Paint,
    pub(super) width: f64,
}

/// The end of a text that lies at its place.
#[derive(Clone, Copy, Debug)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A sheet of paper. Copies share their shapes: plotters draws on one while its owner keeps another.
#[derive(Clone, Debug)]
pub(crate) struct Sheet {
    size: [u32; 2],
    pub(super) title: String,
    shapes: Rc<RefCell<Vec<Shape>>>,
}

impl Sheet {
    /// An empty sheet of this width and height; `title` describes it to screen readers.
    pub(crate) fn new(size: [u32; 2], title: &str) -> Self {
        Self { size, title: title.to_owned(), shapes: Rc::default() }
    }

    pub(super) const fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) fn shapes(&self) -> Vec<Shape> {
        self.shapes.borrow().clone()
    }

    fn push(&self, shape: Shape) {
        self.shapes.borrow_mut().push(shape);
    }

    /// A mark of a series, with `title` as its tooltip. Series differ in shape and in colour.
    pub(crate) fn mark(&self, series: usize, [x, y]: [f64; 2], title: &str) {
        let color = SERIES[series % SERIES.len()];
        let fill = Some(Paint { rgb: [color.0, color.1, color.2], opacity: 0.72 });
        let stroke =
            Some(Stroke { paint: Paint { rgb: [PAPER.0, PAPER.1, PAPER.2], opacity: 1.0 }, width: 1.4 });
        let corners: &[[f64; 2]] = match series % 4 {
            0 => {
                let (center, title) = ([x, y], title.to_owned());
                return self.push(Shape::Disc { center, radius: 7.2, fill, stroke, title });
            }
            1 => &[[0.0, -9.8], [8.6, 5.0], [-8.6, 5.0]],
            2 => &[[-6.4, -6.4], [6.4, -6.4], [6.4, 6.4], [-6.4, 6.4]],
            _ => &[[0.0, -9.0], [9.0, 0.0], [0.0, 9.0], [-9.0, 0.0]],
        };
        let mut points: Vec<_> = corners.iter().map(|corner| [x + corner[0], y + corner[1]]).collect();
        points.push(points[0]);
        self.push(Shape::Path { points, fill, stroke, title: title.to_owned() });
    }
}

/// A mark at a place in a chart.
pub(crate) struct Mark {
    pub(crate) at: (f64, f64),
    pub(crate) series: usize,
    /// The tooltip, or nothing.
    pub(crate) title: String,
}

impl<'a> PointCollection<'a, (f64, f64)> for &'a Mark {
    type Point = &'a (f64, f64);
    type IntoIter = std::iter::Once<Self::Point>;

    fn point_iter(self) -> Self::IntoIter {
        std::iter::once(&self.at)
    }
}

impl Drawable<Sheet> for Mark {
    fn draw<I: Iterator<Item = BackendCoord>>(&self, pos: I, sheet: &mut Sheet, _: (u32, u32)) -> Drawn {
        pos.for_each(|at| sheet.mark(self.series, dots(at), &self.title));
        Ok(())
    }
}

fn dots((x, y): BackendCoord) -> [f64; 2] {
    [f64::from(x), f64::from(y)]
}

fn paint(color: BackendColor) -> Option<Paint> {
    let BackendColor { alpha, rgb: (r, g, b) } = color;
    (alpha > 0.0).then_some(Paint { rgb: [r, g, b], opacity: alpha })
}

fn stroke(style: &impl BackendStyle) -> Option<Stroke> {
    Some(Stroke { paint: paint(style.color())?, width: f64::from(style.stroke_width()) })
}

impl DrawingBackend for Sheet {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.size[0], self.size[1])
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn {
        self.draw_circle(point, 1, &color, true)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        if let Some(stroke) = stroke(style) {
            let points = path.into_iter().map(dots).collect();
            self.push(Shape::Path { points, fill: None, stroke: Some(stroke), title: String::new() });
        }
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
        if fill { self.fill_polygon(corners, style) } else { self.draw_path(corners, style) }
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        if let Some(fill) = paint(style.color()) {
            let points = corners.into_iter().map(dots).collect();
            self.push(Shape::Path { points, fill: Some(fill), stroke: None, title: String::new() });
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let (fill, stroke) = if fill { (paint(style.color()), None) } else { (None, stroke(style)) };
        if fill.is_some() || stroke.is_some() {
            let (center, radius) = (dots(center), f64::from(radius));
            self.push(Shape::Disc { center, radius, fill, stroke, title: String::new() });
        }
        Ok(())
    }

    /// Text runs from left to right: no chart here turns its titles.
    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, pos: BackendCoord) -> Drawn {
        let Some(paint) = paint(style.color()) else { return Ok(()) };
        let anchor = match style.anchor().h_pos {
            HPos::Left => Anchor::Start,
            HPos::Center => Anchor::Middle,
            HPos::Right => Anchor::End,
        };
        let below = match style.anchor().v_pos {
            VPos::Top => CAPITALS + 0.14,
            VPos::Center => CAPITALS / 2.0,
            VPos::Bottom => -0.14,
        };
        let ([x, y], size) = (dots(pos), style.size());
        let bold = matches!(style.style(), FontStyle::Bold);
        let at = [x, y + below * size];
        self.push(Shape::Text { at, anchor, size, bold, paint, text: text.to_owned() });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let size = style.size();
        Ok(((lettering(text).1 * CAPITALS * size / CAPITAL).ceil() as u32, size.ceil() as u32))
    }
}
