//! The geometry of an item, in patient LPS mm.

use data_encoding::HEXLOWER;
use serde::{Deserialize, Serialize};

use super::patient_mm;
use relief_base::{Patient, Point};

/// The place and the shape of an item.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Geometry {
    /// A landmark.
    Point {
        /// The position.
        #[serde(with = "patient_mm")]
        at_mm: Point<Patient>,
    },
    /// A straight distance.
    Line {
        /// Both ends.
        #[serde(with = "patient_mm::array")]
        ends_mm: [Point<Patient>; 2],
    },
    /// The angle between two arms.
    Angle {
        /// The end of one arm, where both meet, the end of the other.
        #[serde(with = "patient_mm::array")]
        points_mm: [Point<Patient>; 3],
    },
    /// A line through points.
    Curve {
        /// In order: two or more, three or more where it is closed.
        #[serde(with = "patient_mm::array")]
        points_mm: Vec<Point<Patient>>,
        /// Whether the last point is joined to the first.
        #[serde(default)]
        closed: bool,
        /// Whether it is a centripetal Catmull-Rom spline, instead of straight between its points.
        #[serde(default)]
        smooth: bool,
    },
    /// A rectangle of a plane.
    Plane {
        /// Its centre.
        #[serde(with = "patient_mm")]
        center_mm: Point<Patient>,
        /// Across it; a unit vector.
        normal: [f64; 3],
        /// Along its width; a unit vector across the normal.
        axis: [f64; 3],
        /// Width along the axis, and height across it.
        size_mm: [f64; 2],
    },
    /// Voxels of a structure.
    Region(RegionSummary),
    /// A surface of triangles.
    Mesh(MeshSummary),
}

/// A region: its voxels are the content, a `.seg.nrrd` file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionSummary {
    /// The file's content.
    pub content: ContentId,
    /// The index of the segment that is the region.
    pub label: u16,
    /// The number of its voxels.
    pub voxels: u64,
    /// Their volume.
    pub volume_ml: f64,
}

/// A mesh: its triangles are the content, a binary PLY file in patient LPS mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshSummary {
    /// The file's content.
    pub content: ContentId,
    /// Corners.
    pub vertices: u32,
    /// Faces.
    pub triangles: u32,
    /// Of the surface.
    pub area_mm2: f64,
    /// Enclosed, where the surface is closed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_ml: Option<f64>,
}

/// SHA-256 of a content, as 64 hexadecimal digits: its name everywhere.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ContentId(String);

impl ContentId {
    /// The name of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        use sha2::Digest;
        Self(HEXLOWER.encode(&sha2::Sha256::digest(bytes)))
    }

    /// The 64 digits.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for ContentId {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        let is_digit = |letter: u8| letter.is_ascii_digit() || (b'a'..=b'f').contains(&letter);
        if text.len() == 64 && text.bytes().all(is_digit) {
            return Ok(Self(text));
        }
        Err("a content's name is 64 digits of lower-case hexadecimal".to_owned())
    }
}

impl From<ContentId> for String {
    fn from(id: ContentId) -> Self {
        id.0
    }
}

impl Geometry {
    /// The key `kind` of its JSON form.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Point { .. } => "point",
            Self::Line { .. } => "line",
            Self::Angle { .. } => "angle",
            Self::Curve { .. } => "curve",
            Self::Plane { .. } => "plane",
            Self::Region(_) => "region",
            Self::Mesh(_) => "mesh",
        }
    }

    /// The points that people set: those of the geometry, a plane's centre; none of regions and
    /// meshes.
    #[must_use]
    pub fn points(&self) -> &[Point<Patient>] {
        match self {
            Self::Point { at_mm } => std::slice::from_ref(at_mm),
            Self::Line { ends_mm } => ends_mm,
            Self::Angle { points_mm } => points_mm,
            Self::Curve { points_mm, .. } => points_mm,
            Self::Plane { center_mm, .. } => std::slice::from_ref(center_mm),
            Self::Region(_) | Self::Mesh(_) => &[],
        }
    }

    /// The same, to be moved.
    pub fn points_mut(&mut self) -> &mut [Point<Patient>] {
        match self {
            Self::Point { at_mm } => std::slice::from_mut(at_mm),
            Self::Line { ends_mm } => ends_mm,
            Self::Angle { points_mm } => points_mm,
            Self::Curve { points_mm, .. } => points_mm,
            Self::Plane { center_mm, .. } => std::slice::from_mut(center_mm),
            Self::Region(_) | Self::Mesh(_) => &mut [],
        }
    }

    /// The content that it refers to.
    #[must_use]
    pub const fn content(&self) -> Option<&ContentId> {
        match self {
            Self::Region(region) => Some(&region.content),
            Self::Mesh(mesh) => Some(&mesh.content),
            _ => None,
        }
    }
}
