//! Parts that readers of mesh files share: the axes that a file states, and the form of its
//! triangles.

use std::collections::HashMap;

use glam::DVec3;

use crate::mesh::TriangleMesh;
use relief_base::Point;

/// A mesh and the warnings of its reader.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadMesh {
    /// In patient LPS mm.
    pub mesh: TriangleMesh,
    /// Warnings, in sentences.
    pub warnings: Vec<String>,
}

/// The axes that a file states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Axes {
    #[default]
    Unsaid,
    Lps,
    Ras,
}

impl Axes {
    /// Looks for `SPACE=` in a comment or header.
    pub(super) fn read(&mut self, text: &str) {
        if text.contains("SPACE=LPS") {
            *self = Self::Lps;
        } else if text.contains("SPACE=RAS") {
            *self = Self::Ras;
        }
    }

    /// The place in LPS. RAS is LPS turned by half a turn about z, so triangles keep their sense.
    pub(super) fn place(self, xyz: DVec3) -> Point<relief_base::Patient> {
        Point::from_xyz(if self == Self::Ras { DVec3::new(-xyz.x, -xyz.y, xyz.z) } else { xyz })
    }

    pub(super) fn warning(self) -> Option<String> {
        (self == Self::Unsaid)
            .then(|| "the file does not say SPACE=LPS or SPACE=RAS: taken as LPS".to_owned())
    }
}

/// Triangles of a polygon: a fan around its first corner.
pub(super) fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]])
}

impl ReadMesh {
    /// Merges vertices at one place, which many programs repeat for each face, and removes
    /// triangles with two equal vertices, with a warning. Otherwise a closed surface would have no
    /// volume.
    pub(super) fn weld(&mut self) {
        let mesh = &mut self.mesh;
        let mut known = HashMap::with_capacity(mesh.vertices.len());
        let mut kept = Vec::with_capacity(mesh.vertices.len());
        let mut merged = Vec::with_capacity(mesh.vertices.len());
        for vertex in &mesh.vertices {
            // Adding zero turns -0 into 0.
            let key = (vertex.xyz + 0.0).to_array().map(f64::to_bits);
            merged.push(*known.entry(key).or_insert_with(|| {
                kept.push(*vertex);
                kept.len() as u32 - 1
            }));
        }
        mesh.vertices = kept;
        for corner in mesh.triangles.iter_mut().flatten() {
            *corner = merged[*corner as usize];
        }
        let before = mesh.triangles.len();
        mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        if mesh.triangles.len() < before {
            let message = format!("{} triangles without area are left out", before - mesh.triangles.len());
            self.warnings.push(message);
        }
    }
}
