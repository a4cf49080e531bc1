//! The part of a body that a volume shows, and the look that suits it where a user names none.
//!
//! It decides by volumes and shares of tissues in cells of 4 mm: a closed skull around a brain, lungs
//! in most slices, the width of the body. It knows no organs, and reads no DICOM attributes: those
//! for the body part are often missing or wrong. A wrong answer costs a preset that the user changes;
//! nothing that measures depends on it.
//!
//! Values: HU. Volumes: ml.

use std::fmt;

use rayon::prelude::*;

use super::cells::{CellGrid, Edges, filled_layer};
use super::{Preset, Quantity, Volume, preset};

/// Sides of a cell, mm.
const CELL_MM: f64 = 4.0;

/// A part of the body, as far as it decides a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyPart {
    /// A skull that encloses a brain.
    Head,
    /// Lungs in most slices.
    Chest,
    /// A trunk without lungs, or with their lower parts alone.
    Abdomen,
    /// A narrow body part with bones.
    Limb,
    /// Bones or a model of them, without soft tissue.
    Skeleton,
    /// Anything else, such as a test object.
    Other,
}

/// The anatomy found in a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Anatomy {
    /// The part of the body.
    pub part: BodyPart,
    /// Whether organs or vessels hold contrast medium.
    pub has_contrast: bool,
    /// Whether there are implants or other parts of metal.
    pub has_metal: bool,
    /// Whether there is bone, or something as dense.
    pub has_bone: bool,
    /// The quantity, the lowest and the highest value, if the values are not HU. Then the anatomy is
    /// unknown.
    pub other_values: Option<(Quantity, [i16; 2])>,
}

impl BodyPart {
    /// The name in answers and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Chest => "chest",
            Self::Abdomen => "abdomen",
            Self::Limb => "limb",
            Self::Skeleton => "skeleton",
            Self::Other => "object",
        }
    }
}

impl Anatomy {
    /// The anatomy of a volume from which the table was removed.
    #[must_use]
    pub fn of(volume: &Volume) -> Self {
        if !volume.quantity().is_hu() {
            let (low, high) = volume.range_hu();
            return Self { other_values: Some((volume.quantity(), [low, high])), ..Self::NOTHING };
        }
        Measures::of(volume).map_or(Self::NOTHING, |measures| measures.anatomy())
    }

    /// Of a volume of air.
    const NOTHING: Self = Self {
        part: BodyPart::Other,
        has_contrast: false,
        has_metal: false,
        has_bone: true,
        other_values: None,
    };

    /// The preset that suits it; `None` if the values are not HU, for which presets are made.
    #[must_use]
    pub fn preset(self) -> Option<&'static Preset> {
        if self.other_values.is_some() {
            return None;
        }
        let name = match (self.part, self.has_contrast) {
            (BodyPart::Head | BodyPart::Limb, true) => "vessels",
            (BodyPart::Chest, true) => "heart",
            (BodyPart::Abdomen, true) => "kidneys",
            (BodyPart::Chest | BodyPart::Abdomen | BodyPart::Limb, false) => "skin-and-bone",
            (BodyPart::Other, _) if !self.has_bone => "skin",
            (BodyPart::Head | BodyPart::Skeleton | BodyPart::Other, _) => "bone",
        };
        preset(name)
    }

    /// The quantity of the values.
    #[must_use]
    pub fn quantity(self) -> Quantity {
        self.other_values.map_or(Quantity::Hounsfield, |(quantity, _)| quantity)
    }

    /// Centre and width of the window that suits its slices, HU. Other quantities have a window over
    /// all values.
    #[must_use]
    pub fn window_hu(self) -> [f64; 2] {
        if let Some((_, range)) = self.other_values {
            let [low, high] = range.map(f64::from);
            return [(low + high) / 2.0, (high - low).max(1.0)];
        }
        match (self.part, self.has_contrast) {
            (BodyPart::Head, false) => [40.0, 80.0],
            (BodyPart::Head, true) => [80.0, 240.0],
            (BodyPart::Chest, false) => [-550.0, 1500.0],
            (BodyPart::Skeleton, _) => [500.0, 2500.0],
            _ => [40.0, 400.0],
        }
    }
}

/// Such as "a chest without contrast medium".
impl fmt::Display for Anatomy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let medium = if self.has_contrast { "with contrast medium" } else { "without contrast medium" };
        let metal = if self.has_metal { " and with metal" } else { "" };
        if let Some((quantity, _)) = self.other_values {
            return write!(f, "values of type {}", quantity.unit());
        }
        match self.part {
            BodyPart::Skeleton => write!(f, "bones without soft tissue{metal}"),
            BodyPart::Other => write!(f, "no body part that is known{metal}"),
            BodyPart::Abdomen => write!(f, "an {} {medium}{metal}", self.part.name()),
            _ => write!(f, "a {} {medium}{metal}", self.part.name()),
        }
    }
}

/// Values of a cell: the mean, the standard deviation and the highest of its voxels, HU.
#[derive(Clone, Copy, Debug)]
struct Cell {
    mean: f32,
    deviation: f32,
    highest: i16,
}

/// The body: the largest object, holes of its slices filled.
struct Body {
    grid: CellGrid,
    cells: Vec<Cell>,
    is_body: Vec<bool>,
}

/// Volumes of tissues, ml, and lengths, mm.
#[derive(Clone, Copy, Debug, Default)]
struct Measures {
    body: f64,
    soft: f64,
    fat: f64,
    bone: f64,
    metal: f64,
    air: f64,
    lung: f64,
    /// Soft tissue that bone encloses in slices.
    brain: f64,
    /// Inside of organs and vessels that are brighter than soft tissue and no bone.
    enhanced: f64,
    /// Share of the slices in which lungs take a tenth of the body.
    lung_slices: f64,
    /// From the patient's right to the left.
    width_mm: f64,
}

impl Measures {
    fn anatomy(&self) -> Anatomy {
        let share = |ml: f64| ml / self.body;
        let part = if share(self.air) > 0.25 && share(self.soft) < 0.4 && share(self.bone) > 0.1 {
            BodyPart::Skeleton
        } else if self.brain >= 300.0 && share(self.lung) < 0.1 {
            BodyPart::Head
        } else if self.lung_slices >= 0.5 && share(self.lung) > 0.08 {
            BodyPart::Chest
        } else if self.width_mm >= 250.0 && share(self.soft) > 0.5 && share(self.fat) > 0.02 {
            BodyPart::Abdomen
        } else if self.body >= 300.0
            && share(self.bone) >= 0.01
            && share(self.soft) > 0.5
            && share(self.fat) > 0.02
        {
            BodyPart::Limb
        } else {
            BodyPart::Other
        };
        let is_living = !matches!(part, BodyPart::Skeleton | BodyPart::Other);
        Anatomy {
            part,
            // The marrow of vertebrae takes up to 0.001, organs in a venous phase 0.01.
            has_contrast: is_living && share(self.enhanced) > 0.002,
            has_metal: self.metal >= 0.5,
            has_bone: share(self.bone) >= 0.01,
            other_values: None,
        }
    }

    /// The measures of a volume; `None` where there is nothing but air.
    fn of(volume: &Volume) -> Option<Self> {
        let body = Body::of(volume)?;
        let ml = body.grid.spacing_mm.iter().product::<f64>() / 1000.0;
        let count = |is_in: &(dyn Fn(usize, Cell) -> bool + Sync)| {
            let cells = body.cells.par_iter().enumerate().with_min_len(1 << 14);
            cells.filter(|(at, cell)| body.is_body[*at] && is_in(*at, **cell)).count() as f64 * ml
        };
        let between = |low: f32, high: f32| count(&|_, cell| cell.mean > low && cell.mean < high);
        let brain = body.enclosed_by_bone();
        Some(Self {
            body: count(&|_, _| true),
            soft: between(-150.0, 150.0),
            fat: between(-150.0, -30.0),
            bone: between(250.0, f32::INFINITY),
            metal: between(2500.0, f32::INFINITY),
            air: between(f32::NEG_INFINITY, -300.0),
            lung: between(f32::NEG_INFINITY, LUNG_HU),
            brain: count(&|at, cell| brain[at] && cell.mean > -20.0 && cell.mean < 100.0),
            enhanced: count(&|at, cell| cell.mean > 150.0 && body.is_inside_enhanced(at)),
            lung_slices: body.lung_slices(),
            width_mm: body.width_mm(),
        })
    }
}

/// Highest mean of a cell of lung, HU.
const LUNG_HU: f32 = -600.0;

impl Body {
    fn of(volume: &Volume) -> Option<Self> {
        const TISSUE_HU: f32 = -300.0;
        let grid = CellGrid::of(volume, CELL_MM);
        if u32::try_from(grid.dims.iter().product::<usize>()).is_err() {
            return None;
        }
        let cells = cells(volume, &grid);
        let tissue: Vec<bool> = cells.iter().map(|cell| cell.mean > TISSUE_HU).collect();
        let objects = grid.components(&tissue, false);
        let largest = objects.iter().max_by_key(|object| object.len())?;
        let mut is_body = vec![false; cells.len()];
        largest.join(&mut is_body);
        let is_body = layers_filled(&grid, &is_body);
        Some(Self { grid, cells, is_body })
    }

    /// Cells that bone encloses in their slices, without the bone.
    fn enclosed_by_bone(&self) -> Vec<bool> {
        let at = 0..self.cells.len();
        let bone: Vec<bool> = at.map(|at| self.is_body[at] && self.cells[at].highest > 300).collect();
        let filled = layers_filled(&self.grid, &bone);
        filled.into_iter().zip(bone).map(|(filled, bone)| filled && !bone).collect()
    }

    /// Whether a cell and its six neighbours are even and brighter than soft tissue: marrow and cortex
    /// of bones are uneven.
    fn is_inside_enhanced(&self, at: usize) -> bool {
        let is_even = |at: usize| {
            let Cell { mean, deviation, .. } = self.cells[at];
            self.is_body[at] && mean > 120.0 && mean < 600.0 && deviation < 30.0
        };
        let [i, j, k] = self.grid.place(at);
        let [nx, ny, nz] = self.grid.dims;
        let has_neighbours = (1..nx.saturating_sub(1)).contains(&i)
            && (1..ny.saturating_sub(1)).contains(&j)
            && (1..nz.saturating_sub(1)).contains(&k);
        let strides = [1, nx, nx * ny];
        has_neighbours
            && is_even(at)
            && strides.iter().all(|stride| is_even(at - stride) && is_even(at + stride))
    }

    fn lung_slices(&self) -> f64 {
        let layer = self.grid.layer_cells();
        let slices = self.is_body.chunks_exact(layer).zip(self.cells.chunks_exact(layer));
        let areas: Vec<[usize; 2]> = slices
            .map(|(is_body, cells)| {
                let body = is_body.iter().zip(cells).filter(|(is_body, _)| **is_body);
                let lung = body.clone().filter(|(_, cell)| cell.mean < LUNG_HU).count();
                [body.count(), lung]
            })
            .collect();
        // Slices that cut the body's end count for nothing.
        let least = areas.iter().map(|[body, _]| body / 5).max().unwrap_or(0).max(1);
        let whole: Vec<_> = areas.iter().filter(|[body, _]| *body >= least).collect();
        let with_lung = whole.iter().filter(|[body, lung]| lung * 10 > *body).count();
        with_lung as f64 / whole.len().max(1) as f64
    }

    fn width_mm(&self) -> f64 {
        let columns = self.is_body.iter().enumerate().filter(|(_, is_body)| **is_body);
        let columns = columns.map(|(at, _)| at % self.grid.dims[0]);
        let (first, last) =
            columns.fold((usize::MAX, 0), |(first, last), column| (first.min(column), last.max(column)));
        (last + 1).saturating_sub(first) as f64 * self.grid.spacing_mm[0]
    }
}

fn layers_filled(grid: &CellGrid, set: &[bool]) -> Vec<bool> {
    let [nx, ny, _] = grid.dims;
    set.par_chunks(nx * ny).flat_map_iter(|layer| filled_layer(layer, [nx, ny], Edges::All)).collect()
}

/// The cells of a volume, from about eight voxels of each.
fn cells(volume: &Volume, grid: &CellGrid) -> Vec<Cell> {
    let [nx, ny, _] = volume.grid().dims();
    let steps = grid.edges.map(|edge| edge.div_ceil(2).max(1));
    let layer = |slab: &[i16]| {
        // Whole numbers: sum, sum of squares, count, and the highest value.
        let mut sums = vec![([0i64; 2], 0u32, i16::MIN); grid.layer_cells()];
        for (row, values) in slab.chunks_exact(nx).enumerate() {
            let (j, k) = (row % ny, row / ny);
            let is_sampled = (j % grid.edges[1]).is_multiple_of(steps[1]) && k.is_multiple_of(steps[2]);
            if !is_sampled {
                continue;
            }
            let cells = &mut sums[j / grid.edges[1] * grid.dims[0]..][..grid.dims[0]];
            for (([sum, squares], count, highest), run) in cells
                .iter_mut()
                .map(|(sums, count, highest)| (sums, count, highest))
                .zip(values.chunks(grid.edges[0]))
            {
                for &hu in run.iter().step_by(steps[0]) {
                    *sum += i64::from(hu);
                    *squares += i64::from(hu).pow(2);
                    *count += 1;
                    *highest = (*highest).max(hu);
                }
            }
        }
        sums.into_iter().map(|([sum, squares], count, highest)| {
            let count = f64::from(count.max(1));
            let mean = sum as f64 / count;
            let deviation = (squares as f64 / count - mean * mean).max(0.0).sqrt();
            Cell { mean: mean as f32, deviation: deviation as f32, highest }
        })
    };
    volume.voxels_hu().par_chunks(nx * ny * grid.edges[2]).flat_map_iter(layer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, PRESETS, Phantom, PhantomKind, PhantomRecipe};

    fn preset_of(anatomy: Anatomy) -> &'static str {
        anatomy.preset().unwrap().name
    }

    /// Invariant: Volumes of other quantities than HU get no HU preset and no HU window by default.
    #[test]
    fn values_that_are_not_hu_show_no_anatomy() {
        let head = Phantom::head(48).unwrap().volume;
        let (low, high) = head.range_hu();
        assert!(head.clone().of_quantity(Quantity::Hounsfield).anatomy().preset().is_some());
        for quantity in [Quantity::Concentration, Quantity::ModifiedHounsfield, Quantity::Unspecified] {
            let other = head.clone().of_quantity(quantity);
            assert_eq!(other.content_hash(), head.content_hash());
            assert!(other.table().is_none() && other.downsampled(2).quantity() == quantity);
            let anatomy = other.anatomy();
            assert!(anatomy.part == BodyPart::Other && anatomy.preset().is_none());
            let [center, width] = anatomy.window_hu();
            assert_eq!([center - width / 2.0, center + width / 2.0], [low, high].map(f64::from));
        }
    }

    #[test]
    fn the_head_phantom_is_a_head_and_spheres_are_no_anatomy() {
        let anatomy = Anatomy::of(&Phantom::head(96).unwrap().volume);
        assert_eq!((anatomy.part, anatomy.has_contrast), (BodyPart::Head, false));
        assert_eq!((preset_of(anatomy), anatomy.window_hu()), ("bone", [40.0, 80.0]));
        assert_eq!(anatomy.to_string(), "a head without contrast medium");
        for kind in [PhantomKind::Sphere, PhantomKind::Slab, PhantomKind::Axes] {
            let phantom = PhantomRecipe::new(kind).with_size(48).unwrap().make();
            let anatomy = Anatomy::of(&phantom.volume);
            assert_eq!((anatomy.part, preset_of(anatomy)), (BodyPart::Other, "bone"), "{kind:?}");
        }
    }

    /// A trunk of muscle in a layer of fat, with a spine of bone; lungs and vessels as wanted.
    fn trunk(lung: Option<i16>, vessel: i16, width_mm: f64) -> Anatomy {
        let grid = Grid::axis_aligned([100, 70, 50], [4.0, 4.0, 4.0], [0.0; 3]).unwrap();
        let hu = |[i, j, k]: [usize; 3]| {
            let at = |x: f64, y: f64| [(i as f64 - x) * 4.0, (j as f64 - y) * 4.0];
            let inside = |[x, y]: [f64; 2], a: f64, b: f64| (x / a).powi(2) + (y / b).powi(2) < 1.0;
            let half = width_mm / 2.0;
            // Noise, as bone marrow and tissue have it.
            let noise = ((i * 7 + j * 13 + k * 29) % 11) as i16 - 5;
            if inside(at(50.0, 50.0), 20.0, 20.0) {
                return 500 + 40 * noise;
            }
            if inside(at(50.0, 40.0), 14.0, 14.0) {
                return vessel + noise;
            }
            let is_lung = inside(at(35.0, 32.0), 45.0, 60.0) || inside(at(65.0, 32.0), 45.0, 60.0);
            match lung {
                Some(hu) if is_lung && k < 40 => hu + noise,
                _ if inside(at(50.0, 35.0), half - 20.0, 90.0) => 50 + noise,
                _ if inside(at(50.0, 35.0), half, 110.0) => -100 + noise,
                _ => -1000,
            }
        };
        let place = |at: usize| [at % 100, at / 100 % 70, at / 7000];
        let voxels = (0..grid.voxel_count()).map(|at| hu(place(at))).collect();
        Anatomy::of(&Volume::new(grid, voxels).unwrap())
    }

    #[test]
    fn trunks_and_limbs_are_distinguished_with_and_without_contrast_medium() {
        for (lung, vessel, width_mm, part, contrast, name) in [
            (Some(-800), 50, 360.0, BodyPart::Chest, false, "skin-and-bone"),
            (Some(-800), 280, 360.0, BodyPart::Chest, true, "heart"),
            (None, 50, 360.0, BodyPart::Abdomen, false, "skin-and-bone"),
            (None, 250, 360.0, BodyPart::Abdomen, true, "kidneys"),
            (None, 50, 160.0, BodyPart::Limb, false, "skin-and-bone"),
            (None, 300, 160.0, BodyPart::Limb, true, "vessels"),
        ] {
            let anatomy = trunk(lung, vessel, width_mm);
            assert_eq!((anatomy.part, anatomy.has_contrast), (part, contrast), "{anatomy:?}");
            assert_eq!(preset_of(anatomy), name);
        }
    }

    #[test]
    fn every_choice_is_a_preset_and_a_window() {
        use BodyPart::{Abdomen, Chest, Head, Limb, Other, Skeleton};
        for part in [Head, Chest, Abdomen, Limb, Skeleton, Other] {
            for flags in 0..8 {
                let [has_contrast, has_metal, has_bone] = [1, 2, 4].map(|bit| flags & bit != 0);
                let anatomy = Anatomy { part, has_contrast, has_metal, has_bone, other_values: None };
                assert!(PRESETS.iter().any(|preset| preset.name == preset_of(anatomy)));
                assert!(anatomy.window_hu()[1] > 0.0);
                assert!(!anatomy.to_string().is_empty());
            }
        }
    }

    #[test]
    fn air_and_a_single_voxel_are_no_body() {
        for (dims, hu) in [([20, 20, 20], -1000), ([1, 1, 1], 40), ([1, 1, 1], -1000), ([300, 1, 1], 3000)] {
            let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
            let voxels = vec![hu; grid.voxel_count()];
            assert_eq!(Anatomy::of(&Volume::new(grid, voxels).unwrap()).part, BodyPart::Other);
        }
    }
}
