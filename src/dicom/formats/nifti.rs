//! NIfTI-1 and NIfTI-2 in a single file; segments are described in an XML extension, where there is
//! one.
//!
//! The layout is that of nifti1.h and nifti2.h. Spaces: the file's world is RAS mm; here it becomes
//! LPS.

use glam::{DMat3, DQuat, DVec3};

use super::FormatError;
use super::bytes::Source;
use super::header::{Described, Header, NamedSegment, Scale};
use super::values::{Number, Voxel};
use relief_base::Transform;
use relief_volume::Grid;

/// Longest stretch from the header to the voxels: extensions are notes of a few kilobytes.
const LONGEST_EXTENSIONS: u64 = 1 << 24;
/// Most segments that an extension may name.
const MOST_NAMES: usize = 1 << 16;

/// The fields of a header, of either version.
struct Fields {
    bytes: Vec<u8>,
    is_big_endian: bool,
    is_second: bool,
}

impl Fields {
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut array = [0; N];
        array.copy_from_slice(&self.bytes[at..at + N]);
        if self.is_big_endian {
            array.reverse();
        }
        array
    }

    fn i16(&self, at: usize) -> i64 {
        i16::from_le_bytes(self.array(at)).into()
    }

    fn i32(&self, at: usize) -> i64 {
        i32::from_le_bytes(self.array(at)).into()
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.array(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.array(at)).into()
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.array(at))
    }

    fn dim(&self, n: usize) -> i64 {
        if self.is_second { self.i64(16 + 8 * n) } else { self.i16(40 + 2 * n) }
    }

    fn pixdim(&self, n: usize) -> f64 {
        if self.is_second { self.f64(104 + 8 * n) } else { self.f32(76 + 4 * n) }
    }

    fn float(&self, [first, second]: [usize; 2], n: usize) -> f64 {
        if self.is_second { self.f64(second + 8 * n) } else { self.f32(first + 4 * n) }
    }

    fn code(&self, [first, second]: [usize; 2]) -> i64 {
        if self.is_second { self.i32(second) } else { self.i16(first) }
    }
}

pub(super) fn read(source: &mut Source) -> Result<Described, FormatError> {
    let mut bytes = source.take(4)?;
    let size = [bytes[0], bytes[1], bytes[2], bytes[3]];
    let is_big_endian = ![348, 540].contains(&i32::from_le_bytes(size));
    let is_second = if is_big_endian { i32::from_be_bytes(size) } else { i32::from_le_bytes(size) } == 540;
    let length = if is_second { 540 } else { 348 };
    bytes.extend(source.take(length - 4)?);
    let fields = Fields { bytes, is_big_endian, is_second };
    check_magic(&fields)?;
    let offset = voxel_offset(&fields)?;
    let header = Header {
        grid: grid(&fields)?,
        layers: 1,
        voxel: Voxel { number: number(fields.i16(if is_second { 12 } else { 70 }))?, is_big_endian },
        scale: scale(&fields)?,
    };
    let between = source.take((offset - length as u64) as usize)?;
    Ok(Described { header, segments: segments(&between, is_big_endian) })
}

fn check_magic(fields: &Fields) -> Result<(), FormatError> {
    let magic = if fields.is_second { &fields.bytes[4..7] } else { &fields.bytes[344..347] };
    let expected: [&[u8]; 2] = if fields.is_second { [b"n+2", b"ni2"] } else { [b"n+1", b"ni1"] };
    if magic == expected[0] {
        return Ok(());
    }
    let shown = magic.escape_ascii().to_string();
    let allowed = match magic == expected[1] {
        true => "n+1 or n+2: voxels in the same file (convert the pair of .hdr and .img)",
        false => "n+1 or n+2",
    };
    Err(FormatError::header("magic", shown, allowed))
}

/// Bytes from the start of the file to the voxels.
fn voxel_offset(fields: &Fields) -> Result<u64, FormatError> {
    let least = fields.bytes.len() as u64 + 4;
    let found = if fields.is_second { fields.i64(168) as f64 } else { fields.f32(108) };
    let allowed = least as f64..=(least + LONGEST_EXTENSIONS) as f64;
    if found.fract() == 0.0 && allowed.contains(&found) {
        return Ok(found as u64);
    }
    let allowed = format!("a whole number from {least} on, and at most {LONGEST_EXTENSIONS} bytes more");
    Err(FormatError::header("vox_offset", found, allowed))
}

fn number(code: i64) -> Result<Number, FormatError> {
    Ok(match code {
        2 => Number::U8,
        4 => Number::I16,
        8 => Number::I32,
        16 => Number::F32,
        64 => Number::F64,
        256 => Number::I8,
        512 => Number::U16,
        768 => Number::U32,
        1024 => Number::I64,
        1280 => Number::U64,
        _ => {
            return Err(FormatError::header(
                "datatype",
                code,
                "2, 4, 8, 16, 64, 256, 512, 768, 1024 or 1280",
            ));
        }
    })
}

/// A slope of 0 means none.
fn scale(fields: &Fields) -> Result<Scale, FormatError> {
    let [slope, intercept] = [fields.float([112, 176], 0), fields.float([116, 184], 0)];
    if slope == 0.0 || (slope.is_nan() && intercept.is_nan()) {
        return Ok(Scale::NONE);
    }
    if !slope.is_finite() || !intercept.is_finite() {
        let found = format!("{slope}, {intercept}");
        return Err(FormatError::header("scl_slope, scl_inter", found, "finite numbers"));
    }
    Ok(Scale { slope, intercept })
}

fn grid(fields: &Fields) -> Result<Grid, FormatError> {
    let mut dims = [1; 3];
    let used = fields.dim(0);
    if !(1..=7).contains(&used) {
        return Err(FormatError::header("dim[0]", used, "1 to 7"));
    }
    for n in 1..=usize::try_from(used).unwrap_or(7) {
        let found = fields.dim(n);
        let largest = if n <= 3 { 1 << 20 } else { 1 };
        match usize::try_from(found).ok().filter(|found| (1..=largest).contains(found)) {
            Some(found) if n <= 3 => dims[n - 1] = found,
            Some(_) => {}
            None => {
                let allowed = if n <= 3 { "1 to 1048576" } else { "1: of a series of volumes, take one out" };
                return Err(FormatError::header(&format!("dim[{n}]"), found, allowed));
            }
        }
    }
    Ok(Grid::new(dims, lps_from_voxel(fields)?)?)
}

type LpsFromVoxel = Transform<relief_base::Patient, relief_base::Voxel>;

/// The affine map of the s-form, or else of the q-form. What says neither has no place in the
/// patient.
fn lps_from_voxel(fields: &Fields) -> Result<LpsFromVoxel, FormatError> {
    let [qform, sform] = [fields.code([252, 344]), fields.code([254, 348])];
    let (axes, origin) = match (sform > 0, qform > 0) {
        (true, _) => sform_map(fields),
        (false, true) => qform_map(fields),
        (false, false) => {
            let allowed = "a code above 0: the file does not say where its voxels lie";
            return Err(FormatError::header("qform_code and sform_code", "0", allowed));
        }
    };
    if axes.determinant() == 0.0 {
        let form = if sform > 0 { "srow_x, srow_y, srow_z" } else { "pixdim" };
        let found = format!(
            "columns {:?}, {:?}, {:?}",
            axes.x_axis.to_array(),
            axes.y_axis.to_array(),
            axes.z_axis.to_array()
        );
        let other =
            if sform > 0 && qform > 0 { "; the q-form may be right: set sform_code to 0" } else { "" };
        let allowed = format!("three independent directions of the voxel axes{other}");
        return Err(FormatError::header(form, found, allowed));
    }
    // The unit of length is in three bits; 0 says nothing and is mm in practice.
    let unit = if fields.is_second { fields.i32(500) } else { i64::from(fields.bytes[123]) } & 7;
    let mm = match unit {
        0 | 2 => 1.0,
        1 => 1000.0,
        3 => 0.001,
        _ => return Err(FormatError::header("xyzt_units", unit, "1, 2 or 3 (m, mm, µm)")),
    };
    let lps = DVec3::new(-mm, -mm, mm);
    Ok(Transform::from_axes(axes.x_axis * lps, axes.y_axis * lps, axes.z_axis * lps, origin * lps))
}

fn sform_map(fields: &Fields) -> (DMat3, DVec3) {
    let row = |n: usize| [0, 1, 2, 3].map(|column| fields.float([280 + 16 * n, 400 + 32 * n], column));
    let [x, y, z] = [row(0), row(1), row(2)];
    let column = |n: usize| DVec3::new(x[n], y[n], z[n]);
    (DMat3::from_cols(column(0), column(1), column(2)), column(3))
}

/// A turn by a quaternion whose real part is left out, then spacing, and the sign of the third
/// axis.
fn qform_map(fields: &Fields) -> (DMat3, DVec3) {
    let part = |n: usize| fields.float([256, 352], n);
    let [b, c, d] = [part(0), part(1), part(2)];
    let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    let turn = DMat3::from_quat(DQuat::from_xyzw(b, c, d, a).normalize());
    let sign = if fields.pixdim(0) < 0.0 { -1.0 } else { 1.0 };
    let spacing = DVec3::new(fields.pixdim(1), fields.pixdim(2), sign * fields.pixdim(3));
    (turn * DMat3::from_diagonal(spacing), DVec3::new(part(3), part(4), part(5)))
}

/// Segments of the extensions, if one of them is XML with `Label` elements as Connectome Workbench
/// and TotalSegmentator write them: a key, a colour of 0 to 1, and the name as text. What cannot be
/// read is no segment, and no error either.
fn segments(between: &[u8], is_big_endian: bool) -> Vec<NamedSegment> {
    let Some((&[present, ..], mut rest)) = between.split_first_chunk::<4>() else { return Vec::new() };
    let mut segments = Vec::new();
    while let Some((head, _)) = rest.split_first_chunk::<8>().filter(|_| present != 0) {
        let [a, b, c, d, ..] = *head;
        let size = if is_big_endian { [d, c, b, a] } else { [a, b, c, d] };
        let size = u32::from_le_bytes(size) as usize;
        let Some(extension) = rest.get(8..size) else { break };
        segments.extend(labels_of_xml(extension));
        rest = &rest[size..];
    }
    segments.truncate(MOST_NAMES);
    segments
}

fn labels_of_xml(extension: &[u8]) -> Vec<NamedSegment> {
    use quick_xml::events::Event;
    let text = String::from_utf8_lossy(extension);
    let mut reader = quick_xml::Reader::from_str(text.trim_end_matches('\0'));
    let mut segments = Vec::new();
    let mut open: Option<NamedSegment> = None;
    while segments.len() < MOST_NAMES {
        match reader.read_event() {
            Ok(Event::Start(start)) if start.name().as_ref() == "Label" => open = label_of(&start),
            Ok(Event::CData(name)) => {
                let name = name.into_inner().into_owned();
                open = open.map(|segment| NamedSegment { name: Some(name), ..segment });
            }
            Ok(Event::Text(name)) => {
                let name = name.trim().to_owned();
                if let Some(segment) = open.as_mut().filter(|s| s.name.is_none() && !name.is_empty()) {
                    segment.name = Some(name);
                }
            }
            Ok(Event::End(end)) if end.name().as_ref() == "Label" => segments.extend(open.take()),
            Ok(Event::Eof) | Err(_) => break,
            Ok(_) => {}
        }
    }
    segments
}

fn label_of(start: &quick_xml::events::BytesStart<'_>) -> Option<NamedSegment> {
    let value = |name: &str| {
        let attribute = start.try_get_attribute(name).ok()??;
        attribute.value.trim().parse::<f64>().ok()
    };
    let key = value("Key").filter(|key| (1.0..=65535.0).contains(key) && key.fract() == 0.0)?;
    let rgb = match [value("Red"), value("Green"), value("Blue")] {
        [Some(r), Some(g), Some(b)] => Some([r, g, b]),
        _ => None,
    };
    Some(NamedSegment { label: key as u16, layer: 0, name: None, rgb })
}
