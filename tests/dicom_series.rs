//! Whole series against facts computed by other software (pydicom, cross-checked with SimpleITK).
//!
//! Truth: `../shared/data/NAME.facts.json`, and for resampled series the positions of known features.

mod common;

use std::path::Path;

use common::{facts, numbers, shared_data, unpacked};
use glam::DVec3;
use relief::dicom::{self, Loaded, Strictness, WarningCode};
use relief::space::{Point, Voxel};
use serde_json::Value;

fn load(path: &Path) -> Loaded {
    let found = dicom::discover(path, Strictness::Lenient, &|_| ()).unwrap();
    dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap()
}

fn hex(bytes: [u8; 32]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn point(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

/// Loads a series and compares what every series must have: the stack as read.
fn load_with_facts(name: &str) -> Option<(Loaded, Value)> {
    let folder = unpacked(name, name)?;
    let facts = facts(&shared_data(name)?, &format!("{name}.facts.json"));
    let loaded = load(&folder);
    assert_eq!(hex(loaded.stack_sha256()), facts["hu"]["sha256_int16le_zyx"], "{name}: stack as read");
    Some((loaded, facts))
}

/// A regular series: nothing resampled, geometry and samples as the facts say.
fn check_regular(name: &str) {
    let Some((loaded, facts)) = load_with_facts(name) else { return };
    assert_eq!(loaded.warnings, [], "{name}");
    let (geometry, grid) = (&facts["geometry"], loaded.volume.grid());
    let [nx, ny, nz] = grid.dims();
    assert_eq!(numbers(&geometry["shape_zyx"]), [nz as f64, ny as f64, nx as f64], "{name}");
    for (k, position) in geometry["ipp_all_lps"].as_array().unwrap().iter().enumerate() {
        let at = grid.patient_from_voxel() * Point::<Voxel>::new(0.0, 0.0, k as f64);
        assert!(at.xyz.distance(point(position)) < 1e-3, "{name} slice {k}: {} for {position}", at.xyz);
    }
    let spacing = numbers(&geometry["pixel_spacing_row_col_mm"]);
    let step = geometry["mean_step_length_mm"].as_f64().unwrap();
    for (found, expected) in grid.spacing_mm().into_iter().zip([spacing[1], spacing[0], step]) {
        assert!((found - expected).abs() < 1e-3, "{name}: {found} mm, not {expected} mm");
    }
    for sample in facts["samples"].as_array().unwrap() {
        let zyx: Vec<usize> = numbers(&sample["zyx"]).into_iter().map(|n| n as usize).collect();
        let index = [zyx[2], zyx[1], zyx[0]];
        assert_eq!(Value::from(loaded.volume.hu(index)), sample["hu"], "{name} at {index:?}");
        let [i, j, k] = index.map(|n| n as f64);
        let at = grid.patient_from_voxel() * Point::<Voxel>::new(i, j, k);
        assert!(at.xyz.distance(point(&sample["lps_mm"])) < 1e-3, "{name} at {index:?}: {}", at.xyz);
    }
}

#[test]
fn lidc_idri_0314_is_as_pydicom_reads_it() {
    check_regular("lidc-idri-0314");
}

#[test]
fn catphan504_cbct_with_turned_rows_is_as_pydicom_reads_it() {
    check_regular("catphan504-cbct");
}

#[test]
fn crlm_ct_1004_is_as_pydicom_reads_it() {
    check_regular("crlm-ct-1004");
}

#[test]
fn phantom_skull_5mm_is_as_pydicom_reads_it() {
    check_regular("phantom-skull-5mm");
}

#[test]
fn sts_001_thigh_with_non_square_slices_is_as_pydicom_reads_it() {
    check_regular("sts-001-thigh");
}

#[test]
fn totalseg_abdomen_with_empty_uids_is_as_pydicom_reads_it() {
    check_regular("totalseg-abdomen-j2k");
}
