//! DICOM segmentation objects (SEG) as label maps.
//!
//! BINARY objects hold a bit for each voxel of each frame, packed without regard to frames (PS3.3
//! C.8.20, PS3.5 8.1.1). Each frame is a slice of one segment, and slices without the segment are
//! often left out. LABELMAP objects hold the segment's number. The grid spans the existing frames.
//! FRACTIONAL objects are not read, since their threshold would be a guess, nor are compressed
//! ones.
//!
//! Spaces: patient LPS mm, as the frames' positions have it. Whether the frame of reference is that
//! of some series is not looked at: some writers invent one, and the positions hold all the same.

use std::path::Path;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::attributes::{
    BETWEEN, BITS_ALLOCATED, COLUMNS, FRAMES, ORIENTATION, POSITION, ROWS, SEGMENT, SEGMENTATION, SPACING,
    THICKNESS, check, numbers, positive, required, text,
};
use super::charset::Charset;
use super::dataset::{DataSet, Encoding, Retention};
use super::error::{Defect, FrameGridError};
use super::file_bytes::Bytes;
use super::groups::Groups;
use super::load::LoadLimits;
use super::part10::{self, Object};
use relief_base::Budget;
use relief_base::Transform;
use relief_volume::{Grid, LabelMap, Layers, Segment};

/// A segmentation and the anomalies of its file.
#[derive(Debug)]
pub struct LoadedSegmentation {
    /// The segments by their numbers, on the object's own grid.
    pub map: LabelMap,
    /// How each anomaly was handled, as sentences.
    pub warnings: Vec<String>,
}

/// One slice of one segment, or of all.
struct Frame {
    position: DVec3,
    /// None where the voxels themselves say.
    segment: Option<u16>,
}

/// The geometry of the slices: directions are unit vectors.
struct Stack {
    row: DVec3,
    column: DVec3,
    /// Between columns and between rows, mm.
    pixel_mm: [f64; 2],
    origin: DVec3,
    spacing_mm: f64,
    slices: usize,
}

fn keep(tag: Tag) -> Retention {
    match tag {
        tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE
        | tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE
        | tags::PLANE_POSITION_SEQUENCE
        | tags::PLANE_ORIENTATION_SEQUENCE
        | tags::PIXEL_MEASURES_SEQUENCE
        | tags::SEGMENT_SEQUENCE
        | tags::SEGMENT_IDENTIFICATION_SEQUENCE => Retention::Items,
        tags::SPECIFIC_CHARACTER_SET
        | tags::ROWS
        | tags::COLUMNS
        | tags::NUMBER_OF_FRAMES
        | tags::BITS_ALLOCATED
        | tags::SEGMENTATION_TYPE
        | tags::SEGMENT_NUMBER
        | tags::SEGMENT_LABEL
        | tags::REFERENCED_SEGMENT_NUMBER
        | tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE
        | tags::IMAGE_POSITION_PATIENT
        | tags::IMAGE_ORIENTATION_PATIENT
        | tags::PIXEL_SPACING
        | tags::SLICE_THICKNESS
        | tags::SPACING_BETWEEN_SLICES => Retention::Value,
        _ => Retention::Nothing,
    }
}

/// Loads a segmentation object; voxels count two bytes each within the limits.
///
/// # Errors
/// When it is no segmentation object of type BINARY or LABELMAP, compressed, cut short, larger than
/// allowed, or its frames lie on no regular grid.
pub fn load_segmentation(limits: LoadLimits, path: &Path) -> Result<LoadedSegmentation, Defect> {
    load(limits, Bytes::Disk(path.to_owned()))
}

/// As [`load_segmentation`], of a file's bytes.
///
/// # Errors
/// As [`load_segmentation`].
pub fn read_segmentation(limits: LoadLimits, bytes: &[u8]) -> Result<LoadedSegmentation, Defect> {
    load(limits, Bytes::Memory(bytes::Bytes::copy_from_slice(bytes)))
}

fn load(limits: LoadLimits, bytes: Bytes) -> Result<LoadedSegmentation, Defect> {
    flat(parse(limits, bytes)?)
}

/// One map of all frames.
fn flat(parsed: Parsed) -> Result<LoadedSegmentation, Defect> {
    let dims = parsed.dims;
    let voxels = dims.iter().map(|&n| n as u64).product::<u64>();
    let mut painter = Painter { dims, labels: zeros(voxels)?, overlaps: 0 };
    painter.paint(&parsed)?;
    let warnings = painter.warnings();
    let map = LabelMap::new(grid(&parsed.stack, dims)?, &painter.labels, parsed.segments);
    let map = map.map_err(FrameGridError::from)?;
    Ok(LoadedSegmentation { map, warnings })
}

/// The layers of a segmentation, in each of which no segments overlap, and the anomalies of its
/// file.
#[derive(Debug)]
pub struct LoadedLayers {
    /// Maps on the object's own grid; each segment is in one of them, with its number.
    pub layers: Vec<LabelMap>,
    /// How each anomaly was handled, as sentences.
    pub warnings: Vec<String>,
}

/// As [`read_segmentation`], in as many layers as there have to be: segments of BINARY objects may
/// overlap, and nothing of them is lost.
///
/// # Errors
/// As [`load_segmentation`]; the layers count towards the limits together.
pub fn read_segmentation_layers(limits: LoadLimits, bytes: &[u8]) -> Result<LoadedLayers, Defect> {
    let parsed = parse(limits, Bytes::Memory(bytes::Bytes::copy_from_slice(bytes)))?;
    if parsed.bits > 1 {
        // A number for each voxel.
        let LoadedSegmentation { map, warnings } = flat(parsed)?;
        return Ok(LoadedLayers { layers: vec![map], warnings });
    }
    let mut layers = Layers::new(grid(&parsed.stack, parsed.dims)?, limits.voxel_bytes);
    let area = parsed.dims[0] * parsed.dims[1];
    for (at, segment) in parsed.segments.iter().enumerate() {
        if parsed.segments[..at].iter().any(|known| known.label == segment.label) {
            continue; // of two descriptions the first counts
        }
        let own =
            (0..parsed.frames.len()).filter(|&index| parsed.frames[index].segment == Some(segment.label));
        let frames = own
            .map(|index| Ok((parsed.slice_of(index) * area, parsed.packed(index)?)))
            .collect::<Result<Vec<_>, Defect>>()?;
        let voxels = frames.iter().flat_map(|(first, (packed, shift))| {
            let is_set = move |at: &usize| packed[(shift + at) / 8] >> ((shift + at) % 8) & 1 == 1;
            (0..area).filter(is_set).map(move |at| first + at)
        });
        layers.add(segment.clone(), voxels).map_err(FrameGridError::from)?;
    }
    Ok(LoadedLayers { layers: layers.into_maps(), warnings: Vec::new() })
}

/// A segmentation whose voxels are still in its bytes.
struct Parsed {
    object: Object,
    /// The start of the pixels in the object.
    position: u64,
    bits: u32,
    dims: [usize; 3],
    stack: Stack,
    frames: Vec<Frame>,
    segments: Vec<Segment>,
}

fn parse(limits: LoadLimits, bytes: Bytes) -> Result<Parsed, Defect> {
    // Inflated, it has at most the bytes of its voxels, and a header.
    let budget = Budget::new(0, limits.voxel_bytes.saturating_add(64 << 20));
    let object = part10::open(bytes, &budget)?;
    let walked = object.walk(keep)?;
    let data = &walked.data;
    let kind = text(data, tags::SEGMENTATION_TYPE);
    let expected = "BINARY or LABELMAP, of a segmentation object (SEG)";
    check(kind == "BINARY" || kind == "LABELMAP", SEGMENTATION, &kind, expected)?;
    if !object.syntax.is_native() {
        let found = format!("{} ({})", object.syntax.uid, object.syntax.name());
        return Err(Defect::TransferSyntax { found, why: "is compressed; decompress the object first" });
    }
    let rows = required(data, ROWS, "at least 1")?;
    let columns = required(data, COLUMNS, "at least 1")?;
    check((1..=1 << 16).contains(&rows), ROWS, &rows, "1 to 65536")?;
    check((1..=1 << 16).contains(&columns), COLUMNS, &columns, "1 to 65536")?;
    let segments = segments(data, kind == "LABELMAP")?;
    let (stack, frames) = arrange(data, kind == "BINARY", &segments)?;
    let dims = [columns as usize, rows as usize, stack.slices];
    let voxels = dims.iter().map(|&n| n as u64).product::<u64>();
    if voxels.saturating_mul(2) > limits.voxel_bytes {
        let allowed = limits.voxel_bytes / 2;
        return Err(FrameGridError::TooLarge { dims, allowed }.into());
    }
    let bits = required(data, BITS_ALLOCATED, "1, 8 or 16")?;
    let fits = if kind == "BINARY" { bits == 1 } else { bits == 8 || bits == 16 };
    check(fits, BITS_ALLOCATED, &bits, "1 in BINARY segmentations, 8 or 16 in LABELMAP ones")?;
    let pixels = walked.pixels.ok_or_else(|| Defect::NoPixels { expected: "a segmentation".to_owned() })?;
    let bits_of_frame = dims[0] as u64 * dims[1] as u64 * u64::from(bits);
    let expected = (bits_of_frame * frames.len() as u64).div_ceil(8);
    let found = pixels.length.unwrap_or(0);
    if found < expected {
        return Err(Defect::FewPixels { found, expected });
    }
    Ok(Parsed { object, position: pixels.position, bits, dims, stack, frames, segments })
}

impl Parsed {
    /// The bytes of a frame, and the number of bits of the first that belong to the frame before.
    fn packed(&self, index: usize) -> Result<(Vec<u8>, usize), Defect> {
        let bits_of_frame = self.dims[0] as u64 * self.dims[1] as u64 * u64::from(self.bits);
        let begin = index as u64 * bits_of_frame;
        let bytes = begin / 8..(begin + bits_of_frame).div_ceil(8);
        let mut packed = vec![0; (bytes.end - bytes.start) as usize];
        self.object.bytes.read_exact_at(self.position + bytes.start, &mut packed)?;
        Ok((packed, (begin % 8) as usize))
    }

    /// The slice of the grid that a frame is.
    fn slice_of(&self, index: usize) -> usize {
        let normal = self.stack.row.cross(self.stack.column);
        let height = (self.frames[index].position - self.stack.origin).dot(normal) / self.stack.spacing_mm;
        (height.round() as usize).min(self.dims[2] - 1)
    }
}

fn zeros(voxels: u64) -> Result<Vec<u16>, Defect> {
    let short = || FrameGridError::NoMemory { voxels };
    let count = usize::try_from(voxels).map_err(|_| short())?;
    let mut labels = Vec::new();
    labels.try_reserve_exact(count).map_err(|_| short())?;
    labels.resize(count, 0);
    Ok(labels)
}

/// The segments that are described. Number 0 of a LABELMAP object is its background (PS3.3 C.8.20.2),
/// which is no segment here.
fn segments(data: &DataSet, is_label_map: bool) -> Result<Vec<Segment>, Defect> {
    let charset = Charset::of(data);
    let segment = |item: &DataSet| {
        let number = required(item, SEGMENT, "1 to 65535")?;
        let label = u16::try_from(number).unwrap_or(0);
        if is_label_map && number == 0 {
            return Ok(None);
        }
        check(label > 0, SEGMENT, &number, "1 to 65535")?;
        let name = charset.within(item).text(item, tags::SEGMENT_LABEL);
        let lab = <[u16; 3]>::try_from(item.words(tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE)).ok();
        Ok(Some(Segment::new(label, name.as_deref(), lab.map(srgb_of_lab))))
    };
    data.items(tags::SEGMENT_SEQUENCE).iter().map(segment).filter_map(Result::transpose).collect()
}

/// The frames, and the stack that they are slices of.
fn arrange(data: &DataSet, is_binary: bool, segments: &[Segment]) -> Result<(Stack, Vec<Frame>), Defect> {
    let [count] = numbers(data, FRAMES, "a whole number")?;
    let described = data.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).len();
    let is_described = count >= 1.0 && count == described as f64;
    check(is_described, FRAMES, &count, "as many as there are per-frame functional groups")?;
    let count = count as u32;
    let groups = Groups::new(data, count)?;
    let [rx, ry, rz, cx, cy, cz] = orientation(&groups, 0)?;
    let (row, column) = (DVec3::new(rx, ry, rz), DVec3::new(cx, cy, cz));
    let is_right = |a: DVec3| (a.length() - 1.0).abs() < 1e-3;
    let is_right = is_right(row) && is_right(column) && row.dot(column).abs() < 1e-3;
    check(is_right, ORIENTATION, &format!("{row:?}, {column:?}"), "two unit vectors at a right angle")?;
    let mut frames = Vec::with_capacity(count as usize);
    for index in 0..count {
        let turned = orientation(&groups, index)?.into_iter().zip([rx, ry, rz, cx, cy, cz]);
        let is_parallel = turned.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-3;
        check(
            is_parallel,
            ORIENTATION,
            &format!("another one in frame {}", index + 1),
            "one for all frames",
        )?;
        let [x, y, z] = numbers(groups.plane_position(index), POSITION, "three numbers in mm")?;
        let segment = if is_binary { Some(segment_of(&groups, index, segments)?) } else { None };
        frames.push(Frame { position: DVec3::new(x, y, z), segment });
    }
    let [between_rows, between_columns] = numbers(groups.measures(0), SPACING, "two positive numbers in mm")?;
    let is_length = |mm: f64| (1e-4..1e4).contains(&mm);
    let found = format!("{between_rows}, {between_columns}");
    check(
        is_length(between_rows) && is_length(between_columns),
        SPACING,
        &found,
        "two positive numbers in mm",
    )?;
    let stated = [BETWEEN, THICKNESS].map(|attribute| positive(groups.measures(0), attribute));
    let (row, column) = (row.normalize(), column.normalize());
    let normal = row.cross(column);
    let (spacing_mm, slices, first) = spacing(&frames, normal, stated)?;
    let origin = frames[first].position;
    let pixel_mm = [between_columns, between_rows];
    let stack = Stack { row, column, pixel_mm, origin, spacing_mm, slices };
    let sideways = frames.iter().map(|frame| {
        let away = frame.position - origin;
        (away - normal * away.dot(normal)).length()
    });
    if sideways.fold(0.0, f64::max) > 0.1 * between_rows.min(between_columns) {
        return Err(FrameGridError::Tilted.into());
    }
    Ok((stack, frames))
}

fn orientation(groups: &Groups<'_>, frame: u32) -> Result<[f64; 6], Defect> {
    numbers(groups.plane_orientation(frame), ORIENTATION, "six numbers")
}

/// The segment of a frame of a BINARY object.
fn segment_of(groups: &Groups<'_>, frame: u32, segments: &[Segment]) -> Result<u16, Defect> {
    let wanted = tags::REFERENCED_SEGMENT_NUMBER;
    let data = groups.find(frame, tags::SEGMENT_IDENTIFICATION_SEQUENCE, wanted);
    let number = required(data, super::attributes::REFERENCED_SEGMENT, "a segment's number")?;
    let known = segments.iter().map(|segment| segment.label).find(|label| u32::from(*label) == number);
    known.ok_or_else(|| Defect::Attribute {
        attribute: super::attributes::REFERENCED_SEGMENT,
        found: number.to_string(),
        expected: "the number of a segment of SegmentSequence",
    })
}

/// Distance between slices, their number from the first to the last, and the first frame. The
/// distance is the smallest gap between frames, or the declared one where that fits too: slices may
/// be left out.
fn spacing(
    frames: &[Frame],
    normal: DVec3,
    [between, thickness]: [Option<f64>; 2],
) -> Result<(f64, usize, usize), Defect> {
    const SAME_MM: f64 = 1e-3;
    let height = |frame: &Frame| frame.position.dot(normal);
    let by_height = |a: &usize, b: &usize| height(&frames[*a]).total_cmp(&height(&frames[*b]));
    let first = (0..frames.len()).min_by(by_height).unwrap_or(0);
    let mut heights: Vec<f64> = frames.iter().map(height).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup_by(|a, b| (*a - *b).abs() < SAME_MM);
    let span = heights[heights.len() - 1] - heights[0];
    let Some(gap) = heights.windows(2).map(|pair| pair[1] - pair[0]).reduce(f64::min) else {
        let Some(mm) = between.or(thickness) else {
            return Err(FrameGridError::NoThickness.into());
        };
        return Ok((mm, 1, first));
    };
    let fits = |mm: f64| {
        let off = |height: &f64| ((height - heights[0]) / mm - ((height - heights[0]) / mm).round()).abs();
        heights.iter().map(off).fold(0.0, f64::max) < 0.1
    };
    // Over the whole span, so that rounding of one gap does not add up.
    let over_span = |mm: f64| span / (span / mm).round().max(1.0);
    let candidates = between.into_iter().chain([gap]).filter(|mm| *mm <= span * 1.1).map(over_span);
    match candidates.into_iter().find(|mm| fits(*mm)) {
        Some(mm) => Ok((mm, (span / mm).round() as usize + 1, first)),
        None => Err(FrameGridError::Uneven { least_mm: gap }.into()),
    }
}

fn grid(stack: &Stack, dims: [usize; 3]) -> Result<Grid, Defect> {
    let Stack { row, column, pixel_mm: [across, down], origin, spacing_mm, .. } = *stack;
    let normal = row.cross(column);
    let axes = Transform::from_axes(row * across, column * down, normal * spacing_mm, origin);
    Ok(Grid::new(dims, axes).map_err(FrameGridError::from)?)
}

/// Puts frames into the grid.
struct Painter {
    dims: [usize; 3],
    labels: Vec<u16>,
    overlaps: u64,
}

impl Painter {
    fn paint(&mut self, parsed: &Parsed) -> Result<(), Defect> {
        let area = self.dims[0] * self.dims[1];
        let is_big_endian = parsed.object.syntax.encoding == Encoding::ExplicitBig;
        for (index, frame) in parsed.frames.iter().enumerate() {
            let (packed, shift) = parsed.packed(index)?;
            let target = &mut self.labels[parsed.slice_of(index) * area..][..area];
            for (at, label) in target.iter_mut().enumerate() {
                let stored = match parsed.bits {
                    1 => {
                        let bit = shift + at;
                        u16::from(packed[bit / 8] >> (bit % 8) & 1) * frame.segment.unwrap_or(1)
                    }
                    8 => packed[at].into(),
                    _ if is_big_endian => u16::from_be_bytes([packed[2 * at], packed[2 * at + 1]]),
                    _ => u16::from_le_bytes([packed[2 * at], packed[2 * at + 1]]),
                };
                if stored > 0 {
                    self.overlaps += u64::from(*label > 0);
                    *label = stored;
                }
            }
        }
        Ok(())
    }

    fn warnings(&self) -> Vec<String> {
        let overlap = (self.overlaps > 0).then(|| {
            format!("segments overlap in {} voxels: the one of the later frame has them", self.overlaps)
        });
        overlap.into_iter().collect()
    }
}

/// Display-referred sRGB, 0..1, of a CIELab colour as DICOM has it (PS3.3 C.10.7.1.1): 16-bit
/// shares of 0..100 and -128..127, under the white of D50.
fn srgb_of_lab([l, a, b]: [u16; 3]) -> [f64; 3] {
    let share = |value: u16| f64::from(value) / 65535.0;
    let (l, a, b) = (100.0 * share(l), 255.0 * share(a) - 128.0, 255.0 * share(b) - 128.0);
    let y = (l + 16.0) / 116.0;
    let cube =
        |f: f64| if f > 6.0 / 29.0 { f.powi(3) } else { 3.0 * (6.0f64 / 29.0).powi(2) * (f - 4.0 / 29.0) };
    // XYZ of the D50 white, and linear sRGB of XYZ with Bradford's adaptation from D50 to D65.
    let [x, y, z] = [0.964_22 * cube(y + a / 500.0), cube(y), 0.825_21 * cube(y - b / 200.0)];
    let linear = [
        3.133_856_1 * x - 1.616_866_7 * y - 0.490_614_6 * z,
        -0.978_768_4 * x + 1.916_141_5 * y + 0.033_454_0 * z,
        0.071_945_3 * x - 0.228_991_4 * y + 1.405_242_7 * z,
    ];
    linear.map(|value| {
        let value = value.clamp(0.0, 1.0);
        if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
    })
}

/// The other way: CIELab under D50 as DICOM has it.
pub(super) fn lab_of_srgb(rgb: [f64; 3]) -> [u16; 3] {
    let [r, g, b] = rgb.map(|value| {
        let value = value.clamp(0.0, 1.0);
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    });
    // The inverse of the matrix above, over the white.
    let x = (0.436_074_7 * r + 0.385_064_9 * g + 0.143_080_4 * b) / 0.964_22;
    let y = 0.222_504_5 * r + 0.716_878_6 * g + 0.060_616_9 * b;
    let z = (0.013_932_2 * r + 0.097_104_5 * g + 0.714_173_3 * b) / 0.825_21;
    let [x, y, z] = [x, y, z].map(|t| {
        if t > (6.0f64 / 29.0).powi(3) { t.cbrt() } else { t / (3.0 * (6.0f64 / 29.0).powi(2)) + 4.0 / 29.0 }
    });
    let shares =
        [(116.0 * y - 16.0) / 100.0, (500.0 * (x - y) + 128.0) / 255.0, (200.0 * (y - z) + 128.0) / 255.0];
    shares.map(|share| (share.clamp(0.0, 1.0) * 65535.0).round() as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cielab_under_d50_becomes_the_srgb_that_it_was_made_of() {
        // Worked out apart from this code, by matrices the other way: white, black, (221, 130,
        // 101).
        for (lab, rgb) in [
            ([65535, 32896, 32896], [255.0; 3]),
            ([0, 32896, 32896], [0.0; 3]),
            ([41984, 41604, 40995], [221.0, 130.0, 101.0]),
        ] {
            let found = srgb_of_lab(lab).map(|channel| 255.0 * channel);
            let off = found.iter().zip(rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 0.5, "{lab:?}: {found:?} for {rgb:?}");
        }
    }

    #[test]
    fn every_colour_of_eight_bits_comes_back() {
        for rgb in
            [[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255], [221, 130, 101], [3, 9, 200]]
        {
            let rgb = rgb.map(|channel| f64::from(channel) / 255.0);
            let found = srgb_of_lab(lab_of_srgb(rgb));
            let off = found.iter().zip(rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 0.5 / 255.0, "{found:?} for {rgb:?}");
        }
    }
}
