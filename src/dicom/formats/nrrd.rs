//! NRRD with its voxels behind the header, and the segments of 3D Slicer in it.
//!
//! After Teem's description of the format, versions 1 to 5. Encodings raw and gzip; a layer of a
//! segmentation is a first axis of kind `list`. Spaces: the header names the world; here it becomes
//! LPS mm.

use std::collections::HashMap;

use glam::DVec3;

use super::FormatError;
use super::bytes::Source;
use super::header::{Described, Header, NamedSegment, Scale};
use super::values::{Number, Voxel};
use relief_base::Transform;
use relief_volume::{Grid, Layers};

/// Longest line: names and terms of a segment in one.
const LONGEST_LINE: usize = 1 << 16;
/// Longest header: a kilobyte for each of the segments of the largest atlases.
const LONGEST_HEADER: usize = 1 << 22;
/// Most values in a voxel.
const MOST_LAYERS: usize = Layers::MOST;

/// Fields by their names, and key/value pairs by their keys.
#[derive(Default)]
struct Lines {
    fields: HashMap<String, String>,
    pairs: HashMap<String, String>,
}

impl Lines {
    fn read(source: &mut Source) -> Result<Self, FormatError> {
        source.line(LONGEST_LINE)?; // the magic, which was looked at
        let mut lines = Self::default();
        let mut bytes = 0;
        while bytes < LONGEST_HEADER {
            let Some(line) = source.line(LONGEST_LINE)? else {
                return Err(FormatError::header("the header", "cut short", "an empty line behind it"));
            };
            bytes += line.len() + 1;
            if line.is_empty() {
                return Ok(lines);
            }
            if line.starts_with('#') {
                continue;
            }
            // A pair has := and a field has a colon and a space.
            match (line.split_once(":="), line.split_once(": ")) {
                (Some((key, value)), field) if field.is_none_or(|(name, _)| name.len() > key.len()) => {
                    lines.pairs.insert(key.to_owned(), value.to_owned());
                }
                (_, Some((name, value))) => {
                    lines.fields.insert(name.trim().to_lowercase(), value.trim().to_owned());
                }
                _ => return Err(FormatError::header("the header", line, "fields as name: value")),
            }
        }
        Err(FormatError::header("the header", format!("more than {LONGEST_HEADER} bytes"), "fewer"))
    }

    fn field(&self, name: &str) -> Option<&str> {
        self.fields.get(name).map(String::as_str)
    }

    fn required(&self, name: &str) -> Result<&str, FormatError> {
        self.field(name).ok_or_else(|| FormatError::header(name, "not there", "a value"))
    }
}

pub(super) fn read(source: &mut Source) -> Result<Described, FormatError> {
    let lines = Lines::read(source)?;
    for detached in ["data file", "datafile"] {
        if let Some(file) = lines.field(detached) {
            let allowed = "voxels behind the header (write the file with its data attached)";
            return Err(FormatError::header(detached, file, allowed));
        }
    }
    for skip in ["line skip", "lineskip", "byte skip", "byteskip"] {
        if let Some(found) = lines.field(skip).filter(|count| *count != "0") {
            return Err(FormatError::header(skip, found, "0"));
        }
    }
    let number = number(lines.required("type")?)?;
    let (layers, dims) = sizes(&lines)?;
    let grid = Grid::new(dims, lps_from_voxel(&lines, layers > 1)?)?;
    let voxel = Voxel { number, is_big_endian: is_big_endian(&lines, number)? };
    let header = Header { grid, layers, voxel, scale: Scale::NONE };
    let segments = segments(&lines, layers);
    match lines.required("encoding")?.to_lowercase().as_str() {
        "raw" => {}
        "gzip" | "gz" => source.unpack_rest(),
        other => return Err(FormatError::header("encoding", other, "raw, gzip")),
    }
    Ok(Described { header, segments })
}

fn number(name: &str) -> Result<Number, FormatError> {
    Ok(match name.to_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => Number::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Number::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Number::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Number::U16,
        "int" | "signed int" | "int32" | "int32_t" => Number::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Number::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Number::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return Err(FormatError::header("type", name, "a type of whole or floating-point numbers")),
    })
}

fn is_big_endian(lines: &Lines, number: Number) -> Result<bool, FormatError> {
    match lines.field("endian").map(str::to_lowercase).as_deref() {
        Some("little") => Ok(false),
        Some("big") => Ok(true),
        None if number.bytes() == 1 => Ok(false),
        other => Err(FormatError::header("endian", other.unwrap_or("not there"), "little, big")),
    }
}

/// Values in a voxel, and voxels along the three axes of space.
fn sizes(lines: &Lines) -> Result<(usize, [usize; 3]), FormatError> {
    let text = lines.required("sizes")?;
    let sizes: Option<Vec<usize>> = text.split_whitespace().map(|size| size.parse().ok()).collect();
    let refused = |allowed: &str| Err(FormatError::header("sizes", text, allowed));
    let sizes = sizes.filter(|sizes| sizes.iter().all(|size| (1..=1 << 20).contains(size)));
    match sizes.as_deref() {
        Some(&[x, y, z]) => Ok((1, [x, y, z])),
        Some(&[layers, x, y, z]) if layers <= MOST_LAYERS => Ok((layers, [x, y, z])),
        Some(&[_, _, _, _]) => refused("at most 64 values in each voxel, which come first"),
        _ => refused("three whole numbers from 1 to 1048576, or four with the layers first"),
    }
}

type LpsFromVoxel = Transform<relief_base::Patient, relief_base::Voxel>;

/// The directions of the axes of space, behind that of layers, and the origin.
fn lps_from_voxel(lines: &Lines, has_layers: bool) -> Result<LpsFromVoxel, FormatError> {
    let space = lines.required("space")?.to_lowercase();
    let lps = match space.as_str() {
        "left-posterior-superior" | "lps" => DVec3::ONE,
        "right-anterior-superior" | "ras" => DVec3::new(-1.0, -1.0, 1.0),
        "left-anterior-superior" | "las" => DVec3::new(1.0, -1.0, 1.0),
        _ => {
            let allowed = "left-posterior-superior, right-anterior-superior or left-anterior-superior";
            return Err(FormatError::header("space", space, allowed));
        }
    };
    let text = lines.required("space directions")?;
    let origin = vectors(lines.required("space origin")?);
    let (Some(axes), Some(&[Some(origin)])) = (vectors(text), origin.as_deref()) else {
        let allowed = "vectors as (x,y,z), and none for an axis of layers";
        return Err(FormatError::header("space directions, space origin", text, allowed));
    };
    if axes.iter().skip(1).any(Option::is_none) || has_layers && axes.first().is_some_and(Option::is_some) {
        let allowed = "none for the first axis where voxels have layers, and vectors for the others";
        return Err(FormatError::header("space directions", text, allowed));
    }
    let axes: Vec<DVec3> = axes.into_iter().flatten().collect();
    let &[x, y, z] = axes.as_slice() else {
        return Err(FormatError::header("space directions", text, "three vectors"));
    };
    let lps = lps * mm_per_unit(lines)?;
    Ok(Transform::from_axes(x * lps, y * lps, z * lps, origin * lps))
}

/// Millimetres of the unit of each axis of space: quoted texts; without any, or empty, mm.
fn mm_per_unit(lines: &Lines) -> Result<DVec3, FormatError> {
    let Some(text) = lines.field("space units") else { return Ok(DVec3::ONE) };
    let allowed = "three of \"mm\", \"um\", \"nm\", \"cm\", \"m\", or their names";
    let refused = || FormatError::header("space units", text, allowed);
    let mm = |unit: &str| {
        Some(match unit.trim().to_lowercase().as_str() {
            "" | "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => 1.0,
            "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" | "micrometer" | "micrometers"
            | "micrometre" | "micrometres" => 1e-3,
            "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => 1e-6,
            "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => 10.0,
            "m" | "meter" | "meters" | "metre" | "metres" => 1000.0,
            _ => return None,
        })
    };
    // Every second part lies between quotes.
    let parts: Vec<&str> = text.split('"').collect();
    let units: Option<Vec<f64>> = match parts.as_slice() {
        [_] => text.split_whitespace().map(mm).collect(),
        parts => parts.iter().skip(1).step_by(2).map(|unit| mm(unit)).collect(),
    };
    let units = units.ok_or_else(refused)?;
    let &[x, y, z] = units.as_slice() else { return Err(refused()) };
    Ok(DVec3::new(x, y, z))
}

/// Vectors as `(x,y,z)`, and `none`.
fn vectors(text: &str) -> Option<Vec<Option<DVec3>>> {
    let mut vectors = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inner, after) = rest.strip_prefix('(')?.split_once(')')?;
        let numbers: Option<Vec<f64>> = inner.split(',').map(|number| number.trim().parse().ok()).collect();
        let &[x, y, z] = numbers?.as_slice() else { return None };
        vectors.push(Some(DVec3::new(x, y, z)));
        rest = after.trim_start();
    }
    (vectors.len() <= 4).then_some(vectors)
}

/// Segments as 3D Slicer names them: `Segment0_Name`, `_LabelValue`, `_Layer`, `_Color`. The
/// numbering has no gaps.
fn segments(lines: &Lines, layers: usize) -> Vec<NamedSegment> {
    let mut segments = Vec::new();
    for n in 0..=usize::from(u16::MAX) {
        let value = |key: &str| lines.pairs.get(&format!("Segment{n}_{key}")).map(String::as_str);
        if value("ID").is_none() && value("Name").is_none() {
            break;
        }
        // Files of early versions have neither: one segment in each layer, of value 1.
        let layer = value("Layer").and_then(|layer| layer.trim().parse().ok()).unwrap_or(n);
        let usual = if layers > 1 { 1 } else { n + 1 };
        let label = value("LabelValue").and_then(|label| label.trim().parse().ok());
        let label = label.unwrap_or(u16::try_from(usual).unwrap_or(u16::MAX));
        let numbers: Vec<f64> =
            value("Color").unwrap_or("").split_whitespace().filter_map(|part| part.parse().ok()).collect();
        let rgb = <[f64; 3]>::try_from(numbers).ok();
        segments.push(NamedSegment { label, layer, name: value("Name").map(str::to_owned), rgb });
    }
    segments
}
