//! Segments of a label map; as `shaders/lib/labels.wgsl`.
//!
//! Spaces: voxel index, HU. The table has the request's own entries, two for the look of each place
//! in the list of segments, and the entries of further transfer functions: see `tables`.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};
use relief_volume::SegmentIndices;

use super::super::labels::{Edges, Labels};
use super::super::tables::Tables;

/// The label map of a request and the looks of its segments.
pub(super) struct Segments<'a, L: Lanes> {
    lanes: L,
    places: &'a SegmentIndices,
    edges: Edges,
    entries: &'a [[f32; 4]],
    first_look: L::Real,
    strides: [i32; 2],
    last: Triple<L::Real>,
}

impl<'a, L: Lanes> Segments<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, labels: &'a Labels, entries: &'a [[f32; 4]], tables: &Tables) -> Self {
        let [nx, ny, nz] = labels.map.grid().dims();
        Self {
            lanes,
            places: labels.map.places(),
            edges: labels.edges,
            entries,
            first_look: lanes.splat(tables.own.entries.len() as f64),
            strides: [nx as i32, (nx * ny) as i32],
            last: Triple([nx, ny, nz].map(|side| lanes.splat((side - 1) as f64))),
        }
    }

    /// Colour and opacity of values at positions.
    #[inline(always)]
    pub(super) fn classify(&self, p: Triple<L::Real>, hu: L::Real) -> [L::Real; 4] {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let at = self.look_at(p);
        let [first_hu, entries_per_hu, first, last] = self.look(at);
        let [tint_r, tint_g, tint_b, stays] = self.look(at + one);
        let x = ((hu - first_hu) * entries_per_hu).clamped(zero, last);
        let i = x.floor().min((last - one).max(zero));
        let [r, g, b, opacity] = self.mixed(first + i, x - i);
        let is_shown = zero.lt(last);
        [r * stays + tint_r, g * stays + tint_g, b * stays + tint_b, opacity.or_where_not(is_shown, zero)]
    }

    /// The lanes in which the segment is visible.
    #[inline(always)]
    pub(super) fn is_shown(&self, p: Triple<L::Real>) -> L::Mask {
        let [_, _, _, last] = self.look(self.look_at(p));
        self.lanes.splat(0.0).lt(last)
    }

    #[inline(always)]
    fn look(&self, at: L::Real) -> [L::Real; 4] {
        self.lanes.entries(self.entries, self.lanes.place(at))
    }

    /// Between an entry and the next.
    #[inline(always)]
    fn mixed(&self, at: L::Real, share: L::Real) -> [L::Real; 4] {
        let [[r, g, b, a], [r_behind, g_behind, b_behind, a_behind]] =
            self.lanes.entry_pairs(self.entries, self.lanes.place(at));
        [r.lerp(r_behind, share), g.lerp(g_behind, share), b.lerp(b_behind, share), a.lerp(a_behind, share)]
    }

    /// The entries of the looks at positions.
    #[inline(always)]
    fn look_at(&self, p: Triple<L::Real>) -> L::Real {
        let place = match self.edges {
            Edges::Voxels => self.place(p.plus(Triple::of(self.lanes.splat(0.5))).floor()),
            Edges::Smooth => self.weightiest(p),
        };
        self.first_look + place + place
    }

    /// The place in the list of segments of voxels, or of the outermost voxels before them.
    #[inline(always)]
    fn place(&self, voxel: Triple<L::Real>) -> L::Real {
        let voxel = voxel.max(Triple::of(self.lanes.splat(0.0))).min(self.last);
        let at = self.lanes.places(voxel, self.strides);
        match self.places {
            SegmentIndices::Bytes(places) => self.lanes.numbers(places, at),
            SegmentIndices::Words(places) => self.lanes.numbers(places, at),
        }
    }

    /// Of the eight voxels around a position, the segment whose voxels have the greatest trilinear
    /// weight together; of equal ones the first.
    #[inline(always)]
    fn weightiest(&self, p: Triple<L::Real>) -> L::Real {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let base = p.floor();
        let Triple(high) = p.minus(base);
        let mut places = [zero; 8];
        let mut weights = [zero; 8];
        let mut differ = self.lanes.first(0);
        for corner in 0..8 {
            let step = |axis: usize| if corner >> axis & 1 == 1 { one } else { zero };
            let share = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { one - high[axis] };
            places[corner] = self.place(base.plus(Triple([step(0), step(1), step(2)])));
            weights[corner] = share(0) * share(1) * share(2);
            differ = differ | !is_equal::<L>(places[corner], places[0]);
        }
        if !differ.any() {
            return places[0];
        }
        let (mut best, mut greatest) = (zero, -one);
        for corner in 0..8 {
            let mut weight = zero;
            for other in 0..8 {
                let is_same = is_equal::<L>(places[corner], places[other]);
                weight = weight + weights[other].or_where_not(is_same, zero);
            }
            let is_greater = greatest.lt(weight);
            best = places[corner].or_where_not(is_greater, best);
            greatest = weight.or_where_not(is_greater, greatest);
        }
        best
    }
}

#[inline(always)]
fn is_equal<L: Lanes>(a: L::Real, b: L::Real) -> L::Mask {
    a.le(b) & b.le(a)
}
