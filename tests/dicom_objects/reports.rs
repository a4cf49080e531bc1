//! Reports that Relief writes, read by Relief: their content, the reported losses, and the absence
//! of names of patients.

use relief_annotation::{FrameOfReference, Geometry, Item, State};
use relief_dicom::{ReportError, ReportReadOptions, ReportWriteOptions, WrittenReport};

use super::made::{self, at, item};

pub(crate) fn options() -> ReportWriteOptions {
    ReportWriteOptions {
        description: "Landmarks".to_owned(),
        made: "2026-02-01T08:09:10.111Z".parse().unwrap(),
    }
}

pub(crate) fn written(items: &[Item], made: &made::Made) -> WrittenReport {
    relief_dicom::write_report(items, &made.reference, &options()).unwrap()
}

pub(crate) fn read(bytes: &[u8]) -> relief_dicom::ReadReport {
    relief_dicom::read_report(bytes, &ReportReadOptions { author: "importer", series: None }).unwrap()
}

/// The largest distance between points of two geometries of one kind, mm.
pub(crate) fn off(a: &Geometry, b: &Geometry) -> f64 {
    assert_eq!((a.kind(), a.points().len()), (b.kind(), b.points().len()));
    a.points().iter().zip(b.points()).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

#[test]
fn written_reports_are_read_again() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let written = written(&items, &made);
    assert!(written.left_out.is_empty() && written.notes.is_empty(), "{:?}", written.notes);
    let found = read(&written.bytes);
    assert_eq!(found.warnings, Vec::<String>::new());
    assert_eq!(found.items.len(), items.len());
    for (found, item) in found.items.iter().zip(&items) {
        let apart = off(found.geometry.as_ref().unwrap(), item.geometry.as_ref().unwrap());
        assert!(apart < 1e-9, "{}: {apart} mm", item.name);
        // All but how it came here is as it was.
        let mut found = found.clone();
        found.placement.clone_from(&item.placement);
        found.geometry.clone_from(&item.geometry);
        assert_eq!(&found, item);
    }
    for (found, item) in found.items.iter().zip(&items) {
        if let (
            Some(Geometry::Curve { closed: a, smooth: b, .. }),
            Some(Geometry::Curve { closed, smooth, .. }),
        ) = (&found.geometry, &item.geometry)
        {
            assert_eq!((a, b), (closed, smooth), "{}", item.name);
        }
    }
}

#[test]
fn thirty_two_bits_of_a_coordinate_are_kept() {
    let made = made::series();
    let x = -204.123_456_789_012;
    let items = [item(1, "exact", Geometry::Point { at_mm: at(x, 1.0 / 3.0, 999_999.9) })];
    let found = read(&written(&items, &made).bytes).items[0].point().unwrap();
    assert!((found.xyz.x - x).abs() < 1e-5 && (found.xyz.y - 1.0 / 3.0).abs() < 1e-7, "{found:?}");
    assert!(
        (found.xyz.z - 999_999.9).abs() < 0.05,
        "the farthest coordinates are kept to 0.03 mm: {found:?}"
    );
}

#[test]
fn the_same_is_written_as_the_same_and_anything_else_as_another_object() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let first = written(&items, &made).bytes;
    assert_eq!(first, written(&items, &made).bytes);
    let mut moved = items.clone();
    moved[0].geometry = Some(Geometry::Point { at_mm: at(-31.25, 20.5, -203.0) });
    assert_ne!(first, written(&moved, &made).bytes);
}

#[test]
fn items_that_a_report_cannot_hold_are_listed() {
    let made = made::series();
    let plane = Geometry::Plane {
        center_mm: at(0.0, 0.0, 0.0),
        normal: [0.0, 0.0, 1.0],
        axis: [1.0, 0.0, 0.0],
        size_mm: [10.0, 10.0],
    };
    let mut kept = item(1, "kept", Geometry::Point { at_mm: at(1.0, 2.0, 3.0) });
    (kept.rgb, kept.locked, kept.visible, kept.list) = (Some([1.0, 0.0, 0.0]), true, false, "F".to_owned());
    let mut missing = item(3, "missing", plane.clone());
    (missing.geometry, missing.state) = (None, State::Skipped);
    let mut elsewhere = item(4, "elsewhere", Geometry::Point { at_mm: at(1.0, 2.0, 3.0) });
    elsewhere.frame_of_reference = Some(FrameOfReference("1.2.3.4".to_owned()));
    let items = [kept, item(2, "cut", plane), missing, elsewhere];
    let made_report = written(&items, &made);
    let reported: Vec<(&str, String)> =
        made_report.left_out.iter().map(|left| (left.name.as_str(), left.reason.to_string())).collect();
    assert_eq!(reported.len(), 3);
    assert!(reported[0].0 == "cut" && reported[0].1.contains("planes"), "{reported:?}");
    assert!(reported[1].0 == "missing" && reported[1].1.contains("skipped"), "{reported:?}");
    assert!(reported[2].0 == "elsewhere" && reported[2].1.contains("frame of reference"), "{reported:?}");
    assert_eq!(made_report.notes.len(), 4, "{:?}", made_report.notes);
    let nothing = relief_dicom::write_report(&items[1..], &made.reference, &options());
    let Err(ReportError::Nothing(left)) = nothing else { panic!("{nothing:?}") };
    assert_eq!(left.len(), 3);
}

#[test]
fn a_curve_longer_than_sixteen_bits_is_written() {
    let made = made::series();
    let points_mm = (0..9_000).map(|i| at(f64::from(i) * 0.25, f64::from(i % 7), -200.0)).collect();
    let long = item(1, "long", Geometry::Curve { points_mm, closed: false, smooth: false });
    let found = read(&written(std::slice::from_ref(&long), &made).bytes);
    assert_eq!(found.items[0].geometry, long.geometry);
}

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
///
/// Names of patients and UIDs stay out of what people see; the report itself has them, word for
/// word.
#[test]
fn a_report_names_the_patient_and_nothing_else_does() {
    let made = made::series();
    let items = made::items(&made.frame_of_reference);
    let bytes = written(&items, &made).bytes;
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("PHANTOM^MÜNZE") && text.contains("SECRET-17") && text.contains("ISO_IR 192"));
    let shown = format!("{:?} {:?}", made.reference, read(&bytes));
    for secret in ["MÜNZE", "SECRET", made.frame_of_reference.as_str()] {
        assert!(!shown.contains(secret), "{secret} is shown");
    }
    // A cut: the element is named by its path, and nothing of its content.
    let cut = relief_dicom::read_report(
        &bytes[..bytes.len() - 2000],
        &ReportReadOptions { author: "x", series: None },
    );
    let message = cut.unwrap_err().to_string();
    assert!(message.starts_with("(0040,A730)[") && message.contains("expected"), "{message}");
    assert!(!message.contains("ring") && !message.contains("2.25."), "{message}");
}
