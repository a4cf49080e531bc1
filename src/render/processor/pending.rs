//! Visible samples that wait until a full vector of them can be lit.
//!
//! Lights need gradients, which are slow, and few neighbouring rays are visible at the same sample. A
//! sample has N components: its position (voxel index) first, its weight last.

use relief_lanes::{Lanes, MOST_LANES, Mask as _, Real as _, Triple};

use super::ray::Rays;

/// Room for samples: fewer than there are lanes wait, and twice as many may be added at once.
const WAITING: usize = 4 * MOST_LANES;

/// Visible samples that are not lit yet, and the colours of those that are.
pub(super) struct Pending<L: Lanes, const N: usize> {
    lanes: L,
    /// Component after component.
    samples: [[L::Scalar; WAITING]; N],
    /// The lanes of their rays.
    rays: [u8; WAITING],
    pub(super) len: usize,
    directions: [[L::Scalar; MOST_LANES]; 3],
    sums: [[L::Scalar; MOST_LANES]; 3],
}

impl<L: Lanes, const N: usize> Pending<L, N> {
    #[inline(always)]
    pub(super) fn new(lanes: L, rays: &Rays<L>) -> Self {
        let zero = lanes.scalar(0.0);
        let mut directions = [[zero; MOST_LANES]; 3];
        rays.direction.0[0].store(&mut directions[0]);
        rays.direction.0[1].store(&mut directions[1]);
        rays.direction.0[2].store(&mut directions[2]);
        let samples = [[zero; WAITING]; N];
        let (rays, sums) = ([0; WAITING], [[zero; MOST_LANES]; 3]);
        Self { lanes, samples, rays, len: 0, directions, sums }
    }

    /// Appends the samples of the chosen lanes. Fewer than there are lanes wait.
    #[inline(always)]
    pub(super) fn push(&mut self, sample: [L::Real; N], chosen: L::Mask) {
        for (numbers, waiting) in sample.into_iter().zip(&mut self.samples) {
            self.lanes.gathered(numbers, chosen).store(&mut waiting[self.len..]);
        }
        let mut bits = chosen.bits();
        while bits != 0 {
            self.rays[self.len] = bits.trailing_zeros() as u8;
            self.len += 1;
            bits &= bits - 1;
        }
    }

    /// The first samples, one in each lane, and the directions of their rays. Lanes beyond those
    /// that wait hold older samples.
    #[inline(always)]
    pub(super) fn front(&self) -> ([L::Real; N], Triple<L::Real>) {
        let mut sample = [self.lanes.splat(0.0); N];
        for (numbers, waiting) in sample.iter_mut().zip(&self.samples) {
            *numbers = self.lanes.load(waiting);
        }
        let along = |axis: usize| self.lanes.chosen(&self.directions[axis], &self.rays);
        (sample, Triple([along(0), along(1), along(2)]))
    }

    /// Adds the light of the first samples to their rays, and forgets them.
    #[inline(always)]
    pub(super) fn add(&mut self, light: Triple<L::Real>) {
        let done = self.len.min(L::COUNT);
        let mut shares = [[self.lanes.scalar(0.0); MOST_LANES]; 3];
        light.0[0].store(&mut shares[0]);
        light.0[1].store(&mut shares[1]);
        light.0[2].store(&mut shares[2]);
        for (sums, shares) in self.sums.iter_mut().zip(&shares) {
            for (share, &ray) in shares[..done].iter().zip(&self.rays) {
                let sum = &mut sums[usize::from(ray) % MOST_LANES];
                *sum = *sum + *share;
            }
        }
        self.len -= done;
        for to in (0..self.len).step_by(L::COUNT) {
            for component in &mut self.samples {
                self.lanes.load(&component[to + L::COUNT..]).store(&mut component[to..]);
            }
        }
        for i in 0..self.len {
            self.rays[i] = self.rays[i + L::COUNT];
        }
    }

    /// The colours of the rays.
    #[inline(always)]
    pub(super) fn colors(&self) -> Triple<L::Real> {
        let [red, green, blue] = &self.sums;
        Triple([self.lanes.load(red), self.lanes.load(green), self.lanes.load(blue)])
    }
}
