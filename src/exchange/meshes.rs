//! Meshes: a file is an item, whose triangles are a content in binary PLY, patient LPS mm.
//!
//! Several meshes are written as one of all their triangles. A closed surface whose triangles go
//! the wrong way round, so that it would enclose less than nothing, is turned.

use super::reading::Reading;
use super::{ExchangeError, Format, Imported, LeftOut, ReadContext, WriteContext, regions, structures};
use relief_annotation::{Geometry, Item, MeshFormat, TriangleMesh};

const fn kind(format: Format) -> MeshFormat {
    match format {
        Format::Stl => MeshFormat::Stl,
        Format::Obj => MeshFormat::Obj,
        Format::Glb => MeshFormat::Glb,
        _ => MeshFormat::Ply,
    }
}

/// Reads a mesh: one item.
///
/// # Errors
/// As [`super::read`]; places are lines, bytes or keys.
pub(super) fn read(
    format: Format,
    bytes: &[u8],
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let found = relief_annotation::read_mesh(kind(format), bytes)
        .map_err(|error| ExchangeError::Mesh(Box::new(error)))?;
    let mut reading = Reading::new(format, context);
    for warning in found.warnings {
        reading.warn("", &warning);
    }
    let mut mesh = found.mesh;
    if mesh.measures().volume_ml.is_some_and(|ml| ml < 0.0) {
        reading.warn("", "the triangles go round the wrong way: they are turned");
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    if context.grid.is_some_and(|grid| {
        let ([low, high], bounds) = (mesh.span(), grid.bounds());
        !low.max(bounds.min.xyz).cmplt(high.min(bounds.max.xyz)).all()
    }) {
        reading.warn("", "the mesh lies outside of the volume; is it of the same scan?");
    }
    let kept = structures::content_of_mesh(&mesh).map_err(|error| regions::failed(format, error))?;
    let name = if context.list.is_empty() { "mesh" } else { context.list };
    let item = reading.item(name, Some(Geometry::Mesh(kept.summary.clone())))?;
    reading.push("the mesh", item)?;
    reading.contents.push((kept.summary.content, kept.media_type.to_owned(), kept.bytes));
    Ok(reading.finish())
}

/// One mesh of all items.
///
/// # Errors
/// When a content is not there or no mesh.
pub(super) fn write(
    format: Format,
    items: &[&Item],
    context: &WriteContext<'_>,
    left_out: &mut Vec<LeftOut>,
) -> Result<Vec<u8>, ExchangeError> {
    let mut joined = TriangleMesh::default();
    for item in items {
        let Some(Geometry::Mesh(summary)) = &item.geometry else { continue };
        let bytes =
            (context.contents)(&summary.content).ok_or_else(|| regions::no_content(format, item.id))?;
        let mesh = relief_annotation::read_mesh(MeshFormat::Ply, &bytes)
            .map_err(|error| ExchangeError::Mesh(Box::new(error)))?
            .mesh;
        let first = u32::try_from(joined.vertices.len()).unwrap_or(u32::MAX);
        joined.vertices.extend(mesh.vertices);
        // More corners than numbers; `check` rejects the resulting mesh.
        joined
            .triangles
            .extend(mesh.triangles.iter().map(|corners| corners.map(|at| at.saturating_add(first))));
    }
    if items.len() > 1 {
        let reason = "the triangles of all are one mesh".to_owned();
        left_out.push(LeftOut {
            what: "borders".to_owned(),
            reason,
            items: items.iter().map(|item| item.id).collect(),
        });
    }
    let name = items.first().map_or("mesh", |item| item.name.as_str());
    relief_annotation::write_mesh(kind(format), &joined, name).map_err(|error| regions::failed(format, error))
}
