//! Reports of Relief as others read them: highdicom as 3D Slicer calls it, DCMTK and dicom3tools,
//! OHIF.

use serde_json::Value;

use super::made;
use super::reports::written;
use super::tools::{dciodvfy, dsrdump, file_of, ohif, python};

/// The calls that 3D Slicer's plugin for TID 1500 makes, and the other groups.
const HIGHDICOM: &str = r"
import json, sys, highdicom as hd
from pydicom.sr.codedict import codes
report = hd.sr.srread(sys.argv[1])
content = report.content
found = {'series': report.SeriesDescription, 'patient': str(report.PatientName), 'study': report.StudyInstanceUID}
found['points'] = []
for group in content.get_planar_roi_measurement_groups(
        graphic_type=hd.sr.GraphicTypeValues3D.POINT, reference_type=codes.DCM.ImageRegion):
    roi = group.roi
    found['points'].append({'name': group.tracking_identifier, 'uid': group.tracking_uid, 'code': group.finding_type.value,
        'scheme': group.finding_type.scheme_designator, 'meaning': group.finding_type.meaning,
        'at': roi.value.tolist(), 'frame': roi.frame_of_reference_uid})
found['polygons'] = [{'finding': g.finding_type.meaning, 'points': g.roi.value.tolist(),
                      'numbers': [[m.name.meaning, m.value, m.unit.value] for m in g.get_measurements()]}
    for g in content.get_planar_roi_measurement_groups(graphic_type=hd.sr.GraphicTypeValues3D.POLYGON)]
found['lines'] = [{'finding': g.finding_type.meaning,
                   'numbers': [[m.name.meaning, m.value, m.unit.value] for m in g.get_measurements()]}
    for g in content.get_image_measurement_groups()]
print(json.dumps(found))
";

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
#[test]
fn highdicom_reads_points_and_measures() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let (_folder, file) = file_of("report.dcm", &written(&items, &made).bytes);
    let Some(found) = python("reports read by highdicom", HIGHDICOM, &[&file]) else { return };
    let found: Value = serde_json::from_str(&found).unwrap();
    assert_eq!(
        (found["series"].as_str(), found["patient"].as_str()),
        (Some("Landmarks"), Some("PHANTOM^MÜNZE"))
    );
    let points = found["points"].as_array().unwrap();
    assert_eq!(points.len(), 2);
    for (point, item) in points.iter().zip(&items) {
        assert_eq!(
            (&point["name"], &point["meaning"]),
            (&item.name.as_str().into(), &item.name.as_str().into())
        );
        assert_eq!(point["uid"], format!("2.25.{}", item.id.number()));
        assert_eq!(point["frame"], made.frame_of_reference.as_str());
        let at = super::common::numbers(&point["at"][0]);
        let expected = item.point().unwrap().xyz.to_array();
        let apart = at.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-5, "{}: {at:?} for {expected:?}", item.name);
    }
    assert_eq!((&points[0]["code"], &points[0]["scheme"]), (&"T-11149".into(), &"99LAB".into()));
    let polygons = found["polygons"].as_array().unwrap();
    let names: Vec<&str> = polygons.iter().map(|polygon| polygon["finding"].as_str().unwrap()).collect();
    assert_eq!(names, ["flat ring", "smooth ring"]);
    let area = polygons[0]["numbers"][0][1].as_f64().unwrap();
    // The shoelace formula by hand: (-141.4375 - 164.9375 + 113.875 + 309.5) / 2.
    assert!((area - 58.5).abs() < 1e-6, "{area}");
    let lines = found["lines"].as_array().unwrap();
    assert_eq!(lines[0]["numbers"], serde_json::json!([["Length", 13.0, "mm"]]));
    assert_eq!(lines[1]["numbers"], serde_json::json!([["Angle", 90.0, "deg"]]));
    assert_eq!(lines.len(), 5, "line, angle, bent ring, path, smooth path");
    println!("highdicom: {} points, {} polygons, {} lines", points.len(), polygons.len(), lines.len());
}

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
#[test]
fn dsrdump_and_dciodvfy_find_no_fault() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let bytes = written(&items, &made).bytes;
    let (_folder, file) = file_of("report.dcm", &bytes);
    if let Some(dumped) = dsrdump("reports checked by dsrdump", &file) {
        let dumped = dumped.unwrap();
        assert!(dumped.contains("Comprehensive 3D SR Document") && dumped.contains("\"nasion\""), "{dumped}");
        // The check is one: without a frame of reference it is refused, which dciodvfy lets pass.
        let uid = [0x06, 0x30, 0x24, 0x00, b'U', b'I'];
        let at = bytes.windows(6).position(|window| window == uid).unwrap();
        let mut broken = bytes.clone();
        broken[at + 2] = 0x25; // another attribute
        let (_folder, file) = file_of("broken.dcm", &broken);
        assert!(dsrdump("reports checked by dsrdump", &file).unwrap().is_err());
    }
    if let Some((errors, warnings)) = dciodvfy("reports checked by dciodvfy", &file) {
        assert_eq!(errors, Vec::<String>::new());
        // Names stand for themselves in a scheme of Relief's own, and the phantom's study has no
        // date.
        let is_known = |line: &&String| !line.contains("99") && !line.contains("needed to build DICOMDIR");
        let unknown: Vec<&String> = warnings.iter().filter(is_known).collect();
        assert!(unknown.is_empty(), "{unknown:#?}");
    }
}

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
#[test]
fn ohif_shows_every_item_at_its_place() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let (_folder, file) = file_of("report.dcm", &written(&items, &made).bytes);
    let Some(found) = ohif("reports read by OHIF", &file) else { return };
    assert_eq!(found["images"], 7);
    let measurements = found["measurements"].as_array().unwrap();
    assert_eq!(measurements.len(), items.len(), "{found:#}");
    for (item, tool) in items.iter().zip([
        "Probe",
        "Probe",
        "Length",
        "Angle",
        "PlanarFreehandROI",
        "PlanarFreehandROI",
        "PlanarFreehandROI",
        "SplineROI",
        "SplineROI",
    ]) {
        let uid = format!("2.25.{}", item.id.number());
        let one =
            measurements.iter().find(|one| one["uid"] == uid).unwrap_or_else(|| panic!("{}", item.name));
        assert_eq!((&one["description"], &one["tool"]), (&item.name.as_str().into(), &tool.into()));
        assert_eq!(one["frame"], made.frame_of_reference.as_str());
        let points = item.geometry.as_ref().unwrap().points();
        let shown = if tool == "PlanarFreehandROI" { &one["contour"]["polyline"] } else { &one["points"] };
        let shown = shown.as_array().unwrap();
        assert_eq!(shown.len(), points.len(), "{}: {one:#}", item.name);
        for (shown, point) in shown.iter().zip(points) {
            let shown = super::common::numbers(shown);
            let apart =
                shown.iter().zip(point.xyz.to_array()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-5, "{}: {shown:?} for {point:?}", item.name);
        }
    }
    println!("OHIF: {} measurements", measurements.len());
}
