//! Labels of landmarks: beside the ball, joined to it by a leader, at its depth, where no other label is.
//!
//! The nearest landmarks choose first. Each tries eight sides at three distances; one that finds no free place within
//! the picture is left out, its ball stays. Other labelled balls are covered only where there is no place beside them. Pixels of the picture; depth is view depth in mm.

use glam::{BVec2, DVec2};

use super::layers::Rank;
use super::lens::Lens;
use super::shape::{Primitive, Shape, Stroke, pixels};
use super::text::{Style, Typesetter, contrast};

/// Side of the squares in which the picture is remembered as free or taken, px.
const CELL_PX: f64 = 4.0;

/// Distances between ball and label, in heights of capitals.
const GAPS: [f64; 3] = [0.55, 1.4, 2.8];

/// Sides, the preferred one first: right, left, the corners, above, below.
const SIDES: [(f64, f64); 8] =
    [(1.0, 0.0), (-1.0, 0.0), (0.7, -0.7), (0.7, 0.7), (-0.7, -0.7), (-0.7, 0.7), (0.0, -1.0), (0.0, 1.0)];

const TEXT_RGB: [f64; 3] = [1.0; 3];

/// A landmark's name and where its ball is in the picture.
#[derive(Clone, Debug)]
pub(super) struct Label<'a> {
    pub(super) text: &'a str,
    pub(super) middle: DVec2,
    pub(super) radius_px: f64,
    /// Of the ball's nearest point.
    pub(super) depth_mm: f64,
    /// The ball's colour, for the leader.
    pub(super) rgb: [f64; 3],
}

/// Sets labels in capitals of this height, shown at these view depths at most. What `out` has of instruments is kept free.
pub(super) fn set(
    mut labels: Vec<Label<'_>>,
    (height_px, depths_mm): (u32, Option<[f64; 2]>),
    lens: &Lens,
    typesetter: &mut Typesetter,
    out: &mut Vec<Primitive>,
) {
    if labels.is_empty() {
        return;
    }
    let mut taken = Taken::new(lens.size_px);
    for primitive in out.iter().filter(|primitive| primitive.rank == Rank::Instrument) {
        let [left, top, right, bottom] = primitive.bounds();
        taken.mark([DVec2::new(left, top), DVec2::new(right, bottom)], TAKEN);
    }
    for label in &labels {
        taken.mark([label.middle - label.radius_px, label.middle + label.radius_px], BALL);
    }
    labels.sort_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm));
    for label in &labels {
        let Some(place) = label.place(height_px, &taken) else { continue };
        taken.mark(place.corners(), TAKEN);
        let shown_mm = depths_mm.map(|[near, far]| label.depth_mm.clamp(near, far));
        label.leader(&place, (f64::from(height_px), shown_mm), lens, out);
        let style = Style { height_px, rgb: TEXT_RGB, rank: Rank::Scene, shown_mm };
        typesetter.set(label.text, place.middle, label.depth_mm, style, out);
    }
}

/// Where a label goes.
struct Place {
    middle: DVec2,
    half: DVec2,
    /// From the ball towards the label.
    side: DVec2,
}

impl Place {
    fn corners(&self) -> [DVec2; 2] {
        [self.middle - self.half, self.middle + self.half]
    }
}

impl Label<'_> {
    /// The first free place in the order of distances and sides.
    fn place(&self, height_px: u32, taken: &Taken) -> Option<Place> {
        let height = f64::from(height_px);
        // Rims and descenders reach beyond the line.
        let half = (Typesetter::size_px(self.text, height_px) + DVec2::new(0.4, 1.0) * height) / 2.0;
        let sides = GAPS.into_iter().flat_map(|gap| SIDES.map(|(x, y)| (DVec2::new(x, y), gap)));
        let mut places = sides.map(|(side, gap)| {
            let near = self.middle + side * (self.radius_px + gap * height);
            let outwards =
                DVec2::select(BVec2::new(side.x == 0.0, side.y == 0.0), DVec2::ZERO, side.signum());
            Place { middle: near + outwards * half, half, side }
        });
        // The first free one, or else the first that covers nothing but balls.
        let mut over_balls = None;
        let free = places.find_map(|place| match taken.most_in(place.corners())? {
            FREE => Some(place),
            BALL => {
                over_balls.get_or_insert(place);
                None
            }
            _ => None,
        });
        free.or(over_balls)
    }

    /// A line from the ball to its label.
    fn leader(
        &self,
        place: &Place,
        (height, shown_mm): (f64, Option<f64>),
        lens: &Lens,
        out: &mut Vec<Primitive>,
    ) {
        let from = self.middle + place.side.normalize() * self.radius_px;
        let [low, high] = place.corners();
        let to = from.clamp(low, high);
        let width = (height / 12.0).max(1.2);
        for (width, rgb) in [(width, self.rgb), (width + height / 8.0, contrast(self.rgb))] {
            let stroke = Stroke::flat(lens, [from, to], [self.depth_mm; 2], width);
            #[expect(clippy::cast_possible_truncation, reason = "colours are kept as f32")]
            let rgb = rgb.map(|channel| (channel * 255.0) as f32);
            let shape = Shape::Stroke(stroke);
            out.push(Primitive { shape, rgb, opacity: 1.0, rank: Rank::Scene, shown_mm });
        }
    }
}

/// What a part of a picture has: nothing, a labelled ball, or something that no label may cover.
const FREE: u8 = 0;
const BALL: u8 = 1;
const TAKEN: u8 = 2;

/// What the parts of a picture have.
struct Taken {
    cells: Vec<u8>,
    columns: u32,
    rows: u32,
    size_px: DVec2,
}

impl Taken {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a picture's size")]
    fn new(size_px: DVec2) -> Self {
        let [columns, rows] = (size_px / CELL_PX).ceil().to_array().map(|count| count as u32);
        Self { cells: vec![FREE; columns as usize * rows as usize], columns, rows, size_px }
    }

    /// The cells that a box touches, row by row.
    fn cells_of(&self, [low, high]: [DVec2; 2]) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let [left, right] = pixels(low.x / CELL_PX, high.x / CELL_PX, [0, self.columns]);
        let [top, bottom] = pixels(low.y / CELL_PX, high.y / CELL_PX, [0, self.rows]);
        let columns = self.columns as usize;
        (top as usize..bottom as usize)
            .map(move |row| row * columns + left as usize..row * columns + right as usize)
    }

    fn mark(&mut self, corners: [DVec2; 2], what: u8) {
        for range in self.cells_of(corners) {
            self.cells[range].iter_mut().for_each(|cell| *cell = what.max(*cell));
        }
    }

    /// The most of what a box touches; `None` where it does not lie within the picture.
    fn most_in(&self, corners: [DVec2; 2]) -> Option<u8> {
        let [low, high] = corners;
        if low.min_element() < 0.0 || !high.cmple(self.size_px).all() {
            return None;
        }
        let mut most = FREE;
        for range in self.cells_of(corners) {
            most = self.cells[range].iter().copied().fold(most, u8::max);
            if most == TAKEN {
                break;
            }
        }
        Some(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Orbit;
    use crate::space::Point;

    fn lens() -> Lens {
        Lens::new(&Orbit::default().camera(Point::new(0.0, 0.0, 0.0), 100.0).unwrap(), [400, 300])
    }

    fn label(x: f64, y: f64) -> Label<'static> {
        let middle = DVec2::new(x, y);
        Label { text: "Gonion", middle, radius_px: 5.0, depth_mm: 100.0 + x, rgb: [1.0, 0.0, 0.0] }
    }

    /// The boxes of all rims of a picture's labels: six letters each.
    fn boxes(labels: Vec<Label<'_>>) -> Vec<[f64; 4]> {
        let mut out = Vec::new();
        set(labels, (16, None), &lens(), &mut Typesetter::default(), &mut out);
        let stamps: Vec<_> = out.iter().filter(|one| matches!(one.shape, Shape::Stamp(_))).collect();
        let join =
            |a: [f64; 4], b: [f64; 4]| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
        stamps.chunks(12).filter_map(|text| text.iter().map(|one| one.bounds()).reduce(join)).collect()
    }

    #[test]
    fn a_label_stands_to_the_right_where_there_is_room_and_to_the_left_at_the_right_edge() {
        let right = boxes(vec![label(100.0, 150.0)])[0];
        assert!(right[0] > 105.0 && right[1] < 150.0 && right[3] > 150.0, "{right:?}");
        let left = boxes(vec![label(390.0, 150.0)])[0];
        assert!(left[2] < 385.0, "{left:?}");
    }

    #[test]
    fn labels_never_overlap_and_stay_within_the_picture() {
        let many: Vec<_> =
            (0..300).map(|i| label(f64::from(i % 20) * 20.0 + 9.0, f64::from(i / 20) * 20.0 + 9.0)).collect();
        let boxes = boxes(many);
        assert!((15..300).contains(&boxes.len()), "{} labels found a place", boxes.len());
        for (i, a) in boxes.iter().enumerate() {
            assert!(a[0] >= -1.0 && a[1] >= -1.0 && a[2] <= 401.0 && a[3] <= 301.0, "{a:?}");
            for b in &boxes[..i] {
                let apart =
                    a[2] <= b[0] + 1.0 || b[2] <= a[0] + 1.0 || a[3] <= b[1] + 1.0 || b[3] <= a[1] + 1.0;
                assert!(apart, "{a:?} and {b:?}");
            }
        }
    }
}
