//! Overlay items in patient mm, and the instruments that follow the camera.
//!
//! These are the values of a request. How they become pixels is in the modules beside; their JSON
//! is in `scene`.

use std::sync::Arc;

use super::text::HEIGHTS_PX;
use relief_base::{OutOfRange, Patient, Point};

/// Everything that is drawn over a picture, in the same depth as the volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlays {
    /// At most [`Overlays::MAX_ITEMS`].
    pub items: Vec<OverlayItem>,
    /// The twelve edges of the volume's box.
    pub bounding_box: bool,
    /// A cube in the lower right corner that turns with the patient, with the letters of its sides.
    pub orientation_cube: bool,
    /// A bar of a round length in the lower left corner, true at the depth of the focal point.
    pub scale_bar: bool,
    /// The identity of the series, a line in the upper left corner.
    pub caption: Option<Arc<str>>,
    /// Height of the capitals of labels, px; a fraction of the picture's height by default.
    pub label_height_px: Option<u32>,
    /// Range of view depths in which labels are shown, mm; by default each label has its ball's
    /// depth. Displays that shift pixels by their depth blur words far from the screen. Occlusion
    /// still uses the ball's depth.
    pub label_depths_mm: Option<[f64; 2]>,
    /// Opacity of parts behind the volume's surface, 0..1: 0 hides them, 1 shows them as if nothing
    /// were in front.
    pub occluded: f64,
}

/// One thing in patient space. Cheap to clone: lists are shared.
#[derive(Clone, Debug, PartialEq)]
pub enum OverlayItem {
    /// A ball.
    Landmark(Landmark),
    /// A straight line.
    Line(Line),
    /// A line through many points.
    Curve(Curve),
    /// A surface of triangles.
    Mesh(Mesh),
    /// Words at a point.
    Text(Text),
}

/// A ball around a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Its centre.
    pub at: Point<Patient>,
    /// Its size.
    pub radius: Radius,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
    /// Its name, written beside it where there is room.
    pub label: Option<Arc<str>>,
}

/// The size of a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// A length in the patient, mm.
    Mm(f64),
    /// As many pixels at the depth of its centre, whatever the distance.
    Px(f64),
}

/// A straight line of constant width in the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Both ends.
    pub ends: [Point<Patient>; 2],
    /// Width, px.
    pub width_px: f64,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
}

/// A line through points in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Two or more; three or more where it is closed.
    pub points: Arc<[Point<Patient>]>,
    /// Whether the last point is joined to the first.
    pub closed: bool,
    /// Whether it is a centripetal Catmull-Rom spline through the points, instead of straight
    /// between them.
    pub smooth: bool,
    /// Width, px.
    pub width_px: f64,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
}

/// Triangles, seen from both sides, under a headlight.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Corners.
    pub vertices: Arc<[Point<Patient>]>,
    /// Three indices of corners each.
    pub triangles: Arc<[[u32; 3]]>,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
    /// 0.05..1. From a half on the mesh writes depth.
    pub opacity: f64,
}

/// Words that face the viewer, in the middle of the place that shows a point, at its depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Its place.
    pub at: Point<Patient>,
    /// One line. Characters that the font does not have are drawn as boxes.
    pub text: String,
    /// Height of capitals, 12..96 px; a fraction of the picture's height by default.
    pub height_px: Option<u32>,
    /// Display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
}

impl Default for Overlays {
    fn default() -> Self {
        Self {
            items: Vec::new(),
            bounding_box: false,
            orientation_cube: false,
            scale_bar: false,
            caption: None,
            label_height_px: None,
            label_depths_mm: None,
            occluded: Self::DEFAULT_OCCLUDED,
        }
    }
}

impl Overlays {
    /// Most items of a request.
    pub const MAX_ITEMS: usize = 20_000;
    /// Most points of all curves of a request together.
    pub const MAX_POINTS: usize = 100_000;
    /// Most corners of all meshes of a request together.
    pub const MAX_VERTICES: usize = 200_000;
    /// Most triangles of all meshes of a request together.
    pub const MAX_TRIANGLES: usize = 400_000;
    /// Most characters of a text or a label.
    pub const MAX_LINE: usize = 120;
    /// Most characters of all texts and labels of a request together.
    pub const MAX_CHARACTERS: usize = 100_000;
    /// Instruments with their name in `--overlay` and queries, and their key in the JSON form.
    pub const SWITCHES: [(&str, &str); 4] = [
        ("bounding-box", "bounding_box"),
        ("cube", "orientation_cube"),
        ("scale-bar", "scale_bar"),
        ("caption", "caption"),
    ];
    /// Opacity of hidden parts where a request says nothing.
    pub const DEFAULT_OCCLUDED: f64 = 0.25;
    /// Widths of lines and curves, px.
    pub(super) const WIDTHS_PX: [f64; 2] = [0.5, 64.0];
    /// Coordinates, mm either way: those of cameras.
    const FARTHEST_MM: f64 = 1e6;

    /// The names of [`Overlays::SWITCHES`] in one line.
    #[must_use]
    pub fn switch_names() -> String {
        Self::SWITCHES.map(|(name, _)| name).join(", ")
    }

    /// Whether nothing is to be drawn.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.are_a_caption() && self.caption.is_none()
    }

    /// Whether nothing but a caption is to be drawn, which has no place in the patient.
    #[must_use]
    pub fn are_a_caption(&self) -> bool {
        self.items.is_empty() && !self.bounding_box && !self.orientation_cube && !self.scale_bar
    }

    /// Bytes that the lists take.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        let inner = |item: &OverlayItem| match item {
            OverlayItem::Curve(curve) => size_of_val(&*curve.points),
            OverlayItem::Mesh(mesh) => size_of_val(&*mesh.vertices) + size_of_val(&*mesh.triangles),
            OverlayItem::Text(text) => text.text.len(),
            OverlayItem::Landmark(landmark) => landmark.label.as_ref().map_or(0, |label| label.len()),
            OverlayItem::Line(_) => 0,
        };
        size_of_val(self.items.as_slice()) + self.items.iter().map(inner).sum::<usize>()
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first value out of range, with its key's path.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("overlays.occluded", self.occluded, [0.0, 1.0])?;
        if let Some(height_px) = self.label_height_px {
            within("overlays.label_height_px", f64::from(height_px), HEIGHTS_PX.map(f64::from))?;
        }
        if let Some([near, far]) = self.label_depths_mm
            && !(near.abs() <= Self::FARTHEST_MM && far.abs() <= Self::FARTHEST_MM && near <= far)
        {
            let allowed = format!("two depths within {} mm, the first not the larger", Self::FARTHEST_MM);
            return Err(OutOfRange::new("overlays.label_depths_mm", format!("{near}, {far}"), allowed));
        }
        at_most("overlays.items", "items", self.items.len(), Self::MAX_ITEMS)?;
        let mut sums = Sums::default();
        for (index, item) in self.items.iter().enumerate() {
            let path = Path { index, kind: item.kind() };
            item.validate(path)?;
            sums.add(item, path)?;
        }
        Ok(())
    }
}

impl OverlayItem {
    /// The item's key in the JSON form.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Landmark(_) => "landmark",
            Self::Line(_) => "line",
            Self::Curve(_) => "curve",
            Self::Mesh(_) => "mesh",
            Self::Text(_) => "text",
        }
    }

    fn validate(&self, path: Path) -> Result<(), OutOfRange> {
        match self {
            Self::Landmark(Landmark { at, radius, rgb, label }) => {
                path.point("at_mm", *at)?;
                match *radius {
                    Radius::Mm(mm) => path.within("radius_mm", mm, [0.000_001, 1000.0])?,
                    Radius::Px(px) => path.within("radius_px", px, [0.5, 500.0])?,
                }
                label.as_ref().map_or(Ok(()), |label| path.line("label", label))?;
                path.rgb(rgb)
            }
            Self::Line(Line { ends: [from, to], width_px, rgb }) => {
                path.point("from_mm", *from)?;
                path.point("to_mm", *to)?;
                path.within("width_px", *width_px, Overlays::WIDTHS_PX)?;
                path.rgb(rgb)
            }
            Self::Curve(Curve { points, closed, smooth: _, width_px, rgb }) => {
                let least = if *closed { 3 } else { 2 };
                if points.len() < least {
                    let found = format!("{} points", points.len());
                    return Err(path.refuse("points_mm", &found, &format!("at least {least}")));
                }
                path.points("points_mm", points)?;
                path.within("width_px", *width_px, Overlays::WIDTHS_PX)?;
                path.rgb(rgb)
            }
            Self::Mesh(mesh) => mesh.validate(path),
            Self::Text(Text { at, text, height_px, rgb }) => {
                path.point("at_mm", *at)?;
                path.line("text", text)?;
                if let Some(height_px) = *height_px {
                    path.within("height_px", f64::from(height_px), HEIGHTS_PX.map(f64::from))?;
                }
                path.rgb(rgb)
            }
        }
    }
}

impl Mesh {
    fn validate(&self, path: Path) -> Result<(), OutOfRange> {
        let Self { vertices, triangles, rgb, opacity } = self;
        for (key, count) in [("vertices_mm", vertices.len()), ("triangles", triangles.len())] {
            if count == 0 {
                return Err(path.refuse(key, "empty", "at least one triangle and its corners"));
            }
        }
        path.points("vertices_mm", vertices)?;
        let known = |corner: &u32| (*corner as usize) < vertices.len();
        if let Some(at) = triangles.iter().position(|corners| !corners.iter().all(known)) {
            let allowed = format!("indices of vertices_mm, 0 to {}", vertices.len() - 1);
            return Err(path.refuse(&format!("triangles[{at}]"), format!("{:?}", triangles[at]), &allowed));
        }
        path.within("opacity", *opacity, [0.05, 1.0])?;
        path.rgb(rgb)
    }
}

/// Counts over all items: together they bound the memory and the work of a picture.
#[derive(Default)]
struct Sums {
    points: usize,
    vertices: usize,
    triangles: usize,
    characters: usize,
}

impl Sums {
    fn add(&mut self, item: &OverlayItem, path: Path) -> Result<(), OutOfRange> {
        let over = |key: &str, sum: usize, most: usize| {
            let found = format!("{sum} in all items up to this one");
            if sum <= most { Ok(()) } else { Err(path.refuse(key, &found, &format!("at most {most}"))) }
        };
        match item {
            OverlayItem::Curve(curve) => {
                self.points += curve.points.len();
                over("points_mm", self.points, Overlays::MAX_POINTS)
            }
            OverlayItem::Mesh(mesh) => {
                self.vertices += mesh.vertices.len();
                self.triangles += mesh.triangles.len();
                over("vertices_mm", self.vertices, Overlays::MAX_VERTICES)?;
                over("triangles", self.triangles, Overlays::MAX_TRIANGLES)
            }
            OverlayItem::Text(Text { text, .. }) => {
                self.characters += text.chars().count();
                over("text", self.characters, Overlays::MAX_CHARACTERS)
            }
            OverlayItem::Landmark(Landmark { label, .. }) => {
                self.characters += label.as_ref().map_or(0, |label| label.chars().count());
                over("label", self.characters, Overlays::MAX_CHARACTERS)
            }
            OverlayItem::Line(_) => Ok(()),
        }
    }
}

/// The place of an item in the JSON form.
#[derive(Clone, Copy)]
struct Path {
    index: usize,
    kind: &'static str,
}

impl Path {
    fn key(self, key: &str) -> String {
        format!("overlays.items[{}].{}.{key}", self.index, self.kind)
    }

    fn refuse(self, key: &str, found: impl std::fmt::Display, allowed: &str) -> OutOfRange {
        OutOfRange::new(self.key(key), found, allowed)
    }

    fn within(self, key: &str, value: f64, range: [f64; 2]) -> Result<(), OutOfRange> {
        if is_within(value, range) { Ok(()) } else { within(&self.key(key), value, range) }
    }

    fn line(self, key: &str, text: &str) -> Result<(), OutOfRange> {
        let count = text.chars().count();
        if !(1..=Overlays::MAX_LINE).contains(&count) {
            let allowed = format!("1 to {} characters", Overlays::MAX_LINE);
            return Err(self.refuse(key, format!("{count} characters"), &allowed));
        }
        match text.chars().find(|character| character.is_control()) {
            Some(character) => Err(self.refuse(
                key,
                format!("a text with {character:?}"),
                "one line without control characters",
            )),
            None => Ok(()),
        }
    }

    fn rgb(self, rgb: &[f64; 3]) -> Result<(), OutOfRange> {
        rgb.iter().try_for_each(|&channel| self.within("rgb", channel, [0.0, 1.0]))
    }

    fn point(self, key: &str, point: Point<Patient>) -> Result<(), OutOfRange> {
        let far = Overlays::FARTHEST_MM;
        match point.xyz.to_array().iter().find(|mm| !(-far..=far).contains(*mm)) {
            Some(mm) => Err(self.refuse(key, mm, &format!("-{far} to {far} mm each"))),
            None => Ok(()),
        }
    }

    fn points(self, key: &str, points: &[Point<Patient>]) -> Result<(), OutOfRange> {
        points
            .iter()
            .enumerate()
            .try_for_each(|(i, point)| self.point(key, *point).map_err(|error| at_index(error, i)))
    }
}

fn at_index(error: OutOfRange, index: usize) -> OutOfRange {
    OutOfRange { path: format!("{}[{index}]", error.path), ..error }
}

fn is_within(value: f64, [low, high]: [f64; 2]) -> bool {
    (low..=high).contains(&value)
}

fn within(path: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), OutOfRange> {
    let inside = is_within(value, [low, high]);
    inside.then_some(()).ok_or_else(|| OutOfRange::new(path, value, format!("{low} to {high}")))
}

fn at_most(path: &str, what: &str, found: usize, most: usize) -> Result<(), OutOfRange> {
    if found <= most {
        return Ok(());
    }
    Err(OutOfRange::new(path, format!("{found} {what}"), format!("at most {most}")))
}
