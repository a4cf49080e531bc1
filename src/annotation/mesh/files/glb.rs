//! GLB: binary glTF 2.0 with one buffer of its own. Triangles of the shown scene, wherever its
//! nodes put them.
//!
//! glTF has metres, Y up and the front towards +Z, so a patient's left is +X: X = x, Y = z, Z = -y
//! of LPS, divided by 1000. Written files keep LPS mm in the buffer; the node converts.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde::Deserialize;

use super::content::ReadMesh;
use super::format::{MeshFileError, MeshFilePlace, MeshFormat};
use super::source::Bytes;
use crate::mesh::TriangleMesh;
use relief_base::Point;

const FORMAT: MeshFormat = MeshFormat::Glb;
/// The words that a file and its chunks begin with.
const MAGIC: u32 = 0x4654_6c67;
const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;
/// Column after column: from LPS mm to the axes and metres of glTF.
const GLTF_FROM_PATIENT: [f64; 16] =
    [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, -0.001, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
/// Most nodes, however they are nested.
const MOST_NODES: usize = 100_000;

pub(super) fn write(mesh: &TriangleMesh, name: &str) -> Vec<u8> {
    let places: Vec<[f32; 3]> = mesh.vertices.iter().map(|vertex| vertex.xyz.as_vec3().to_array()).collect();
    let fold = |start: f32, with: fn(f32, f32) -> f32| {
        places.iter().fold([start; 3], |all, place| std::array::from_fn(|axis| with(all[axis], place[axis])))
    };
    let [corners, indices] = [12 * places.len(), 12 * mesh.triangles.len()];
    let json = serde_json::json!({
        "asset": {"version": "2.0", "generator": "Relief", "extras": {"SPACE": "LPS"}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name, "matrix": GLTF_FROM_PATIENT}],
        "meshes": [{"name": name, "primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": places.len(), "type": "VEC3",
             "min": fold(f32::INFINITY, f32::min), "max": fold(f32::NEG_INFINITY, f32::max)},
            {"bufferView": 1, "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": corners, "target": 34962},
            {"buffer": 0, "byteOffset": corners, "byteLength": indices, "target": 34963},
        ],
        "buffers": [{"byteLength": corners + indices}],
    });
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + corners + indices;
    let mut bytes = Vec::with_capacity(total);
    let word = |bytes: &mut Vec<u8>, word: u32| bytes.extend(word.to_le_bytes());
    for value in [MAGIC, 2, total as u32, json.len() as u32, JSON] {
        word(&mut bytes, value);
    }
    bytes.extend(json);
    word(&mut bytes, (corners + indices) as u32);
    word(&mut bytes, BIN);
    places.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
    mesh.triangles.iter().flatten().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    bytes
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
#[derive(Default)]
struct Document {
    scene: Option<usize>,
    scenes: Vec<Scene>,
    nodes: Vec<Node>,
    meshes: Vec<Mesh>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<View>,
    buffers: Vec<Buffer>,
    extensions_required: Vec<String>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Node {
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    #[serde(default)]
    attributes: std::collections::BTreeMap<String, usize>,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
struct Buffer {
    uri: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

fn refuse(key: &str, found: impl std::fmt::Display, expected: &str) -> MeshFileError {
    MeshFileError::new(FORMAT, MeshFilePlace::Key(key.to_owned()), found, expected)
}

pub(super) fn read(bytes: &[u8]) -> Result<ReadMesh, MeshFileError> {
    let mut source = Bytes::new(FORMAT, bytes, 0);
    let wrong = |at, found: u32, expected: &str| {
        Err(MeshFileError::new(FORMAT, MeshFilePlace::Byte(at), found, expected))
    };
    let [magic, version, _length] =
        [source.u32("a header")?, source.u32("a header")?, source.u32("a header")?];
    if magic != MAGIC {
        return wrong(0, magic, "glTF's first four bytes (of .gltf files with text, make .glb)");
    }
    if version != 2 {
        return wrong(4, version, "version 2");
    }
    let size = source.u32("the size of the JSON")? as usize;
    let kind = source.u32("a chunk's kind")?;
    if kind != JSON {
        return wrong(16, kind, "a chunk of JSON first");
    }
    let json = source.take(size, "JSON")?;
    let mut buffer = &[][..];
    while source.left() >= 8 {
        let size = source.u32("a chunk's size")? as usize;
        let kind = source.u32("a chunk's kind")?;
        let part = source.take(size, "a chunk")?;
        if kind == BIN && buffer.is_empty() {
            buffer = part;
        }
    }
    let mut json = serde_json::Deserializer::from_slice(json);
    let document: Document = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let key = error.path().to_string();
        refuse(&key, error.inner(), "glTF's JSON")
    })?;
    if !document.extensions_required.is_empty() {
        let found = document.extensions_required.join(", ");
        return Err(refuse("extensionsRequired", found, "a file without required extensions"));
    }
    if document.buffers.iter().any(|buffer| buffer.uri.is_some()) {
        let expected = "one buffer in the file itself (export as a single .glb)";
        return Err(refuse("buffers", "a buffer in another file", expected));
    }
    let mut reader =
        Reader { document: &document, buffer, most: bytes.len(), mesh: TriangleMesh::default(), left_out: 0 };
    reader.scene()?;
    let Reader { mesh, left_out, .. } = reader;
    let mut warnings = Vec::new();
    if left_out > 0 {
        if mesh.triangles.is_empty() {
            return Err(refuse("meshes", "only points and lines", "triangles, strips or fans of them"));
        }
        warnings.push(format!("{left_out} parts that are points or lines are left out"));
    }
    Ok(ReadMesh { mesh, warnings })
}

/// How corners become triangles: modes 4 to 6 of glTF.
#[derive(Clone, Copy)]
enum TriangleOrder {
    Each,
    Strip,
    Fan,
}

impl TriangleOrder {
    const fn of_mode(mode: u32) -> Option<Self> {
        match mode {
            4 => Some(Self::Each),
            5 => Some(Self::Strip),
            6 => Some(Self::Fan),
            _ => None,
        }
    }

    fn triangles(self, corners: &[f64]) -> Vec<[f64; 3]> {
        match self {
            Self::Each => corners.as_chunks().0.to_vec(),
            // Every second triangle of a strip is turned.
            Self::Strip => corners
                .array_windows()
                .enumerate()
                .map(|(n, &[a, b, c])| if n % 2 == 0 { [a, b, c] } else { [b, a, c] })
                .collect(),
            Self::Fan => corners
                .get(1..)
                .unwrap_or_default()
                .array_windows()
                .map(|&[b, c]| [corners[0], b, c])
                .collect(),
        }
    }
}

struct Reader<'a> {
    document: &'a Document,
    buffer: &'a [u8],
    /// Most corners and triangles: a mesh that many nodes show must not grow beyond the file.
    most: usize,
    mesh: TriangleMesh,
    left_out: usize,
}

impl Reader<'_> {
    fn scene(&mut self) -> Result<(), MeshFileError> {
        let document = self.document;
        let scene = document.scene.unwrap_or(0);
        let Some(scene) = document.scenes.get(scene) else {
            return Err(refuse("scene", scene, "the number of a scene"));
        };
        let mut open: Vec<(usize, DAffine3)> =
            scene.nodes.iter().map(|node| (*node, DAffine3::IDENTITY)).collect();
        let mut seen = 0;
        while let Some((index, parent)) = open.pop() {
            seen += 1;
            let key = format!("nodes[{index}]");
            let Some(node) = document.nodes.get(index) else {
                return Err(refuse(&key, "no such node", "one"));
            };
            if seen > MOST_NODES {
                return Err(refuse(&key, "nodes without end", "nodes in a tree, at most 100000"));
            }
            let own = parent * node.transform(&key)?;
            open.extend(node.children.iter().map(|child| (*child, own)));
            if let Some(mesh) = node.mesh {
                let key = format!("meshes[{mesh}]");
                let Some(mesh) = document.meshes.get(mesh) else {
                    return Err(refuse(&key, "no such mesh", "one"));
                };
                for (n, primitive) in mesh.primitives.iter().enumerate() {
                    self.primitive(primitive, &format!("{key}.primitives[{n}]"), own)?;
                }
            }
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, key: &str, own: DAffine3) -> Result<(), MeshFileError> {
        let order = TriangleOrder::of_mode(primitive.mode.unwrap_or(4));
        let (Some(&position), Some(order)) = (primitive.attributes.get("POSITION"), order) else {
            self.left_out += 1;
            return Ok(());
        };
        let first = self.mesh.vertices.len();
        let places = self.values(position, "VEC3", &[5126])?;
        let corners = match primitive.indices {
            Some(indices) => self.values(indices, "SCALAR", &[5121, 5123, 5125])?,
            None => (0..places.len() / 3).map(|n| n as f64).collect(),
        };
        let corners = order.triangles(&corners);
        let [vertices, triangles] = [first + places.len() / 3, self.mesh.triangles.len() + corners.len()];
        if vertices > self.most || triangles > self.most {
            return Err(refuse(
                key,
                format!("{triangles} triangles in all"),
                "no more than the file has bytes",
            ));
        }
        let patient_from_gltf = DMat4::from_cols_array(&GLTF_FROM_PATIENT).inverse();
        for place in places.as_chunks::<3>().0 {
            let place = patient_from_gltf.transform_point3(own.transform_point3(DVec3::from(*place)));
            if !place.is_finite() {
                return Err(refuse(key, place, "finite places"));
            }
            self.mesh.vertices.push(Point::from_xyz(place));
        }
        let is_mirrored = own.matrix3.determinant() < 0.0;
        for corners in &corners {
            if let Some(found) = corners.iter().find(|corner| **corner >= (places.len() / 3) as f64) {
                return Err(refuse(
                    key,
                    format!("corner {found}"),
                    &format!("0 to {} (not included)", places.len() / 3),
                ));
            }
            let [a, b, c] = corners.map(|corner| first as u32 + corner as u32);
            self.mesh.triangles.push(if is_mirrored { [a, c, b] } else { [a, b, c] });
        }
        Ok(())
    }

    /// All numbers of an accessor.
    fn values(&self, index: usize, kind: &str, types: &[u32]) -> Result<Vec<f64>, MeshFileError> {
        let key = format!("accessors[{index}]");
        let Some(accessor) = self.document.accessors.get(index) else {
            return Err(refuse(&key, "no such accessor", "one"));
        };
        let size = match accessor.component_type {
            5121 => 1,
            5123 => 2,
            _ => 4,
        };
        if accessor.kind != kind || !types.contains(&accessor.component_type) || accessor.sparse.is_some() {
            let found = format!("{} of {}", accessor.kind, accessor.component_type);
            return Err(refuse(&key, found, &format!("{kind} of {types:?}, not sparse")));
        }
        let view = accessor.buffer_view.and_then(|view| self.document.buffer_views.get(view));
        let Some(view) = view.filter(|view| view.buffer == 0) else {
            return Err(refuse(
                &format!("{key}.bufferView"),
                "none in the file",
                "one in the file's own buffer",
            ));
        };
        let width = if kind == "VEC3" { 3 } else { 1 };
        let stride = view.byte_stride.unwrap_or(width * size).max(1);
        let part = view
            .byte_offset
            .checked_add(view.byte_length)
            .and_then(|end| self.buffer.get(view.byte_offset..end));
        let part = part.and_then(|part| part.get(accessor.byte_offset..));
        let needed = accessor
            .count
            .checked_sub(1)
            .map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(width * size));
        let Some(part) = part.filter(|part| needed.is_some_and(|needed| needed <= part.len())) else {
            let found = format!("{} values beyond the end of the buffer", accessor.count);
            return Err(refuse(&key, found, &format!("a part of its {} bytes", self.buffer.len())));
        };
        let mut values = Vec::with_capacity(accessor.count * width);
        for first in (0..accessor.count).map(|n| n * stride) {
            values.extend((0..width).map(|n| value(&part[first + n * size..], accessor.component_type)));
        }
        Ok(values)
    }
}

/// A number at the beginning of bytes that are long enough.
fn value(bytes: &[u8], kind: u32) -> f64 {
    match kind {
        5121 => f64::from(bytes[0]),
        5123 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        5125 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        _ => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}

impl Node {
    fn transform(&self, key: &str) -> Result<DAffine3, MeshFileError> {
        let own = match &self.matrix {
            Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(matrix)),
            None => {
                let rotation = DQuat::from_array(self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
                if !(rotation.length_squared() > 0.0 && rotation.is_finite()) {
                    return Err(refuse(&format!("{key}.rotation"), rotation, "a unit quaternion"));
                }
                DAffine3::from_scale_rotation_translation(
                    DVec3::from(self.scale.unwrap_or([1.0; 3])),
                    rotation.normalize(),
                    DVec3::from(self.translation.unwrap_or_default()),
                )
            }
        };
        if own.is_finite() {
            Ok(own)
        } else {
            Err(refuse(key, "a transform that is not finite", "a finite one"))
        }
    }
}
