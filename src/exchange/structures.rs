//! Regions and meshes in the log: a file as content, and its summary in the item.
//!
//! A region's content is a `.seg.nrrd` file on the volume's grid, a mesh's a binary PLY in patient
//! LPS mm.

use relief_annotation::{
    ContentId, MeshError, MeshFileError, MeshFormat, MeshSummary, RegionSummary, TriangleMesh,
};
use relief_dicom::FormatError;
use relief_volume::{Mask, Segment};

/// The media type of a region's content.
pub(crate) const REGION_TYPE: &str = "application/x-seg-nrrd";

/// A content and its summary in an item.
#[derive(Clone, Debug)]
pub struct StoredContent<T> {
    /// For the item's geometry.
    pub summary: T,
    /// Media type of the content.
    pub media_type: &'static str,
    /// The content, which the summary names.
    pub bytes: Vec<u8>,
}

/// Why a content is no region or mesh.
#[derive(Debug, thiserror::Error)]
pub enum StructureError {
    /// The system gives no room for a file.
    #[error("cannot create a temporary file: {0}")]
    Temporary(#[from] std::io::Error),
    /// It is no label map.
    #[error(transparent)]
    Region(#[from] FormatError),
    /// It is no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// Its segment has no voxel.
    #[error("the region's file has no voxel with label {0}")]
    Label(u16),
}

/// Packs a region.
///
/// # Errors
/// Only when memory cannot be allocated, since it writes to memory.
pub fn content_of_region(
    mask: &Mask,
    name: &str,
    rgb: Option<[f64; 3]>,
) -> Result<StoredContent<RegionSummary>, std::io::Error> {
    let bytes = relief_dicom::write_seg_nrrd(&mask.to_labels(Segment::new(1, Some(name), rgb)))?;
    let (voxels, volume_ml) = (mask.voxels(), mask.volume_ml());
    let summary = RegionSummary { content: ContentId::of(&bytes), label: 1, voxels, volume_ml };
    Ok(StoredContent { summary, media_type: REGION_TYPE, bytes })
}

/// Unpacks a region.
///
/// # Errors
/// When the content is no label map, or has no voxel of the region.
pub fn mask_of_content(summary: &RegionSummary, bytes: &[u8]) -> Result<Mask, StructureError> {
    let found = relief_dicom::read_labels_of_bytes(bytes)?;
    let mask = Mask::of_label(&found.map, summary.label);
    if mask.voxels() == 0 {
        return Err(StructureError::Label(summary.label));
    }
    Ok(mask)
}

/// Packs a mesh.
///
/// # Errors
/// When it is empty or unsound: see [`MeshError`].
pub fn content_of_mesh(mesh: &TriangleMesh) -> Result<StoredContent<MeshSummary>, MeshError> {
    let bytes = relief_annotation::write_mesh(MeshFormat::Ply, mesh, "")?;
    let measures = mesh.measures();
    let summary = MeshSummary {
        content: ContentId::of(&bytes),
        vertices: mesh.vertices.len() as u32,
        triangles: mesh.triangles.len() as u32,
        area_mm2: measures.area_mm2,
        volume_ml: measures.volume_ml,
    };
    Ok(StoredContent { summary, media_type: MeshFormat::Ply.media_type(), bytes })
}

/// Unpacks a mesh.
///
/// # Errors
/// When the content is no PLY file.
pub fn mesh_of_content(bytes: &[u8]) -> Result<TriangleMesh, StructureError> {
    Ok(relief_annotation::read_mesh(MeshFormat::Ply, bytes)?.mesh)
}
