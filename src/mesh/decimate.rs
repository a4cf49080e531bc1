//! Fewer triangles: edges collapse where that changes the surface least (meshoptimizer's quadrics).
//!
//! The library keeps borders and most of the topology, but may fold a thin tube into an edge of four triangles. A mesh
//! that was closed must stay so: where it came apart, the corners around are held, and it is done again from the beginning.

use meshopt::{SimplifyOptions, VertexDataAdapter};

use super::fans::{Fan, Fans};
use super::{MeshError, TriangleMesh};

/// How far to go: as far as both allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimation {
    /// Triangles that are wanted. More are left where fewer would change the surface by more than allowed, or its topology.
    pub triangles: usize,
    /// How far the surface may move, about, mm.
    pub error_mm: f64,
}

impl Decimation {
    /// So many triangles, whatever it costs.
    #[must_use]
    pub fn to(triangles: usize) -> Self {
        Self { triangles, error_mm: f64::INFINITY }
    }
}

/// Times that a mesh which came apart is begun anew; each holds more corners.
const MOST_TIMES: usize = 12;

impl TriangleMesh {
    /// A mesh with fewer triangles, whose corners are among those of this one. A closed one stays closed, a closed 2-manifold
    /// stays one; where that cannot be had the mesh comes back as it is.
    ///
    /// # Errors
    /// When fewer than 4 triangles are asked for, the error is not above 0, or [`TriangleMesh::check`] fails.
    pub fn decimated(&self, decimation: Decimation) -> Result<Self, MeshError> {
        self.check()?;
        let Decimation { triangles, error_mm } = decimation;
        let refuse = |key, found: String, allowed: &str| {
            Err(MeshError::Argument { key, found, allowed: allowed.to_owned() })
        };
        if triangles < 4 {
            return refuse("triangles", triangles.to_string(), "4 or more: a tetrahedron");
        }
        if !(error_mm > 0.0) {
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
        let before = soundness(self);
        let mut held = vec![false; self.vertices.len()];
        // Errors of meshoptimizer are f32, and none is larger than this.
        let error = error_mm.min(1e30) as f32;
        for _ in 0..MOST_TIMES {
            let left = meshopt::simplify_with_locks(
                &indices,
                &places,
                &held,
                3 * triangles,
                error,
                SimplifyOptions::ErrorAbsolute,
                None,
            );
            let triangles = left.as_chunks::<3>().0.to_vec();
            let made = Self { vertices: self.vertices.clone(), triangles };
            let fans = Fans::new(&made);
            let is_worse = |corner: &usize| {
                let kind = fans.kind(*corner);
                kind != Fan::Empty && kind != Fan::Closed && before[*corner] == Fan::Closed
            };
            let torn: Vec<usize> = (0..fans.len()).filter(is_worse).collect();
            if torn.is_empty() && !made.triangles.is_empty() {
                return Ok(made.compacted());
            }
            self.hold(&mut held, &torn);
        }
        Ok(self.clone())
    }

    /// Holds corners and what is around them in this mesh.
    fn hold(&self, held: &mut [bool], torn: &[usize]) {
        torn.iter().for_each(|corner| held[*corner] = true);
        let near: Vec<u32> = self
            .triangles
            .iter()
            .filter(|corners| corners.iter().any(|corner| held[*corner as usize]))
            .flatten()
            .copied()
            .collect();
        near.into_iter().for_each(|corner| held[corner as usize] = true);
    }
}

fn soundness(mesh: &TriangleMesh) -> Vec<Fan> {
    use rayon::prelude::*;
    let fans = Fans::new(mesh);
    (0..fans.len()).into_par_iter().map(|corner| fans.kind(corner)).collect()
}
