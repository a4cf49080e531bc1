//! The fragments of overlays in the pixels of a band of rows, sorted by depth, and how a pixel
//! becomes one colour and depth.
//!
//! A pixel has 16 sample points. A fragment is the part of one primitive in one pixel: the covered
//! points, and one depth and colour for all of them. Colours are 0..255 in display-referred sRGB;
//! depth is view depth in mm.

use glam::DVec2;

/// Every sample point.
pub(super) const FULL: u16 = u16::MAX;

/// Number of sample points.
const POINTS: f32 = 16.0;

/// Covered sample points from which on a pixel takes the overlay's depth: a half.
const HALF: u32 = 8;

/// Opacity from which on an overlay writes depth.
const DENSE: f32 = 0.5;

/// Most fragments kept of a pixel. Where there are more, the two farthest become one.
const MOST_FRAGMENTS: usize = 32;

/// The sample points of a pixel from its corner: each has a row and a column of sixteenths for
/// itself, so that upright and level edges have 16 steps too.
pub(super) const SAMPLE_POINTS: [DVec2; 16] = {
    let mut points = [DVec2::ZERO; 16];
    let mut i = 0;
    while i < 16 {
        points[i] = DVec2::new((i as f64 + 0.5) / 16.0, ((i * 5 % 16) as f64 + 0.5) / 16.0);
        i += 1;
    }
    points
};

/// The order of layers, whatever their depths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Rank {
    /// Belongs to the picture: nothing hides it.
    Instrument,
    /// Belongs to the scene: the volume may hide it.
    Scene,
}

/// One primitive in one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fragment {
    pub(super) rgb: [f32; 3],
    pub(super) opacity: f32,
    pub(super) depth_mm: f32,
    /// The depth that it gives to a pixel.
    pub(super) shown_mm: f32,
    /// Covered sample points, a bit each.
    pub(super) points: u16,
    pub(super) rank: Rank,
}

impl Fragment {
    fn key(&self) -> (Rank, f32) {
        (self.rank, self.depth_mm)
    }

    fn hides_all_behind(&self) -> bool {
        self.points == FULL && self.opacity >= 1.0
    }

    /// The scene is hidden beyond this depth.
    fn wall_mm(&self) -> f32 {
        if self.rank == Rank::Instrument { f32::NEG_INFINITY } else { self.depth_mm }
    }

    /// Whether the volume is before it.
    fn is_hidden_by(&self, volume_mm: f32) -> bool {
        self.rank == Rank::Scene && self.depth_mm > volume_mm
    }

    fn weight(&self, points: u16) -> f32 {
        points.count_ones() as f32 * self.opacity
    }

    /// This one and one behind it as one: as much colour and opacity in all.
    fn merged(&self, behind: &Self) -> Self {
        let (both, alone) = (self.points & behind.points, behind.points & !self.points);
        let near = self.weight(self.points);
        let far = behind.weight(alone) + behind.weight(both) * (1.0 - self.opacity);
        let sum = (near + far).max(f32::MIN_POSITIVE);
        let points = self.points | behind.points;
        let mix = |i: usize| (near * self.rgb[i] + far * behind.rgb[i]) / sum;
        let opacity = (sum / points.count_ones().max(1) as f32).min(1.0);
        Self { rgb: std::array::from_fn(mix), opacity, points, ..*self }
    }
}

/// No fragment.
const NONE: u32 = u32::MAX;

/// A pixel of a band.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    /// Its nearest fragment; [`NONE`] for an empty pixel.
    first: u32,
    /// Their number.
    count: u32,
    /// Depth from which on nothing is seen, since a fragment hides all behind it: no end where none
    /// does.
    wall_mm: f32,
}

impl Pixel {
    const EMPTY: Self = Self { first: NONE, count: 0, wall_mm: f32::INFINITY };
}

/// A fragment and the one behind it.
#[derive(Clone, Copy, Debug)]
struct LinkedFragment {
    fragment: Fragment,
    next: u32,
}

/// Memory of a band, used again for the next one. Fragments of all pixels lie side by side, in the
/// order in which they came.
#[derive(Default)]
pub(super) struct Scratch {
    pixels: Vec<Pixel>,
    linked: Vec<LinkedFragment>,
    touched: Vec<usize>,
    /// One pixel's fragments, in their order.
    list: Vec<Fragment>,
    /// Sample points of a row.
    pub(super) points: Vec<u16>,
}

/// Rows of a picture that are drawn together.
pub(super) struct Band<'a> {
    /// The first row, and the one after the last.
    pub(super) rows: [u32; 2],
    pub(super) width: u32,
    color_rgba: &'a mut [[u8; 4]],
    depth_mm: &'a mut [f32],
    pub(super) scratch: &'a mut Scratch,
}

impl<'a> Band<'a> {
    /// The rows from one on up to before another, with their pixels.
    pub(super) fn new(
        rows: [u32; 2],
        width: u32,
        color_rgba: &'a mut [[u8; 4]],
        depth_mm: &'a mut [f32],
        scratch: &'a mut Scratch,
    ) -> Self {
        if scratch.pixels.len() < color_rgba.len() {
            scratch.pixels.resize(color_rgba.len(), Pixel::EMPTY);
        }
        Self { rows, width, color_rgba, depth_mm, scratch }
    }

    fn place(&self, column: u32, row: u32) -> usize {
        ((row - self.rows[0]) * self.width + column) as usize
    }

    /// Puts a fragment into a pixel of this band.
    pub(super) fn add(&mut self, column: u32, row: u32, fragment: Fragment) {
        let at = self.place(column, row);
        self.scratch.insert(at, fragment);
    }

    /// Whether a fragment of this rank, as near as this or farther, would be hidden by others in
    /// all of these columns of a row.
    pub(super) fn are_hidden(&self, row: u32, [first, end]: [u32; 2], (rank, mm): (Rank, f32)) -> bool {
        let pixels = &self.scratch.pixels[self.place(first, row)..self.place(end, row)];
        rank == Rank::Scene && pixels.iter().all(|pixel| pixel.wall_mm <= mm)
    }

    /// Converts the collected fragments to colour and depth. Parts behind the volume have
    /// `occluded` of their opacity.
    pub(super) fn resolve(&mut self, occluded: f32) {
        let Scratch { pixels, linked, touched, list, .. } = &mut *self.scratch;
        for at in touched.drain(..) {
            let mut next = std::mem::replace(&mut pixels[at], Pixel::EMPTY).first;
            if let Some(LinkedFragment { fragment, .. }) = linked.get(next as usize)
                && fragment.hides_all_behind()
                && !fragment.is_hidden_by(self.depth_mm[at])
            {
                // The result of the sums in `blend`.
                let [r, g, b] = fragment.rgb.map(byte);
                self.color_rgba[at] = [r, g, b, 255];
                self.depth_mm[at] = fragment.shown_mm;
                continue;
            }
            list.clear();
            while let Some(link) = linked.get(next as usize) {
                list.push(link.fragment);
                next = link.next;
            }
            let volume_mm = self.depth_mm[at];
            let split = list.partition_point(|fragment| !fragment.is_hidden_by(volume_mm));
            let (front, hidden) = list.split_at(split);
            self.color_rgba[at] = blend(front, hidden, occluded, self.color_rgba[at]);
            self.depth_mm[at] = depth_of(front).unwrap_or(volume_mm);
        }
        linked.clear();
    }
}

impl Scratch {
    /// Puts a fragment behind all that are not behind it. Equal ones stay in the order in which
    /// they came.
    fn insert(&mut self, at: usize, fragment: Fragment) {
        let (pixel, linked) = (&mut self.pixels[at], &mut self.linked);
        if pixel.first == NONE {
            self.touched.push(at);
        }
        let (mut before, mut next, mut passed) = (NONE, pixel.first, 0);
        while let Some(link) = linked.get(next as usize)
            && link.fragment.key() <= fragment.key()
        {
            (before, next) = (next, link.next);
            passed += 1;
        }
        if linked.get(before as usize).is_some_and(|link| link.fragment.hides_all_behind()) {
            return;
        }
        pixel.count += 1;
        if fragment.hides_all_behind() {
            (next, pixel.count) = (NONE, passed + 1);
            pixel.wall_mm = fragment.wall_mm();
        }
        let Ok(new) = u32::try_from(linked.len()) else { return };
        linked.push(LinkedFragment { fragment, next });
        match linked.get_mut(before as usize) {
            Some(link) => link.next = new,
            None => pixel.first = new,
        }
        if pixel.count as usize > MOST_FRAGMENTS {
            self.merge_last(at);
        }
    }

    /// Makes one of the two farthest fragments of a pixel.
    fn merge_last(&mut self, at: usize) {
        let (pixel, linked) = (&mut self.pixels[at], &mut self.linked);
        let mut place = pixel.first as usize;
        while let Some(LinkedFragment { next, .. }) = linked.get(place).copied()
            && let Some(last) = linked.get(next as usize).copied()
        {
            if last.next != NONE {
                place = next as usize;
                continue;
            }
            let merged = linked[place].fragment.merged(&last.fragment);
            linked[place] = LinkedFragment { fragment: merged, next: NONE };
            pixel.count -= 1;
            if merged.hides_all_behind() {
                pixel.wall_mm = merged.wall_mm();
            }
        }
    }
}

/// Colour and coverage of a pixel: `front` over `hidden` with a part of its opacity over the
/// volume's picture.
///
/// Hidden fragments hide one another as if the volume were absent; the factor applies to their
/// combined colour.
fn blend(front: &[Fragment], hidden: &[Fragment], occluded: f32, [r, g, b, coverage]: [u8; 4]) -> [u8; 4] {
    if front.iter().chain(hidden).all(|fragment| fragment.opacity >= 1.0) {
        return blend_opaque(front, hidden, occluded, [r, g, b, coverage]);
    }
    let mut rgb = [0.0; 3];
    let mut passing = [1.0f32; 16];
    for fragment in front {
        add(&mut rgb, fragment, attenuate(&mut passing, &[1.0; 16], fragment));
    }
    let mut passing_hidden = [1.0f32; 16];
    for fragment in hidden {
        let share = attenuate(&mut passing_hidden, &passing, fragment);
        add(&mut rgb, fragment, share * occluded);
    }
    let of_volume = |(front, hidden): (&f32, &f32)| front * (1.0 - occluded * (1.0 - hidden)) / POINTS;
    let rest: f32 = passing.iter().zip(&passing_hidden).map(of_volume).sum();
    over_volume(rgb, rest, [r, g, b, coverage])
}

/// The same where every fragment is opaque, so that a sample point is that of one: counting bits
/// comes to the same numbers.
fn blend_opaque(front: &[Fragment], hidden: &[Fragment], occluded: f32, volume: [u8; 4]) -> [u8; 4] {
    let mut rgb = [0.0; 3];
    let mut open = FULL;
    for fragment in front {
        add(&mut rgb, fragment, (fragment.points & open).count_ones() as f32 / POINTS);
        open &= !fragment.points;
    }
    let mut open_hidden = FULL;
    for fragment in hidden {
        let share = (fragment.points & open_hidden & open).count_ones() as f32 / POINTS;
        add(&mut rgb, fragment, share * occluded);
        open_hidden &= !fragment.points;
    }
    let [bare, dimmed] = [0.0, 1.0].map(|hidden: f32| (1.0 - occluded * hidden) / POINTS);
    let of_point = |i: u32| match (open >> i & 1, open_hidden >> i & 1) {
        (0, _) => 0.0,
        (_, 0) => dimmed,
        _ => bare,
    };
    over_volume(rgb, (0..16).map(of_point).sum(), volume)
}

/// The fragments of a pixel over the rest of it, which is the volume's picture.
fn over_volume(rgb: [f32; 3], rest: f32, [r, g, b, coverage]: [u8; 4]) -> [u8; 4] {
    let volume = [r, g, b].map(f32::from);
    let [r, g, b] = std::array::from_fn(|i| byte(rgb[i] + rest * volume[i]));
    [r, g, b, byte(255.0 - rest * (255.0 - f32::from(coverage)))]
}

/// Takes a fragment's opacity out of the light that passes at each sample point; gives the share of the
/// pixel's light that it has, where `before` of it comes that far.
fn attenuate(passing: &mut [f32; 16], before: &[f32; 16], fragment: &Fragment) -> f32 {
    let mut share = 0.0;
    for (i, (passes, arrives)) in passing.iter_mut().zip(before).enumerate() {
        if fragment.points >> i & 1 == 1 {
            share += *passes * arrives * fragment.opacity;
            *passes *= 1.0 - fragment.opacity;
        }
    }
    share / POINTS
}

fn add(rgb: &mut [f32; 3], fragment: &Fragment, share: f32) {
    for (sum, channel) in rgb.iter_mut().zip(fragment.rgb) {
        *sum += share * channel;
    }
}

fn byte(value: f32) -> u8 {
    (value + 0.5).clamp(0.0, 255.0) as u8
}

/// The depth that unhidden fragments give a pixel: one of theirs, where the dense ones cover at
/// least half of it. It is that of the fragment with the largest uncovered part, the nearest of
/// equals; depths are never blended.
fn depth_of(front: &[Fragment]) -> Option<f32> {
    let mut covered = 0u16;
    let mut best: Option<(u32, f32)> = None;
    for fragment in front.iter().filter(|fragment| fragment.opacity >= DENSE) {
        let seen = (fragment.points & !covered).count_ones();
        covered |= fragment.points;
        if best.is_none_or(|(most, _)| seen > most) {
            best = Some((seen, fragment.shown_mm));
        }
    }
    best.filter(|_| covered.count_ones() >= HALF).map(|(_, depth_mm)| depth_mm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fragment(rgb: [f32; 3], opacity: f32, depth_mm: f32, points: u16) -> Fragment {
        Fragment { rgb, opacity, depth_mm, shown_mm: depth_mm, points, rank: Rank::Scene }
    }

    fn resolved(fragments: &[Fragment], volume: ([u8; 4], f32), occluded: f32) -> ([u8; 4], f32) {
        let mut scratch = Scratch::default();
        let (mut color, mut depth) = ([volume.0], [volume.1]);
        let mut band = Band::new([0, 1], 1, &mut color, &mut depth, &mut scratch);
        for &one in fragments {
            band.add(0, 0, one);
        }
        band.resolve(occluded);
        (color[0], depth[0])
    }

    const RED: [f32; 3] = [255.0, 0.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 255.0];
    const GREY: [u8; 4] = [100, 100, 100, 255];

    /// Invariant: The depth of a pixel is that of the volume or of an overlay, never a mixture;
    /// hidden overlays are dimmed and write no depth.
    #[test]
    fn depth_is_taken_from_one_or_the_other_and_never_blended() {
        for count in 0..=16u32 {
            let points = (0xffffu32 << count >> 16) as u16;
            assert_eq!(points.count_ones(), count);
            let one = fragment(RED, 1.0, 50.0, points);
            let (color, depth) = resolved(&[one], (GREY, 80.0), 0.25);
            assert_eq!(depth, if count >= 8 { 50.0 } else { 80.0 }, "{count} of 16 points");
            let red = 100.0 + 155.0 * f64::from(count) / 16.0;
            assert!((f64::from(color[0]) - red).abs() <= 0.5, "{count} of 16 points: {color:?}");
        }
    }

    #[test]
    fn hidden_overlays_are_dimmed_and_write_no_depth() {
        let behind = fragment(RED, 1.0, 90.0, FULL);
        let (color, depth) = resolved(&[behind], (GREY, 80.0), 0.25);
        assert_eq!((color, depth), ([139, 75, 75, 255], 80.0));
        assert_eq!(resolved(&[behind], (GREY, 80.0), 0.0), (GREY, 80.0));
        // A second one behind is hidden by the first: no more than a quarter in all.
        let farther = fragment(BLUE, 1.0, 95.0, FULL);
        assert_eq!(resolved(&[farther, behind], (GREY, 80.0), 0.25).0, color);
        // Where the ray hit nothing, the overlay is all there is.
        assert_eq!(resolved(&[behind], ([9, 9, 9, 0], f32::INFINITY), 0.25), ([255, 0, 0, 255], 90.0));
    }

    /// Words keep their depth order among other parts, at the depth where a display shows them
    /// sharp.
    #[test]
    fn a_pixel_gets_the_depth_that_is_to_be_shown() {
        let word = Fragment { shown_mm: 95.0, ..fragment(RED, 1.0, 50.0, FULL) };
        assert_eq!(resolved(&[word], (GREY, 80.0), 0.25), ([255, 0, 0, 255], 95.0));
    }

    #[test]
    fn translucent_ones_blend_in_order_of_depth_and_write_depth_from_a_half_on() {
        let (near, far) = (fragment(RED, 0.4, 10.0, FULL), fragment(BLUE, 0.5, 20.0, FULL));
        let expected = [0.4 * 255.0, 0.0, 0.6 * 0.5 * 255.0].map(|c: f32| c + 0.3 * 100.0);
        for order in [[near, far], [far, near]] {
            let (color, depth) = resolved(&order, (GREY, 80.0), 0.25);
            for i in 0..3 {
                assert!((f32::from(color[i]) - expected[i]).abs() <= 0.5, "{color:?} for {expected:?}");
            }
            assert_eq!(depth, 20.0, "0.4 is too thin to have a depth");
        }
    }

    #[test]
    fn a_thousand_thin_layers_stay_bounded_and_add_up() {
        let layers: Vec<_> =
            (0..1000u16).map(|i| fragment(RED, 0.01, f32::from(i * 7 % 1000), FULL)).collect();
        let (color, _) = resolved(&layers, ([0, 0, 0, 0], f32::INFINITY), 0.25);
        assert_eq!(color, [255, 0, 0, 255]);
        let mut scratch = Scratch { pixels: vec![Pixel::EMPTY], ..Scratch::default() };
        layers.iter().for_each(|one| scratch.insert(0, *one));
        assert_eq!(scratch.pixels[0].count as usize, MOST_FRAGMENTS);
    }
}
