//! The phantoms of closed form: sphere, slab, ramp, axes.
//!
//! Edges are anti-aliased by covered volume: a voxel's value is the mean of the continuous phantom
//! over the voxel's box, rounded to a whole HU. For the slab that fraction is exact; for balls it
//! is a 16 x 16 midpoint quadrature of exact chords along the axis that the surface faces most,
//! good to 0.2 % of a voxel. No noise.

use rayon::prelude::*;

use super::facts::{PhantomFacts, Placement};
use super::truth::{Material, PhantomLandmark, Surface, SurfaceShape};

const AIR_HU: f64 = -1000.0;
const SPHERE_HU: f64 = 500.0;
const SPHERE_RADIUS_MM: f64 = 80.0;
const SLAB_HU: f64 = 300.0;
const SLAB_HALF_THICKNESS_MM: f64 = 50.0;
/// Whole numbers and even ones for x and y, so that HU is whole at every voxel centre of every
/// size.
const RAMP_HU_PER_MM: [f64; 3] = [2.0, 4.0, -6.0];
/// Name, axis, side, value and radius of each ball of the `axes` phantom; all at 40 mm from the
/// origin.
const AXIS_BALLS: [(&str, usize, f64, f64, f64); 6] = [
    ("left (+x)", 0, 1.0, 300.0, 14.0),
    ("right (-x)", 0, -1.0, 600.0, 12.0),
    ("back (+y)", 1, 1.0, 900.0, 10.0),
    ("front (-y)", 1, -1.0, 1200.0, 8.0),
    ("head (+z)", 2, 1.0, 1500.0, 16.0),
    ("feet (-z)", 2, -1.0, 1800.0, 6.0),
];
const AXIS_BALL_DISTANCE_MM: f64 = 40.0;
/// Sub-columns along each of the two axes across the chords.
const SUBCOLUMNS: u32 = 16;

/// Progress: called with the number of slices just finished.
type SliceProgress<'a> = &'a (dyn Fn(usize) + Sync);

pub(super) fn sphere(placement: &Placement, report: SliceProgress<'_>) -> (Vec<i16>, PhantomFacts) {
    let ball = Ball { center_mm: [0.0; 3], radius_mm: SPHERE_RADIUS_MM };
    let voxels = fill(placement, report, |center| {
        AIR_HU + (SPHERE_HU - AIR_HU) * ball.covered_fraction(center, placement.spacing_mm)
    });
    let facts = PhantomFacts {
        materials: vec![material("air", AIR_HU), material("sphere", SPHERE_HU)],
        surfaces: vec![ball.surface("sphere", "sphere")],
        landmarks: ball.poles("sphere", SPHERE_HU),
        ..PhantomFacts::default()
    };
    (voxels, facts)
}

pub(super) fn slab(placement: &Placement, report: SliceProgress<'_>) -> (Vec<i16>, PhantomFacts) {
    let half_step = placement.spacing_mm[1] / 2.0;
    let voxels = fill(placement, report, |[_, y, _]| {
        let low = (y - half_step).max(-SLAB_HALF_THICKNESS_MM);
        let high = (y + half_step).min(SLAB_HALF_THICKNESS_MM);
        AIR_HU + (SLAB_HU - AIR_HU) * ((high - low).max(0.0) / (2.0 * half_step))
    });
    let face = |name: &str, side: f64| Surface {
        name: name.to_owned(),
        inside: "slab".to_owned(),
        outside: "air".to_owned(),
        shape: SurfaceShape::Plane {
            point_mm: [0.0, side * SLAB_HALF_THICKNESS_MM, 0.0],
            normal: [0.0, side, 0.0],
        },
    };
    let facts = PhantomFacts {
        materials: vec![material("air", AIR_HU), material("slab", SLAB_HU)],
        surfaces: vec![face("front face", -1.0), face("back face", 1.0)],
        ..PhantomFacts::default()
    };
    (voxels, facts)
}

pub(super) fn ramp(placement: &Placement, report: SliceProgress<'_>) -> (Vec<i16>, PhantomFacts) {
    let [gx, gy, gz] = RAMP_HU_PER_MM;
    let voxels = fill(placement, report, |[x, y, z]| gx * x + gy * y + gz * z);
    (voxels, PhantomFacts { gradient_hu_per_mm: Some(RAMP_HU_PER_MM), ..PhantomFacts::default() })
}

pub(super) fn axes(placement: &Placement, report: SliceProgress<'_>) -> (Vec<i16>, PhantomFacts) {
    let balls = AXIS_BALLS.map(|(_, axis, side, hu, radius_mm)| {
        let mut center_mm = [0.0; 3];
        center_mm[axis] = side * AXIS_BALL_DISTANCE_MM;
        (Ball { center_mm, radius_mm }, hu)
    });
    let voxels = fill(placement, report, |center| {
        let excess =
            |(ball, hu): &(Ball, f64)| (hu - AIR_HU) * ball.covered_fraction(center, placement.spacing_mm);
        AIR_HU + balls.iter().map(excess).sum::<f64>() // the balls do not touch
    });
    let named = || AXIS_BALLS.iter().zip(&balls);
    let mut materials = vec![material("air", AIR_HU)];
    materials.extend(named().map(|((name, ..), (_, hu))| material(name, *hu)));
    let facts = PhantomFacts {
        materials,
        surfaces: named().map(|((name, ..), (ball, _))| ball.surface(name, name)).collect(),
        ..PhantomFacts::default()
    };
    (voxels, facts)
}

/// Voxels of `hu` at their centres (mm), slice by slice in parallel, rounded to whole HU.
fn fill(placement: &Placement, report: SliceProgress<'_>, hu: impl Fn([f64; 3]) -> f64 + Sync) -> Vec<i16> {
    let [nx, ny, nz] = placement.dims;
    let mut voxels = vec![0i16; nx * ny * nz];
    voxels.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slice)| {
        let z = placement.coordinate(2, k);
        for (j, row) in slice.chunks_mut(nx).enumerate() {
            let y = placement.coordinate(1, j);
            for (i, voxel) in row.iter_mut().enumerate() {
                let rounded = hu([placement.coordinate(0, i), y, z]).round() as i16;
                *voxel = rounded;
            }
        }
        report(1);
    });
    voxels
}

/// A solid ball, mm.
#[derive(Clone, Copy, Debug)]
struct Ball {
    center_mm: [f64; 3],
    radius_mm: f64,
}

impl Ball {
    /// The part of a voxel's box that the ball covers, 0..1.
    fn covered_fraction(&self, voxel_mm: [f64; 3], size_mm: [f64; 3]) -> f64 {
        let offset: [f64; 3] = std::array::from_fn(|a| (voxel_mm[a] - self.center_mm[a]).abs());
        let distance = norm(offset);
        let half_diagonal = norm(size_mm) / 2.0;
        if distance > self.radius_mm + half_diagonal {
            return 0.0;
        }
        if distance < self.radius_mm - half_diagonal {
            return 1.0;
        }
        self.edge_fraction(offset, size_mm)
    }

    /// Mean over sub-columns of the chord's share of the box, along the axis that the surface faces
    /// most.
    ///
    /// Along that axis the chord's end varies slowly from column to column, so the midpoint rule is
    /// accurate.
    fn edge_fraction(&self, offset: [f64; 3], size: [f64; 3]) -> f64 {
        let chord_axis = (0..3).fold(0, |best, a| if offset[a] > offset[best] { a } else { best });
        let (u, v) = ((chord_axis + 1) % 3, (chord_axis + 2) % 3);
        let sub = |axis: usize, n: u32| {
            offset[axis] + size[axis] * ((f64::from(n) + 0.5) / f64::from(SUBCOLUMNS) - 0.5)
        };
        let (low, high) =
            (offset[chord_axis] - size[chord_axis] / 2.0, offset[chord_axis] + size[chord_axis] / 2.0);
        let mut covered = 0.0;
        for a in 0..SUBCOLUMNS {
            for b in 0..SUBCOLUMNS {
                let half_chord_squared =
                    self.radius_mm * self.radius_mm - sub(u, a).powi(2) - sub(v, b).powi(2);
                let half_chord = half_chord_squared.max(0.0).sqrt();
                covered += (high.min(half_chord) - low.max(-half_chord)).max(0.0);
            }
        }
        covered / (size[chord_axis] * f64::from(SUBCOLUMNS * SUBCOLUMNS))
    }

    fn surface(&self, name: &str, inside: &str) -> Surface {
        Surface {
            name: name.to_owned(),
            inside: inside.to_owned(),
            outside: "air".to_owned(),
            shape: SurfaceShape::Sphere { center_mm: self.center_mm, radius_mm: self.radius_mm },
        }
    }

    /// The six points of the surface on the patient axes through the centre.
    fn poles(&self, on: &str, inside_hu: f64) -> Vec<PhantomLandmark> {
        let pole = |(name, axis, side): (&str, usize, f64)| {
            let mut outward = [0.0; 3];
            outward[axis] = side;
            PhantomLandmark {
                name: name.to_owned(),
                position_mm: std::array::from_fn(|a| self.center_mm[a] + self.radius_mm * outward[a]),
                on: on.to_owned(),
                outward,
                level_hu: (inside_hu + AIR_HU) / 2.0,
            }
        };
        let sides = [
            ("left pole", 0, 1.0),
            ("right pole", 0, -1.0),
            ("back pole", 1, 1.0),
            ("front pole", 1, -1.0),
            ("head pole", 2, 1.0),
            ("feet pole", 2, -1.0),
        ];
        sides.into_iter().map(pole).collect()
    }
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn material(name: &str, hu: f64) -> Material {
    Material { name: name.to_owned(), hu }
}
