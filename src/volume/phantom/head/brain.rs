//! The brain: hemispheres with folds, ventricles, deep grey matter, cerebellum and brain stem.
//!
//! Folds are made as growth makes them, not as an atlas has them: sulci are sheets that run inwards
//! from the surface along the zeros of a warped noise, so they look like folds without being any
//! person's.

use glam::Vec3;

use super::super::noise::{gradient_noise, vector_noise};
use super::super::sdf::{Box3, Field, LocalField, ball, block, cone, ellipsoid, smooth_max, smooth_step};
use super::edge::Edge;

pub(super) const CSF_HU: f32 = 8.0;
pub(super) const GREY_HU: f32 = 40.0;
pub(super) const WHITE_HU: f32 = 27.0;
pub(super) const DURA_HU: f32 = 58.0;
pub(super) const CALCIFIED_HU: f32 = 260.0;

/// Fluid between the inner table and the brain, mm.
const SUBARACHNOID_MM: f32 = 2.0;
/// Thickness of the cortex, mm.
const CORTEX_MM: f32 = 3.0;
/// Width of a fold, mm.
const FOLD_MM: f32 = 12.0;
/// The point at which folds converge, and the semi-axes over which they are spread.
const HUB: Vec3 = Vec3::new(0.0, 4.0, 36.0);
const SPREAD: Vec3 = Vec3::new(62.0, 80.0, 62.0);

/// Parts of the brain that have shapes of their own.
pub(super) struct Brain {
    ventricles: Field,
    deep_grey: Field,
    callosum: Field,
    stem: Field,
    cerebellum: Field,
    calcified: Field,
}

/// The part of a [`Brain`] near a block of voxels.
pub(super) struct LocalBrain<'a> {
    ventricles: LocalField<'a>,
    deep_grey: LocalField<'a>,
    callosum: LocalField<'a>,
    stem: LocalField<'a>,
    cerebellum: LocalField<'a>,
    calcified: LocalField<'a>,
}

impl Brain {
    pub(super) fn new() -> Self {
        Self {
            ventricles: ventricles(),
            deep_grey: deep_grey(),
            callosum: callosum(),
            stem: stem(),
            cerebellum: cerebellum(),
            calcified: calcified(),
        }
    }

    pub(super) fn near(&self, region: &Box3) -> LocalBrain<'_> {
        LocalBrain {
            ventricles: self.ventricles.near(region),
            deep_grey: self.deep_grey.near(region),
            callosum: self.callosum.near(region),
            stem: self.stem.near(region),
            cerebellum: self.cerebellum.near(region),
            calcified: self.calcified.near(region),
        }
    }
}

impl LocalBrain<'_> {
    /// HU of a point at a signed distance from the wall of the cranial cavity (negative inside),
    /// mm.
    pub(super) fn hu(&self, p: Vec3, cavity: f32, edge: Edge, seed: u64) -> f32 {
        let below = posterior_fossa(p);
        let mut hu = CSF_HU;
        hu = edge.paint(hu, DURA_HU, -cavity - 0.9);
        hu = edge.paint(hu, DURA_HU, below.abs() - 0.7);
        let callosum = self.callosum.distance(p);
        let falx = (p.x.abs() - 0.6).max(6.0 - callosum).max(below);
        hu = edge.paint(hu, DURA_HU, falx);
        if below > -4.0 {
            hu = self.cerebrum(hu, p, cavity, below, callosum, edge, seed);
        }
        hu = self.hindbrain(hu, p, cavity, below, edge, seed);
        let ripple = 0.5 * gradient_noise(p * 0.12, seed ^ 0x7e17);
        hu = edge.paint(hu, CSF_HU, self.ventricles.distance(p) + ripple);
        edge.paint(hu, CALCIFIED_HU, self.calcified.distance(p))
    }

    #[expect(clippy::too_many_arguments, reason = "distances that the caller has already")]
    fn cerebrum(
        &self,
        hu: f32,
        p: Vec3,
        cavity: f32,
        below: f32,
        callosum: f32,
        edge: Edge,
        seed: u64,
    ) -> f32 {
        let fissure = (p.x.abs() - 1.9).max(1.5 - callosum);
        let outer = (cavity + SUBARACHNOID_MM).max(1.8 - below);
        let surface = smooth_max(outer, -fissure, 3.0);
        let surface = smooth_max(surface, -sylvian_fissure(p), 3.0);
        if surface > 2.0 {
            return hu;
        }
        let pia = (-surface).min(sulcus_distance(p, -surface, seed));
        let bark = CORTEX_MM + 0.5 * gradient_noise(p * 0.2, seed ^ 0xc0e7);
        let deep = self.deep_grey.distance(p);
        let tissue = WHITE_HU + (GREY_HU - WHITE_HU) * edge.cover(pia - bark).max(edge.cover(deep));
        let tissue = tissue + (WHITE_HU - tissue) * edge.cover(callosum);
        hu + (tissue - hu) * edge.cover(-pia)
    }

    fn hindbrain(&self, hu: f32, p: Vec3, cavity: f32, below: f32, edge: Edge, seed: u64) -> f32 {
        let stem = self.stem.distance(p);
        let lobes = self.cerebellum.distance(p);
        let cerebellum = lobes.max(cavity + 1.5).max(below + 1.5);
        let hu = if cerebellum < 2.0 { self.folia(hu, p, cerebellum, edge, seed) } else { hu };
        edge.paint(hu, 0.5 * (WHITE_HU + GREY_HU), stem.max(cavity + 1.2))
    }

    /// The cerebellum's thin leaves: layers of cortex around a tree of white matter.
    fn folia(&self, hu: f32, p: Vec3, surface: f32, edge: Edge, seed: u64) -> f32 {
        let bend = 0.9 * gradient_noise(p * 0.07, seed ^ 0xf01a);
        let layer = (p.z + 0.25 * p.y) / 4.2 + bend;
        let gap = (layer - layer.floor() - 0.5).abs() * 4.2;
        let cleft = (gap - 0.75).max(-surface - 6.0);
        let pia = (-surface).min(cleft);
        let tissue = GREY_HU + (WHITE_HU - GREY_HU) * edge.cover(6.5 + surface + 1.5 * bend);
        hu + (tissue - hu) * edge.cover(-pia)
    }
}

/// Distance to fluid in the nearest sulcus at a depth below the surface of a hemisphere, mm.
fn sulcus_distance(p: Vec3, depth: f32, seed: u64) -> f32 {
    if depth > 26.0 {
        return f32::MAX;
    }
    let spread = (p - HUB) / SPREAD;
    let direction = spread / spread.length().max(0.2) * 70.0; // nearly constant along the way inwards
    let bent = direction
        + 9.0 * vector_noise(direction / 30.0, seed ^ 0x5a1c)
        + 0.3 * (p - HUB)
        + 9.0 * vector_noise(p / 22.0, seed ^ 0xbe4d);
    let fold = gradient_noise(bent / FOLD_MM, seed ^ 0x9417);
    // The noise crosses zero with a slope of about 1.5 per unit.
    let sideways = fold.abs() * FOLD_MM / 1.5;
    let end = 9.5 + 6.0 * gradient_noise(direction / 17.0, seed ^ 0xdee9);
    let half_width = 1.25 - 0.9 * smooth_step(0.0, end, depth);
    let beyond = (depth - end).max(0.0);
    (sideways * sideways + beyond * beyond).sqrt() - half_width
}

/// Signed distance to the space under the tentorium, mm: negative in the posterior fossa.
pub(super) fn posterior_fossa(p: Vec3) -> f32 {
    let (x, y) = (p.x, 0.8 * (p.y - 25.0));
    let tentorium = 35.0 - 0.55 * (x * x + y * y + 20.0).sqrt();
    let ridge = 0.42 * x.abs() - 16.0;
    let under = (p.z - tentorium) / 1.14;
    let behind = (ridge - p.y) / 1.08;
    // The brain stem passes the notch in front of the tentorium's free edge.
    under.max(behind)
}

/// Signed distance to the cleft between the temporal lobe and the lobes above it, mm.
fn sylvian_fissure(p: Vec3) -> f32 {
    let x = p.x.abs();
    let sheet = (p.z - 33.0 - 0.32 * (p.y + 20.0)).abs() / 1.05 - 1.1;
    let cleft = sheet.max(34.0 - x).max((p.y + 2.0).abs() - 30.0);
    let island = ((x - 34.5).abs() - 1.0).max((p.z - 40.0).abs() - 12.0).max((p.y + 2.0).abs() - 24.0);
    cleft.min(island)
}

fn ventricles() -> Field {
    let mut csf = Field::new(3.0);
    csf.join_path(
        0.0,
        &[
            [6.5, -32.0, 49.0, 3.5],
            [9.5, -20.0, 57.0, 6.4],
            [9.8, 0.0, 62.0, 5.8],
            [14.0, 20.0, 61.0, 6.0],
            [24.0, 38.0, 50.0, 8.0],
            [31.0, 30.0, 36.0, 5.0],
            [34.0, 12.0, 26.0, 3.4],
            [33.0, -4.0, 22.0, 2.6],
        ],
    );
    csf.join_path(
        0.0,
        &[
            [-6.5, -31.0, 49.0, 3.2],
            [-9.0, -20.0, 57.0, 6.0],
            [-9.5, 0.0, 62.0, 5.5],
            [-14.0, 20.0, 61.0, 5.7],
            [-24.0, 38.0, 50.0, 7.6],
            [-31.0, 30.0, 36.0, 4.7],
            [-34.0, 12.0, 26.0, 3.2],
            [-33.0, -4.0, 22.0, 2.5],
        ],
    );
    csf.join_both(2.0, cone([24.0, 38.0, 50.0], 6.0, [20.0, 60.0, 43.0], 2.8)); // occipital horn
    csf.join_both(2.0, cone([8.5, -24.0, 54.0], 4.2, [3.0, 0.0, 61.0], 1.8));
    csf.join(1.0, block([0.0, 4.0, 43.0], [1.7, 13.0, 9.0], 1.6)); // third ventricle
    csf.join_both(1.0, cone([1.5, -6.0, 50.0], 1.3, [7.0, -10.0, 55.0], 1.6)); // foramen of Monro
    csf.join(0.5, cone([0.0, 17.0, 36.0], 1.1, [0.0, 23.0, 18.0], 1.2)); // aqueduct
    csf.join(1.5, ellipsoid([0.0, 25.0, 6.0], [7.0, 5.0, 10.0])); // fourth ventricle
    csf.join(0.0, ellipsoid([0.0, 40.0, -15.0], [10.0, 9.0, 5.0])); // cisterna magna
    csf.join(0.0, ellipsoid([0.0, 24.0, 37.0], [9.0, 4.0, 5.0])); // quadrigeminal cistern
    csf.join(2.0, ellipsoid([0.0, -14.0, 33.0], [12.0, 7.0, 5.0])); // suprasellar cistern
    csf
}

fn deep_grey() -> Field {
    let mut grey = Field::new(3.0);
    grey.join_both(0.0, ellipsoid([9.5, 8.0, 46.0], [7.0, 13.5, 9.0]).turned(0.0, 0.0, -18.0)); // thalamus
    // Caudate.
    grey.join_path_both(0.0, &[[13.0, -20.0, 51.0, 5.5], [15.0, -6.0, 60.0, 4.0], [18.0, 10.0, 63.0, 2.8]]);
    // Lentiform.
    grey.join_both(0.0, ellipsoid([23.5, -4.0, 44.0], [5.5, 16.5, 10.0]).turned(0.0, 0.0, -10.0));
    grey.join_both(0.0, ellipsoid([24.0, -16.0, 18.0], [7.0, 8.0, 7.0])); // amygdala
    // Hippocampus.
    grey.join_path_both(0.0, &[[25.0, -8.0, 17.0, 4.0], [27.0, 10.0, 22.0, 4.0], [23.0, 28.0, 34.0, 3.0]]);
    grey
}

fn callosum() -> Field {
    let mut white = Field::new(10.0);
    white.join_path(
        0.0,
        &[
            [0.0, -22.0, 44.0, 2.0],
            [0.0, -34.0, 50.0, 4.5],
            [0.0, -32.0, 61.0, 4.0],
            [0.0, -18.0, 68.0, 3.2],
            [0.0, 4.0, 71.0, 3.2],
            [0.0, 24.0, 68.0, 3.6],
            [0.0, 38.0, 58.0, 5.0],
            [0.0, 32.0, 50.0, 3.0],
        ],
    );
    // Everything that the callosum spans is joined across the midline.
    white.join(3.0, ellipsoid([0.0, 4.0, 50.0], [9.0, 30.0, 18.0]));
    white
}

fn stem() -> Field {
    let mut stem = Field::new(3.0);
    stem.join(0.0, ellipsoid([0.0, 9.0, 27.0], [14.0, 10.0, 11.0])); // midbrain
    stem.join_both(3.0, cone([6.0, 3.0, 27.0], 5.0, [14.0, 0.0, 38.0], 5.5)); // cerebral peduncles
    stem.join(5.0, ellipsoid([0.0, 8.5, 8.0], [16.5, 13.0, 13.5])); // pons
    stem.join_both(5.0, cone([12.0, 12.0, 6.0], 6.5, [20.0, 28.0, 4.0], 6.0)); // middle cerebellar peduncle
    stem.join(5.0, cone([0.0, 15.0, -4.0], 8.5, [0.0, 24.0, -28.0], 6.0)); // medulla
    stem.join_path(
        3.0,
        &[
            [0.0, 24.0, -27.0, 6.0],
            [0.0, 27.0, -50.0, 5.6],
            [0.0, 29.0, -75.0, 5.8],
            [0.0, 27.0, -145.0, 6.0],
        ],
    );
    stem
}

fn cerebellum() -> Field {
    let mut lobes = Field::new(10.0);
    lobes.join_both(0.0, ellipsoid([22.0, 48.0, 1.0], [26.0, 28.0, 21.0]));
    lobes.join(5.0, ellipsoid([0.0, 46.0, 8.0], [9.0, 24.0, 22.0])); // vermis
    lobes.cut(3.0, ellipsoid([0.0, 80.0, 0.0], [2.5, 14.0, 22.0])); // notch
    lobes.join_both(3.0, ball([7.0, 34.0, -16.0], 6.0)); // tonsils
    lobes
}

fn calcified() -> Field {
    let mut spots = Field::new(2.5);
    spots.join(0.0, ellipsoid([0.3, 23.0, 44.0], [1.8, 2.2, 1.7])); // pineal gland
    spots.join(0.0, ellipsoid([23.0, 41.0, 49.0], [1.9, 3.4, 1.6])); // choroid plexus, left
    spots.join(0.0, ellipsoid([-23.5, 40.0, 48.0], [1.5, 2.6, 1.4])); // right
    spots
}
