//! STL: binary, and ASCII when read. Its triangles share no vertices.

use glam::DVec3;

use super::content::{Axes, ReadMesh};
use super::format::{MeshFileError, MeshFilePlace, MeshFormat};
use super::source::{Bytes, lines, number};
use crate::mesh::TriangleMesh;

const FORMAT: MeshFormat = MeshFormat::Stl;
/// Bytes of a header.
const HEADER: usize = 80;
/// Bytes of a triangle.
const TRIANGLE: usize = 50;

pub(super) fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + 4 + TRIANGLE * mesh.triangles.len());
    // It must not begin with `solid`, which is how ASCII begins.
    bytes.extend_from_slice(b"Relief mesh, mm, SPACE=LPS");
    bytes.resize(HEADER, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|corner| mesh.vertices[corner as usize].xyz);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for vector in [normal, a, b, c] {
            bytes.extend(vector.as_vec3().to_array().iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend([0, 0]);
    }
    bytes
}

pub(super) fn read(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let count = bytes.get(HEADER..HEADER + 4).map(|n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]));
    let size = count.map(|count| HEADER as u64 + 4 + TRIANGLE as u64 * u64::from(count));
    // Binary files of some programs begin with `solid` too: the size decides.
    let begins = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let is_text = begins && size != Some(bytes.len() as u64);
    if is_text { read_text(bytes) } else { read_binary(bytes) }
}

/// A mesh without shared corners, as it is read.
#[derive(Default)]
struct Corners {
    mesh: TriangleMesh,
    axes: Axes,
    warnings: Vec<String>,
}

impl Corners {
    fn corner(&mut self, xyz: DVec3) -> u32 {
        self.mesh.vertices.push(self.axes.place(xyz));
        self.mesh.vertices.len() as u32 - 1
    }

    fn finish(mut self) -> ReadMesh {
        self.warnings.extend(self.axes.warning());
        ReadMesh { mesh: self.mesh, warnings: self.warnings }
    }
}

fn read_binary(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let mut source = Bytes::new(FORMAT, bytes, 0);
    let mut corners = Corners::default();
    corners.axes.read(&String::from_utf8_lossy(source.take(HEADER, "the header")?));
    let count = source.u32("the number of triangles")?;
    if (source.left() as u64) < u64::from(count) * TRIANGLE as u64 {
        let found = format!("{} bytes for {count} triangles", source.left());
        return Err(MeshFileError::new(
            FORMAT,
            MeshFilePlace::Byte(source.at),
            found,
            format!("{TRIANGLE} for each"),
        ));
    }
    for _ in 0..count {
        source.take(12, "a normal")?;
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            let at = source.at;
            let mut xyz = [0.0; 3];
            for x in &mut xyz {
                *x = f64::from(f32::from_le_bytes(source.array("a corner")?));
            }
            if !xyz.iter().all(|x| x.is_finite()) {
                return Err(MeshFileError::new(
                    FORMAT,
                    MeshFilePlace::Byte(at),
                    format!("{xyz:?}"),
                    "finite coordinates",
                ));
            }
            *corner = corners.corner(DVec3::from(xyz));
        }
        source.take(2, "a triangle's attributes")?;
        corners.mesh.triangles.push(triangle);
    }
    if source.left() > 0 {
        corners.warnings.push(format!("{} bytes behind the last triangle are not read", source.left()));
    }
    Ok(corners.finish())
}

fn read_text(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let mut corners = Corners::default();
    let (mut triangle, mut is_open) = (Vec::new(), false);
    for (line, text) in lines(bytes) {
        let mut words = text.split_ascii_whitespace();
        let refuse =
            |expected: &str| Err(MeshFileError::new(FORMAT, MeshFilePlace::Line(line), &text, expected));
        match words.next().map(str::to_ascii_lowercase).as_deref() {
            Some("solid") => {
                corners.axes.read(&text);
                is_open = true;
            }
            Some("vertex") => {
                let mut xyz = [0.0; 3];
                for x in &mut xyz {
                    *x = number(FORMAT, line, words.next())?;
                }
                triangle.push(corners.corner(DVec3::from(xyz)));
            }
            Some("endfacet") => {
                let &[a, b, c] = &triangle[..] else { return refuse("three vertices in a facet") };
                corners.mesh.triangles.push([a, b, c]);
                triangle.clear();
            }
            Some("facet") if !triangle.is_empty() => return refuse("endfacet before the next facet"),
            Some("endsolid" | "end") => is_open = false,
            None | Some("facet" | "outer" | "endloop") => {}
            Some(_) => return refuse("solid, facet, outer loop, vertex, endloop, endfacet or endsolid"),
        }
    }
    let expected = if triangle.is_empty() { "endsolid: the file is cut short" } else { "endfacet" };
    if is_open || !triangle.is_empty() {
        return Err(MeshFileError::new(FORMAT, MeshFilePlace::Byte(bytes.len()), "the end", expected));
    }
    Ok(corners.finish())
}
