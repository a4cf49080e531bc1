//! Fewer triangles: edges collapse where that changes the surface least (meshoptimizer's quadrics).
//!
//! The library keeps borders and most of the topology, but may fold a thin part until four
//! triangles share an edge. Closed meshes are repaired to manifolds afterwards (see `mend`).

use meshopt::{SimplifyOptions, VertexDataAdapter};

use super::fans::{Fan, Fans};
use super::{MeshError, TriangleMesh};
use relief_base::OutOfRange;

/// The limits of decimation. It ends at the first one that it reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimation {
    /// Triangles that are wanted. More are left where fewer would change the surface by more than
    /// allowed, or its topology.
    pub triangles: usize,
    /// The largest movement of the surface, about, mm.
    pub error_mm: f64,
}

impl Decimation {
    /// This number of triangles, at any error.
    #[must_use]
    pub fn to(triangles: usize) -> Self {
        Self { triangles, error_mm: f64::INFINITY }
    }
}

impl TriangleMesh {
    /// A mesh with fewer triangles. Its vertices are among those of this mesh, except for a few
    /// where it was repaired. A closed 2-manifold stays one; other meshes keep their topology as
    /// far as meshoptimizer keeps it. Parts may collapse and vanish, but never all.
    ///
    /// # Errors
    /// When `triangles` is below 4, the error is not above 0, or [`TriangleMesh::check`]
    /// fails.
    pub fn decimated(&self, decimation: Decimation) -> Result<Self, MeshError> {
        self.check()?;
        let Decimation { triangles, error_mm } = decimation;
        let refuse = |key, found: String, allowed: &str| Err(OutOfRange::new(key, found, allowed).into());
        if triangles < 4 {
            return refuse("triangles", triangles.to_string(), "4 or more: a tetrahedron");
        }
        if error_mm.is_nan() || error_mm <= 0.0 {
            return refuse("error_mm", error_mm.to_string(), "more than 0");
        }
        if self.triangles.len() <= triangles {
            return Ok(self.clone());
        }
        let middle = self.middle();
        let places: Vec<f32> =
            self.vertices.iter().flat_map(|vertex| (vertex.xyz - middle).as_vec3().to_array()).collect();
        let Ok(places) = VertexDataAdapter::new(bytemuck::cast_slice(&places), 12, 0) else {
            return Ok(self.clone());
        };
        let indices: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        // Errors of meshoptimizer are f32, and none is larger than this.
        let error = error_mm.min(1e30) as f32;
        let options = SimplifyOptions::ErrorAbsolute;
        let left = meshopt::simplify(&indices, &places, 3 * triangles, error, options, None);
        let mut made = Self { vertices: self.vertices.clone(), triangles: left.as_chunks::<3>().0.to_vec() };
        let is_manifold = |mesh: &Self| {
            let fans = Fans::new(mesh);
            (0..fans.len()).all(|corner| matches!(fans.kind(corner), Fan::Closed | Fan::Empty))
        };
        if is_manifold(self) {
            made.mend();
        }
        Ok(if made.triangles.is_empty() { self.clone() } else { made.compacted() })
    }
}
