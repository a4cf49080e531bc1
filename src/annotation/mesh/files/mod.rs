//! Meshes as files: PLY, STL, OBJ and GLB, both ways.
//!
//! Written files state `SPACE=LPS`: in the header of STL (80 bytes), in a comment of OBJ and PLY.
//! Files that state `SPACE=RAS` are mirrored when read; without a statement LPS is assumed, with a
//! warning, as in 3D Slicer. GLB has metres and Y up by definition: a node converts. Vertices at one
//! place are merged.
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
    let mut found = match format {
        MeshFormat::Ply => ply::read(bytes),
        MeshFormat::Stl => stl::read(bytes),
        MeshFormat::Obj => obj::read(bytes),
        MeshFormat::Glb => glb::read(bytes),
    }?;
    found.weld();
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
    fn vertices_that_each_face_repeats_are_merged() {
        let mesh = tetrahedron();
        let vertices =
            mesh.triangles.iter().flatten().map(|&corner| mesh.vertices[corner as usize]).collect();
        let apart = TriangleMesh { vertices, triangles: vec![[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]] };
        assert_eq!(apart.measures().volume_ml, None);
        for format in MeshFormat::ALL {
            let found = read_mesh(format, &write_mesh(format, &apart, "a").unwrap()).unwrap().mesh;
            assert_eq!(found.vertices.len(), 4, "{format:?}");
            let [found, mesh] = [&found, &mesh].map(|mesh| mesh.measures().volume_ml.unwrap());
            assert!((found - mesh).abs() < 1e-9, "{format:?}");
        }
    }

    #[test]
    fn text_of_stl_has_any_case_and_an_end() {
        let mut text = "SOLID a SPACE=LPS\n".to_owned();
        let mesh = tetrahedron();
        for triangle in &mesh.triangles {
            text += "FACET NORMAL 0 0 0\nOUTER LOOP\n";
            for &corner in triangle {
                let [x, y, z] = mesh.vertices[corner as usize].xyz.to_array();
                text += &format!("VERTEX {x:e} {y:E} +{z}\n");
            }
            text += "ENDLOOP\nENDFACET\n";
        }
        let cut = read_mesh(MeshFormat::Stl, text.as_bytes()).unwrap_err().to_string();
        assert!(cut.contains("cut short"), "{cut}");
        let whole = read_mesh(MeshFormat::Stl, (text + "ENDSOLID a\n").as_bytes()).unwrap();
        assert_eq!((whole.mesh.measures(), whole.warnings), (mesh.measures(), vec![]));
    }

    #[test]
    fn lines_of_obj_are_continued() {
        let text = "# SPACE=LPS\nv 1 2 \\\n3\nv 4 5 6\nv 7 8 10\nf 1 \\\r\n2 \\\n3\n";
        let found = read_mesh(MeshFormat::Obj, text.as_bytes()).unwrap();
        assert_eq!((found.mesh.triangles, found.warnings), (vec![[0, 1, 2]], vec![]));
        let wrong = read_mesh(MeshFormat::Obj, b"v 1 2 3\nf 1 \\\n2 x\n").unwrap_err().to_string();
        assert!(wrong.contains("line 2"), "{wrong}");
    }

    #[test]
    fn strips_of_glb_are_triangles_and_other_files_are_refused() {
        let mesh = tetrahedron();
        let corners = TriangleMesh { triangles: vec![[0, 2, 1], [3, 0, 2]], ..mesh.clone() };
        let written = write_mesh(MeshFormat::Glb, &corners, "a").unwrap();
        let changed = |from: &str, to: &str| {
            let at = written.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
            [&written[..at], to.as_bytes(), &written[at + from.len()..]].concat()
        };
        let strip = read_mesh(MeshFormat::Glb, &changed("\"mode\":4", "\"mode\":5")).unwrap().mesh;
        assert!(strip.measures().is_closed && strip.triangles.len() == 4);
        let [strip, whole] = [&strip, &mesh].map(|mesh| mesh.measures().volume_ml.unwrap());
        assert!((strip - whole).abs() < 1e-9);
        let refused =
            read_mesh(MeshFormat::Glb, &changed("\"byteLength\":72}]", "\"uri\":\"abcdefg\"}]")).unwrap_err();
        assert!(refused.to_string().contains("another file"), "{refused}");
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
