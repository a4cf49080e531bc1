//! Procedural phantoms: volumes made by formula, each with its [`PhantomTruth`].
//!
//! A [`PhantomRecipe`] (kind, size, seed) makes a [`Phantom`] (volume and truth). Equal recipes
//! make equal voxels, whatever the number of threads. Nothing is read or written here:
//! `dicom::write` makes files of it.
//!
//! | kind | size is | purpose |
//! |---|---|---|
//! | `head` | voxels across 240 mm; 256 x 256 x 220 by default | anatomy worth showing, landmarks |
//! | `sphere` | voxels across 256 mm | depth and normals in closed form |
//! | `slab` | voxels across 256 mm | absorption in closed form |
//! | `ramp` | voxels of 1 mm | interpolation and gradients: HU is linear in x, y and z |
//! | `axes` | voxels across 128 mm | orientation and handedness: six balls that differ |
//!
//! Space: patient LPS, mm. Values: HU.

mod facts;
mod head;
mod noise;
mod sdf;
mod solids;
mod truth;

use std::str::FromStr;

use super::{LabelMap, Segment, Volume, stack_sha256};
use facts::{PhantomFacts, Placement};
pub(crate) use truth::TRUTH_SCHEMA;
pub use truth::{Material, PhantomLandmark, PhantomTruth, Surface, SurfaceShape};

/// The kinds of phantoms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PhantomKind {
    /// A human head with skin, skull, teeth, brain, vessels and air cavities.
    Head,
    /// A ball of 80 mm radius, 500 HU, in air.
    Sphere,
    /// A slab of 300 HU, 100 mm thick along y, endless in x and z, in air.
    Slab,
    /// HU linear in x, y and z: 2, 4 and -6 HU per mm.
    Ramp,
    /// Six balls of different value and radius on the patient axes.
    Axes,
}

impl PhantomKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Head, Self::Sphere, Self::Slab, Self::Ramp, Self::Axes];

    /// The name on the command line and in `truth.json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Sphere => "sphere",
            Self::Slab => "slab",
            Self::Ramp => "ramp",
            Self::Axes => "axes",
        }
    }

    /// Default number of voxels across.
    #[must_use]
    pub const fn default_size(self) -> usize {
        match self {
            Self::Head | Self::Sphere | Self::Slab => 256,
            Self::Ramp | Self::Axes => 64,
        }
    }
}

/// An unknown name of a phantom.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown phantom {0:?}; known phantoms: head, sphere, slab, ramp, axes")]
pub struct UnknownPhantom(String);

impl FromStr for PhantomKind {
    type Err = UnknownPhantom;

    fn from_str(name: &str) -> Result<Self, UnknownPhantom> {
        let found = Self::ALL.into_iter().find(|kind| kind.name() == name);
        found.ok_or_else(|| UnknownPhantom(name.to_owned()))
    }
}

/// A size outside [`PhantomRecipe::SIZES`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the size is {found} voxels, allowed: {low} to {high}")]
pub struct PhantomSizeError {
    found: usize,
    low: usize,
    high: usize,
}

/// Everything that decides a phantom's voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PhantomRecipe {
    kind: PhantomKind,
    size: usize,
    seed: u64,
}

/// A procedural volume and its truth.
#[derive(Clone, Debug)]
pub struct Phantom {
    /// The voxels.
    pub volume: Volume,
    /// The objects in the volume.
    pub truth: PhantomTruth,
}

impl PhantomRecipe {
    /// Permitted numbers of voxels across. The largest makes about 2 GiB of voxels.
    pub const SIZES: std::ops::RangeInclusive<usize> = 16..=1024;

    /// The kind in its default size, seed 0.
    #[must_use]
    pub const fn new(kind: PhantomKind) -> Self {
        Self { kind, size: kind.default_size(), seed: 0 }
    }

    /// The same with `size` voxels across.
    ///
    /// # Errors
    /// When the size is outside [`PhantomRecipe::SIZES`].
    pub fn with_size(self, size: usize) -> Result<Self, PhantomSizeError> {
        if !Self::SIZES.contains(&size) {
            let (low, high) = (*Self::SIZES.start(), *Self::SIZES.end());
            return Err(PhantomSizeError { found: size, low, high });
        }
        Ok(Self { size, ..self })
    }

    /// The same with another seed for its noise and its irregular shapes (only the head has any).
    #[must_use]
    pub const fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Voxels along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.placement().dims
    }

    /// Makes the phantom.
    #[must_use]
    pub fn make(&self) -> Phantom {
        self.make_reporting(&|_| {})
    }

    /// Makes the phantom and calls `report` with the number of slices just finished, from any
    /// thread.
    #[must_use]
    pub fn make_reporting(&self, report: &(dyn Fn(usize) + Sync)) -> Phantom {
        let placement = self.placement();
        let (voxels, facts) = match self.kind {
            PhantomKind::Sphere => solids::sphere(&placement, report),
            PhantomKind::Slab => solids::slab(&placement, report),
            PhantomKind::Ramp => solids::ramp(&placement, report),
            PhantomKind::Axes => solids::axes(&placement, report),
            PhantomKind::Head => head::head(&placement, self.seed, report),
        };
        self.assemble(&placement, voxels, facts)
    }

    /// The organs of the phantom as segments on its grid; only the head has any.
    #[must_use]
    pub fn label_map(&self) -> Option<LabelMap> {
        if self.kind != PhantomKind::Head {
            return None;
        }
        let placement = self.placement();
        let described = head::ORGANS.map(|(label, name, rgb)| {
            Segment::new(label, Some(name), Some(rgb.map(|byte| f64::from(byte) / 255.0)))
        });
        let labels = head::labels(&placement, self.seed);
        let map = LabelMap::new(placement.grid(), &labels, described.to_vec());
        Some(map.expect("one label was made for each voxel of the placement"))
    }

    fn assemble(&self, placement: &Placement, voxels: Vec<i16>, facts: PhantomFacts) -> Phantom {
        let Placement { dims, spacing_mm, origin_mm } = *placement;
        let truth = PhantomTruth {
            schema: TRUTH_SCHEMA.to_owned(),
            kind: self.kind.name().to_owned(),
            size: self.size,
            seed: self.seed,
            dims,
            spacing_mm,
            origin_mm,
            stack_sha256: data_encoding::HEXLOWER.encode(&stack_sha256(&voxels)),
            noise_sigma_hu: facts.noise_sigma_hu,
            gradient_hu_per_mm: facts.gradient_hu_per_mm,
            materials: facts.materials,
            surfaces: facts.surfaces,
            landmarks: facts.landmarks,
        };
        let volume = Volume::new(placement.grid(), voxels)
            .expect("one value was made for each voxel of the placement");
        Phantom { volume, truth }
    }

    /// The grid of the voxels: around the patient origin, except for the head, whose origin is
    /// between the ears.
    fn placement(&self) -> Placement {
        let n = self.size;
        match self.kind {
            PhantomKind::Sphere | PhantomKind::Slab => Placement::centered([n; 3], [256.0; 3], [0.0; 3]),
            PhantomKind::Ramp => Placement::centered([n; 3], [n as f64; 3], [0.0; 3]),
            PhantomKind::Axes => Placement::centered([n; 3], [128.0; 3], [0.0; 3]),
            PhantomKind::Head => head::placement(n),
        }
    }
}

impl Phantom {
    /// The ball of 80 mm radius with `size` voxels across.
    ///
    /// # Errors
    /// When the size is outside [`PhantomRecipe::SIZES`]; so for the others.
    pub fn sphere(size: usize) -> Result<Self, PhantomSizeError> {
        Ok(PhantomRecipe::new(PhantomKind::Sphere).with_size(size)?.make())
    }

    /// The slab of 100 mm along y with `size` voxels across.
    ///
    /// # Errors
    /// As [`Phantom::sphere`].
    pub fn slab(size: usize) -> Result<Self, PhantomSizeError> {
        Ok(PhantomRecipe::new(PhantomKind::Slab).with_size(size)?.make())
    }

    /// The head with `size` voxels across, seed 0.
    ///
    /// # Errors
    /// As [`Phantom::sphere`].
    pub fn head(size: usize) -> Result<Self, PhantomSizeError> {
        Ok(PhantomRecipe::new(PhantomKind::Head).with_size(size)?.make())
    }

    /// The linear ramp of `size` voxels of 1 mm across.
    ///
    /// # Errors
    /// As [`Phantom::sphere`].
    pub fn ramp(size: usize) -> Result<Self, PhantomSizeError> {
        Ok(PhantomRecipe::new(PhantomKind::Ramp).with_size(size)?.make())
    }

    /// The six balls with `size` voxels across.
    ///
    /// # Errors
    /// As [`Phantom::sphere`].
    pub fn axes(size: usize) -> Result<Self, PhantomSizeError> {
        Ok(PhantomRecipe::new(PhantomKind::Axes).with_size(size)?.make())
    }
}
