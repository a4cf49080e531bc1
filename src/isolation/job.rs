//! Jobs of a child and its answers, as JSON. Voxels, labels and contents follow an answer as bytes.

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use relief_annotation::{FrameOfReference, Item};
use relief_base::Transform;
use relief_dicom::{SeriesIdentity, SeriesReference, WarningCode};
use relief_volume::{Grid, GridError, Segment};

/// A job; the file or folder is the child's standard input.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum Job {
    /// The series of a file or folder.
    List {
        /// The resources that reading may take.
        limits: ReadLimits,
        /// Whether the contents of series are hashed, which reads all of their files.
        hashes_contents: bool,
    },
    /// A series of a file or folder.
    Series(SeriesChoice, ReadLimits),
    /// A label map, brought to a grid.
    Labels {
        /// The grid of the volume.
        grid: WireGrid,
        /// Most voxels of the map.
        most_voxels: u64,
    },
    /// A file of annotations.
    Annotations(Box<AnnotationJob>),
    /// No file: the child tries forbidden actions.
    Probe(Probe),
}

/// The series that a child reads, and the options of reading.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeriesChoice {
    /// The name of the file or folder in refusals: its own may be that of a patient.
    pub subject: String,
    /// The series; the only one if absent.
    pub uid: Option<String>,
    /// Whether a defective file is an error.
    pub is_strict: bool,
    /// Voxels of a side whose mean is one voxel of the result; at least 1.
    pub downsample: u8,
    /// Whether a volume in NIfTI or NRRD is taken as well.
    pub takes_volume_files: bool,
    /// Whether the content of a DICOM series is hashed before it is read.
    pub hashes_content: bool,
}

impl SeriesChoice {
    /// The only DICOM series of what messages call `subject`, in full resolution, without its
    /// defective files.
    #[must_use]
    pub fn only(subject: &str) -> Self {
        let subject = subject.to_owned();
        Self {
            subject,
            uid: None,
            is_strict: false,
            downsample: 1,
            takes_volume_files: false,
            hashes_content: false,
        }
    }
}

/// A series that a child found, by its headers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListedSeries {
    /// SeriesInstanceUID, with `#1`, `#2`, ... where it names several stacks.
    pub uid: String,
    /// Modality.
    pub modality: String,
    /// Columns, rows and slices.
    pub dims: [usize; 3],
    /// Distance between columns and between rows, mm.
    pub pixel_mm: [f64; 2],
    /// Thickness of a slice, mm.
    pub thickness_mm: Option<f64>,
    /// UID of the frame of reference.
    pub frame_of_reference: Option<String>,
    /// SHA-256 of its files, lowercase hexadecimal digits, if requested.
    pub sha256: Option<String>,
}

/// The result of reading headers, before voxels are read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundSeries {
    /// Columns, rows and slices of the volume.
    pub dims: [usize; 3],
    /// SHA-256 of the files of a DICOM series, lowercase hexadecimal digits, if requested.
    pub sha256: Option<String>,
}

/// The resources that reading may take.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct ReadLimits {
    /// Most bytes of voxels.
    pub(crate) voxel_bytes: u64,
    /// Most bytes that headers may keep.
    pub(crate) kept_bytes: u64,
    /// Most bytes that compressed data may unpack to.
    pub(crate) unpacked_bytes: u64,
}

/// The task of a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Probe {
    /// To open a file, to connect, to start a program.
    Rights,
    /// To allocate without end.
    Memory,
}

/// Rights that a child still has after it gave them up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RemainingRights {
    /// It opens files that it was not given.
    pub opens_files: bool,
    /// It connects to a network address.
    pub connects: bool,
    /// It starts programs.
    pub starts_programs: bool,
    /// Whether the kernel enforces Landlock for it.
    pub has_landlock: bool,
    /// Whether the kernel enforces the filter of system calls for it.
    pub has_seccomp: bool,
}

impl RemainingRights {
    /// Whether none is left.
    #[must_use]
    pub fn are_none(&self) -> bool {
        !(self.opens_files || self.connects || self.starts_programs)
    }
}

impl std::fmt::Display for RemainingRights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let rights = [
            (self.opens_files, "opens files"),
            (self.connects, "connects to other machines"),
            (self.starts_programs, "starts programs"),
        ];
        let left: Vec<&str> =
            rights.iter().filter(|(is_left, _)| *is_left).map(|(_, right)| *right).collect();
        f.write_str(&left.join(" and "))
    }
}

/// A file of annotations and the context in which it is read.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct AnnotationJob {
    /// Name of the format; found out from file name and content if absent.
    pub(crate) format: Option<String>,
    pub(crate) file_name: String,
    pub(crate) author: String,
    pub(crate) set: String,
    pub(crate) list: String,
    pub(crate) frame_of_reference: Option<FrameOfReference>,
    pub(crate) grid: Option<WireGrid>,
    pub(crate) series: Option<SeriesReference>,
    /// Largest file.
    pub(crate) most_bytes: u64,
}

/// The answer of a child.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum Answer {
    /// The series of a file or folder, at least one.
    Listed { series: Vec<ListedSeries> },
    /// The file is a volume in NIfTI or NRRD.
    VolumeFile { grid: WireGrid },
    /// The headers of a series have been read; the parent says whether it wants the voxels.
    Found(FoundSeries),
    /// A series; its voxels follow, 16-bit HU, x fastest.
    Series(Box<SeriesAnswer>),
    /// A label map; the label of each voxel follows, 16 bits.
    Labels { grid: WireGrid, segments: Vec<WireSegment>, warnings: Vec<String> },
    /// Annotations; their contents follow, one behind the other.
    Annotations { items: Vec<Item>, contents: Vec<WireContent>, warnings: Vec<String> },
    /// The rights that were left to the child.
    Probed(RemainingRights),
    /// The file is damaged, or of another kind.
    Refused { kind: Refusal, reason: String },
}

/// The reason for refusing a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Refusal {
    /// Its content.
    Content,
    /// Neither name nor content says which format it has.
    UnknownFormat,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SeriesAnswer {
    pub(crate) grid: WireGrid,
    /// The unit of the values, by its Rescale Type.
    pub(crate) unit: String,
    /// Anomalies of the series, and files that were left out.
    pub(crate) warnings: Vec<WarningCode>,
    /// Their messages.
    pub(crate) messages: Vec<String>,
    pub(crate) identity: Option<SeriesIdentity>,
    pub(crate) reference: Option<SeriesReference>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct WireContent {
    pub(crate) media_type: String,
    pub(crate) bytes: u64,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct WireSegment {
    label: u16,
    name: Option<String>,
    rgb: Option<[f64; 3]>,
}

impl From<&Segment> for WireSegment {
    fn from(segment: &Segment) -> Self {
        Self { label: segment.label, name: segment.name.clone(), rgb: segment.rgb }
    }
}

impl From<WireSegment> for Segment {
    fn from(wire: WireSegment) -> Self {
        Self::new(wire.label, wire.name.as_deref(), wire.rgb)
    }
}

/// A grid: JSON keeps every bit of its numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct WireGrid {
    dims: [usize; 3],
    /// Columns of patient-from-voxel: three axes and the origin, mm.
    patient_from_voxel: [[f64; 3]; 4],
}

impl From<&Grid> for WireGrid {
    fn from(grid: &Grid) -> Self {
        let affine = grid.patient_from_voxel().affine;
        let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
        let patient_from_voxel = [x, y, z, affine.translation].map(|column| column.to_array());
        Self { dims: grid.dims(), patient_from_voxel }
    }
}

impl TryFrom<&WireGrid> for Grid {
    type Error = GridError;

    fn try_from(wire: &WireGrid) -> Result<Self, GridError> {
        let [x, y, z, origin] = wire.patient_from_voxel.map(DVec3::from);
        let affine = DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: origin };
        Self::new(wire.dims, Transform::from_affine(affine))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_keeps_every_bit() {
        let axes = (DVec3::new(0.1, 1e-17, -0.3), DVec3::new(1.0 / 3.0, 0.7, 0.0), DVec3::Z * 1.25);
        let origin = DVec3::new(-124.755_859_375, f64::MIN_POSITIVE, 1e300);
        let grid = Grid::new([3, 4, 5], Transform::from_axes(axes.0, axes.1, axes.2, origin)).unwrap();
        let text = serde_json::to_string(&WireGrid::from(&grid)).unwrap();
        let read: WireGrid = serde_json::from_str(&text).unwrap();
        assert_eq!(Grid::try_from(&read).unwrap(), grid);
    }
}
