//! Label maps as NIfTI-1, gzip-compressed: both maps of the voxels (s-form and q-form) in RAS mm,
//! and the segments' names and colours in an extension as Connectome Workbench has it, which other
//! programs pass over.

use std::fmt::Write as _;
use std::io;

use glam::{DMat3, DQuat, DVec3};

use super::write::compressed;
use relief_volume::{Grid, LabelMap};

/// Most voxels along an axis: extents are 16-bit.
const MOST_ALONG: usize = i16::MAX as usize;
const HEADER: usize = 348;
/// Position of the four bytes that say whether extensions follow, and of the first extension.
const EXTENSIONS: usize = HEADER + 4;
/// The code of Workbench's extensions.
const CARET: i32 = 30;
const INTENT_LABEL: i16 = 1002;
const SCANNER_ANATOMICAL: i16 = 1;
const MILLIMETRES: u8 = 2;
/// The largest deviation of axes from right angles, as a cosine, for the q-form, which has turns only.
const RIGHT_ANGLE: f64 = 1e-6;

/// The bytes of a `.nii.gz` file: labels as unsigned integers of 8 bits, or of 16 where some are
/// beyond 255.
///
/// # Errors
/// When an axis has more than 32767 voxels, which the format cannot say.
pub fn write_nifti_labels(map: &LabelMap) -> io::Result<Vec<u8>> {
    let dims = map.grid().dims();
    if dims.iter().any(|&n| n > MOST_ALONG) {
        let problem = format!("found {dims:?} voxels, NIfTI-1 has at most {MOST_ALONG} along an axis");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
    }
    let is_wide = map.segments().iter().any(|segment| segment.label > 255);
    let extension = extension(map);
    let mut head = header(map.grid(), is_wide, EXTENSIONS + extension.len());
    head.extend_from_slice(&extension);
    compressed(std::slice::from_ref(map), &head, is_wide)
}

fn header(grid: &Grid, is_wide: bool, offset: usize) -> Vec<u8> {
    let mut bytes = vec![0u8; EXTENSIONS];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    let [nx, ny, nz] = grid.dims().map(|n| n as i16);
    for (n, dim) in [3, nx, ny, nz, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * n, &dim.to_le_bytes());
    }
    put(68, &INTENT_LABEL.to_le_bytes());
    let (kind, bits): (i16, i16) = if is_wide { (512, 16) } else { (2, 8) };
    put(70, &kind.to_le_bytes());
    put(72, &bits.to_le_bytes());
    let mut put_float = |at: usize, value: f64| put(at, &(value as f32).to_le_bytes());
    // RAS: the first two axes of the patient point the other way.
    let ras = |v: DVec3| v * DVec3::new(-1.0, -1.0, 1.0);
    let affine = grid.patient_from_voxel().affine;
    let axes =
        DMat3::from_cols(ras(affine.matrix3.x_axis), ras(affine.matrix3.y_axis), ras(affine.matrix3.z_axis));
    let origin = ras(affine.translation);
    let (sign, turn) = quaternion(axes).unwrap_or((1.0, DQuat::IDENTITY));
    let [dx, dy, dz] = grid.spacing_mm();
    for (n, value) in [sign, dx, dy, dz, 1.0, 1.0, 1.0, 1.0].into_iter().enumerate() {
        put_float(76 + 4 * n, value);
    }
    put_float(108, offset as f64);
    put_float(112, 1.0); // slope, beside an intercept of 0
    for (n, value) in [turn.x, turn.y, turn.z, origin.x, origin.y, origin.z].into_iter().enumerate() {
        put_float(256 + 4 * n, value);
    }
    for row in 0..3 {
        for (column, value) in axes.row(row).to_array().into_iter().chain([origin[row]]).enumerate() {
            put_float(280 + 16 * row + 4 * column, value);
        }
    }
    put(123, &[MILLIMETRES]);
    let has_turn = quaternion(axes).is_some();
    put(252, &(if has_turn { SCANNER_ANATOMICAL } else { 0 }).to_le_bytes());
    put(254, &SCANNER_ANATOMICAL.to_le_bytes());
    put(148, b"Relief label map");
    put(344, b"n+1\0");
    put(HEADER, &[1, 0, 0, 0]);
    bytes
}

/// The turn of axes at right angles, with the sign of the third; `None` of others.
fn quaternion(axes: DMat3) -> Option<(f64, DQuat)> {
    let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::normalize);
    let cosine = [x.dot(y), y.dot(z), z.dot(x)].into_iter().map(f64::abs).fold(0.0, f64::max);
    let sign = if x.cross(y).dot(z) < 0.0 { -1.0 } else { 1.0 };
    let turn = DQuat::from_mat3(&DMat3::from_cols(x, y, z * sign)).normalize();
    // The real part is left out of the file and taken to be positive.
    let turn = if turn.w < 0.0 { -turn } else { turn };
    (cosine <= RIGHT_ANGLE).then_some((sign, turn))
}

/// Names and colours, in a multiple of 16 bytes.
fn extension(map: &LabelMap) -> Vec<u8> {
    let mut xml = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><CaretExtension><VolumeInformation Index=\"0\"><LabelTable>\
         <Label Key=\"0\" Red=\"0\" Green=\"0\" Blue=\"0\" Alpha=\"0\"><![CDATA[none]]></Label>",
    );
    for segment in map.segments() {
        let [r, g, b] = segment.color();
        let name = segment.name.clone().unwrap_or_else(|| format!("Segment {}", segment.label));
        let name = name.replace("]]>", "]] >");
        let _ = write!(
            xml,
            "<Label Key=\"{}\" Red=\"{r}\" Green=\"{g}\" Blue=\"{b}\" Alpha=\"1\"><![CDATA[{name}]]></Label>",
            segment.label
        );
    }
    xml.push_str(
        "</LabelTable><StudyMetaDataLinkSet/><VolumeType>Label</VolumeType></VolumeInformation></CaretExtension>",
    );
    let size = (8 + xml.len()).next_multiple_of(16);
    let size_field = i32::try_from(size).unwrap_or(i32::MAX); // 65535 names of 128 letters are far below
    let mut bytes = [size_field.to_le_bytes(), CARET.to_le_bytes()].concat();
    bytes.extend_from_slice(xml.as_bytes());
    bytes.resize(size, 0);
    bytes
}
