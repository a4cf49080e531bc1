//! What overlays put into the pixels of a band of rows, sorted by depth, and how a pixel becomes one colour and depth.
//!
//! A pixel has 16 sample points. A fragment is what one primitive has in one pixel: which of the points it covers, and
//! one depth and colour for them all. Colours are 0..255 in display-referred sRGB; depth is view depth in mm.

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

/// The sample points of a pixel from its corner: each has a row and a column of sixteenths for itself, so that upright
/// and level edges have 16 steps too.
pub(super) fn sample_points() -> [DVec2; 16] {
    std::array::from_fn(|i| DVec2::new(i as f64 + 0.5, (i * 5 % 16) as f64 + 0.5) / 16.0)
}

/// What stands before what, whatever the depths.
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

/// Memory of a band, used again for the next one.
#[derive(Default)]
pub(super) struct Scratch {
    pixels: Vec<Vec<Fragment>>,
    touched: Vec<usize>,
}

/// Rows of a picture that are drawn together.
pub(super) struct Band<'a> {
    /// The first row, and the one after the last.
    pub(super) rows: [u32; 2],
    pub(super) width: u32,
    pub(super) color_rgba: &'a mut [[u8; 4]],
    pub(super) depth_mm: &'a mut [f32],
    pub(super) scratch: &'a mut Scratch,
}

impl Band<'_> {
    /// Puts a fragment into a pixel of this band.
    pub(super) fn add(&mut self, column: u32, row: u32, fragment: Fragment) {
        let at = ((row - self.rows[0]) * self.width + column) as usize;
        let Scratch { pixels, touched } = &mut *self.scratch;
        if pixels.len() < self.color_rgba.len() {
            pixels.resize_with(self.color_rgba.len(), Vec::new);
        }
        let list = &mut pixels[at];
        if list.is_empty() {
            touched.push(at);
        }
        insert(list, fragment);
    }

    /// Whether a fragment of this rank, as near as this or farther, would be hidden by others of its pixel, whatever it is.
    pub(super) fn is_hidden(&self, column: u32, row: u32, key: (Rank, f32)) -> bool {
        let at = ((row - self.rows[0]) * self.width + column) as usize;
        let last = self.scratch.pixels.get(at).and_then(|list| list.last());
        last.is_some_and(|last| last.hides_all_behind() && last.key() <= key)
    }

    /// Turns what was added into colour and depth. What lies behind the volume has `occluded` of its opacity.
    pub(super) fn resolve(&mut self, occluded: f32) {
        let Scratch { pixels, touched } = &mut *self.scratch;
        for at in touched.drain(..) {
            let list = &mut pixels[at];
            let volume_mm = self.depth_mm[at];
            let split = list.partition_point(|fragment| !fragment.is_hidden_by(volume_mm));
            let (front, hidden) = list.split_at(split);
            self.color_rgba[at] = blend(front, hidden, occluded, self.color_rgba[at]);
            self.depth_mm[at] = depth_of(front).unwrap_or(volume_mm);
            list.clear();
        }
    }
}

/// Puts a fragment behind all that are not behind it. Equal ones stay in the order in which they came.
fn insert(list: &mut Vec<Fragment>, fragment: Fragment) {
    let at = list.partition_point(|known| known.key() <= fragment.key());
    if list[..at].last().is_some_and(Fragment::hides_all_behind) {
        return;
    }
    if fragment.hides_all_behind() {
        list.truncate(at);
    }
    list.insert(at, fragment);
    if list.len() > MOST_FRAGMENTS
        && let Some(last) = list.pop()
        && let Some(before) = list.last_mut()
    {
        *before = before.merged(&last);
    }
}

/// Colour and coverage of a pixel: `front` over `hidden` with a part of its opacity over the volume's picture.
///
/// Hidden fragments hide one another as if they were seen alone; the share is of what is then seen of them all.
fn blend(front: &[Fragment], hidden: &[Fragment], occluded: f32, [r, g, b, coverage]: [u8; 4]) -> [u8; 4] {
    if let [only, ..] = front
        && only.hides_all_behind()
    {
        // What the sums below come to.
        let [r, g, b] = only.rgb.map(byte);
        return [r, g, b, 255];
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
    let volume = [r, g, b].map(f32::from);
    let [r, g, b] = std::array::from_fn(|i| byte(rgb[i] + rest * volume[i]));
    [r, g, b, byte(255.0 - rest * (255.0 - f32::from(coverage)))]
}

/// Takes a fragment's opacity out of what passes at each sample point; gives the share of the pixel's light that it has,
/// where `before` of it comes that far.
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

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
fn byte(value: f32) -> u8 {
    (value + 0.5).clamp(0.0, 255.0) as u8
}

/// The depth that unhidden fragments give a pixel: one of theirs, where the dense ones cover at least half of it. It is
/// that of the fragment with the largest uncovered part, the nearest of equals; depths are never blended.
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
        let mut band = Band {
            rows: [0, 1],
            width: 1,
            color_rgba: &mut color,
            depth_mm: &mut depth,
            scratch: &mut scratch,
        };
        for &one in fragments {
            band.add(0, 0, one);
        }
        band.resolve(occluded);
        (color[0], depth[0])
    }

    const RED: [f32; 3] = [255.0, 0.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 255.0];
    const GREY: [u8; 4] = [100, 100, 100, 255];

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
    fn what_the_volume_hides_is_dimmed_and_writes_no_depth() {
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

    /// Words keep their place among what is before and behind, and stand where they can be read.
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
        let mut list = Vec::new();
        layers.iter().for_each(|one| insert(&mut list, *one));
        assert_eq!(list.len(), MOST_FRAGMENTS);
    }
}
