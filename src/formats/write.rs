//! Label maps written as 3D Slicer has them: NRRD with names and colours of the segments.

use std::fmt::Write;
use std::io::Write as _;

use crate::volume::{LabelMap, Places};

/// The bytes of a `.seg.nrrd` file.
///
/// # Errors
/// None but those of memory: it is written there.
pub fn seg_nrrd(map: &LabelMap) -> std::io::Result<Vec<u8>> {
    let is_wide = map.segments().iter().any(|segment| segment.label > 255);
    let kind = if is_wide { "uint16" } else { "uint8" };
    let header = header(map, kind).into_bytes();
    // The header of NRRD is not compressed.
    let voxels = compressed(map, &[], is_wide)?;
    Ok([header, voxels].concat())
}

/// A head and the labels behind it, of 8 bits or of 16 in little-endian order, compressed with gzip.
pub(super) fn compressed(map: &LabelMap, head: &[u8], is_wide: bool) -> std::io::Result<Vec<u8>> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(head)?;
    let label_of = |place: usize| place.checked_sub(1).map_or(0, |at| map.segments()[at].label);
    let count = match map.places() {
        Places::Bytes(places) => places.len(),
        Places::Words(places) => places.len(),
    };
    let mut part = Vec::new();
    for first in (0..count).step_by(1 << 16) {
        part.clear();
        for at in first..count.min(first + (1 << 16)) {
            let [low, high] = label_of(map.places().at(at)).to_le_bytes();
            part.push(low);
            if is_wide {
                part.push(high);
            }
        }
        encoder.write_all(&part)?;
    }
    encoder.finish()
}

fn header(map: &LabelMap, kind: &str) -> String {
    let [nx, ny, nz] = map.grid().dims();
    let affine = map.grid().patient_from_voxel().affine;
    let vector = |v: glam::DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let axes = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis].map(vector).join(" ");
    let origin = vector(affine.translation);
    let mut text = format!(
        "NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {axes}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space origin: {origin}\n"
    );
    for (n, segment) in map.segments().iter().enumerate() {
        let [r, g, b] = segment.color();
        let _ = write!(
            text,
            "Segment{n}_Color:={r} {g} {b}\nSegment{n}_ID:=Segment_{n}\nSegment{n}_LabelValue:={}\n\
             Segment{n}_Layer:=0\n",
            segment.label
        );
        if let Some(name) = &segment.name {
            let _ = writeln!(text, "Segment{n}_Name:={name}");
        }
    }
    text.push('\n');
    text
}
