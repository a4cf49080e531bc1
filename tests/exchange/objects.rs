//! Reports and segmentations of DICOM, dispatched: what others read of them is in
//! `tests/dicom_objects`.

use super::{CONTEXT, asymmetric, everything};
use crate::dicom_objects::made;
use dicom_dictionary_std::tags;
use relief_annotation::{FrameOfReference, Geometry, Item};
use relief_dicom::WarningCode;
use relief_exchange::{Format, ReadContext, WriteContext};
use relief_volume::{LabelMap, Segment};

fn frame(made: &made::Made) -> FrameOfReference {
    FrameOfReference(made.frame_of_reference.clone())
}

#[test]
fn a_report_needs_a_series_and_comes_back_with_its_points() {
    let series = made::series();
    let frame = frame(&series);
    let own = |items: Vec<Item>| -> Vec<Item> {
        items.into_iter().map(|item| Item { frame_of_reference: Some(frame.clone()), ..item }).collect()
    };
    let alone = WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] };
    let refused = relief_exchange::write(Format::Sr, &asymmetric(), &alone).unwrap_err().to_string();
    assert!(refused.starts_with("sr needs a DICOM series"), "{refused}");
    let context = WriteContext { series: Some(&series.reference), ..alone };
    let written = relief_exchange::write(Format::Sr, &own(asymmetric()), &context).unwrap();
    assert_eq!(written.items, 3);
    assert_eq!(Format::of(std::path::Path::new("any"), &written.bytes), Some(Format::Sr));
    let context = ReadContext { frame_of_reference: Some(&frame), list: "report", set: "anna", ..CONTEXT };
    let back = relief_exchange::read(Format::Sr, &written.bytes, &context).unwrap();
    for (item, back) in asymmetric().iter().zip(&back.items) {
        assert_eq!((&item.name, item.point(), back.set.as_str()), (&back.name, back.point(), "anna"));
        assert_eq!((back.list.as_str(), back.frame_of_reference.as_ref()), ("report", Some(&frame)));
    }
    let other = FrameOfReference("1.2.3.4".to_owned());
    let elsewhere = ReadContext { frame_of_reference: Some(&other), ..CONTEXT };
    let refused = relief_exchange::read(Format::Sr, &written.bytes, &elsewhere).unwrap_err().to_string();
    assert!(refused.contains("another one than the series'"), "{refused}");
    assert!(!refused.contains(&frame.0) && !refused.contains("1.2.3.4"), "a UID leads to a patient");
    // Losses of a report are listed for each item.
    let context = WriteContext {
        contents: &|_| None,
        grid: None,
        series: Some(&series.reference),
        phase: None,
        warnings: &[],
    };
    let written = relief_exchange::write(Format::Sr, &own(everything()), &context).unwrap();
    let lost: usize =
        written.left_out.iter().filter(|lost| lost.what == "items").map(|lost| lost.items.len()).sum();
    assert_eq!(written.items + lost, everything().len());
    assert!(lost >= 3, "a plane, and two without a place: {:?}", written.left_out);
    for cut in [0, 100, 200, 1000, written.bytes.len() / 2] {
        let refused =
            relief_exchange::read(Format::Sr, &written.bytes[..cut], &CONTEXT).unwrap_err().to_string();
        assert!(refused.starts_with("sr: "), "{refused}");
    }
}

#[test]
fn regions_become_a_segmentation_of_the_series() {
    let series = made::series();
    let mut labels = vec![0u16; series.grid.voxel_count()];
    labels[125..137].fill(1);
    labels[300..305].fill(2);
    let segments =
        vec![Segment::new(1, Some("first"), Some([0.5, 0.25, 1.0])), Segment::new(2, Some("second"), None)];
    let map = LabelMap::new(series.grid.clone(), &labels, segments).unwrap();
    let bytes = relief_dicom::write_seg_nrrd(&map).unwrap();
    let imported = relief_exchange::read(Format::SegNrrd, &bytes, &CONTEXT).unwrap();
    let content = imported.contents[0].2.clone();
    let contents = |_: &relief_annotation::ContentId| Some(content.clone());
    let context = WriteContext {
        contents: &contents,
        grid: Some(&series.grid),
        series: Some(&series.reference),
        phase: None,
        warnings: &[],
    };
    let written = relief_exchange::write(Format::Seg, &imported.items, &context).unwrap();
    assert_eq!(
        (written.items, Format::of(std::path::Path::new("x"), &written.bytes)),
        (2, Some(Format::Seg))
    );
    let back = relief_exchange::read(Format::Seg, &written.bytes, &CONTEXT).unwrap();
    let voxels = |item: &Item| match item.geometry.as_ref().unwrap() {
        Geometry::Region(region) => region.voxels,
        other => panic!("{other:?}"),
    };
    let found: Vec<(&str, u64)> = back.items.iter().map(|item| (item.name.as_str(), voxels(item))).collect();
    assert_eq!(found, [("first", 12), ("second", 5)]);
    let alone = WriteContext { series: None, ..context };
    let refused = relief_exchange::write(Format::Seg, &imported.items, &alone).unwrap_err().to_string();
    assert!(refused.starts_with("seg needs a DICOM series"), "{refused}");
    let refused =
        relief_exchange::read(Format::Seg, &written.bytes[..400], &CONTEXT).unwrap_err().to_string();
    assert!(refused.starts_with("seg: "), "{refused}");
}

#[test]
fn contours_become_curves_in_lists_of_their_structures() {
    let Some(folder) = super::common::unpacked("structures of a thigh", "sts-001-thigh", &[]) else { return };
    let bytes = std::fs::read(folder.join("rtstruct/RS.dcm")).unwrap();
    assert_eq!(Format::of(std::path::Path::new("x"), &bytes), Some(Format::RtStruct));
    let context = ReadContext { set: "plan", ..CONTEXT };
    let imported = relief_exchange::read(Format::RtStruct, &bytes, &context).unwrap();
    assert_eq!(imported.items.len(), 32);
    for item in &imported.items {
        assert!(item.set == "plan" && item.author == "ben" && item.list == "GTV_Mass_CT", "{item:?}");
        assert!(matches!(
            item.geometry,
            Some(Geometry::Curve { .. } | Geometry::Point { .. } | Geometry::Line { .. })
        ));
    }
    let refused = relief_exchange::read(Format::RtStruct, &bytes[..300], &CONTEXT).unwrap_err().to_string();
    assert!(refused.starts_with("rtstruct: "), "{refused}");
    let alone = WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] };
    let refused = relief_exchange::write(Format::RtStruct, &asymmetric(), &alone).unwrap_err().to_string();
    assert!(refused.contains("rtstruct cannot be written (can be: mrk.json"), "{refused}");
}

/// Invariant: DICOMweb answers and exports carry the warnings of their series.
#[test]
fn exports_carry_the_warnings_of_the_series() {
    let series = made::series();
    let mut labels = vec![0u16; series.grid.voxel_count()];
    labels[125..137].fill(1);
    let map =
        LabelMap::new(series.grid.clone(), &labels, vec![Segment::new(1, Some("first"), None)]).unwrap();
    let bytes = relief_dicom::write_seg_nrrd(&map).unwrap();
    let imported = relief_exchange::read(Format::SegNrrd, &bytes, &CONTEXT).unwrap();
    let content = imported.contents[0].2.clone();
    let context = WriteContext {
        contents: &|_| Some(content.clone()),
        grid: Some(&series.grid),
        series: Some(&series.reference),
        phase: None,
        warnings: &[WarningCode::OtherValues, WarningCode::GantryTilt, WarningCode::OtherValues],
    };
    for format in [Format::Seg, Format::LabelMap, Format::SegNrrd, Format::Nifti] {
        let written = relief_exchange::write(format, &imported.items, &context).unwrap();
        let object = dicom_object::from_reader(&written.bytes[..]).ok();
        let comments =
            object.map(|object| object.element(tags::IMAGE_COMMENTS).unwrap().to_str().unwrap().into_owned());
        let left_out = written.left_out.iter().find(|lost| lost.what == "warnings of the series");
        assert_eq!(comments.is_some(), left_out.is_none(), "{format}: one of both");
        let text = comments.unwrap_or_else(|| left_out.unwrap().reason.clone());
        assert!(text.contains("The slices are tilted") && text.matches("not in HU").count() == 1, "{text}");
    }
}
