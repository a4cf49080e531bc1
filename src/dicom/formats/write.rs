//! Label maps written as 3D Slicer has them: NRRD with names and colours of the segments.

use std::fmt::Write;
use std::io::Write as _;

use relief_volume::{Grid, LabelMap, Segment};

/// The bytes of a `.seg.nrrd` file.
///
/// # Errors
/// Only a lack of memory: the file is written there.
pub fn write_seg_nrrd(map: &LabelMap) -> std::io::Result<Vec<u8>> {
    write_seg_nrrd_layers(std::slice::from_ref(map))
}

/// The bytes of a `.seg.nrrd` file of several layers, whose segments may overlap: maps of one grid,
/// whose labels differ.
///
/// # Errors
/// When there is no map, or they are of different grids.
pub fn write_seg_nrrd_layers(maps: &[LabelMap]) -> std::io::Result<Vec<u8>> {
    let wrong = |why| std::io::Error::new(std::io::ErrorKind::InvalidInput, why);
    let first = maps.first().ok_or_else(|| wrong("there is no layer to be written"))?;
    if maps.iter().any(|map| map.grid() != first.grid()) {
        return Err(wrong("layers lie on different grids"));
    }
    let is_wide = maps.iter().flat_map(LabelMap::segments).any(|segment| segment.label > 255);
    let kind = if is_wide { "uint16" } else { "uint8" };
    let header = header(first.grid(), maps, kind).into_bytes();
    // The header of NRRD is not compressed.
    let voxels = compressed(maps, &[], is_wide)?;
    Ok([header, voxels].concat())
}

/// A head and the labels behind it, those of a voxel in all layers side by side, of 8 bits or of 16
/// in little-endian order, compressed with gzip.
pub(super) fn compressed(maps: &[LabelMap], head: &[u8], is_wide: bool) -> std::io::Result<Vec<u8>> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(head)?;
    let label_of = |map: &LabelMap, at: usize| {
        map.places().at(at).checked_sub(1).map_or(0, |at| map.segments()[at].label)
    };
    let count = maps.first().map_or(0, |map| map.grid().voxel_count());
    let mut part = Vec::new();
    for first in (0..count).step_by(1 << 16) {
        part.clear();
        for at in first..count.min(first + (1 << 16)) {
            for map in maps {
                let [low, high] = label_of(map, at).to_le_bytes();
                part.push(low);
                if is_wide {
                    part.push(high);
                }
            }
        }
        encoder.write_all(&part)?;
    }
    encoder.finish()
}

fn header(grid: &Grid, maps: &[LabelMap], kind: &str) -> String {
    let [nx, ny, nz] = grid.dims();
    let affine = grid.patient_from_voxel().affine;
    let vector = |v: glam::DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let axes = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis].map(vector).join(" ");
    let origin = vector(affine.translation);
    // Several layers are a first axis of their own.
    let layers = maps.len();
    let (dimension, size, direction, list) =
        if layers > 1 { (4, format!("{layers} "), "none ", "list ") } else { (3, String::new(), "", "") };
    let mut text = format!(
        "NRRD0004\ntype: {kind}\ndimension: {dimension}\nspace: left-posterior-superior\nsizes: {size}{nx} {ny} {nz}\n\
         space directions: {direction}{axes}\nkinds: {list}domain domain domain\nendian: little\nencoding: gzip\n\
         space origin: {origin}\n"
    );
    let mut segments: Vec<(usize, &Segment)> = Vec::new();
    for (layer, map) in maps.iter().enumerate() {
        segments.extend(map.segments().iter().map(|segment| (layer, segment)));
    }
    segments.sort_by_key(|(_, segment)| segment.label);
    for (n, (layer, segment)) in segments.into_iter().enumerate() {
        let [r, g, b] = segment.color();
        let _ = write!(
            text,
            "Segment{n}_Color:={r} {g} {b}\nSegment{n}_ID:=Segment_{n}\nSegment{n}_LabelValue:={}\n\
             Segment{n}_Layer:={layer}\n",
            segment.label
        );
        if let Some(name) = &segment.name {
            let _ = writeln!(text, "Segment{n}_Name:={name}");
        }
    }
    text.push('\n');
    text
}
