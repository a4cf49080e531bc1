//! Visible samples that wait until a full vector of them can be lit.
//!
//! Lights need gradients, which are slow, and few neighbouring rays are visible at the same sample. A
//! sample has N components: its position (voxel index) first, its weight last.

use relief_lanes::{Lanes, MOST_LANES, Mask as _, Real as _, Triple};

use super::ray::Rays;

/// Room for samples: fewer than there are lanes wait, and twice as many may be added at once.
const WAITING: usize = 3 * MOST_LANES;

/// Visible samples that are not lit yet, and the colours of those that are.
pub(super) struct Pending<L: Lanes, const N: usize> {
    lanes: L,
    /// Component after component.
    samples: [[L::Scalar; WAITING]; N],
    /// The lanes of their rays.
    rays: [L::Scalar; WAITING],
    pub(super) len: usize,
    /// Samples that were added at once: a bit for the lane of each that still waits. A ring.
    groups: [u32; WAITING],
    first_group: usize,
    last_group: usize,
    /// 0, 1, 2 and so on.
    lane_numbers: L::Real,
    directions: Triple<L::Real>,
    /// Of their rays: see [`Rays::face_normals`].
    pub(super) face_normals: [Triple<L::Real>; 2],
    sums: Triple<L::Real>,
}

impl<L: Lanes, const N: usize> Pending<L, N> {
    #[inline(always)]
    pub(super) fn new(lanes: L, rays: &Rays<L>) -> Self {
        let zero = lanes.scalar(0.0);
        Self {
            lanes,
            samples: [[zero; WAITING]; N],
            rays: [zero; WAITING],
            len: 0,
            groups: [0; WAITING],
            first_group: 0,
            last_group: 0,
            lane_numbers: lanes.by_lane(|lane| lane as f64),
            directions: rays.direction,
            face_normals: rays.face_normals,
            sums: Triple::of(lanes.splat(0.0)),
        }
    }

    /// Appends the samples of the chosen lanes, of which there are some. Fewer than there are lanes
    /// wait.
    #[inline(always)]
    pub(super) fn push(&mut self, sample: [L::Real; N], chosen: L::Mask) {
        for (numbers, waiting) in sample.into_iter().zip(&mut self.samples) {
            self.lanes.gathered(numbers, chosen).store(&mut waiting[self.len..]);
        }
        self.lanes.gathered(self.lane_numbers, chosen).store(&mut self.rays[self.len..]);
        let bits = chosen.bits();
        self.len += bits.count_ones() as usize;
        self.groups[self.last_group % WAITING] = bits;
        self.last_group = (self.last_group + 1) % WAITING;
    }

    /// The first samples, one in each lane, and the directions of their rays. Lanes beyond those
    /// that wait hold older samples.
    #[inline(always)]
    pub(super) fn front(&self) -> ([L::Real; N], Triple<L::Real>) {
        let mut sample = [self.lanes.splat(0.0); N];
        for (numbers, waiting) in sample.iter_mut().zip(&self.samples) {
            *numbers = self.lanes.load(waiting);
        }
        (sample, self.of_rays(self.directions))
    }

    /// The values of the rays of the first samples.
    #[inline(always)]
    pub(super) fn of_rays(&self, Triple([x, y, z]): Triple<L::Real>) -> Triple<L::Real> {
        // No `map`: it would be a call without the vector instructions.
        Triple([self.number_of_rays(x), self.number_of_rays(y), self.number_of_rays(z)])
    }

    /// The same of a number.
    #[inline(always)]
    pub(super) fn number_of_rays(&self, value: L::Real) -> L::Real {
        self.lanes.permuted(value, self.lanes.place(self.lanes.load(&self.rays)))
    }

    /// Adds the light of the first samples to their rays, and forgets them.
    #[inline(always)]
    pub(super) fn add(&mut self, light: Triple<L::Real>) {
        let Triple([red, green, blue]) = light;
        let done = self.len.min(L::COUNT);
        let mut before = 0;
        while before < done {
            let bits = self.next_group(done - before);
            let group = self.lanes.mask(bits);
            let places = self.lane_numbers + self.lanes.splat(before as f64);
            let places = self.lanes.place(self.lanes.spread(places, group));
            let share = Triple([
                self.lanes.permuted(red, places),
                self.lanes.permuted(green, places),
                self.lanes.permuted(blue, places),
            ]);
            self.sums = self.sums.plus(share).or_where_not([group; 3], self.sums);
            before += bits.count_ones() as usize;
        }
        self.len -= done;
        for to in (0..self.len).step_by(L::COUNT) {
            for component in &mut self.samples {
                self.lanes.load(&component[to + L::COUNT..]).store(&mut component[to..]);
            }
            self.lanes.load(&self.rays[to + L::COUNT..]).store(&mut self.rays[to..]);
        }
    }

    /// Takes the lanes of the first group that waits, at most a number of them.
    #[inline(always)]
    fn next_group(&mut self, most: usize) -> u32 {
        let group = &mut self.groups[self.first_group % WAITING];
        let mut rest = *group;
        if most < rest.count_ones() as usize {
            for _ in 0..most {
                rest &= rest - 1;
            }
            let first = *group & !rest;
            *group = rest;
            return first;
        }
        self.first_group = (self.first_group + 1) % WAITING;
        rest
    }

    /// The colours of the rays.
    #[inline(always)]
    pub(super) fn colors(&self) -> Triple<L::Real> {
        self.sums
    }
}
