//! DICOM segmentation objects of three writers, as the facts have them.

use std::path::Path;

use relief_dicom::{LoadLimits, LoadedSegmentation, load_segmentation};

use super::common::{facts, numbers, shared_data, unpacked};
use super::{measured, near};

fn load(path: &Path) -> LoadedSegmentation {
    load_segmentation(LoadLimits::default(), path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn a_nodule_lies_where_the_facts_have_it() {
    let Some(interop) = unpacked("a DICOM segmentation", "interop", &["dicom"]) else { return };
    let facts =
        &facts(&shared_data("a DICOM segmentation", &["interop.facts.json"]).unwrap(), "interop.facts.json")
            ["lidc-idri-0314_SEG"];
    let found = load(&interop.join("dicom/lidc-idri-0314_SEG_slicer-reporting.dcm"));
    assert_eq!(found.map.grid().dims(), [512, 512, 275]);
    let (label, voxels, ml, center) = measured(&found.map)[0];
    assert_eq!((label, facts["n_voxels"].as_u64()), (1, Some(voxels)));
    assert!((facts["volume_mm3"].as_f64().unwrap() / 1000.0 - ml).abs() < 1e-4, "{ml} ml");
    assert!(near(center, &numbers(&facts["centroid_lps"]), 0.01), "{center:?}");
}

#[test]
fn segments_of_dcmqi_and_highdicom_have_their_voxels_names_and_colours() {
    let Some(interop) = unpacked("DICOM segmentations", "interop", &["dicom"]) else { return };
    let facts =
        facts(&shared_data("DICOM segmentations", &["interop.facts.json"]).unwrap(), "interop.facts.json");
    for name in [
        "highdicom/seg_image_ct_binary",
        "highdicom/seg_image_ct_binary_overlap",
        "highdicom/seg_image_ct_binary_single_frame",
        "dcmqi/liver_seg",
        "dcmqi/sr_ref_seg",
    ] {
        let fact = &facts[format!("dicom/{name}.dcm")];
        let found = load(&interop.join(format!("dicom/{name}.dcm")));
        let names: Vec<&str> =
            found.map.segments().iter().filter_map(|segment| segment.name.as_deref()).collect();
        let expected: Vec<&str> =
            fact["segments"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
        assert_eq!(names, expected, "{name}");
        let set = fact["n_set"].as_u64().unwrap();
        let overlap: u64 =
            found.warnings.iter().filter_map(|w| w.split(' ').nth(3)?.parse::<u64>().ok()).sum();
        // A voxel of two segments is one voxel here.
        assert_eq!(found.map.labelled_voxels() + overlap, set, "{name}: {:?}", found.warnings);
        assert_eq!(overlap > 0, name.ends_with("overlap"), "{name}");
    }
    let liver = load(&interop.join("dicom/dcmqi/liver_seg.dcm")).map;
    let rgb = liver.segments()[0].rgb.unwrap().map(|channel| 255.0 * channel);
    // 3D Slicer's liver. Its writer takes the white of D65, where the standard has D50: 4 of 255
    // apart.
    assert!(near(rgb, &[221.0, 130.0, 101.0], 4.5), "{rgb:?}");
    assert!(near(liver.grid().origin().xyz.to_array(), &[-235.2, -226.8, -128.69], 5.0));
    assert_eq!(liver.grid().dims(), [512, 512, 3]);
}

#[test]
fn frames_that_end_within_a_byte_are_read_on_from_there() {
    let Some(data) = shared_data("bits that are not aligned", &["quirks/liver_nonbyte_aligned.dcm"]) else {
        return;
    };
    let whole = load(&data.join("quirks/liver.dcm")).map;
    let odd = load(&data.join("quirks/liver_nonbyte_aligned.dcm")).map;
    assert_eq!(odd.grid().dims(), [510, 510, 3]);
    // The same liver with a row and a column less on each side, or two on one: nothing of it is
    // lost.
    assert_eq!(odd.labelled_voxels(), whole.labelled_voxels());
    let counts = |map: &relief_volume::LabelMap| {
        let area = map.grid().dims()[0] * map.grid().dims()[1];
        [0, 1, 2].map(|k| (0..area).filter(|at| map.places().at(k * area + at) > 0).count())
    };
    assert_eq!(counts(&odd), counts(&whole));
}

#[test]
fn invalid_segmentations_are_refused_with_the_attribute() {
    let Some(data) = shared_data("objects that are no segmentations", &["quirks/liver.dcm"]) else { return };
    let error = load_segmentation(LoadLimits::default(), &data.join("quirks/CT_small.dcm")).unwrap_err();
    assert!(error.to_string().contains("SegmentationType (0062,0001)"), "{error}");
    let liver = data.join("quirks/liver.dcm");
    let error = load_segmentation(LoadLimits { voxel_bytes: 1 << 20 }, &liver).unwrap_err();
    assert!(error.to_string().contains("expected at most 524288"), "{error}");
}

/// Invariant: Label maps of other programs lie where those programs put them; damaged files, and
/// files that claim too much, end in an error.
#[test]
fn damaged_segmentations_end_in_an_error_or_a_map() {
    let Some(data) = shared_data("damaged segmentations", &["quirks/liver.dcm"]) else { return };
    let bytes = std::fs::read(data.join("quirks/liver.dcm")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.dcm");
    let mut refused = 0;
    let header = bytes.len() - 98_304;
    for cut in (0..header).step_by(97).chain([header + 10, bytes.len() - 1]) {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        refused += usize::from(load_segmentation(LoadLimits::default(), &path).is_err());
    }
    assert!(refused > 20, "{refused} cuts are noticed");
    for at in (132..header).step_by(13) {
        let mut damaged = bytes.clone();
        damaged[at] ^= [1, 0x80, 0xff][at % 3];
        std::fs::write(&path, &damaged).unwrap();
        let _ = load_segmentation(LoadLimits { voxel_bytes: 1 << 26 }, &path); // whatever it is, no panic
    }
}
