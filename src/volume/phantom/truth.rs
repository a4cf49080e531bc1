//! The truth of a phantom: its objects and their places, as JSON.
//!
//! Positions and lengths are in patient LPS mm, values in HU. Lists keep their order from version
//! to version, so that a test or a tool may address an entry by its place as well as by its name.
//! It is not a segmentation: it names closed-form surfaces and single points, each of which lies on
//! the model by construction.

use serde::{Deserialize, Serialize};

/// The format name in a [`PhantomTruth`] document.
pub(crate) const TRUTH_SCHEMA: &str = "relief.phantom.truth/1";

/// Everything that is known about a phantom without looking at its voxels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhantomTruth {
    /// `relief.phantom.truth/1`.
    pub schema: String,
    /// The name of the phantom's kind, as on the command line.
    pub kind: String,
    /// The requested size: voxels across.
    pub size: usize,
    /// The seed of everything random in it.
    pub seed: u64,
    /// Voxels along x, y and z.
    pub dims: [usize; 3],
    /// Distance between voxel centres, mm.
    pub spacing_mm: [f64; 3],
    /// Centre of the first voxel, patient LPS mm.
    pub origin_mm: [f64; 3],
    /// SHA-256 of the voxels: little-endian int16 HU, x fastest, then y, then z (towards the head).
    pub stack_sha256: String,
    /// Standard deviation of the noise added to each voxel, HU.
    pub noise_sigma_hu: f64,
    /// For a linear ramp: the change of HU per mm along x, y and z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gradient_hu_per_mm: Option<[f64; 3]>,
    /// The materials of the phantom.
    pub materials: Vec<Material>,
    /// Surfaces with a closed form.
    pub surfaces: Vec<Surface>,
    /// Named points.
    pub landmarks: Vec<PhantomLandmark>,
}

impl PhantomTruth {
    /// The landmarks as a table of points, LPS mm, that Relief and 3D Slicer import.
    #[must_use]
    pub fn landmark_table(&self) -> String {
        let rows =
            self.landmarks.iter().map(|PhantomLandmark { name, position_mm: [l, p, s], on, .. }| {
                format!("{name},{l},{p},{s},on {on}\n")
            });
        std::iter::once("label,l,p,s,description\n".to_owned()).chain(rows).collect()
    }

    /// The landmark of this name.
    #[must_use]
    pub fn landmark(&self, name: &str) -> Option<&PhantomLandmark> {
        self.landmarks.iter().find(|landmark| landmark.name == name)
    }

    /// The value of the material of this name, HU.
    #[must_use]
    pub fn material_hu(&self, name: &str) -> Option<f64> {
        self.materials.iter().find(|material| material.name == name).map(|material| material.hu)
    }
}

/// A material and its value before noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Plain name, for example `cortical bone`.
    pub name: String,
    /// Value, HU.
    pub hu: f64,
}

/// A surface with a closed form, and the HU values on its two sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// Plain name, for example `left eyeball`.
    pub name: String,
    /// The material on the inner side.
    pub inside: String,
    /// The material on the outer side; `various` where there are several.
    pub outside: String,
    /// Its place.
    pub shape: SurfaceShape,
}

/// The closed form of a surface, patient LPS mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SurfaceShape {
    /// Points at a distance from a centre.
    Sphere {
        /// Centre.
        center_mm: [f64; 3],
        /// Radius.
        radius_mm: f64,
    },
    /// Points at which the three coordinates from the centre, divided by the semi-axes, have norm
    /// 1.
    Ellipsoid {
        /// Centre.
        center_mm: [f64; 3],
        /// Semi-axes along x, y and z.
        semi_axes_mm: [f64; 3],
    },
    /// A plane.
    Plane {
        /// A point of it.
        point_mm: [f64; 3],
        /// Unit normal, from the inner to the outer side.
        normal: [f64; 3],
    },
}

/// A named point on the boundary of a tissue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhantomLandmark {
    /// Anatomical name in lower case; `left` and `right` are the patient's.
    pub name: String,
    /// Position, patient LPS mm.
    pub position_mm: [f64; 3],
    /// The boundary that it lies on: `skin`, `bone`, `tooth`, or the name of a surface.
    pub on: String,
    /// Unit vector out of the tissue at the landmark: along it the value falls through `level_hu`.
    pub outward: [f64; 3],
    /// The value halfway between the two sides, HU.
    pub level_hu: f64,
}
