//! The head's truth: landmarks found on the model itself, surfaces with a closed form, materials.
//!
//! A landmark is where a straight line that a textbook's definition gives first meets its tissue:
//! the anatomy's own values are followed with infinitely sharp edges and no grain, so that the
//! point lies on the model by construction and not where someone typed it.

use glam::Vec3;

use super::super::sdf::Box3;
use super::super::{Material, PhantomLandmark, Surface, SurfaceShape};
use super::brain;
use super::edge::Edge;
use super::soft::{EYE_CENTER, EYE_RADIUS, LENS_CENTER, LENS_RADII};
use super::tissue::{self, Anatomy};

/// An edge so sharp that it moves no landmark.
const SHARP: Edge = Edge { half_width_mm: 0.02 };
/// Lines are followed in pieces of this length, each with the parts near it.
const PIECE_MM: f32 = 8.0;
/// Step along a line, mm: shorter than any bone is thin.
const STEP_MM: f32 = 0.2;

#[derive(Clone, Copy, Debug)]
enum Boundary {
    Skin,
    Bone,
    Tooth,
}

impl Boundary {
    fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Bone => "bone",
            Self::Tooth => "tooth",
        }
    }

    /// Halfway between the tissue and its usual surroundings.
    fn level_hu(self) -> f32 {
        match self {
            Self::Skin => 0.5 * (tissue::SKIN_HU + tissue::AIR_HU),
            Self::Bone => 0.5 * (tissue::CORTICAL_HU + tissue::MUSCLE_HU),
            Self::Tooth => 0.5 * (tissue::ENAMEL_HU + tissue::MUSCLE_HU),
        }
    }
}

/// How a landmark is found: of all lines from points around `from`, the one that hits first.
struct Definition {
    name: &'static str,
    on: Boundary,
    /// The start of the middle line, outside the tissue.
    from: [f32; 3],
    /// The direction of lines; need not be a unit vector.
    toward: [f32; 3],
    /// Half-extents of the start points around `from`, along one or two directions; zero for a
    /// single line.
    spread: [[f32; 3]; 2],
}

const NONE: [f32; 3] = [0.0; 3];

const fn alone(name: &'static str, on: Boundary, from: [f32; 3], toward: [f32; 3]) -> Definition {
    Definition { name, on, from, toward, spread: [NONE, NONE] }
}

/// Definitions in the order of the truth. Those of a pair are given for the left and mirrored for
/// the right.
fn definitions() -> Vec<Definition> {
    use Boundary::{Bone, Skin, Tooth};
    let (back, front, up, down) = ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
    let along = |axis: usize, half: f32| {
        let mut spread = NONE;
        spread[axis] = half;
        spread
    };
    let scan = |name, on, from, toward, spread| Definition { name, on, from, toward, spread: [spread, NONE] };
    let teeth = super::teeth::teeth();
    let below_upper = (teeth.upper_incisor - Vec3::Z * 3.0).into();
    let above_lower = (teeth.lower_incisor + Vec3::Z).into();
    let mut list = vec![
        scan("vertex", Skin, [0.0, 10.0, 145.0], down, along(1, 30.0)),
        scan("pronasale", Skin, [0.0, -140.0, -3.0], back, along(2, 8.0)),
        alone("nasion", Bone, [0.0, -110.0, 36.0], back),
        scan("anterior nasal spine", Bone, [0.0, -104.0, -16.0], back, along(2, 3.0)),
        alone("tip of left upper central incisor", Tooth, below_upper, up),
        alone("tip of left lower central incisor", Tooth, above_lower, down),
        scan("pogonion", Bone, [0.0, -105.0, -78.0], back, along(2, 6.0)),
        scan("menton", Bone, [0.0, -86.0, -100.0], up, along(1, 8.0)),
    ];
    let corner = |name, from: [f32; 3], toward: [f32; 3], spread: [[f32; 3]; 2]| Definition {
        name,
        on: Bone,
        from,
        toward,
        spread,
    };
    let pairs = [
        corner("left gonion", [58.0, -3.0, -76.0], [-0.2, -0.62, 0.76], [[6.0, 0.0, 1.6], [0.0, 7.7, 6.3]]),
        corner("left zygion", [85.0, -32.0, 0.0], [-1.0, 0.0, 0.0], [[0.0, 14.0, 0.0], [0.0, 0.0, 6.0]]),
        corner("left orbitale", [33.0, -82.5, 14.0], down, [NONE, [0.0, 4.0, 0.0]]),
        corner("left external auditory meatus", [60.0, -0.6, 2.0], up, [NONE, NONE]),
    ];
    for pair in pairs {
        let mirror = |[x, y, z]: [f32; 3]| [-x, y, z];
        let right = Definition {
            name: RIGHT_NAMES
                .iter()
                .find(|(left, _)| *left == pair.name)
                .map_or(pair.name, |(_, right)| right),
            on: pair.on,
            from: mirror(pair.from),
            toward: mirror(pair.toward),
            spread: pair.spread.map(mirror),
        };
        list.extend([pair, right]);
    }
    list.extend([
        scan("inion", Bone, [0.0, 112.0, -1.0], front, along(2, 6.0)),
        scan("basion", Bone, [0.0, 24.0, -19.0], front, along(2, 6.0)),
        scan("opisthion", Bone, [0.0, 26.0, -21.0], back, along(2, 6.0)),
        alone("sella", Bone, [0.0, -19.0, 27.0], down),
    ]);
    list
}

const RIGHT_NAMES: [(&str, &str); 4] = [
    ("left gonion", "right gonion"),
    ("left zygion", "right zygion"),
    ("left orbitale", "right orbitale"),
    ("left external auditory meatus", "right external auditory meatus"),
];

/// All landmarks. Each definition hits the model: a test holds every seed tried to 20 of them.
pub(super) fn landmarks(anatomy: &Anatomy) -> Vec<PhantomLandmark> {
    definitions().iter().filter_map(|definition| definition.find(anatomy)).collect()
}

impl Definition {
    /// Searches the start points in three rounds, each finer around the best of the one before.
    fn find(&self, anatomy: &Anatomy) -> Option<PhantomLandmark> {
        let toward = Vec3::from(self.toward).normalize();
        let [u, v] = self.spread.map(Vec3::from);
        let level = self.on.level_hu();
        let mut best: Option<(f32, Vec3)> = None;
        let (mut center, mut scale) = (Vec3::from(self.from), 1.0f32);
        for _ in 0..3 {
            for n in grid(u) {
                for m in grid(v) {
                    let start = center + (u * n + v * m) * scale;
                    let way = first_crossing(anatomy, start, toward, level);
                    if let Some(way) = way.filter(|&way| best.is_none_or(|(shortest, _)| way < shortest)) {
                        best = Some((way, start));
                    }
                }
            }
            center = best?.1;
            scale *= 0.25;
        }
        let (way, start) = best?;
        let exact = |v: Vec3| v.to_array().map(|c| (f64::from(c) * 1e3).round() / 1e3);
        Some(PhantomLandmark {
            name: self.name.to_owned(),
            position_mm: exact(start + toward * way),
            on: self.on.name().to_owned(),
            outward: (-toward).as_dvec3().normalize().to_array(),
            level_hu: f64::from(level),
        })
    }
}

/// Steps from -1 to 1 along a spread; only the middle where the spread is zero.
fn grid(spread: Vec3) -> impl Iterator<Item = f32> + Clone {
    let steps = if spread == Vec3::ZERO { 0 } else { 5 };
    (-steps..=steps).map(|n| n as f32 / 5.0)
}

/// Way along a line to where the value first rises through `level`, mm; `None` for a line that
/// starts above it or meets nothing.
fn first_crossing(anatomy: &Anatomy, start: Vec3, toward: Vec3, level: f32) -> Option<f32> {
    const PIECES: u8 = 6;
    for piece in 0..PIECES {
        let first = f32::from(piece) * PIECE_MM;
        let (a, b) = (start + toward * first, start + toward * (first + PIECE_MM));
        let Some(local) = anatomy.near(&Box3 { min: a.min(b) - 0.1, max: a.max(b) + 0.1 }) else { continue };
        let above = |way: f32| local.hu(start + toward * way, SHARP) > level;
        let mut way = first;
        while way < first + PIECE_MM {
            if above(way) {
                return (way > 0.0).then(|| bisected((way - STEP_MM).max(first), way, above));
            }
            way += STEP_MM;
        }
    }
    None
}

/// The value from which a condition that fails at `low` and holds at `high` begins to hold.
fn bisected(mut low: f32, mut high: f32, holds: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..10 {
        let middle = 0.5 * (low + high);
        if holds(middle) { high = middle } else { low = middle }
    }
    high
}

/// Surfaces of the head that are spheres and ellipsoids to the last digit.
pub(super) fn surfaces() -> Vec<Surface> {
    let sided = |side: f32, [x, y, z]: [f32; 3]| [side * x, y, z].map(f64::from);
    let mut list = Vec::new();
    for (name, side) in [("left", 1.0), ("right", -1.0)] {
        let center_mm = sided(side, EYE_CENTER);
        list.push(Surface {
            name: format!("{name} eyeball"),
            inside: "sclera".to_owned(),
            outside: "various".to_owned(),
            shape: SurfaceShape::Sphere { center_mm, radius_mm: f64::from(EYE_RADIUS) },
        });
        list.push(Surface {
            name: format!("{name} lens"),
            inside: "lens".to_owned(),
            outside: "vitreous body".to_owned(),
            shape: SurfaceShape::Ellipsoid {
                center_mm: sided(side, LENS_CENTER),
                semi_axes_mm: LENS_RADII.map(f64::from),
            },
        });
    }
    list
}

/// The materials of the head.
pub(super) fn materials() -> Vec<Material> {
    let named = [
        ("air", tissue::AIR_HU),
        ("skin", tissue::SKIN_HU),
        ("fat", tissue::FAT_HU),
        ("muscle", tissue::MUSCLE_HU),
        ("gland", tissue::GLAND_HU),
        ("mucosa", tissue::MUCOSA_HU),
        ("cartilage", tissue::CARTILAGE_HU),
        ("cortical bone", tissue::CORTICAL_HU),
        ("cancellous bone", tissue::CANCELLOUS_HU),
        ("enamel", tissue::ENAMEL_HU),
        ("dentine", tissue::DENTINE_HU),
        ("pulp", tissue::PULP_HU),
        ("amalgam", tissue::AMALGAM_HU),
        ("sclera", tissue::SCLERA_HU),
        ("vitreous body", tissue::VITREOUS_HU),
        ("lens", tissue::LENS_HU),
        ("grey matter", brain::GREY_HU),
        ("white matter", brain::WHITE_HU),
        ("cerebrospinal fluid", brain::CSF_HU),
        ("dura", brain::DURA_HU),
        ("calcification", brain::CALCIFIED_HU),
        ("artery with contrast medium", tissue::ARTERY_HU),
        ("vein with contrast medium", tissue::VEIN_HU),
    ];
    named.map(|(name, hu)| Material { name: name.to_owned(), hu: f64::from(hu) }).into()
}
