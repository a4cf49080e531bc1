//! Annotations as overlays: shapes, labels and their depth.
//!
//! What it is: [`Drawables`], the visible items of a volume with their shapes, built once for each
//! state of the log, and their overlays in the picture of a request ([`Drawables::draw`]). What it
//! is not: storage (see `relief_store`) or drawing of pixels (see `relief_render`).
//!
//! | item | in a view | in a slice |
//! |---|---|---|
//! | point | a ball with its name | the same, within [`slice::REACH_MM`] of the slab |
//! | line | the line, with name and length | its part within that reach |
//! | angle | both arms, with name and degrees | as lines |
//! | curve | the curve, with name and length | as lines |
//! | plane | its outline, with its name | as lines |
//! | region, mesh | the surface, with its name | its outline in the slice |
//!
//! Missing and skipped items, and those that are hidden, are not drawn. Whatever a picture has no
//! room for is counted, not forgotten in silence; names go before items. Patient mm; depth is view
//! depth in mm.

mod comfort;
mod content;
mod contour;
mod slice;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use relief_annotation::{Geometry, Item, catmull_rom, measures};
use relief_base::{Patient, Point, Vector};
use relief_display::DisplaySettings;
use relief_render::{
    Curve, Landmark, Line, Mesh, Mode, OverlayItem, Overlays, Radius, RenderRequest, depth_limits,
    length_words,
};
use relief_volume::Grid;
use slice::{Cut, between};

pub use content::{ContentError, region_of_content, shape_of_content};

/// Radius of a point's ball, and width of lines, px.
const RADIUS_PX: f64 = 6.0;
const WIDTH_PX: f64 = 3.0;
/// Radius of the ball from which a label's leader starts if the item has no point there, px.
const ANCHOR_PX: f64 = 1.5;
/// Opacity of surfaces: they write depth, and their inside shines through.
const OPACITY: f64 = 0.6;
/// Straight parts between two points of a smooth curve in a slice.
const PARTS: usize = 16;

/// Triangles in patient mm. Cheap to clone.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceMesh {
    /// Corners.
    pub vertices: Arc<[Point<Patient>]>,
    /// Three indices of corners each.
    pub triangles: Arc<[[u32; 3]]>,
}

impl SurfaceMesh {
    /// Most triangles of a shape that is to be drawn: a surface of more is decimated before, or
    /// three of them would be all that a picture has room for.
    pub const MOST_TRIANGLES: usize = 20_000;
}

/// One item, ready to be drawn.
#[derive(Clone, Debug)]
struct Drawable {
    label: Arc<str>,
    rgb: [f64; 3],
    geometry: Geometry,
    /// The points of a curve, and the corners of a plane.
    points: Arc<[Point<Patient>]>,
    shape: Option<Arc<SurfaceMesh>>,
}

/// The items that are drawn over pictures of a volume. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Drawables {
    items: Arc<[Drawable]>,
}

/// Items and labels that exceeded the limits of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOutCounts {
    /// Items that were drawn, or lie outside of the slice.
    pub drawn: usize,
    /// Items that were not, since the picture has as many overlays as it may have.
    pub left_out: usize,
    /// Items that were drawn without their names, since the picture has as many words as it may
    /// have. The first ones have theirs.
    pub unlabelled: usize,
}

impl Drawables {
    /// The drawables of these items, in their order. `shape_of` returns the triangles of a region
    /// or mesh; an item without triangles is not drawn.
    pub fn new<'a>(
        items: impl IntoIterator<Item = &'a Item>,
        mut shape_of: impl FnMut(&Geometry) -> Option<Arc<SurfaceMesh>>,
    ) -> Self {
        let drawable = |item: &Item| {
            let geometry = item.geometry.clone().filter(|_| item.visible)?;
            let shape = match geometry {
                Geometry::Region(_) | Geometry::Mesh(_) => {
                    Some(shape_of(&geometry).filter(|shape| !shape.triangles.is_empty())?)
                }
                _ => None,
            };
            let rgb = item.rgb.unwrap_or_else(|| usual_rgb(&geometry));
            let label = label(&item.name, &geometry).into();
            let points = match &geometry {
                Geometry::Curve { points_mm, .. } => points_mm.as_slice().into(),
                Geometry::Plane { .. } => corners(&geometry).into(),
                _ => [].into(),
            };
            Some(Drawable { label, rgb, geometry, points, shape })
        };
        Self { items: items.into_iter().filter_map(drawable).collect() }
    }

    /// Whether there is nothing to draw.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Adds the items to the overlays of a request on this grid, in their order, as long as there
    /// is room.
    pub fn draw(&self, request: &mut RenderRequest, display: &DisplaySettings, grid: &Grid) -> LeftOutCounts {
        if self.is_empty() {
            return LeftOutCounts::default();
        }
        let mut room = Room::beside(&request.overlays);
        let mut overlays = Overlays::clone(&request.overlays);
        let cut = matches!(request.mode, Mode::Slice(_)).then(|| Cut::of(request));
        let mut drawn = LeftOutCounts::default();
        let mut parts = Vec::new();
        for item in self.items.iter() {
            match &cut {
                Some(cut) => item.in_slice(cut, &mut parts),
                None => item.in_view(request.camera.eye(), &mut parts),
            }
            let is_silent = !room.has_words_for(&parts);
            if is_silent {
                silence(&mut parts);
            }
            if room.take(&parts) {
                drawn.drawn += 1;
                drawn.unlabelled += usize::from(is_silent);
                overlays.items.append(&mut parts);
            } else {
                drawn.left_out += 1;
                parts.clear();
            }
        }
        if overlays.label_depths_mm.is_none() {
            let limits = display.limits(depth_limits(&request.camera, grid)).ok();
            let profile = display.profile().ok();
            overlays.label_depths_mm = limits.zip(profile).map(|(limits, profile)| {
                comfort::label_depths_mm(&profile, limits, &overlays, request.size_px)
            });
        }
        request.overlays = Arc::new(overlays);
        drawn
    }
}

impl Drawable {
    /// Adds the item in space, for an eye there.
    fn in_view(&self, eye: Point<Patient>, parts: &mut Vec<OverlayItem>) {
        match &self.geometry {
            Geometry::Point { at_mm } => parts.push(self.ball(*at_mm, RADIUS_PX)),
            Geometry::Line { ends_mm: [a, b] } => {
                parts.extend([self.line([*a, *b]), self.anchor(between(*a, *b, 0.5))]);
            }
            Geometry::Angle { points_mm: [a, corner, b] } => {
                parts.extend([self.line([*a, *corner]), self.line([*corner, *b]), self.anchor(*corner)]);
            }
            Geometry::Curve { closed, smooth, .. } => {
                let points = Arc::clone(&self.points);
                let anchor = points.get(points.len() / 2).map(|&middle| self.anchor(middle));
                let (closed, smooth) = (*closed, *smooth);
                let curve = Curve { points, closed, smooth, width_px: WIDTH_PX, rgb: self.rgb };
                parts.extend([OverlayItem::Curve(curve)].into_iter().chain(anchor));
            }
            Geometry::Plane { .. } => {
                let points = Arc::clone(&self.points);
                let anchor = points.first().map(|&corner| self.anchor(corner));
                let curve = Curve { points, closed: true, smooth: false, width_px: WIDTH_PX, rgb: self.rgb };
                parts.extend([OverlayItem::Curve(curve)].into_iter().chain(anchor));
            }
            Geometry::Region(_) | Geometry::Mesh(_) => {
                let Some(SurfaceMesh { vertices, triangles }) = self.shape.as_deref().cloned() else {
                    return;
                };
                // Where the surface is nearest to the eye: nothing of it hides its name.
                let distance = |point: &Point<Patient>| point.distance(eye);
                let nearest = vertices.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
                let anchor = nearest.map(|&nearest| self.anchor(nearest));
                let mesh = Mesh { vertices, triangles, rgb: self.rgb, opacity: OPACITY };
                parts.extend([OverlayItem::Mesh(mesh)].into_iter().chain(anchor));
            }
        }
    }

    /// Adds the part of the item that lies in a slice.
    fn in_slice(&self, cut: &Cut, parts: &mut Vec<OverlayItem>) {
        let lines: Vec<Vec<Point<Patient>>> = match &self.geometry {
            Geometry::Point { at_mm } => {
                parts.extend(cut.near(*at_mm).map(|at| self.ball(at, RADIUS_PX)));
                return;
            }
            Geometry::Region(_) | Geometry::Mesh(_) => {
                self.shape.as_deref().map(|shape| contour::contours(shape, cut)).unwrap_or_default()
            }
            geometry => cut.lines(&polyline(geometry, &self.points)),
        };
        let anchor = lines.iter().max_by_key(|line| line.len()).and_then(|line| line.get(line.len() / 2));
        let anchor = anchor.map(|&at| self.anchor(at));
        let curve = |points: Vec<_>| {
            let points = points.into();
            Curve { points, closed: false, smooth: false, width_px: WIDTH_PX, rgb: self.rgb }
        };
        parts.extend(lines.into_iter().map(curve).map(OverlayItem::Curve).chain(anchor));
    }

    fn ball(&self, at: Point<Patient>, radius_px: f64) -> OverlayItem {
        let label = Some(Arc::clone(&self.label));
        OverlayItem::Landmark(Landmark { at, radius: Radius::Px(radius_px), rgb: self.rgb, label })
    }

    /// A label at a place of the item. Labels are set where there is room for them; words of an
    /// item of their own would not be.
    fn anchor(&self, at: Point<Patient>) -> OverlayItem {
        self.ball(at, ANCHOR_PX)
    }

    fn line(&self, ends: [Point<Patient>; 2]) -> OverlayItem {
        OverlayItem::Line(Line { ends, width_px: WIDTH_PX, rgb: self.rgb })
    }
}

/// The corners of a plane in order; none of others.
fn corners(geometry: &Geometry) -> Vec<Point<Patient>> {
    let Geometry::Plane { center_mm, normal, axis, size_mm: [width, height] } = geometry else {
        return Vec::new();
    };
    let [normal, axis] = [normal, axis].map(|xyz| Vector::<Patient>::from_xyz((*xyz).into()));
    let up = normal.cross(axis);
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(x, y)| *center_mm + axis * (x * width) + up * (y * height))
        .to_vec()
}

/// The line of an item that is made of lines, through its points; `corners` are those of a plane.
fn polyline(geometry: &Geometry, corners: &[Point<Patient>]) -> Vec<Point<Patient>> {
    match geometry {
        Geometry::Curve { points_mm, closed, smooth } => {
            let mut line: Vec<_> = points_mm.iter().map(|point| point.xyz).collect();
            if *smooth {
                line = catmull_rom(&line, *closed, PARTS);
            } else {
                line.extend(closed.then(|| line.first().copied()).flatten());
            }
            line.into_iter().map(Point::from_xyz).collect()
        }
        Geometry::Plane { .. } => corners.iter().chain(corners.first()).copied().collect(),
        geometry => geometry.points().to_vec(),
    }
}

/// The name and the main measure of an item.
fn label(name: &str, geometry: &Geometry) -> String {
    let measured = match geometry {
        Geometry::Line { .. } | Geometry::Angle { .. } | Geometry::Curve { .. } => measures(geometry),
        _ => Vec::new(),
    };
    let label = match measured.first() {
        Some(measure) if measure.unit == "deg" => format!("{name} {:.1}°", measure.value),
        Some(measure) if measure.unit == "mm" => format!("{name} {}", length_words(measure.value)),
        Some(measure) => format!("{name} {:.1} {}", measure.value, measure.unit),
        None => name.to_owned(),
    };
    label.chars().take(Overlays::MAX_LINE).collect()
}

/// Colours that go with the kinds.
fn usual_rgb(geometry: &Geometry) -> [f64; 3] {
    match geometry {
        Geometry::Point { .. } => [1.0, 0.35, 0.25],
        Geometry::Line { .. } => [0.35, 0.85, 1.0],
        Geometry::Angle { .. } => [1.0, 0.8, 0.3],
        Geometry::Curve { .. } => [0.65, 0.9, 0.35],
        Geometry::Plane { .. } => [0.8, 0.6, 1.0],
        Geometry::Region(_) => [0.45, 0.9, 0.5],
        Geometry::Mesh(_) => [0.9, 0.75, 0.5],
    }
}

/// Removes labels, and balls that only carry a label.
fn silence(parts: &mut Vec<OverlayItem>) {
    parts.retain_mut(|part| {
        let OverlayItem::Landmark(landmark) = part else { return true };
        landmark.label = None;
        landmark.radius != Radius::Px(ANCHOR_PX)
    });
}

/// The limits of a request that its own overlays leave.
struct Room {
    items: usize,
    points: usize,
    vertices: usize,
    triangles: usize,
    characters: usize,
}

impl Room {
    fn beside(overlays: &Overlays) -> Self {
        let mut room = Self {
            items: Overlays::MAX_ITEMS,
            points: Overlays::MAX_POINTS,
            vertices: Overlays::MAX_VERTICES,
            triangles: Overlays::MAX_TRIANGLES,
            characters: Overlays::MAX_CHARACTERS,
        };
        room.take(&overlays.items);
        room
    }

    /// Whether there is room for all words of these.
    fn has_words_for(&self, parts: &[OverlayItem]) -> bool {
        Self::of(parts).characters <= self.characters
    }

    /// Takes the room of these; false where there is too little for all of them.
    fn take(&mut self, parts: &[OverlayItem]) -> bool {
        let needed = Self::of(parts);
        let left = |room: usize, needed: usize| room.checked_sub(needed);
        let rest = (|| {
            Some(Self {
                items: left(self.items, needed.items)?,
                points: left(self.points, needed.points)?,
                vertices: left(self.vertices, needed.vertices)?,
                triangles: left(self.triangles, needed.triangles)?,
                characters: left(self.characters, needed.characters)?,
            })
        })();
        rest.map(|rest| *self = rest).is_some()
    }

    /// The room that these need.
    fn of(parts: &[OverlayItem]) -> Self {
        let mut needed = Self { items: parts.len(), points: 0, vertices: 0, triangles: 0, characters: 0 };
        for part in parts {
            match part {
                OverlayItem::Curve(curve) => needed.points += curve.points.len(),
                OverlayItem::Mesh(mesh) => {
                    needed.vertices += mesh.vertices.len();
                    needed.triangles += mesh.triangles.len();
                }
                OverlayItem::Landmark(landmark) => {
                    needed.characters += landmark.label.as_ref().map_or(0, |label| label.chars().count());
                }
                OverlayItem::Text(text) => needed.characters += text.text.chars().count(),
                OverlayItem::Line(_) => {}
            }
        }
        needed
    }
}
