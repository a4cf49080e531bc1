//! Label maps: the structure of each voxel of a grid, and the names of the structures.
//!
//! [`LabelMap`] holds segments by their labels on a grid of its own; [`LabelMap::resampled`] brings
//! it to a volume's grid. [`BrickLabels`] lists the segments of each brick for empty-space
//! skipping. This module reads no files (see the crate `dicom`), and has no colours except those in
//! a file.
//!
//! Spaces: voxel index and patient mm. A voxel belongs to one segment or to none; label 0 means
//! none.

mod bricks;
mod layers;
mod palette;

use std::sync::OnceLock;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::{ContentHash, Grid};
use relief_base::{Patient, Point};

pub use bricks::BrickLabels;
pub use layers::{Layers, LayersError};

/// One structure of a label map.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// The number that the file gives it; never 0.
    pub label: u16,
    /// Its name, where the file has one.
    pub name: Option<String>,
    /// Its colour in display-referred sRGB, 0..1, where the file says.
    pub rgb: Option<[f64; 3]>,
}

impl Segment {
    /// Longest name that is kept, in characters.
    pub const LONGEST_NAME: usize = 128;

    /// A segment as a file describes it: the name without control characters and cut to
    /// [`Segment::LONGEST_NAME`], a colour only where all of it is within 0..1.
    #[must_use]
    pub fn new(label: u16, name: Option<&str>, rgb: Option<[f64; 3]>) -> Self {
        let clean = |name: &str| -> String {
            let shown = name.trim().chars().filter(|letter| !letter.is_control());
            shown.take(Self::LONGEST_NAME).collect()
        };
        let name = name.map(clean).filter(|name| !name.is_empty());
        let rgb = rgb.filter(|rgb| rgb.iter().all(|channel| (0.0..=1.0).contains(channel)));
        Self { label, name, rgb }
    }

    /// The colour that it is shown in: the file's, or one that goes with its label.
    #[must_use]
    pub fn color(&self) -> [f64; 3] {
        self.rgb.unwrap_or_else(|| palette::color(self.label))
    }
}

/// For every voxel the place of its segment in [`LabelMap::segments`], counted from 1; 0 for none.
/// x fastest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SegmentIndices {
    /// At most 255 segments.
    Bytes(Vec<u8>),
    /// More.
    Words(Vec<u16>),
}

impl SegmentIndices {
    /// The place at an index of the voxels, 0 for none.
    #[must_use]
    pub fn at(&self, index: usize) -> usize {
        match self {
            Self::Bytes(places) => places[index].into(),
            Self::Words(places) => places[index].into(),
        }
    }

    /// Bytes in memory.
    fn bytes(&self) -> u64 {
        match self {
            Self::Bytes(places) => places.len() as u64,
            Self::Words(places) => size_of_val(places.as_slice()) as u64,
        }
    }

    fn of_labels(labels: &[u16], place_of: &[u16], segments: usize) -> Self {
        if segments <= usize::from(u8::MAX) {
            let byte = |&label: &u16| place_of[usize::from(label)] as u8;
            return Self::Bytes(labels.par_iter().map(byte).collect());
        }
        Self::Words(labels.par_iter().map(|&label| place_of[usize::from(label)]).collect())
    }
}

/// A number of labels that is not that of the grid's voxels.
#[derive(Clone, Debug, thiserror::Error)]
#[error("a grid of {dims:?} voxels needs {expected} labels, found {found}")]
pub struct LabelCountError {
    dims: [usize; 3],
    expected: usize,
    found: usize,
}

/// The segment of each voxel of a grid.
pub struct LabelMap {
    grid: Grid,
    segments: Vec<Segment>,
    /// The number of voxels of each segment.
    counts: Vec<u64>,
    places: SegmentIndices,
    hash: OnceLock<ContentHash>,
}

/// Voxels are left out, since there are millions. The hash identifies them.
impl std::fmt::Debug for LabelMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("LabelMap").field(&self.content_hash()).finish()
    }
}

/// Equal in content: grid, segments and voxels.
impl PartialEq for LabelMap {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other) || self.content_hash() == other.content_hash()
    }
}

impl LabelMap {
    /// The map of `labels` (x fastest) on `grid`. Segments are all labels that occur and all that
    /// are `described`, in the order of their labels; of two descriptions of one label the first
    /// counts.
    ///
    /// # Errors
    /// When the number of labels is not that of the grid's voxels.
    pub fn new(grid: Grid, labels: &[u16], described: Vec<Segment>) -> Result<Self, LabelCountError> {
        let expected = grid.voxel_count();
        if labels.len() != expected {
            return Err(LabelCountError { dims: grid.dims(), expected, found: labels.len() });
        }
        let counts = count(labels);
        let mut segments: Vec<Segment> = described.into_iter().filter(|segment| segment.label > 0).collect();
        segments.sort_by_key(|segment| segment.label); // stable: the first of two stays first
        segments.dedup_by_key(|segment| segment.label);
        let is_described =
            |label: u16| segments.binary_search_by_key(&label, |segment| segment.label).is_ok();
        let occurring = (1..=u16::MAX).filter(|&label| counts[usize::from(label)] > 0);
        let bare: Vec<Segment> = occurring
            .filter(|&label| !is_described(label))
            .map(|label| Segment::new(label, None, None))
            .collect();
        segments.extend(bare);
        segments.sort_by_key(|segment| segment.label);
        let mut place_of = vec![0; usize::from(u16::MAX) + 1];
        for (place, segment) in (1..).zip(&segments) {
            place_of[usize::from(segment.label)] = place;
        }
        let places = SegmentIndices::of_labels(labels, &place_of, segments.len());
        let counts = segments.iter().map(|segment| counts[usize::from(segment.label)]).collect();
        Ok(Self { grid, segments, counts, places, hash: OnceLock::new() })
    }

    /// The map of one segment, from places that are 0 or 1 and the number of ones.
    pub(super) fn of_one(grid: Grid, places: Vec<u8>, segment: Segment, voxels: u64) -> Self {
        let places = SegmentIndices::Bytes(places);
        Self { grid, segments: vec![segment], counts: vec![voxels], places, hash: OnceLock::new() }
    }

    /// Bytes of its voxels in memory: one or two for each.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.places.bytes()
    }

    /// The grid of the voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The segments, labels rising.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// The segments with the number of voxels of each.
    pub fn counted(&self) -> impl Iterator<Item = (&Segment, u64)> {
        self.segments.iter().zip(self.counts.iter().copied())
    }

    /// For every voxel the place of its segment.
    #[must_use]
    pub fn places(&self) -> &SegmentIndices {
        &self.places
    }

    /// The number of voxels of a segment.
    #[must_use]
    pub fn labelled_voxels(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Volume of one voxel, mm³.
    #[must_use]
    pub fn voxel_mm3(&self) -> f64 {
        self.grid.patient_from_voxel().linear().determinant().abs()
    }

    /// Bytes that the voxels take.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        match &self.places {
            SegmentIndices::Bytes(places) => places.len(),
            SegmentIndices::Words(places) => size_of_val(places.as_slice()),
        }
    }

    /// The segment at a position; `None` outside the map and in the background.
    #[must_use]
    pub fn at(&self, position: Point<Patient>) -> Option<&Segment> {
        let index = nearest((self.grid.voxel_from_patient() * position).xyz);
        let place = self.places.at(offset(index, self.grid.dims())?);
        place.checked_sub(1).map(|at| &self.segments[at])
    }

    /// The map on another grid, by nearest neighbour; outside of this map there is no segment.
    /// Segments stay, even those that have no voxel there.
    #[must_use]
    pub fn resampled(&self, grid: &Grid) -> Self {
        let to_own = self.grid.voxel_from_patient() * grid.patient_from_voxel();
        let (from, [nx, ny, _]) = (self.grid.dims(), grid.dims());
        let step = to_own.linear().x_axis;
        let label_of = |place: usize| place.checked_sub(1).map_or(0, |at| self.segments[at].label);
        let mut labels = vec![0u16; grid.voxel_count()];
        labels.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let start = (to_own * Point::new(0.0, (row % ny) as f64, (row / ny) as f64)).xyz;
            for (i, label) in out.iter_mut().enumerate() {
                let found = offset(nearest(start + step * i as f64), from);
                *label = found.map_or(0, |at| label_of(self.places.at(at)));
            }
        });
        Self::new(grid.clone(), &labels, self.segments.clone()).expect("one label was made for each voxel")
    }

    /// Identity by content; computed once, then remembered.
    #[must_use]
    pub fn content_hash(&self) -> ContentHash {
        *self.hash.get_or_init(|| {
            let mut hasher = Sha256::new();
            for n in self.grid.dims() {
                hasher.update((n as u64).to_le_bytes());
            }
            for column in self.grid.patient_from_voxel().affine.to_cols_array() {
                hasher.update(column.to_le_bytes());
            }
            hasher.update(format!("{:?}", self.segments));
            match &self.places {
                SegmentIndices::Bytes(places) => hasher.update(places),
                SegmentIndices::Words(places) => {
                    places.iter().for_each(|place| hasher.update(place.to_le_bytes()));
                }
            }
            ContentHash(hasher.finalize().into())
        })
    }
}

/// The number of voxels of each label.
fn count(labels: &[u16]) -> Vec<u64> {
    let empty = || vec![0u64; usize::from(u16::MAX) + 1];
    let add = |mut counts: Vec<u64>, part: &[u16]| {
        part.iter().for_each(|&label| counts[usize::from(label)] += 1);
        counts
    };
    let merge = |mut a: Vec<u64>, b: Vec<u64>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    labels.par_chunks(1 << 22).fold(empty, add).reduce(empty, merge)
}

/// The voxel that a continuous index is nearest to. Exactly between two it is the higher one,
/// whatever was rounded on the way: the voxels of a map of twice the resolution all lie between
/// two.
fn nearest(index: glam::DVec3) -> [i64; 3] {
    const ROUNDING: f64 = 1e-6;
    index.to_array().map(|x| (x + 0.5 + ROUNDING).floor() as i64)
}

/// The number of a voxel among all; `None` outside the grid.
fn offset(index: [i64; 3], dims: [usize; 3]) -> Option<usize> {
    let mut inside = [0; 3];
    for (axis, (index, n)) in index.into_iter().zip(dims).enumerate() {
        inside[axis] = usize::try_from(index).ok().filter(|&index| index < n)?;
    }
    Some((inside[2] * dims[1] + inside[1]) * dims[0] + inside[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(dims: [usize; 3], spacing: f64, origin: f64) -> Grid {
        Grid::axis_aligned(dims, [spacing; 3], [origin; 3]).unwrap()
    }

    #[test]
    fn segments_are_those_that_occur_and_those_that_are_described() {
        let named = Segment::new(700, Some(" liver\n"), Some([0.5, 0.25, 2.0]));
        let absent = Segment::new(9, Some("spleen"), None);
        let twice = Segment::new(9, Some("again"), None);
        let map = LabelMap::new(grid([3, 1, 1], 1.0, 0.0), &[0, 700, 4], vec![named, absent, twice]).unwrap();
        let found: Vec<_> = map.counted().map(|(s, n)| (s.label, s.name.as_deref(), n)).collect();
        assert_eq!(found, [(4, None, 1), (9, Some("spleen"), 0), (700, Some("liver"), 1)]);
        assert_eq!(*map.places(), SegmentIndices::Bytes(vec![0, 3, 1]));
        assert_eq!(map.segments()[2].rgb, None, "2.0 is no share of a colour");
        assert_eq!(map.at(Point::new(1.4, 0.0, 0.0)).unwrap().label, 700);
        assert_eq!(map.at(Point::new(-0.4, 0.0, 0.0)), None);
        assert_eq!(map.at(Point::new(7.0, 0.0, 0.0)), None);
        assert!(LabelMap::new(grid([3, 1, 1], 1.0, 0.0), &[0, 1], vec![]).is_err());
    }

    #[test]
    fn many_segments_take_words() {
        let labels: Vec<u16> = (0..400).collect();
        let map = LabelMap::new(grid([400, 1, 1], 1.0, 0.0), &labels, vec![]).unwrap();
        assert_eq!(*map.places(), SegmentIndices::Words(labels));
    }

    #[test]
    fn resampling_takes_the_nearest_label_and_none_outside() {
        let coarse = LabelMap::new(grid([2, 1, 1], 2.0, 0.0), &[1, 2], vec![]).unwrap();
        let fine = Grid::axis_aligned([7, 1, 1], [1.0; 3], [-2.0, 0.0, 0.0]).unwrap();
        // Centres at -2 to 4: the map reaches from -1 to 3, and 1 lies between its voxels.
        assert_eq!(*coarse.resampled(&fine).places(), SegmentIndices::Bytes(vec![0, 1, 1, 2, 2, 0, 0]));
        let turned = Grid::new(
            [2, 1, 1],
            relief_base::Transform::from_axes(
                -glam::DVec3::X * 2.0,
                glam::DVec3::Y,
                glam::DVec3::Z,
                glam::DVec3::X * 2.0,
            ),
        );
        assert_eq!(*coarse.resampled(&turned.unwrap()).places(), SegmentIndices::Bytes(vec![2, 1]));
    }

    #[test]
    fn equal_content_is_reported_as_equal() {
        let make = |label| LabelMap::new(grid([2, 1, 1], 2.0, 0.0), &[1, label], vec![]).unwrap();
        assert_eq!(make(5), make(5));
        assert_ne!(make(5), make(6));
        assert_ne!(format!("{:?}", make(5)), format!("{:?}", make(6)), "entity tags are made of it");
    }
}
