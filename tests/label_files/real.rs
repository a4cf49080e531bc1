//! Files of other programs: TotalSegmentator, 3D Slicer, a published mask.

use std::path::Path;

use relief_dicom::Strictness;

use relief_volume::{LabelMap, Volume};
use sha2::{Digest, Sha256};

use super::common::{facts, numbers, shared_data, unpacked};
use super::{measured, near, read};

/// Holds a map against the facts about its labels: voxels, volume, centroid, and mean value where
/// they have it.
fn expect_labels(map: &LabelMap, volume: &Volume, expected: &serde_json::Value, mean: &str) {
    let expected = expected.as_object().unwrap();
    let found = measured(map);
    assert_eq!(found.len(), expected.len(), "as many segments as there are facts");
    for (label, voxels, ml, center) in found {
        let fact = &expected[&label.to_string()];
        assert_eq!(fact["n_voxels"], voxels, "label {label}");
        assert!((fact["volume_ml"].as_f64().unwrap() - ml).abs() < 0.002, "label {label}: {ml} ml");
        let wanted = numbers(&fact["centroid_lps"]);
        assert!(near(center, &wanted, 0.02), "label {label}: {center:?} for {wanted:?}");
        let place = map.segments().iter().position(|segment| segment.label == label).unwrap() + 1;
        let values = volume.voxels_hu().iter().enumerate();
        let sum: i64 =
            values.filter(|(at, _)| map.places().at(*at) == place).map(|(_, &hu)| i64::from(hu)).sum();
        let hu = sum as f64 / voxels as f64;
        assert!((fact[mean].as_f64().unwrap() - hu).abs() < 0.006, "label {label}: {hu} HU");
    }
}

#[test]
fn totalsegmentators_example_is_what_the_facts_say() {
    let Some(data) = shared_data("TotalSegmentator's example", &["volumes", "volumes.facts.json"]) else {
        return;
    };
    let facts = &facts(&data, "volumes.facts.json")[0];
    let read_volume = relief_dicom::read_volume(&data.join("volumes/totalseg_example_ct_sm.nii.gz")).unwrap();
    let volume = read_volume.volume;
    assert_eq!(volume.grid().dims(), [122, 101, 30]);
    // RAS to LPS: x and y change sign.
    assert!(near(volume.grid().origin().xyz.to_array(), &[177.956_329, -11.319, 94.301_758], 1e-4));
    assert_eq!(volume.grid().direction(), [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]);
    let digest = Sha256::digest(bytemuck::cast_slice::<i16, u8>(volume.voxels_hu()));
    let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(facts["sha256_int16le_Fortran_xyz(x fastest)"], hex.as_str());
    let map = read(&data.join("volumes/totalseg_example_seg.nii.gz")).unwrap();
    assert_eq!(map.grid(), volume.grid());
    expect_labels(&map, &volume, &facts["labels"], "mean_value");
    let named = |label: u16| map.segments().iter().find(|segment| segment.label == label).unwrap();
    for (label, fact) in facts["labels"].as_object().unwrap() {
        assert_eq!(named(label.parse().unwrap()).name.as_deref(), fact["name"].as_str(), "label {label}");
    }
    assert_eq!(named(1).rgb, Some([0.0, 1.0, 0.0]), "the extension's colour");
}

/// Invariant: Label maps of other programs lie where those programs put them; damaged files, and
/// files that claim too much, end in an error.
#[test]
fn labels_of_a_series_come_to_its_slices_by_flips() {
    let Some(interop) = unpacked("labels of a series", "interop", &["nifti"]) else { return };
    let series = unpacked("labels of a series", "totalseg-abdomen-j2k", &[]).unwrap();
    let facts =
        facts(&shared_data("labels of a series", &["interop.facts.json"]).unwrap(), "interop.facts.json");
    let found = relief_dicom::discover(&series, Strictness::Lenient, &|_| ()).unwrap();
    let volume = relief_dicom::load(&found.series[0], Strictness::Lenient, &|_| ()).unwrap().volume;
    let map = read(&interop.join("nifti/totalseg-abdomen-j2k_labels.nii.gz")).unwrap();
    assert_ne!(map.grid(), volume.grid(), "the file's rows run the other way");
    let placed = map.resampled(volume.grid());
    expect_labels(&placed, &volume, &facts["totalseg-abdomen-j2k_labels"]["labels"], "mean_HU");
}

#[test]
fn a_published_mask_of_a_series_has_its_volume_and_centroid() {
    let Some(series) = unpacked("a published mask", "sts-001-thigh", &[]) else { return };
    let facts = facts(&shared_data("a published mask", &[]).unwrap(), "sts-001-thigh.mask.facts.json");
    let map = read(&series.join("nifti_mask/mask.nii.gz")).unwrap();
    let (_, voxels, ml, center) = measured(&map)[0];
    assert_eq!(facts["n_voxels"], voxels);
    assert!((facts["volume_ml"].as_f64().unwrap() - ml).abs() < 0.01, "{ml} ml");
    assert!(near(center, &numbers(&facts["centroid_lps"]), 0.01), "{center:?}");
    let volume = relief_dicom::read_volume(&series.join("nifti_image/image.nii.gz")).unwrap().volume;
    let sum: i64 = volume.voxels_hu().iter().map(|&hu| i64::from(hu)).sum();
    assert_eq!(facts["image_sum"].as_f64().unwrap(), sum as f64);
}

#[test]
fn segmentations_of_3d_slicer_have_their_names_and_overlapping_ones_all_segments() {
    let Some(interop) = unpacked("segmentations of 3D Slicer", "interop", &["slicer"]) else { return };
    let facts = facts(
        &shared_data("segmentations of 3D Slicer", &["interop.facts.json"]).unwrap(),
        "interop.facts.json",
    );
    let map = read(&interop.join("slicer/Segmentation.seg.nrrd")).unwrap();
    let fact = &facts["slicer_Segmentation.seg.nrrd"];
    for (segment, voxels) in map.counted() {
        assert_eq!(fact["label_counts"][segment.label.to_string()], voxels);
        let name = &fact["segments"][format!("Segment{}_Name", segment.label - 1)];
        assert_eq!(name.as_str(), segment.name.as_deref());
    }
    assert!(near(map.grid().origin().xyz.to_array(), &numbers(&fact["origin"]), 1e-9));
    assert_eq!(map.segments()[4].rgb, Some([0.086_274_5, 0.772_549, 0.278_431]));
    let volume = relief_dicom::read_volume(&interop.join("slicer/CTChest4.nrrd")).unwrap().volume;
    assert_eq!((volume.range_hu(), volume.grid()), ((-3024, 3070), map.grid()));

    let overlapping =
        relief_dicom::read_labels(&interop.join("slicer/SegmentationOverlapping.seg.nrrd")).unwrap();
    let names: Vec<_> = overlapping.map.segments().iter().filter_map(|s| s.name.as_deref()).collect();
    assert_eq!(names.last(), Some(&"overlapping sphere"));
    let counts: Vec<u64> = overlapping.map.counted().map(|(_, voxels)| voxels).collect();
    // Label 1 of both layers together: the ribs lose the overlap to the sphere.
    assert_eq!(counts[7], 27_626 - 8_487, "the sphere is whole, in the later layer");
    assert!(counts[..7].iter().zip(map.counted()).all(|(now, (_, alone))| *now <= alone));
    assert_eq!(overlapping.warnings.len(), 2, "{:?}", overlapping.warnings);
}

#[test]
fn a_mouse_keeps_its_size() {
    let Some(interop) = unpacked("a mouse's labels", "interop", &["mouse_ct_atlas"]) else { return };
    let map = read(&interop.join("mouse_ct_atlas/low_res_template_UCHAR-label.nii.gz")).unwrap();
    assert_eq!(map.grid().dims(), [130, 206, 114]);
    assert!((map.grid().spacing_mm()[0] - 0.141_113_4).abs() < 1e-6);
    assert!(!relief_dicom::is_volume_file(Path::new("Cargo.toml")));
}
