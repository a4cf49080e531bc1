//! Labels of landmarks: beside the ball, joined to it by a leader, at its depth, where no other
//! label is.
//!
//! The nearest landmarks choose first. Each tries eight sides at three distances; one that finds no
//! free place within the picture is left out, its ball stays. Other labelled balls are covered only
//! where there is no place beside them. So a picture has as many labels as can be read in it, the
//! nearest ones, whatever the number of landmarks; it is full when a thousand in a row found no
//! place.
//!
//! Pixels of the picture; depth is view depth in mm.

use std::ops::Range;

use glam::{BVec2, DVec2};

use super::layers::Rank;
use super::lens::Lens;
use super::primitive::{Primitive, PrimitiveForm};
use super::shape::{Stroke, pixels};
use super::text::{Style, Typesetter, contrast};

/// Side of the squares in which the picture is remembered as free or taken, px.
const CELL_PX: f64 = 4.0;

/// Distances between ball and label, in heights of capitals.
const GAPS: [f64; 3] = [0.55, 1.4, 2.8];

/// Sides, the preferred one first: right, left, the corners, above, below.
const SIDES: [(f64, f64); 8] =
    [(1.0, 0.0), (-1.0, 0.0), (0.7, -0.7), (0.7, 0.7), (-0.7, -0.7), (-0.7, 0.7), (0.0, -1.0), (0.0, 1.0)];

/// The picture counts as full after this number of labels in a row without a place: labels behind
/// them are not tried.
const FULL_AFTER: usize = 1000;

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

/// Sets labels in capitals of this height, shown at these view depths at most. What `out` has of
/// instruments is kept free.
pub(super) fn set(
    mut labels: Vec<Label<'_>>,
    height_px: u32,
    depths_mm: Option<[f64; 2]>,
    lens: &Lens,
    typesetter: &mut Typesetter,
    out: &mut Vec<Primitive>,
) {
    if labels.is_empty() {
        return;
    }
    let mut taken = OccupancyMap::new(lens.size_px, Label::size_px("", height_px).y);
    for primitive in out.iter().filter(|primitive| primitive.rank == Rank::Instrument) {
        let [left, top, right, bottom] = primitive.bounds();
        taken.labels.mark(&taken.cells_of([DVec2::new(left, top), DVec2::new(right, bottom)]));
    }
    for label in &labels {
        taken.balls.mark(&taken.cells_of([label.middle - label.radius_px, label.middle + label.radius_px]));
    }
    labels.sort_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm));
    let mut in_vain = 0;
    for label in &labels {
        let Some(place) = label.place(height_px, &taken) else {
            in_vain += 1;
            if in_vain == FULL_AFTER {
                break;
            }
            continue;
        };
        in_vain = 0;
        taken.labels.mark(&taken.cells_of(place.corners()));
        let shown_mm = depths_mm.map(|[near, far]| label.depth_mm.clamp(near, far));
        label.leader(&place, f64::from(height_px), shown_mm, lens, out);
        let style = Style { height_px, rgb: TEXT_RGB, rank: Rank::Scene, shown_mm };
        typesetter.set(label.text, place.middle, label.depth_mm, style, out);
    }
}

/// The place of a label.
struct LabelPlace {
    middle: DVec2,
    half: DVec2,
    /// From the ball towards the label.
    side: DVec2,
}

impl LabelPlace {
    fn corners(&self) -> [DVec2; 2] {
        [self.middle - self.half, self.middle + self.half]
    }
}

impl Label<'_> {
    /// Width and height of a label's box.
    fn size_px(text: &str, height_px: u32) -> DVec2 {
        // Rims and descenders reach beyond the line.
        Typesetter::size_px(text, height_px) + DVec2::new(0.4, 1.0) * f64::from(height_px)
    }

    /// The first free place in the order of distances and sides.
    fn place(&self, height_px: u32, taken: &OccupancyMap) -> Option<LabelPlace> {
        let height = f64::from(height_px);
        let half = Self::size_px(self.text, height_px) / 2.0;
        let sides = GAPS.into_iter().flat_map(|gap| SIDES.map(|(x, y)| (DVec2::new(x, y), gap)));
        let mut places = sides.map(|(side, gap)| {
            let near = self.middle + side * (self.radius_px + gap * height);
            let outwards =
                DVec2::select(BVec2::new(side.x == 0.0, side.y == 0.0), DVec2::ZERO, side.signum());
            LabelPlace { middle: near + outwards * half, half, side }
        });
        // The first free one, or else the first that covers nothing but balls.
        let mut over_balls = None;
        let free = places.find_map(|place| match taken.most_in(place.corners())? {
            Occupancy::Nothing => Some(place),
            Occupancy::Balls => {
                over_balls.get_or_insert(place);
                None
            }
            Occupancy::Labels => None,
        });
        free.or(over_balls)
    }

    /// A line from the ball to its label.
    fn leader(
        &self,
        place: &LabelPlace,
        height: f64,
        shown_mm: Option<f64>,
        lens: &Lens,
        out: &mut Vec<Primitive>,
    ) {
        let from = self.middle + place.side.normalize() * self.radius_px;
        let [low, high] = place.corners();
        let to = from.clamp(low, high);
        let width = (height / 12.0).max(1.2);
        for (width, rgb) in [(width, self.rgb), (width + height / 8.0, contrast(self.rgb))] {
            let stroke = Stroke::flat(lens, [from, to], [self.depth_mm; 2], width);
            let rgb = rgb.map(|channel| (channel * 255.0) as f32);
            let shape = PrimitiveForm::Stroke(stroke);
            out.push(Primitive { shape, rgb, opacity: 1.0, rank: Rank::Scene, shown_mm });
        }
    }
}

/// Occupancy of a part of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Occupancy {
    Nothing,
    /// Labelled balls.
    Balls,
    /// Something that no label may cover.
    Labels,
}

/// Occupancy of all parts of a picture.
struct OccupancyMap {
    balls: Marks,
    labels: Marks,
    columns: u32,
    rows: u32,
    size_px: DVec2,
}

/// The marked parts of a picture: a bit for each, in rows of whole words.
struct Marks {
    cells: Vec<u64>,
    /// For each cell whether it or one of the cells below it, within the height of a label, is
    /// marked: one lookup tests most of a label.
    below: Vec<u64>,
    /// Words of a row.
    stride: usize,
    /// Rows that `below` stands for.
    reach: usize,
}

/// A box of cells.
struct Cells {
    words: Range<usize>,
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Cells {
    /// The bits that count in a word of each row.
    fn bits(&self, word: usize) -> u64 {
        let Range { start, end } = self.columns;
        (u64::MAX << start.saturating_sub(word * 64)) & (u64::MAX >> (64 - (end - word * 64).min(64)))
    }
}

impl Marks {
    fn new(stride: usize, rows: usize, reach: usize) -> Self {
        let none = vec![0; stride * rows];
        Self { cells: none.clone(), below: none, stride, reach }
    }

    fn mark(&mut self, cells: &Cells) {
        let Range { start, end } = cells.rows.clone();
        for word in cells.words.clone() {
            let bits = cells.bits(word);
            (start..end).for_each(|row| self.cells[row * self.stride + word] |= bits);
            let above = start.saturating_sub(self.reach - 1);
            (above..end).for_each(|row| self.below[row * self.stride + word] |= bits);
        }
    }

    /// Whether any of these cells is marked: at least as many rows as `below` stands for.
    fn are_in(&self, cells: &Cells) -> bool {
        let Range { start, end } = cells.rows.clone();
        cells.words.clone().any(|word| {
            let bits = cells.bits(word);
            let is_marked = |cells: &[u64], row: usize| cells[row * self.stride + word] & bits != 0;
            is_marked(&self.below, start) || (start + self.reach..end).any(|row| is_marked(&self.cells, row))
        })
    }
}

impl OccupancyMap {
    /// A picture for labels of this height, px.
    fn new(size_px: DVec2, label_px: f64) -> Self {
        let [columns, rows] = (size_px / CELL_PX).ceil().to_array().map(|count| count as u32);
        let marks = || {
            Marks::new(columns.div_ceil(64) as usize, rows as usize, ((label_px / CELL_PX) as usize).max(1))
        };
        Self { balls: marks(), labels: marks(), columns, rows, size_px }
    }

    /// The cells that a box touches.
    fn cells_of(&self, [low, high]: [DVec2; 2]) -> Cells {
        let [left, right] =
            pixels(low.x / CELL_PX, high.x / CELL_PX, [0, self.columns]).map(|at| at as usize);
        let [top, bottom] = pixels(low.y / CELL_PX, high.y / CELL_PX, [0, self.rows]).map(|at| at as usize);
        Cells { words: left / 64..right.div_ceil(64), columns: left..right, rows: top..bottom }
    }

    /// The highest priority that a label's box touches; `None` where the box leaves the picture.
    fn most_in(&self, corners: [DVec2; 2]) -> Option<Occupancy> {
        let [low, high] = corners;
        if low.min_element() < 0.0 || !high.cmple(self.size_px).all() {
            return None;
        }
        let cells = self.cells_of(corners);
        Some(match () {
            () if self.labels.are_in(&cells) => Occupancy::Labels,
            () if self.balls.are_in(&cells) => Occupancy::Balls,
            () => Occupancy::Nothing,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Point;
    use relief_volume::Orbit;

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
        set(labels, 16, None, &lens(), &mut Typesetter::default(), &mut out);
        let stamps: Vec<_> = out.iter().filter(|one| matches!(one.shape, PrimitiveForm::Stamp(_))).collect();
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
