//! Triangle meshes: surfaces of masks, made smooth and light, measured, and as files.
//!
//! What it is: [`surface_nets`] makes a closed surface of a [`Mask`](relief_volume::Mask);
//! [`TriangleMesh::smoothed`] and [`TriangleMesh::decimated`] smooth and simplify it;
//! [`TriangleMesh::measures`] has area and volume; `files` reads and writes PLY, STL, OBJ and GLB.
//! What it is not: rendering (see `relief_render`).
//!
//! Space: patient LPS, mm. The corners of a triangle go counter-clockwise as seen from outside.
//! Equal input gives equal meshes, whatever the number of threads.

mod cells;
mod decimate;
mod fans;
pub(crate) mod files;
mod measure;
mod mend;
mod nets;
mod smooth;

pub use decimate::Decimation;
pub use measure::Measures;
pub use nets::surface_nets;
pub use smooth::Smoothing;

use relief_base::{OutOfRange, Patient, Point};

/// A surface of triangles in patient LPS mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corners.
    pub vertices: Vec<Point<Patient>>,
    /// Three indices of corners each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh that cannot be made or used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// Nothing to make a surface of.
    #[error("the region has no voxels, so it has no surface")]
    Empty,
    /// Too many triangles.
    #[error(
        "the surface has {found} triangles, allowed: at most {allowed}; crop the volume or load it with fewer voxels"
    )]
    TooLarge {
        /// The number found.
        found: u64,
        /// The limit.
        allowed: u64,
    },
    /// A triangle with a corner that is not there.
    #[error("triangle {triangle} has corner {found}, allowed: 0 to {vertices} (not included)")]
    Corner {
        /// The triangle, from 0.
        triangle: usize,
        /// The corner's index.
        found: u32,
        /// The number of corners.
        vertices: usize,
    },
    /// A coordinate that is no number.
    #[error("vertex {0} is not finite")]
    Vertex(usize),
    /// A setting out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
}

impl TriangleMesh {
    /// Most triangles of a mesh: its corners and triangles then take some 2.5 GB.
    pub const MOST_TRIANGLES: u64 = 100_000_000;

    /// Checks that triangles refer to existing vertices, and that vertices are finite.
    ///
    /// # Errors
    /// The first of either that does not.
    pub fn check(&self) -> Result<(), MeshError> {
        if let Some(at) = self.vertices.iter().position(|vertex| !vertex.xyz.is_finite()) {
            return Err(MeshError::Vertex(at));
        }
        let vertices = self.vertices.len();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&found) = corners.iter().find(|corner| **corner as usize >= vertices) {
                return Err(MeshError::Corner { triangle, found, vertices });
            }
        }
        Ok(())
    }

    /// Leaves out corners that no triangle has.
    pub(crate) fn compacted(&self) -> Self {
        let mut place = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        let mut moved = |corner: u32| {
            let place = &mut place[corner as usize];
            if *place == u32::MAX {
                *place = vertices.len() as u32;
                vertices.push(self.vertices[corner as usize]);
            }
            *place
        };
        let triangles = self.triangles.iter().map(|corners| corners.map(&mut moved)).collect();
        Self { vertices, triangles }
    }
}
