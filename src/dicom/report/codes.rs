//! The codes that reports are made of. Meanings are word for word those that readers compare.

use crate::object::Code;

pub(super) const REPORT: Code = Code::dcm("126000", "Imaging Measurement Report");
pub(super) const LANGUAGE: Code = Code::dcm("121049", "Language of Content Item and Descendants");
pub(super) const ENGLISH: Code = Code::new("en-US", "RFC5646", "English (United States)");
pub(super) const OBSERVER_TYPE: Code = Code::dcm("121005", "Observer Type");
pub(super) const PERSON: Code = Code::dcm("121006", "Person");
pub(super) const DEVICE: Code = Code::dcm("121007", "Device");
pub(super) const PERSON_NAME: Code = Code::dcm("121008", "Person Observer Name");
pub(super) const DEVICE_UID: Code = Code::dcm("121012", "Device Observer UID");
pub(super) const DEVICE_NAME: Code = Code::dcm("121013", "Device Observer Name");
pub(super) const PROCEDURE_REPORTED: Code = Code::dcm("121058", "Procedure reported");
pub(super) const CT_OF_ANYTHING: Code = Code::new("25045-6", "LN", "CT unspecified body region");
pub(super) const IMAGE_LIBRARY: Code = Code::dcm("111028", "Image Library");
pub(super) const IMAGE_LIBRARY_GROUP: Code = Code::dcm("126200", "Image Library Group");
pub(super) const MODALITY: Code = Code::dcm("121139", "Modality");
pub(super) const CT: Code = Code::dcm("CT", "Computed Tomography");
pub(super) const FRAME_OF_REFERENCE: Code = Code::dcm("112227", "Frame of Reference UID");
pub(super) const MEASUREMENTS: Code = Code::dcm("126010", "Imaging Measurements");
pub(super) const GROUP: Code = Code::dcm("125007", "Measurement Group");
pub(super) const TRACKING_IDENTIFIER: Code = Code::dcm("112039", "Tracking Identifier");
pub(super) const TRACKING_UID: Code = Code::dcm("112040", "Tracking Unique Identifier");
pub(super) const FINDING: Code = Code::dcm("121071", "Finding");
pub(super) const FINDING_SITE: Code = Code::new("363698007", "SCT", "Finding Site");
pub(super) const COMMENT: Code = Code::dcm("121106", "Comment");
pub(super) const IMAGE_REGION: Code = Code::dcm("111030", "Image Region");
pub(super) const PATH: Code = Code::dcm("121055", "Path");
pub(super) const LENGTH: Code = Code::new("410668003", "SCT", "Length");
pub(super) const PERIMETER: Code = Code::new("131191004", "SCT", "Perimeter");
pub(super) const AREA: Code = Code::new("42798000", "SCT", "Area");
pub(super) const ANGLE: Code = Code::new("1483009", "SCT", "Angle");
/// Other codes of angles: those of DICOM, and of SNOMED before 2017.
pub(super) const OTHER_ANGLES: [(&str, &str); 4] =
    [("110859", "DCM"), ("285285000", "SCT"), ("F-02070", "SRT"), ("1483009", "SCT")];

/// Cornerstone's own concepts: the points that a spline goes through, and which spline it is.
pub(super) const CONTROL_POINTS: Code = Code::new("ControlPoints", CORNERSTONE, "Control Points");
pub(super) const SPLINE_TYPE: Code = Code::new("SplineType", CORNERSTONE, "Spline Type");
pub(super) const CATMULL_ROM: &str = "CATMULLROM";
pub(super) const CORNERSTONE: &str = "99CS3D";

/// How tracking identifiers begin that name a tool of Cornerstone, not a thing.
pub(super) const CORNERSTONE_TOOLS: [&str; 2] = ["Cornerstone3DTools@", "cornerstoneTools@"];
pub(super) const CORNERSTONE_LENGTH: &str = "Cornerstone3DTools@^0.1.0:Length";
pub(super) const CORNERSTONE_ANGLE: &str = "Cornerstone3DTools@^0.1.0:Angle";
pub(super) const CORNERSTONE_FREEHAND: &str = "Cornerstone3DTools@^0.1.0:PlanarFreehandROI";
pub(super) const CORNERSTONE_SPLINE: &str = "Cornerstone3DTools@^0.1.0:PlanarFreehandROI:SplineROI";

/// The scheme of codes that only represent a name.
pub(super) const NAMES: &str = "99RELIEF";
/// Schemes whose codes stand for a name, or for free text.
pub(super) const NAMES_ONLY: [&str; 2] = [NAMES, "CORNERSTONEJS"];

pub(super) const MILLIMETRE: Code = Code::new("mm", "UCUM", "millimeter");
pub(super) const SQUARE_MILLIMETRE: Code = Code::new("mm2", "UCUM", "square millimeter");
pub(super) const DEGREE: Code = Code::new("deg", "UCUM", "degree");

/// This program as an observer; derived once from a random UUID.
pub(super) const OWN_UID: &str = "2.25.125342396745869861420020890032567052335";
