//! Reports that others wrote: highdicom's, also of coordinates in pixels, and dcmqi's.

use relief_annotation::Geometry;
use relief_dicom::{ReportReadOptions, SeriesReference, Strictness};
use serde_json::Value;

use super::common::{numbers, unpacked};
use super::made;
use super::tools::python;

/// A report of points, a polygon, an ellipse and a measured line, as highdicom makes them.
const HIGHDICOM: &str = r"
import glob, sys, numpy as np, highdicom as hd, pydicom
from highdicom.sr import *
from pydicom.sr.codedict import codes
folder, out = sys.argv[1:]
images = [pydicom.dcmread(path) for path in sorted(glob.glob(folder + '/*.dcm'))]
frame = images[0].FrameOfReferenceUID
person = ObserverContext(observer_type=codes.DCM.Person,
    observer_identifying_attributes=PersonObserverIdentifyingAttributes(name='Doe^Jane'))
def region(number, name, kind, points):
    return PlanarROIMeasurementsAndQualitativeEvaluations(
        tracking_identifier=TrackingIdentifier(uid=f'2.25.{number}', identifier=name),
        referenced_region=ImageRegion3D(graphic_type=kind, graphic_data=np.array(points), frame_of_reference_uid=frame),
        finding_type=codes.SCT.Nodule)
kinds = GraphicTypeValues3D
groups = [
    region(1001, 'apex', kinds.POINT, [[-31.5, 20.25, -203.0]]),
    region(1002, 'rim', kinds.POLYGON, [[0, 0, 5], [4, 0, 5], [4, 3, 5], [0, 0, 5]]),
    region(1003, 'oval', kinds.ELLIPSE, [[-6, 0, 1], [6, 0, 1], [0, -2, 1], [0, 2, 1]]),
]
report = MeasurementReport(observation_context=ObservationContext(observer_person_context=person),
    procedure_reported=codes.LN.CTUnspecifiedBodyRegion, imaging_measurements=groups)
sr = Comprehensive3DSR(evidence=images, content=report, series_instance_uid=hd.UID(), series_number=1,
    sop_instance_uid=hd.UID(), instance_number=1, manufacturer='none')
sr.save_as(out)
";

#[test]
fn reports_of_highdicom_are_read() {
    let made = made::series();
    let file = made.folder.path().join("report.dcm");
    let arguments = [&*made.folder.path().join("ct"), &*file];
    if python("reports written by highdicom", HIGHDICOM, &arguments).is_none() {
        return;
    }
    let options = ReportReadOptions { author: "importer", series: None };
    let found = relief_dicom::read_report(&std::fs::read(&file).unwrap(), &options).unwrap();
    let [apex, rim, oval] = &found.items[..] else { panic!("{:?}", found.items) };
    assert_eq!(apex.point().unwrap().xyz.to_array(), [-31.5, 20.25, -203.0]);
    assert_eq!((apex.name.as_str(), apex.author.as_str(), apex.id.number()), ("apex", "Doe^Jane", 1001));
    let concept = apex.concept.as_ref().unwrap();
    assert_eq!((concept.scheme.as_str(), concept.meaning.as_str()), ("SCT", "Nodule"));
    assert_eq!(apex.frame_of_reference.as_ref().unwrap().0, made.frame_of_reference);
    let Some(Geometry::Curve { points_mm, closed: true, smooth: false }) = &rim.geometry else {
        panic!("{rim:?}")
    };
    let corners: Vec<[f64; 3]> = points_mm.iter().map(|point| point.xyz.to_array()).collect();
    assert_eq!(corners, [[0.0, 0.0, 5.0], [4.0, 0.0, 5.0], [4.0, 3.0, 5.0]]);
    let Some(Geometry::Curve { points_mm, closed: true, .. }) = &oval.geometry else { panic!("{oval:?}") };
    assert_eq!(points_mm.len(), 32);
    let on = points_mm.iter().map(|p| (p.xyz.x / 6.0).powi(2) + (p.xyz.y / 2.0).powi(2) - 1.0);
    assert!(on.map(f64::abs).fold(0.0, f64::max) < 1e-9, "{points_mm:?}");
    assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
}

/// Where highdicom has the middle and the rim of the circle in its own sample, in patient mm.
const CIRCLE: &str = r"
import json, sys, numpy as np, highdicom as hd, pydicom
report, image = hd.sr.srread(sys.argv[1]), pydicom.dcmread(sys.argv[2])
group = report.content.get_planar_roi_measurement_groups()[0]
assert group.roi.source_image_for_region if hasattr(group.roi, 'source_image_for_region') else True
to_patient = hd.spatial.ImageToReferenceTransformer(image_position=image.ImagePositionPatient,
    image_orientation=image.ImageOrientationPatient, pixel_spacing=image.PixelSpacing)
print(json.dumps(to_patient(np.array(group.roi.value, dtype=float)).tolist()))
";

#[test]
fn a_circle_in_pixels_has_its_place_once_the_series_is_given() {
    let Some(interop) = unpacked("a report of highdicom", "interop", &["dicom/highdicom"]) else { return };
    let folder = interop.join("dicom/highdicom");
    let file = folder.join("sr_document.dcm");
    let bytes = std::fs::read(&file).unwrap();
    let without =
        relief_dicom::read_report(&bytes, &ReportReadOptions { author: "x", series: None }).unwrap();
    assert!(without.items.is_empty());
    assert!(
        without.warnings.iter().any(|warning| warning.contains("give the series")),
        "{:?}",
        without.warnings
    );
    let image = folder.join("ct_image.dcm");
    let found = relief_dicom::discover(&image, Strictness::Lenient, &|_| ()).unwrap();
    let series = SeriesReference::of(found.select(None).unwrap()).unwrap();
    let with =
        relief_dicom::read_report(&bytes, &ReportReadOptions { author: "x", series: Some(&series) }).unwrap();
    let item = with.items.first().unwrap_or_else(|| panic!("{:?}", with.warnings));
    assert_eq!(item.name, "Planar ROI Measurements");
    assert_eq!(item.concept.as_ref().unwrap().code, "T-A7010");
    let Some(Geometry::Curve { points_mm, closed: true, .. }) = &item.geometry else { panic!("{item:?}") };
    let Some(found) = python("a circle placed by highdicom", CIRCLE, &[&file, &image]) else { return };
    let found: Value = serde_json::from_str(&found).unwrap();
    let [middle, rim] = [0, 1].map(|n| glam::DVec3::from_slice(&numbers(&found[n])));
    let radius = middle.distance(rim);
    let off = points_mm.iter().map(|point| (point.xyz.distance(middle) - radius).abs()).fold(0.0, f64::max);
    assert!(off < 1e-4, "{off} mm off a circle of {radius} mm");
}

#[test]
fn a_report_without_coordinates_is_refused_with_the_reason() {
    let Some(interop) = unpacked("a report of dcmqi", "interop", &["dicom/dcmqi"]) else { return };
    let bytes = std::fs::read(interop.join("dicom/dcmqi/sr_tid1500.dcm")).unwrap();
    let found = relief_dicom::read_report(&bytes, &ReportReadOptions { author: "x", series: None }).unwrap();
    assert!(found.items.is_empty());
    assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
    assert!(found.warnings[0].contains("without coordinates"), "{:?}", found.warnings);
    let image = std::fs::read(interop.join("dicom/highdicom/ct_image.dcm")).unwrap();
    let refused = relief_dicom::read_report(&image, &ReportReadOptions { author: "x", series: None })
        .unwrap_err()
        .to_string();
    assert!(refused.starts_with("ValueType (0040,A040): found \"\", expected CONTAINER"), "{refused}");
}
