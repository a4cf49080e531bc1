//! Meshes as files: PLY, STL, OBJ and GLB, both ways.
//!
//! Written files state `SPACE=LPS`: in the header of STL (80 bytes), in a comment of OBJ and PLY.
//! Files that state `SPACE=RAS` are mirrored when read; without a statement LPS is assumed, with a
//! warning, as in 3D Slicer. GLB has metres and Y up by definition: a node converts.
//!
//! Readers take untrusted bytes: they return a mesh, or an error that names the line, byte or key.
//! Memory grows with the data, never with a declared size. Polygons become fans of triangles;
//! colours, normals, textures, lines and points are ignored.

mod glb;
mod obj;
mod ply;
mod source;
mod stl;

use glam::DVec3;

use super::{MeshError, TriangleMesh};
use relief_base::Point;

/// A mesh file's format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stanford's polygons; written binary, little-endian. Numbers are f32 within 8 m of the
    /// origin, else f64.
    Ply,
    /// Stereolithography; written binary, f32. Corners at equal places become one when it is read.
    Stl,
    /// Wavefront's text, to a millionth of a millimetre.
    Obj,
    /// Binary glTF 2.0, f32.
    Glb,
}

/// A mesh and the warnings of its reader.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadMesh {
    /// In patient LPS mm.
    pub mesh: TriangleMesh,
    /// Warnings, in sentences.
    pub warnings: Vec<String>,
}

/// Why a file is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{format}, {at}: found {found}, expected {expected}")]
pub struct MeshFileError {
    /// The format's name.
    pub format: &'static str,
    /// Where.
    pub at: MeshFilePlace,
    /// The found text or number.
    pub found: String,
    /// What should be.
    pub expected: String,
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MeshFilePlace {
    /// A line of text, from 1.
    Line(usize),
    /// A byte, from 0.
    Byte(usize),
    /// A path in JSON.
    Key(String),
}

impl std::fmt::Display for MeshFilePlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Key(key) => f.write_str(key),
        }
    }
}

impl MeshFileError {
    fn new(
        format: MeshFormat,
        at: MeshFilePlace,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        // Text of a file may be anything: it is shortened to one line.
        let clean = |c: char| if c.is_control() { '?' } else { c };
        let found = found.to_string().chars().map(clean).take(60).collect();
        Self { format: format.name(), at, found, expected: expected.into() }
    }
}

impl MeshFormat {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Stl, Self::Obj, Self::Glb];

    /// Its name, which is the ending of its files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Obj => "obj",
            Self::Glb => "glb",
        }
    }

    /// The format that a file's ending names, in letters of any case.
    #[must_use]
    pub fn of(path: &std::path::Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| format.name() == ending)
    }

    /// Its media type.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Ply => "model/ply",
            Self::Stl => "model/stl",
            Self::Obj => "model/obj",
            Self::Glb => "model/gltf-binary",
        }
    }
}

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

/// The axes that a file states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Axes {
    #[default]
    Unsaid,
    Lps,
    Ras,
}

impl Axes {
    /// Looks for `SPACE=` in a comment or header.
    fn read(&mut self, text: &str) {
        if text.contains("SPACE=LPS") {
            *self = Self::Lps;
        } else if text.contains("SPACE=RAS") {
            *self = Self::Ras;
        }
    }

    /// The place in LPS. RAS is LPS turned by half a turn about z, so triangles keep their sense.
    fn place(self, xyz: DVec3) -> Point<relief_base::Patient> {
        Point::from_xyz(if self == Self::Ras { DVec3::new(-xyz.x, -xyz.y, xyz.z) } else { xyz })
    }

    fn warning(self) -> Option<String> {
        (self == Self::Unsaid)
            .then(|| "the file does not say SPACE=LPS or SPACE=RAS: taken as LPS".to_owned())
    }
}

/// Triangles of a polygon: a fan around its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]])
}

/// Removes triangles with two equal vertices, with a warning.
fn drop_degenerate(triangles: &mut Vec<[u32; 3]>, warnings: &mut Vec<String>) {
    let before = triangles.len();
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    if triangles.len() < before {
        warnings.push(format!("{} triangles without area are left out", before - triangles.len()));
    }
}

#[cfg(test)]
mod tests {
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
    fn files_in_ras_and_files_that_say_nothing_are_told_apart() {
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
    fn what_cannot_be_written_is_named() {
        let mut mesh = tetrahedron();
        mesh.triangles[2][1] = 4;
        let refused = write_mesh(MeshFormat::Stl, &mesh, "").unwrap_err().to_string();
        assert_eq!(refused, "triangle 2 has corner 4, allowed: 0 to 4 (not included)");
        mesh.vertices[1] = Point::new(0.0, f64::NAN, 0.0);
        assert_eq!(write_mesh(MeshFormat::Ply, &mesh, ""), Err(MeshError::Vertex(1)));
        assert_eq!(write_mesh(MeshFormat::Ply, &TriangleMesh::default(), ""), Err(MeshError::Empty));
    }
}
