//! Pre-integrated classification; as `shaders/lib/passage.wgsl`.
//!
//! A sample represents all values on its path: those at its ends, half a sample distance to
//! both sides, and in its middle, and linear between. Values in HU, distances in mm along the rays.

use std::f64::consts::{LN_2, LOG2_E};

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};
use relief_volume::IntegralTable;

use super::super::tables::Tables;

/// Values closer than this, in table entries, are one: a difference of integrals would be rounding.
const ALIKE_ENTRIES: f64 = 8.0;

/// A transfer table and its integrals over values.
pub(super) struct Integrals<'a, L: Lanes> {
    lanes: L,
    entries: &'a [[f32; 4]],
    integrals: &'a [[f32; 4]],
    first_hu: L::Real,
    step_hu: L::Real,
    last: L::Real,
}

/// A passage as two samples in a row, each with half of the path: colour, and contribution.
pub(super) struct Passed<L: Lanes> {
    pub(super) front: [L::Real; 4],
    pub(super) back: [L::Real; 4],
}

impl<L: Lanes> Passed<L> {
    #[inline(always)]
    pub(super) fn opacity(&self) -> L::Real {
        self.front[3] + self.back[3]
    }
}

impl<'a, L: Lanes> Integrals<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, tables: &'a Tables, integral: &'a IntegralTable) -> Self {
        let table = &tables.own;
        Self {
            lanes,
            entries: &table.entries,
            integrals: &integral.entries,
            first_hu: lanes.splat(table.first_hu.into()),
            step_hu: lanes.splat(table.step_hu.into()),
            last: lanes.splat((table.entries.len() - 1) as f64),
        }
    }

    /// The two halves of passages; without opacity where nothing from the lowest to the highest value
    /// is visible.
    #[inline(always)]
    pub(super) fn passed(&self, [front, middle, back]: [L::Real; 3]) -> Passed<L> {
        let number = |x: f64| self.lanes.splat(x);
        let (zero, one) = (number(0.0), number(1.0));
        let (low, high) = (front.min(middle).min(back), front.max(middle).max(back));
        let is_visible = self.is_visible_between(low, high);
        let bend = (front - middle * number(2.0) + back) / number(12.0);
        let (front, middle, back) = (front - bend, middle - bend, back - bend);
        let [front_r, front_g, front_b, front_depth] = self.half_passed(front, middle);
        let [back_r, back_g, back_b, back_depth] = self.half_passed(middle, back);
        let through = (front_depth * number(-LOG2_E)).exp2();
        let added = through * (one - (back_depth * number(-LOG2_E)).exp2());
        let (front_depth, back_depth) = (front_depth.max(number(1e-12)), back_depth.max(number(1e-12)));
        Passed {
            front: [
                front_r / front_depth,
                front_g / front_depth,
                front_b / front_depth,
                (one - through).or_where_not(is_visible, zero),
            ],
            back: [
                back_r / back_depth,
                back_g / back_depth,
                back_b / back_depth,
                added.or_where_not(is_visible, zero),
            ],
        }
    }

    /// Whether any entry from one value to the other is visible: equal sums mean that nothing lies
    /// between them. Empty bricks must show nothing, although lines reach beyond the values that they
    /// connect.
    #[inline(always)]
    fn is_visible_between(&self, low: L::Real, high: L::Real) -> L::Mask {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let first = self.position(low).floor().clamped(zero, self.last - one);
        let end = self.position(high).ceil().clamped(zero, self.last).max(first + one);
        let [_, _, _, to_first] = self.lanes.entries(self.integrals, self.lanes.place(first));
        let [_, _, _, to_end] = self.lanes.entries(self.integrals, self.lanes.place(end));
        to_first.lt(to_end)
    }

    /// Half a sample's path from one value to another: colour times optical depth, and optical depth.
    #[inline(always)]
    fn half_passed(&self, front: L::Real, back: L::Real) -> [L::Real; 4] {
        let number = |x: f64| self.lanes.splat(x);
        let change = back - front;
        let is_alike = change.abs().lt(self.step_hu * number(ALIKE_ENTRIES));
        let [r, g, b, opacity] =
            self.mixed(self.entries, self.inside(self.position((front + back) * number(0.5))));
        let depth = self.optical_depth(opacity) * number(0.5);
        if !(!is_alike).any() {
            return [r * depth, g * depth, b * depth, depth];
        }
        let share = number(0.5) / number(1.0).or_where_not(is_alike, change);
        let [to_r, to_g, to_b, to_depth] = self.integral_to(back);
        let [from_r, from_g, from_b, from_depth] = self.integral_to(front);
        [
            (r * depth).or_where_not(is_alike, (to_r - from_r) * share),
            (g * depth).or_where_not(is_alike, (to_g - from_g) * share),
            (b * depth).or_where_not(is_alike, (to_b - from_b) * share),
            depth.or_where_not(is_alike, (to_depth - from_depth) * share),
        ]
    }

    /// The integrals up to values. Beyond the table its end goes on.
    #[inline(always)]
    fn integral_to(&self, hu: L::Real) -> [L::Real; 4] {
        let x = self.position(hu);
        let inside = self.inside(x);
        let sum = self.mixed(self.integrals, inside);
        let beyond = (x - inside) * self.step_hu;
        if !(x.lt(inside) | inside.lt(x)).any() {
            return sum;
        }
        let end = self.last.or_where_not(inside.lt(x), self.lanes.splat(0.0));
        let [r, g, b, opacity] = self.lanes.entries(self.entries, self.lanes.place(end));
        let depth = self.optical_depth(opacity) * beyond;
        [sum[0] + r * depth, sum[1] + g * depth, sum[2] + b * depth, sum[3] + depth]
    }

    /// Between an entry and the next, at a position inside the table.
    #[inline(always)]
    fn mixed(&self, table: &[[f32; 4]], inside: L::Real) -> [L::Real; 4] {
        let one = self.lanes.splat(1.0);
        let i = inside.floor().min(self.last - one);
        let share = inside - i;
        let [[r, g, b, a], [r_behind, g_behind, b_behind, a_behind]] =
            self.lanes.entry_pairs(table, self.lanes.place(i));
        [r.lerp(r_behind, share), g.lerp(g_behind, share), b.lerp(b_behind, share), a.lerp(a_behind, share)]
    }

    #[inline(always)]
    fn optical_depth(&self, opacity: L::Real) -> L::Real {
        let number = |x: f64| self.lanes.splat(x);
        let transparency = (number(1.0) - opacity).max(number(1e-30));
        (transparency.log2() * number(-LN_2)).min(number(IntegralTable::OPAQUE_DEPTH))
    }

    #[inline(always)]
    fn position(&self, hu: L::Real) -> L::Real {
        (hu - self.first_hu) / self.step_hu
    }

    #[inline(always)]
    fn inside(&self, x: L::Real) -> L::Real {
        x.clamped(self.lanes.splat(0.0), self.last)
    }
}

/// Colours of the first three numbers.
#[inline(always)]
pub(super) fn rgb<R: Copy>([r, g, b, _]: [R; 4]) -> Triple<R> {
    Triple([r, g, b])
}
