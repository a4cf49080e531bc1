//! PLY: ASCII and both byte orders when it is read, little-endian when it is written.

use glam::DVec3;

use super::content::{Axes, ReadMesh, fan};
use super::format::{MeshFileError, MeshFilePlace, MeshFormat};
use super::source::{Bytes, lines};
use crate::mesh::TriangleMesh;

const FORMAT: MeshFormat = MeshFormat::Ply;
/// Longest header.
const LONGEST_HEADER: usize = 1 << 16;
/// Up to here f32 has steps of at most half a micrometre, mm.
const NEAR_MM: f64 = 8192.0;

pub(super) fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let [low, high] = mesh.span();
    let is_near = low.abs().max(high.abs()).max_element() < NEAR_MM;
    let kind = if is_near { "float" } else { "double" };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment Relief mesh, mm, SPACE=LPS\nelement vertex {}\n\
         property {kind} x\nproperty {kind} y\nproperty {kind} z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    bytes.reserve(mesh.vertices.len() * if is_near { 12 } else { 24 } + 13 * mesh.triangles.len());
    for vertex in &mesh.vertices {
        if is_near {
            vertex.xyz.as_vec3().to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        } else {
            vertex.xyz.to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        }
    }
    for corners in &mesh.triangles {
        bytes.push(3);
        corners.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    bytes
}

#[derive(Clone, Copy, PartialEq)]
enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    fn of(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

struct Property {
    name: String,
    /// Of a list the kind of its length.
    count: Option<ScalarType>,
    kind: ScalarType,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    Little,
    Big,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    axes: Axes,
    /// Its size, bytes and lines.
    end: [usize; 2],
}

/// The values behind the header.
enum Values<'a> {
    Text { words: Box<dyn Iterator<Item = (usize, &'a [u8])> + 'a>, line: usize },
    Binary { source: Bytes<'a>, is_big: bool },
}

pub(super) fn read(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let header = read_header(bytes)?;
    let [end, lines] = header.end;
    let mut values = match header.encoding {
        Encoding::Text => {
            let numbered = (lines + 1..).zip(bytes[end..].split(|byte| *byte == b'\n'));
            let words = numbered.flat_map(|(line, text)| {
                let words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
                words.map(move |word| (line, word))
            });
            Values::Text { words: Box::new(words), line: lines }
        }
        encoding => {
            Values::Binary { source: Bytes::new(FORMAT, bytes, end), is_big: encoding == Encoding::Big }
        }
    };
    let mut mesh = TriangleMesh::default();
    let vertices =
        header.elements.iter().filter(|element| element.name == "vertex" && !element.properties.is_empty());
    let corners = vertices.map(|element| element.count).sum::<u64>();
    for element in &header.elements {
        // Without properties it has no values, however many it claims.
        for _ in 0..if element.properties.is_empty() { 0 } else { element.count } {
            match element.name.as_str() {
                "vertex" => mesh.vertices.push(header.axes.place(read_vertex(&mut values, element)?)),
                "face" => read_face(&mut values, element, corners, &mut mesh.triangles)?,
                _ => element.properties.iter().try_for_each(|property| values.skip(property))?,
            }
        }
    }
    Ok(ReadMesh { mesh, warnings: header.axes.warning().into_iter().collect() })
}

fn read_header(bytes: &[u8]) -> Result<Header, MeshFileError> {
    let refuse = |line, found: &str, expected: &str| {
        Err(MeshFileError::new(FORMAT, MeshFilePlace::Line(line), found, expected))
    };
    let (mut encoding, mut elements, mut axes) = (None, Vec::<Element>::new(), Axes::default());
    let head = &bytes[..bytes.len().min(LONGEST_HEADER)];
    let mut end = 0;
    for ((line, text), raw) in lines(head).zip(head.split(|byte| *byte == b'\n')) {
        end += raw.len() + 1;
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if line == 1 => {}
            _ if line == 1 => return refuse(line, &text, "ply"),
            ["format", "ascii", _] => encoding = Some(Encoding::Text),
            ["format", "binary_little_endian", _] => encoding = Some(Encoding::Little),
            ["format", "binary_big_endian", _] => encoding = Some(Encoding::Big),
            ["comment" | "obj_info", ..] => axes.read(&text),
            ["element", name, count] => {
                let Ok(count) = count.parse() else { return refuse(line, count, "the number of elements") };
                // Corners of faces count the vertices of one element.
                if elements.iter().any(|known| known.name == name) {
                    return refuse(line, &format!("a second element {name}"), "each element once");
                }
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref rest @ ..] => {
                let Some(property) = property(rest) else {
                    return refuse(line, &text, "property TYPE NAME or property list TYPE TYPE NAME");
                };
                let Some(element) = elements.last_mut() else {
                    return refuse(line, &text, "an element before it");
                };
                element.properties.push(property);
            }
            ["end_header"] => {
                let Some(encoding) = encoding else {
                    return refuse(line, "end_header", "a format before it");
                };
                for (name, needed) in [("vertex", &["x", "y", "z"][..]), ("face", &["vertex_indices"])] {
                    let element = elements.iter().find(|element| element.name == name);
                    let has = |wanted: &str| {
                        let mut properties = element.iter().flat_map(|element| &element.properties);
                        properties.any(|property| {
                            is_called(&property.name, wanted) && (name == "face") == property.count.is_some()
                        })
                    };
                    if let Some(missing) = needed.iter().find(|needed| !has(needed)) {
                        return refuse(line, &format!("no property {missing} of element {name}"), "one");
                    }
                }
                return Ok(Header { encoding, elements, axes, end: [end.min(bytes.len()), line] });
            }
            [] => {}
            _ => return refuse(line, &text, "format, comment, element, property or end_header"),
        }
    }
    Err(MeshFileError::new(
        FORMAT,
        MeshFilePlace::Byte(head.len()),
        "no end_header",
        "one within the first 64 KiB",
    ))
}

fn property(words: &[&str]) -> Option<Property> {
    let (count, kind, name) = match *words {
        ["list", count, kind, name] => (Some(ScalarType::of(count)?), kind, name),
        [kind, name] => (None, kind, name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), count, kind: ScalarType::of(kind)? })
}

/// Some programs call the corners of a face `vertex_index`.
fn is_called(name: &str, wanted: &str) -> bool {
    name == wanted || (wanted == "vertex_indices" && name == "vertex_index")
}

fn read_vertex(values: &mut Values, element: &Element) -> Result<DVec3, MeshFileError> {
    let mut place = DVec3::ZERO;
    for property in &element.properties {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == property.name);
        match axis.filter(|_| property.count.is_none()) {
            Some(axis) => {
                place[axis] = values.number(property.kind)?;
                if !place[axis].is_finite() {
                    return Err(values.refuse(&place[axis], "a finite coordinate"));
                }
            }
            None => values.skip(property)?,
        }
    }
    Ok(place)
}

fn read_face(
    values: &mut Values,
    element: &Element,
    corners: u64,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), MeshFileError> {
    for property in &element.properties {
        let Some(count) = property.count.filter(|_| is_called(&property.name, "vertex_indices")) else {
            values.skip(property)?;
            continue;
        };
        let mut polygon = Vec::new();
        for _ in 0..values.count(count)? {
            let index = values.number(property.kind)?;
            if !(index >= 0.0
                && index < corners as f64
                && index.fract() == 0.0
                && index <= f64::from(u32::MAX))
            {
                return Err(values.refuse(&index, &format!("a corner, from 0 to {corners} (not included)")));
            }
            polygon.push(index as u32);
        }
        if polygon.len() < 3 {
            return Err(values.refuse(&format!("a face of {} corners", polygon.len()), "three or more"));
        }
        triangles.extend(fan(&polygon));
    }
    Ok(())
}

impl Values<'_> {
    fn refuse(&self, found: &dyn std::fmt::Display, expected: &str) -> MeshFileError {
        let at = match self {
            Self::Text { line, .. } => MeshFilePlace::Line(*line),
            Self::Binary { source, .. } => MeshFilePlace::Byte(source.at),
        };
        MeshFileError::new(FORMAT, at, found, expected)
    }

    fn number(&mut self, kind: ScalarType) -> Result<f64, MeshFileError> {
        match self {
            Self::Text { words, line } => {
                let Some((at, word)) = words.next() else {
                    return Err(MeshFileError::new(
                        FORMAT,
                        MeshFilePlace::Line(*line),
                        "the end",
                        "another number",
                    ));
                };
                *line = at;
                let word = String::from_utf8_lossy(word);
                word.parse()
                    .map_err(|_| MeshFileError::new(FORMAT, MeshFilePlace::Line(at), &word, "a number"))
            }
            Self::Binary { source, is_big } => binary(source, kind, *is_big),
        }
    }

    /// The length of a list.
    fn count(&mut self, kind: ScalarType) -> Result<u64, MeshFileError> {
        let count = self.number(kind)?;
        if count >= 0.0 && count.fract() == 0.0 {
            return Ok(count as u64);
        }
        Err(self.refuse(&count, "the length of a list"))
    }

    fn skip(&mut self, property: &Property) -> Result<(), MeshFileError> {
        let count = property.count.map_or(Ok(1), |count| self.count(count))?;
        (0..count).try_for_each(|_| self.number(property.kind).map(|_| ()))
    }
}

fn binary(source: &mut Bytes, kind: ScalarType, is_big: bool) -> Result<f64, MeshFileError> {
    macro_rules! value {
        ($type:ty) => {{
            let bytes = source.array("a value")?;
            f64::from(if is_big { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
        }};
    }
    Ok(match kind {
        ScalarType::I8 => value!(i8),
        ScalarType::U8 => value!(u8),
        ScalarType::I16 => value!(i16),
        ScalarType::U16 => value!(u16),
        ScalarType::I32 => value!(i32),
        ScalarType::U32 => value!(u32),
        ScalarType::F32 => value!(f32),
        ScalarType::F64 => value!(f64),
    })
}
