//! From the file of a region or mesh to voxels, and to a surface that can be drawn.

use std::io::Write;

use super::SurfaceMesh;

use relief_annotation::{Decimation, MeshFormat, Smoothing, TriangleMesh, read_mesh, surface_nets};
use relief_volume::Mask;

/// The surface of a content: of one label of a label map, or of a whole mesh (label 0), decimated
/// for drawing. Blocks.
///
/// # Errors
/// Why the file gives none, without anything of the file.
pub fn shape_of_content(bytes: &[u8], label: u16) -> Result<SurfaceMesh, String> {
    let mesh = if label == 0 {
        read_mesh(MeshFormat::Ply, bytes).map_err(|error| error.to_string())?.mesh
    } else {
        let mask = region_of_content(bytes, label)?;
        let mesh = surface_nets(&mask).and_then(|mesh| mesh.smoothed(Smoothing::default()));
        mesh.map_err(|error| error.to_string())?
    };
    let mesh = if mesh.triangles.len() > SurfaceMesh::MOST_TRIANGLES {
        mesh.decimated(Decimation::to(SurfaceMesh::MOST_TRIANGLES)).map_err(|error| error.to_string())?
    } else {
        mesh
    };
    let TriangleMesh { vertices, triangles } = mesh;
    Ok(SurfaceMesh { vertices: vertices.into(), triangles: triangles.into() })
}

/// The voxels of one label of a content. Blocks.
///
/// # Errors
/// As [`shape_of_content`].
pub fn region_of_content(bytes: &[u8], label: u16) -> Result<Mask, String> {
    // Readers of label maps take files.
    let mut file = tempfile::NamedTempFile::new().map_err(|error| error.to_string())?;
    file.write_all(bytes).and_then(|()| file.flush()).map_err(|error| error.to_string())?;
    let found = relief_dicom::read_labels(file.path());
    let map =
        found.map_err(|error| error.to_string().replace(&file.path().display().to_string(), "the file"))?.map;
    Ok(Mask::of_label(&map, label))
}
