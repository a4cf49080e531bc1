//! Whole series against facts computed by other software (pydicom, cross-checked with SimpleITK).
//!
//! Truth: `../shared/data/NAME.facts.json`, and for resampled series the positions of known
//! features.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;

use std::path::Path;

use common::{facts, numbers, shared_data, unpacked};
use glam::DVec3;
use relief_base::{Point, Voxel};
use relief_dicom::{Loaded, Strictness, WarningCode};
use serde_json::Value;

fn load(path: &Path) -> Loaded {
    let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ()).unwrap();
    relief_dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap()
}

fn hex(bytes: [u8; 32]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn point(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

/// Loads a series and compares what every series must have: the stack as read.
fn load_with_facts(name: &str) -> Option<(Loaded, Value)> {
    let folder = unpacked(name, name, &[])?;
    let facts = facts(&shared_data(name, &[&format!("{name}.facts.json")])?, &format!("{name}.facts.json"));
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

/// The centre of the voxels above `threshold_hu` within `radius_mm`, found by moving the window to
/// its own centre.
fn settle(loaded: &Loaded, start: DVec3, radius_mm: f64, threshold_hu: i16) -> (DVec3, f64) {
    let grid = loaded.volume.grid();
    let [nx, ny, nz] = grid.dims();
    let spacing = DVec3::from(grid.spacing_mm());
    let reach = (DVec3::splat(radius_mm) / spacing).ceil();
    let mut centre = start;
    for _ in 0..20 {
        let at = (grid.voxel_from_patient() * Point::from_xyz(centre)).xyz.round();
        let (low, high) = (at - reach, at + reach);
        let range =
            |low: f64, high: f64, n: usize| low.max(0.0) as usize..=(high.max(0.0) as usize).min(n - 1);
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for k in range(low.z, high.z, nz) {
            for j in range(low.y, high.y, ny) {
                for i in range(low.x, high.x, nx) {
                    let p = (grid.patient_from_voxel() * Point::new(i as f64, j as f64, k as f64)).xyz;
                    if loaded.volume.hu([i, j, k]) > threshold_hu && p.distance(centre) < radius_mm {
                        sum += p;
                        count += 1.0;
                    }
                }
            }
        }
        let next = sum / count;
        if next.distance(centre) < 1e-3 {
            return (next, count * spacing.element_product());
        }
        centre = next;
    }
    panic!("the window does not settle around {start}");
}

/// The sphere of the skull phantom: found at its position, and of its size.
fn check_sphere(name: &str, expected_code: Option<WarningCode>) {
    let Some((loaded, _)) = load_with_facts(name) else { return };
    let Some(data) = shared_data(name, &["phantom-skull.metrics.json"]) else { return };
    let codes: Vec<WarningCode> = loaded.warnings.iter().map(|warning| warning.code).collect();
    assert_eq!(codes, expected_code.into_iter().collect::<Vec<_>>(), "{name}");
    let metrics = &facts(&data, "phantom-skull.metrics.json")["series"];
    // Whatever the series, the phantom lies where it lies: compare with both measurements.
    for series in ["phantom-skull-5mm", "phantom-skull-tilt-m18.5"] {
        let expected = point(&metrics[series]["sphere_center"]);
        let (centre, volume_mm3) = settle(&loaded, expected, 17.0, -462);
        assert!(centre.distance(expected) < 1.5, "{name}: sphere at {centre}, not {expected} ({series})");
        let diameter = (volume_mm3 * 6.0 / std::f64::consts::PI).cbrt();
        let expected = metrics[series]["sphere_diam"].as_f64().unwrap();
        assert!((diameter - expected).abs() < 0.5, "{name}: diameter {diameter} mm, not {expected} mm");
    }
}

#[test]
fn the_sphere_of_the_untilted_phantom_lies_where_it_was_measured() {
    check_sphere("phantom-skull-5mm", None);
}

#[test]
fn the_sphere_of_the_tilted_phantom_lies_where_it_was_measured() {
    check_sphere("phantom-skull-tilt-m18.5", Some(WarningCode::GantryTilt));
}

#[test]
fn the_tilt_warning_gives_the_angle() {
    let Some((loaded, facts)) = load_with_facts("phantom-skull-tilt-m18.5") else { return };
    assert_eq!(facts["geometry"]["angle_step_vs_normal_deg(shear)"], 18.5);
    assert!(loaded.warnings[0].message.contains("18.50°"), "{}", loaded.warnings[0].message);
    // The new grid is orthogonal, and as fine along the normal as the slices were.
    let [x, y, z] = loaded.volume.grid().axis_directions();
    assert!(x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs()) < 1e-9);
    let normal_step = facts["geometry"]["spacing_along_normal_mm"]["median"].as_f64().unwrap();
    assert!((loaded.volume.grid().spacing_mm()[2] - normal_step).abs() < 1e-3);
}

#[test]
fn catphan_nodes_lie_where_they_were_measured() {
    let Some((loaded, _)) = load_with_facts("catphan504-cbct") else { return };
    let Some(data) = shared_data("catphan nodes", &["catphan504-cbct.metrics.json"]) else { return };
    let grid = loaded.volume.grid();
    for node in facts(&data, "catphan504-cbct.metrics.json")["nodes"].as_array().unwrap() {
        let expected = point(&node["LPS_k32"]);
        let at = (grid.voxel_from_patient() * Point::from_xyz(expected)).xyz.round();
        // Nodes are 3 mm rods of air or Teflon in plastic of about 110 HU; weigh by contrast within
        // 3 mm.
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for (dj, di) in (-7..=7).flat_map(|dj| (-7..=7).map(move |di| (f64::from(dj), f64::from(di)))) {
            let index = at + DVec3::new(di, dj, 0.0);
            let p = (grid.patient_from_voxel() * Point::from_xyz(index)).xyz;
            let hu = loaded.volume.hu([index.x as usize, index.y as usize, 32]);
            let contrast = (f64::from(hu) - 110.0).abs();
            if p.distance(expected) < 3.0 && contrast > 300.0 {
                sum += p * contrast;
                weights += contrast;
            }
        }
        let found = sum / weights;
        assert!(found.distance(expected) < 0.3, "node at {found}, not {expected}");
    }
}

/// Heads scanned in two blocks of different gaps, tilted: no feature was measured, but every slice
/// shows the position of bone.
#[test]
fn bone_of_a_tilted_uneven_head_stays_where_the_slices_have_it() {
    let name = "head-ge-varspacing-tilt";
    let Some((loaded, facts)) = load_with_facts(name) else { return };
    let codes: Vec<WarningCode> = loaded.warnings.iter().map(|warning| warning.code).collect();
    // Slices of 4 mm, then slices of 7 mm that the scanner added up.
    let mixed = WarningCode::MixedSlices;
    assert_eq!(codes, [mixed, mixed, WarningCode::GantryTilt, WarningCode::UnevenSpacing]);
    let folder = unpacked(name, name, &[]).unwrap();
    let (row, column) =
        (point(&facts["geometry"]["row_dir_lps(x axis)"]), point(&facts["geometry"]["col_dir_lps(y axis)"]));
    let mm = facts["geometry"]["pixel_spacing_row_col_mm"][0].as_f64().unwrap();
    let positions = facts["geometry"]["ipp_all_lps"].as_array().unwrap();
    for (file, position) in facts["slice_file_order"].as_array().unwrap().iter().zip(positions) {
        let slice = stored_values(&folder.join(file.as_str().unwrap())); // slope 1, intercept 0
        let (mut of_slice, mut of_volume) = (Centroid::default(), Centroid::default());
        for (y, x) in (0..512).step_by(2).flat_map(|y| (0..512).step_by(2).map(move |x| (y, x))) {
            let p = point(position) + row * (mm * x as f64) + column * (mm * y as f64);
            of_slice.add(p, f64::from(slice[y * 512 + x]));
            of_volume.add(p, trilinear(&loaded, p));
        }
        let moved = of_slice.centre().distance(of_volume.centre());
        assert!(moved < 1.5, "{file}: bone moved by {moved} mm");
    }
}

/// The centre of dense material: values above 300 HU count by how much they are.
#[derive(Default)]
struct Centroid {
    sum: DVec3,
    weights: f64,
}

impl Centroid {
    fn add(&mut self, p: DVec3, hu: f64) {
        let weight = (hu - 300.0).max(0.0);
        self.sum += p * weight;
        self.weights += weight;
    }

    fn centre(&self) -> DVec3 {
        self.sum / self.weights
    }
}

/// Pixels as another reader finds them.
fn stored_values(path: &Path) -> Vec<i16> {
    let object = dicom_object::open_file(path).unwrap();
    let bytes = object.element(dicom_dictionary_std::tags::PIXEL_DATA).unwrap().to_bytes().unwrap();
    bytes.chunks_exact(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]])).collect()
}

fn trilinear(loaded: &Loaded, p: DVec3) -> f64 {
    let grid = loaded.volume.grid();
    let last = DVec3::from(grid.dims().map(|n| n as f64 - 1.0));
    let index = (grid.voxel_from_patient() * Point::from_xyz(p)).xyz.clamp(DVec3::ZERO, last);
    let (low, weight) = (index.floor(), index.fract());
    let corner = |c: usize| {
        let step = DVec3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64);
        let at = (low + step).min(last);
        let share = (DVec3::ONE - step) + (step * 2.0 - DVec3::ONE) * weight;
        share.element_product() * f64::from(loaded.volume.hu([at.x as usize, at.y as usize, at.z as usize]))
    };
    (0..8).map(corner).sum()
}
