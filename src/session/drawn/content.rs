//! From the file of a region or mesh to voxels, and to a surface that can be drawn.

use super::SurfaceMesh;

use relief_annotation::{
    Decimation, MeshError, MeshFileError, MeshFormat, Smoothing, TriangleMesh, read_mesh, surface_nets,
};
use relief_dicom::FormatError;
use relief_volume::Mask;

/// Why a content cannot be drawn. Messages repeat nothing of the content.
#[derive(Debug, thiserror::Error)]
pub enum ContentError {
    /// It is no label map.
    #[error(transparent)]
    Labels(#[from] FormatError),
    /// It is no file of triangles.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// It has no sound surface.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// The surface of a content: of one label of a label map, or of a whole mesh (label 0), decimated
/// for drawing. Blocks.
///
/// # Errors
/// When the content is damaged, or has no surface.
pub fn shape_of_content(bytes: &[u8], label: u16) -> Result<SurfaceMesh, ContentError> {
    let mesh = if label == 0 {
        read_mesh(MeshFormat::Ply, bytes)?.mesh
    } else {
        surface_nets(&region_of_content(bytes, label)?)?.smoothed(Smoothing::default())?
    };
    let mesh = if mesh.triangles.len() > SurfaceMesh::MOST_TRIANGLES {
        mesh.decimated(Decimation::to(SurfaceMesh::MOST_TRIANGLES))?
    } else {
        mesh
    };
    let TriangleMesh { vertices, triangles } = mesh;
    Ok(SurfaceMesh { vertices: vertices.into(), triangles: triangles.into() })
}

/// The voxels of one label of a content. Blocks.
///
/// # Errors
/// When the content is no label map.
pub fn region_of_content(bytes: &[u8], label: u16) -> Result<Mask, ContentError> {
    Ok(Mask::of_label(&relief_dicom::read_labels_of_bytes(bytes)?.map, label))
}
