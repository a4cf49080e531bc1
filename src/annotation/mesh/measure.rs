//! Area, volume and soundness of a mesh.

use glam::DVec3;
use rayon::prelude::*;

use super::TriangleMesh;
use super::fans::{Fan, Fans};

/// The measures of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Measures {
    /// Sum of the triangles' areas.
    pub area_mm2: f64,
    /// The enclosed volume of a closed surface: positive if triangles are counter-clockwise seen
    /// from outside.
    pub volume_ml: Option<f64>,
    /// Whether every edge has two triangles, which run along it in opposite directions.
    pub is_closed: bool,
    /// Whether besides that the triangles around every corner make one round: a closed 2-manifold.
    pub is_manifold: bool,
    /// Corners that triangles have, less edges, plus triangles: 2 for a ball, 0 for a ring; the sum
    /// of all parts. Of a closed surface.
    pub euler: Option<i64>,
}

/// Triangles that are added up together, so that sums do not depend on threads.
const BLOCK: usize = 1 << 14;

impl TriangleMesh {
    /// Area, volume, and whether it is closed.
    ///
    /// The volume is that of the divergence theorem: tetrahedra from the middle of the mesh to each
    /// triangle, with their signs. A mesh that fails [`TriangleMesh::check`] panics.
    #[must_use]
    pub fn measures(&self) -> Measures {
        let fans = Fans::new(self);
        let count =
            |kind: Fan| (0..fans.len()).into_par_iter().filter(|corner| fans.kind(*corner) == kind).count();
        let is_closed = !self.triangles.is_empty() && count(Fan::Open) == 0;
        let is_manifold = is_closed && count(Fan::Pinched) == 0;
        let used = fans.len() - count(Fan::Empty);
        let triangles = self.triangles.len() as i64;
        let euler = is_closed.then(|| used as i64 - triangles * 3 / 2 + triangles);
        let (area_mm2, mm3) = self.sums();
        Measures { area_mm2, volume_ml: is_closed.then_some(mm3 / 1000.0), is_closed, is_manifold, euler }
    }

    /// Area, mm², and volume, mm³.
    pub(super) fn sums(&self) -> (f64, f64) {
        let middle = self.middle();
        let block = |triangles: &[[u32; 3]]| {
            triangles.iter().fold((0.0, 0.0), |(area, volume), corners| {
                let [a, b, c] = corners.map(|corner| self.vertices[corner as usize].xyz - middle);
                let across = (b - a).cross(c - a);
                (area + across.length() / 2.0, volume + a.dot(across) / 6.0)
            })
        };
        let blocks: Vec<(f64, f64)> = self.triangles.par_chunks(BLOCK).map(block).collect();
        blocks.into_iter().fold((0.0, 0.0), |(area, volume), (a, v)| (area + a, volume + v))
    }

    /// The middle of the box around the corners.
    pub(super) fn middle(&self) -> DVec3 {
        let [low, high] = self.span();
        if low.x <= high.x { (low + high) / 2.0 } else { DVec3::ZERO }
    }

    /// The box around the corners: smallest and largest coordinates, mm. Without corners the first
    /// is above the second.
    #[must_use]
    pub fn span(&self) -> [DVec3; 2] {
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        self.vertices.iter().fold(start, |[low, high], vertex| [low.min(vertex.xyz), high.max(vertex.xyz)])
    }
}
