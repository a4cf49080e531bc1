//! RT structure sets (PS3.3 A.19): the contours that planning systems draw, structure by structure.
//!
//! Names, colours and contours as points in patient mm, not voxels. A user may fill the closed
//! contours of a structure to a region; the file does not define the structure between planes.
//!
//! Space: patient LPS mm of the frame of reference that a structure names.

use std::collections::HashMap;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::attributes::quoted;
use super::charset::Charset;
use super::dataset::{Bounds, DataSet, Retention};
use super::whole::{self, ObjectError};
use relief_annotation::{FrameOfReference, Geometry, Item, Method, Placement};
use relief_base::{Patient, Point};

/// The largest file that is read: contours of a hundred structures have a tenth of it.
const MOST_BYTES: usize = 1 << 29;
/// Contours nest three deep; a long one has a hundred thousand numbers of up to 16 characters.
const BOUNDS: Bounds = Bounds { deepest: 8, longest_value: 1 << 24, kept_bytes: 512 << 20 };
/// The largest distance between contours of one level, mm.
const SAME_LEVEL_MM: f64 = 1e-3;

/// The content of a file.
#[derive(Debug)]
pub struct StructureSet {
    /// In the file's order, those without contours too.
    pub structures: Vec<Structure>,
    /// Content that the items do not represent, as sentences.
    pub warnings: Vec<String>,
}

/// A structure, or region of interest (ROI).
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    /// ROI Number (3006,0022).
    pub number: u32,
    /// ROI Name (3006,0026).
    pub name: String,
    /// ROI Display Color (3006,002A), display-referred sRGB, 0..1.
    pub rgb: Option<[f64; 3]>,
    /// RT ROI Interpreted Type (3006,00A4), such as `ORGAN` or `GTV`.
    pub kind: Option<String>,
    /// The coordinate system of its points.
    pub frame_of_reference: Option<FrameOfReference>,
    /// Its contours, in the file's order.
    pub contours: Vec<Contour>,
}

/// A contour.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Whether its last point is joined to its first.
    pub shape: ContourShape,
    /// At least one; a closed contour does not repeat its first.
    pub points_mm: Vec<Point<Patient>>,
}

/// Contour Geometric Type (3006,0042).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContourShape {
    /// A single point.
    Point,
    /// A line, within a plane or not.
    Open,
    /// A closed line within a plane.
    Closed,
    /// The same where several of one plane are joined by exclusive or.
    ClosedXor,
}

impl Contour {
    /// Whether it is closed.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        matches!(self.shape, ContourShape::Closed | ContourShape::ClosedXor)
    }
}

impl Structure {
    /// The levels that its closed contours lie on: distances from the patient's origin along the
    /// normal of the first, mm, rising. None where there is no closed contour that spans a plane.
    #[must_use]
    pub fn levels_mm(&self) -> Vec<f64> {
        let closed = || self.contours.iter().filter(|contour| contour.is_closed());
        let Some(normal) = closed().find_map(|contour| normal(&contour.points_mm)) else { return Vec::new() };
        let mut levels: Vec<f64> = closed().map(|contour| contour.points_mm[0].xyz.dot(normal)).collect();
        levels.sort_by(f64::total_cmp);
        levels.dedup_by(|a, b| (*a - *b).abs() < SAME_LEVEL_MM);
        levels
    }
}

impl StructureSet {
    /// The contours as items, with a list for each structure of the same name; and the omissions,
    /// as sentences.
    ///
    /// # Errors
    /// When this machine gives no random numbers.
    pub fn items(&self, author: &str) -> Result<(Vec<Item>, Vec<String>), getrandom::Error> {
        let (mut items, mut warnings) = (Vec::new(), Vec::new());
        for structure in &self.structures {
            let several = structure.contours.len() > 1;
            let mut left_out = 0;
            for (order, contour) in (0..).zip(&structure.contours) {
                let Some(geometry) = geometry(contour) else {
                    left_out += 1;
                    continue;
                };
                let number = if several { format!(" {}", order + 1) } else { String::new() };
                let name: String = structure.name.chars().take(Item::LONGEST_NAME - number.len()).collect();
                let mut item = Item::new(&(name + &number), author, Some(geometry))?;
                (item.list, item.order, item.rgb) = (structure.name.clone(), order, structure.rgb);
                item.frame_of_reference.clone_from(&structure.frame_of_reference);
                item.placement =
                    Some(Placement { method: Method::Import, device: None, camera: None, snapped_mm: None });
                items.push(item);
            }
            if left_out > 0 {
                let name = &structure.name;
                warnings.push(format!(
                    "{name}: {left_out} contour(s) of too few points, or of more than {}, are left out",
                    Item::MOST_POINTS
                ));
            }
        }
        Ok((items, warnings))
    }
}

fn geometry(contour: &Contour) -> Option<Geometry> {
    let (points_mm, closed) = (contour.points_mm.clone(), contour.is_closed());
    match points_mm[..] {
        [at_mm] => Some(Geometry::Point { at_mm }),
        [_, _] if closed => None,
        [a, b] => Some(Geometry::Line { ends_mm: [a, b] }),
        _ if points_mm.len() > Item::MOST_POINTS => None,
        _ => Some(Geometry::Curve { points_mm, closed, smooth: false }),
    }
}

/// The direction across a closed line (Newell's); `None` of a line without area.
fn normal(points: &[Point<Patient>]) -> Option<DVec3> {
    let around = points.iter().zip(points.iter().cycle().skip(1));
    let origin = points.first()?.xyz;
    around.map(|(a, b)| (a.xyz - origin).cross(b.xyz - origin)).sum::<DVec3>().try_normalize()
}

/// Reads a structure set.
///
/// # Errors
/// When it is not a structure set, is damaged or too large, or a contour's numbers are not
/// points.
pub fn read_structure_set(bytes: &[u8]) -> Result<StructureSet, ObjectError> {
    let data = whole::read(bytes, MOST_BYTES, BOUNDS, keep)?;
    let modality = data.text(tags::MODALITY).unwrap_or_default();
    if modality != "RTSTRUCT" {
        let found = quoted(&modality);
        return Err(whole::wrong("", "Modality", tags::MODALITY, found, "RTSTRUCT, an RT structure set"));
    }
    let charset = Charset::of(&data);
    let mut structures = Vec::new();
    let mut places = HashMap::new();
    for (index, item) in data.items(tags::STRUCTURE_SET_ROI_SEQUENCE).iter().enumerate() {
        let path = format!("{}[{}]", tags::STRUCTURE_SET_ROI_SEQUENCE, index + 1);
        let number = number(item, &path, "ROINumber", tags::ROI_NUMBER)?;
        places.entry(number).or_insert(structures.len());
        let frame = item.text(tags::REFERENCED_FRAME_OF_REFERENCE_UID);
        structures.push(Structure {
            number,
            name: name(charset, item, number),
            rgb: None,
            kind: None,
            frame_of_reference: frame.filter(|uid| (1..=64).contains(&uid.len())).map(FrameOfReference),
            contours: Vec::new(),
        });
    }
    let mut orphans = 0;
    for (index, item) in data.items(tags::ROI_CONTOUR_SEQUENCE).iter().enumerate() {
        let path = format!("{}[{}]", tags::ROI_CONTOUR_SEQUENCE, index + 1);
        let number = number(item, &path, "ReferencedROINumber", tags::REFERENCED_ROI_NUMBER)?;
        let Some(structure) = places.get(&number).map(|&place| &mut structures[place]) else {
            orphans += 1;
            continue;
        };
        structure.rgb = rgb(item);
        for (index, contour) in item.items(tags::CONTOUR_SEQUENCE).iter().enumerate() {
            let path = format!("{path}/{}[{}]", tags::CONTOUR_SEQUENCE, index + 1);
            structure.contours.extend(self::contour(contour, &path)?);
        }
    }
    for item in data.items(tags::RTROI_OBSERVATIONS_SEQUENCE) {
        let number = item.text(tags::REFERENCED_ROI_NUMBER).and_then(|text| text.parse::<u32>().ok());
        if let Some(&place) = number.and_then(|number| places.get(&number)) {
            let kind = item.text(tags::RTROI_INTERPRETED_TYPE).filter(|kind| !kind.is_empty());
            structures[place].kind = kind;
        }
    }
    Ok(StructureSet { warnings: warnings(&structures, orphans), structures })
}

fn keep(tag: Tag) -> Retention {
    match tag {
        tags::STRUCTURE_SET_ROI_SEQUENCE
        | tags::ROI_CONTOUR_SEQUENCE
        | tags::CONTOUR_SEQUENCE
        | tags::RTROI_OBSERVATIONS_SEQUENCE => Retention::Items,
        tags::SPECIFIC_CHARACTER_SET
        | tags::MODALITY
        | tags::ROI_NUMBER
        | tags::ROI_NAME
        | tags::REFERENCED_FRAME_OF_REFERENCE_UID
        | tags::REFERENCED_ROI_NUMBER
        | tags::ROI_DISPLAY_COLOR
        | tags::CONTOUR_GEOMETRIC_TYPE
        | tags::CONTOUR_DATA
        | tags::RTROI_INTERPRETED_TYPE => Retention::Value,
        _ => Retention::Nothing,
    }
}

fn warnings(structures: &[Structure], orphans: usize) -> Vec<String> {
    let empty = structures.iter().filter(|structure| structure.contours.is_empty()).count();
    let empty = (empty > 0).then(|| format!("{empty} structure(s) have no contours"));
    let orphans =
        (orphans > 0).then(|| format!("{orphans} set(s) of contours are of no structure: left out"));
    empty.into_iter().chain(orphans).collect()
}

fn number(item: &DataSet, path: &str, keyword: &'static str, tag: Tag) -> Result<u32, ObjectError> {
    let found = item.text(tag).unwrap_or_default();
    found.parse().map_err(|_| whole::wrong(path, keyword, tag, quoted(&found), "a whole number"))
}

/// One line, as long as an item's name may be.
fn name(charset: Charset, item: &DataSet, number: u32) -> String {
    let text = charset.within(item).text(item, tags::ROI_NAME).unwrap_or_default();
    let clean = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter });
    let clean: String = clean.take(Item::LONGEST_NAME).collect();
    if clean.trim().is_empty() { format!("ROI {number}") } else { clean.trim().to_owned() }
}

/// The colour, where it is three numbers from 0 to 255.
fn rgb(item: &DataSet) -> Option<[f64; 3]> {
    let text = item.text(tags::ROI_DISPLAY_COLOR)?;
    let channels: Vec<f64> = text
        .split('\\')
        .filter_map(|part| part.trim().parse::<u8>().ok())
        .map(|n| f64::from(n) / 255.0)
        .collect();
    channels.try_into().ok()
}

/// A contour; `None` of one without points.
fn contour(item: &DataSet, path: &str) -> Result<Option<Contour>, ObjectError> {
    let kind = item.text(tags::CONTOUR_GEOMETRIC_TYPE).unwrap_or_default();
    let shape = match kind.as_str() {
        "POINT" => ContourShape::Point,
        "OPEN_PLANAR" | "OPEN_NONPLANAR" => ContourShape::Open,
        "CLOSED_PLANAR" => ContourShape::Closed,
        "CLOSEDPLANAR_XOR" => ContourShape::ClosedXor,
        _ => {
            let expected = "POINT, OPEN_PLANAR, OPEN_NONPLANAR, CLOSED_PLANAR or CLOSEDPLANAR_XOR";
            let (keyword, tag) = ("ContourGeometricType", tags::CONTOUR_GEOMETRIC_TYPE);
            return Err(whole::wrong(path, keyword, tag, quoted(&kind), expected));
        }
    };
    let mut points_mm = points(item, path)?;
    if points_mm.len() > 3
        && matches!(shape, ContourShape::Closed | ContourShape::ClosedXor)
        && points_mm.first() == points_mm.last()
    {
        points_mm.pop();
    }
    Ok((!points_mm.is_empty()).then_some(Contour { shape, points_mm }))
}

fn points(item: &DataSet, path: &str) -> Result<Vec<Point<Patient>>, ObjectError> {
    let (keyword, tag) = ("ContourData", tags::CONTOUR_DATA);
    let expected = "triplets of mm, -1e6 to 1e6 each, divided by \\";
    let text = item.text(tags::CONTOUR_DATA).unwrap_or_default();
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let mut numbers = Vec::new();
    for part in text.split('\\') {
        match part.trim().parse::<f64>() {
            Ok(mm) if mm.abs() <= Item::FARTHEST_MM => numbers.push(mm),
            _ => return Err(whole::wrong(path, keyword, tag, quoted(part), expected)),
        }
    }
    match numbers.as_chunks::<3>() {
        (triplets, []) => Ok(triplets.iter().map(|&xyz| Point::from_xyz(DVec3::from_array(xyz))).collect()),
        _ => Err(whole::wrong(path, keyword, tag, format!("{} numbers", numbers.len()), expected)),
    }
}
