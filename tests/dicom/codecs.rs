//! One real CT slice in every transfer syntax, against what pydicom and GDCM decode.
//!
//! Truth: `codecs.facts.json`, of `../shared/data` or of the samples, and the uncompressed slice.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;

use std::path::{Path, PathBuf};

use common::{facts, numbers, shared_data};
use relief_base::{Patient, Point};
use relief_dicom::{Error, Loaded, Strictness};
use relief_volume::Volume;
use serde_json::Value;
use sha2::{Digest, Sha256};

fn load(path: &Path) -> Result<Loaded, Error> {
    let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ())?;
    relief_dicom::load(found.select(None)?, Strictness::Lenient, &|_| ())
}

fn fact(facts: &Value, file: &str) -> Value {
    let mut all = facts.as_array().unwrap().iter();
    all.find(|fact| fact["file"] == file).unwrap_or_else(|| panic!("no facts of {file}")).clone()
}

/// The folder of `codecs` and the facts of one of its files.
fn codec(file: &str) -> Option<(PathBuf, Value)> {
    let data = shared_data("a transfer syntax", &[&format!("codecs/{file}"), "codecs.facts.json"])?;
    let fact = fact(&facts(&data, "codecs.facts.json"), file);
    Some((data.join("codecs"), fact))
}

/// SHA-256 of the stored values, which the facts have, from HU with an intercept of whole HU.
fn stored_sha256(volume: &Volume, intercept: &Value) -> String {
    let intercept: f64 = intercept.as_str().unwrap().parse().unwrap();
    let bytes: Vec<u8> =
        volume.voxels_hu().iter().flat_map(|hu| hu.wrapping_sub(intercept as i16).to_le_bytes()).collect();
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn largest_difference(a: &Volume, b: &Volume) -> i32 {
    let pairs = a.voxels_hu().iter().zip(b.voxels_hu());
    pairs.map(|(&a, &b)| (i32::from(a) - i32::from(b)).abs()).max().unwrap()
}

#[test]
fn lossless_files_decode_to_the_same_bits() {
    for file in [
        "CTImage.dcm",
        "CTImage_LittleEndianImplicit_1.2.840.10008.1.2.dcm",
        "CTImage_LittleEndianExplicit_1.2.840.10008.1.2.1.dcm",
        "CTImage_BigEndianExplicit_1.2.840.10008.1.2.2.dcm",
        "CTImage_DeflatedExplicitVRLittleEndian_1.2.840.10008.1.2.1.99.dcm",
        "CTImage_RLELossless_1.2.840.10008.1.2.5.dcm",
        "CTImage_JPEGProcess14_1.2.840.10008.1.2.4.57.dcm",
        "CTImage_JPEGProcess14SV1_1.2.840.10008.1.2.4.70.dcm",
        #[cfg(feature = "jpeg-ls")]
        "CTImage_JPEGLSLossless_1.2.840.10008.1.2.4.80.dcm",
        "CTImage_JPEG2000LosslessOnly_1.2.840.10008.1.2.4.90.dcm",
        "CT2_UNC.dcm",
        "CT2_HTJ2K_assembled.dcm",
    ] {
        let Some((folder, expected)) = codec(file) else { continue };
        let volume = load(&folder.join(file)).unwrap_or_else(|error| panic!("{file}: {error}")).volume;
        let found = stored_sha256(&volume, &expected["RescaleIntercept"]);
        assert_eq!(found, expected["sha256_stored_int16le"], "{file}");
    }
}

#[test]
fn lossy_files_differ_no_more_than_other_decoders_find() {
    for file in [
        "CTImage_JPEGProcess1_1.2.840.10008.1.2.4.50.dcm",
        "CTImage_JPEGProcess1_1.2.840.10008.1.2.4.50_q_other.dcm",
        "CTImage_JPEGProcess2_4_1.2.840.10008.1.2.4.51.dcm",
        "CTImage_JPEGProcess6_8_1.2.840.10008.1.2.4.53.dcm",
        "CTImage_JPEGProcess10_12_1.2.840.10008.1.2.4.55.dcm",
        #[cfg(feature = "jpeg-ls")]
        "CTImage_JPEGLSLossy_1.2.840.10008.1.2.4.81.dcm",
        "CTImage_JPEG2000_1.2.840.10008.1.2.4.91.dcm",
    ] {
        let Some((folder, expected)) = codec(file) else { continue };
        let loaded = load(&folder.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        let reference = load(&folder.join("CTImage.dcm")).unwrap().volume;
        let step: f64 = expected["RescaleSlope"].as_str().unwrap().parse().unwrap();
        // Decoders of lossy JPEG may round a sample the other way: one step; HU round to whole
        // numbers.
        let limit = expected["max_abs_hu_diff_vs_reference"].as_f64().unwrap() + step + 0.5;
        let found = largest_difference(&loaded.volume, &reference);
        assert!(f64::from(found) <= limit, "{file}: {found} HU off, limit {limit}");
        let range = numbers(&expected["hu_min_max_mean"]);
        let (low, high) = loaded.volume.range_hu();
        for (hu, expected) in [(low, range[0]), (high, range[1])] {
            assert!((f64::from(hu) - expected).abs() <= step + 0.5, "{file}: {hu} HU, not {expected}");
        }
        // HU round to whole numbers, all the same way where the slope makes it so; samples that
        // round the other way are few.
        let mean = mean(loaded.volume.voxels_hu());
        assert!((mean - range[2]).abs() < 0.5 + step / 50.0, "{file}: mean {mean} HU, not {}", range[2]);
    }
}

fn mean(hu: &[i16]) -> f64 {
    hu.iter().map(|&hu| f64::from(hu)).sum::<f64>() / hu.len() as f64
}

#[test]
fn fragments_without_offset_table_are_divided_into_frames() {
    let file = "codecs/CT0012.fragmented_no_bot_jpeg_baseline.51.dcm";
    let Some(data) = shared_data("fragmented enhanced CT", &[file]) else { return };
    let expected = &facts(&data, "enhanced_ct.facts.json")[file];
    let loaded = load(&data.join(file)).unwrap();
    let grid = loaded.volume.grid();
    let [nx, ny, _] = grid.dims();
    let slices: Vec<&[i16]> = loaded.volume.voxels_hu().chunks(nx * ny).collect();
    assert_eq!(slices.len(), 2);
    for frame in expected["frames_facts"].as_array().unwrap() {
        // Rows run to the right, so that the normal points to the feet: the stack is not in the
        // file's order.
        let [x, y, z] = numbers(&frame["ipp"])[..] else { panic!("{frame}") };
        let [low, high, mean_hu] = numbers(&frame["hu_min_max_mean"])[..] else { panic!("{frame}") };
        let index = grid.voxel_from_patient() * Point::<Patient>::new(x, y, z);
        assert!(index.xyz.x.abs() < 1e-6 && index.xyz.y.abs() < 1e-6, "{index:?}");
        let slice = slices[index.xyz.z.round() as usize];
        let range = [*slice.iter().min().unwrap(), *slice.iter().max().unwrap()].map(f64::from);
        assert!((range[0] - low).abs() <= 1.0 && (range[1] - high).abs() <= 1.0, "z {z}: {range:?}");
        assert!((mean(slice) - mean_hu).abs() < 0.1, "z {z}: mean {}, not {mean_hu}", mean(slice));
    }
}

#[test]
fn files_without_ct_pixels_are_refused_by_name() {
    for (file, reason) in [
        ("no-pixel-data.dcm", "not CT"),
        ("no-pixel-spacing.dcm", "not CT"),
        ("CT2_HTJ2K.j2c", "not a DICOM file"),
    ] {
        let Some(data) = shared_data("files without CT pixels", &[&format!("codecs/{file}")]) else {
            continue;
        };
        let error = load(&data.join("codecs").join(file)).unwrap_err().to_string();
        assert!(error.contains(file) && error.contains(reason), "{file}: {error}");
    }
}
