//! Meshes as files: PLY, STL, OBJ and GLB, both ways.
//!
//! Written files state `SPACE=LPS`: in the header of STL (80 bytes), in a comment of OBJ and PLY.
//! Files that state `SPACE=RAS` are mirrored when read; without a statement LPS is assumed, with a
//! warning, as in 3D Slicer. GLB has metres and Y up by definition: a node converts.
//!
//! Readers take untrusted bytes: they return a mesh, or an error that names the line, byte or key.
//! Memory grows with the data, never with a declared size. Polygons become fans of triangles;
//! colours, normals, textures, lines and points are ignored.

mod content;
mod format;
mod glb;
mod obj;
mod ply;
mod source;
mod stl;

pub use content::ReadMesh;
pub use format::{MeshFileError, MeshFilePlace, MeshFormat};

use super::{MeshError, TriangleMesh};

/// Writes a mesh. `name` is stored where the format has a field for it.
///
/// # Errors
/// When [`TriangleMesh::check`] fails, or there are no triangles.
pub fn write_mesh(format: MeshFormat, mesh: &TriangleMesh, name: &str) -> Result<Vec<u8>, MeshError> {
    mesh.check()?;
    if mesh.triangles.is_empty() {
        return Err(MeshError::Empty);
    }
    Ok(match format {
        MeshFormat::Ply => ply::write(mesh),
        MeshFormat::Stl => stl::write(mesh),
        MeshFormat::Obj => obj::write(mesh, name),
        MeshFormat::Glb => glb::write(mesh, name),
    })
}

/// Reads a file's bytes.
///
/// # Errors
/// When they are not of the format, cut short, or hold a triangle without its corners, a corner
/// that is no place, or nothing.
pub fn read_mesh(format: MeshFormat, bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let found = match format {
        MeshFormat::Ply => ply::read(bytes),
        MeshFormat::Stl => stl::read(bytes),
        MeshFormat::Obj => obj::read(bytes),
        MeshFormat::Glb => glb::read(bytes),
    }?;
    if found.mesh.triangles.is_empty() {
        return Err(MeshFileError::new(
            format,
            MeshFilePlace::Byte(bytes.len()),
            "no triangle",
            "at least one",
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use relief_base::Point;

    use super::*;

    /// A tetrahedron that is like itself under no turn or mirror.
    fn tetrahedron() -> TriangleMesh {
        let vertices = [[1.0, 2.0, 3.0], [11.5, 2.0, 3.0], [1.0, 7.25, 3.0], [1.0, 2.0, 4.125]];
        let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        TriangleMesh { vertices: vertices.map(|[x, y, z]| Point::new(x, y, z)).to_vec(), triangles }
    }

    #[test]
    fn every_format_is_written_and_read_alike() {
        let mesh = tetrahedron();
        assert!(mesh.measures().volume_ml.unwrap() > 0.0);
        for format in MeshFormat::ALL {
            let found =
                read_mesh(format, &write_mesh(format, &mesh, "a \"name\"\nof two lines").unwrap()).unwrap();
            assert_eq!(found.warnings, Vec::<String>::new(), "{format:?}");
            let [found, mesh] = [&found.mesh, &mesh].map(TriangleMesh::measures);
            assert!((found.volume_ml.unwrap() - mesh.volume_ml.unwrap()).abs() < 1e-9, "{format:?}");
            assert!((found.area_mm2 - mesh.area_mm2).abs() < 1e-5 && found.is_manifold, "{format:?}");
        }
    }

    #[test]
    fn files_in_ras_and_files_without_a_space_are_distinguished() {
        for format in [MeshFormat::Ply, MeshFormat::Stl, MeshFormat::Obj] {
            let bytes = write_mesh(format, &tetrahedron(), "a").unwrap();
            let changed = |to: &[u8]| {
                let at = bytes.windows(9).position(|part| part == b"SPACE=LPS").unwrap();
                [&bytes[..at], to, &bytes[at + 9..]].concat()
            };
            let ras = read_mesh(format, &changed(b"SPACE=RAS")).unwrap();
            let [low, high] = ras.mesh.span();
            assert_eq!(
                [low, high],
                [DVec3::new(-11.5, -7.25, 3.0), DVec3::new(-1.0, -2.0, 4.125)],
                "{format:?}"
            );
            assert!(ras.mesh.measures().volume_ml.unwrap() > 0.0, "turned, not mirrored");
            let unsaid = read_mesh(format, &changed(b"123456789")).unwrap();
            assert_eq!(unsaid.mesh.span()[0], DVec3::new(1.0, 2.0, 3.0));
            assert!(unsaid.warnings[0].contains("SPACE=LPS"), "{:?}", unsaid.warnings);
        }
    }

    #[test]
    fn formats_name_meshes_that_they_cannot_hold() {
        let mut mesh = tetrahedron();
        mesh.triangles[2][1] = 4;
        let refused = write_mesh(MeshFormat::Stl, &mesh, "").unwrap_err().to_string();
        assert_eq!(refused, "triangle 2 has corner 4, allowed: 0 to 4 (not included)");
        mesh.vertices[1] = Point::new(0.0, f64::NAN, 0.0);
        assert_eq!(write_mesh(MeshFormat::Ply, &mesh, ""), Err(MeshError::Vertex(1)));
        assert_eq!(write_mesh(MeshFormat::Ply, &TriangleMesh::default(), ""), Err(MeshError::Empty));
    }
}
