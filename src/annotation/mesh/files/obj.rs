//! OBJ: corners and faces of Wavefront's text; all else is passed over.

use std::fmt::Write;

use glam::DVec3;

use super::content::{Axes, ReadMesh, fan};
use super::format::{MeshFileError, MeshFilePlace, MeshFormat};
use super::source::{continued_lines, number};
use crate::mesh::TriangleMesh;

const FORMAT: MeshFormat = MeshFormat::Obj;

pub(super) fn write(mesh: &TriangleMesh, name: &str) -> Vec<u8> {
    // Names are one word there.
    let name: String =
        name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    let mut text =
        format!("# Relief mesh, mm, SPACE=LPS\no {}\n", if name.is_empty() { "mesh" } else { &name });
    for vertex in &mesh.vertices {
        let [x, y, z] = vertex.xyz.to_array();
        let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
    }
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|corner| u64::from(corner) + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text.into_bytes()
}

pub(super) fn read(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let (mut places, mut triangles, mut polygon) = (Vec::new(), Vec::new(), Vec::new());
    let (mut axes, mut left_out) = (Axes::default(), 0usize);
    // Faces may name corners that come later in the file.
    let mut farthest = (0u32, 0usize);
    for (line, text) in continued_lines(bytes) {
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut xyz = [0.0; 3];
                for x in &mut xyz {
                    *x = number(FORMAT, line, words.next())?;
                }
                places.push(DVec3::from(xyz));
            }
            Some("f") => {
                polygon.clear();
                for word in words {
                    polygon.push(corner(word, places.len(), line)?);
                }
                if polygon.len() < 3 {
                    return Err(MeshFileError::new(
                        FORMAT,
                        MeshFilePlace::Line(line),
                        &text,
                        "a face of three corners or more",
                    ));
                }
                let largest = polygon.iter().copied().max().unwrap_or_default();
                farthest = farthest.max((largest, line));
                triangles.extend(fan(&polygon));
            }
            Some(word) if word.starts_with('#') => axes.read(&text),
            Some("vt" | "vn" | "vp" | "g" | "o" | "s" | "usemtl" | "mtllib") | None => {}
            Some(_) => left_out += 1,
        }
    }
    if !triangles.is_empty() && farthest.0 as usize >= places.len() {
        let found = format!("corner {}", farthest.0 + 1);
        let expected = format!("one of the {} that the file has", places.len());
        return Err(MeshFileError::new(FORMAT, MeshFilePlace::Line(farthest.1), found, expected));
    }
    let mut warnings = Vec::new();
    if left_out > 0 {
        warnings.push(format!("{left_out} lines that are no corners or faces are passed over"));
    }
    warnings.extend(axes.warning());
    let vertices = places.into_iter().map(|place| axes.place(place)).collect();
    Ok(ReadMesh { mesh: TriangleMesh { vertices, triangles }, warnings })
}

/// `7`, `7/1`, `7//3`, or `-1` for the last corner so far.
fn corner(word: &str, known: usize, line: usize) -> Result<u32, MeshFileError> {
    let index = word.split('/').next().and_then(|index| index.parse::<i64>().ok());
    let from_start = match index {
        Some(index) if index > 0 => Some(index - 1),
        Some(index) if index < 0 => (known as i64).checked_add(index),
        _ => None,
    };
    from_start.and_then(|index| u32::try_from(index).ok()).ok_or_else(|| {
        MeshFileError::new(
            FORMAT,
            MeshFilePlace::Line(line),
            word,
            "the number of a corner, from 1, or -1 for the last one",
        )
    })
}
