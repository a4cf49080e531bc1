//! Damaged, hostile and contradictory input: a clear error or a warning, never a panic, never
//! unbounded memory.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;
use crate::dicom::made;

use std::fs;
use std::path::{Path, PathBuf};

use common::{shared_data, unpacked};
use relief_dicom::{Error, Loaded, Strictness, WarningCode};

fn load_with(path: &Path, strictness: Strictness) -> Result<Loaded, Error> {
    let found = relief_dicom::discover(path, strictness, &|_| ())?;
    relief_dicom::load(found.select(None)?, strictness, &|_| ())
}

fn load(path: &Path) -> Result<Loaded, Error> {
    load_with(path, Strictness::Lenient)
}

/// Loads one file of these bytes.
fn load_bytes(folder: &Path, bytes: &[u8]) -> Result<Loaded, Error> {
    let path = folder.join("damaged.dcm");
    fs::write(&path, bytes).unwrap();
    load(&path)
}

/// The value of an element: its first occurrence of tag (and explicit VR) in a little-endian file.
fn value_at(bytes: &[u8], tag: [u16; 2], vr: &str) -> usize {
    let [group, element] = tag.map(u16::to_le_bytes);
    let header = [&group[..], &element, vr.as_bytes()].concat();
    let at = bytes.windows(header.len()).position(|window| window == header).expect("the element is there");
    at + header.len() + 2
}

/// Slices of 128 x 128 pixels to be damaged: one made here, and a real one where the data are.
fn templates(what: &str) -> Vec<Vec<u8>> {
    let real = shared_data(&format!("{what}, on a real slice"), &["quirks/CT_small.dcm"]);
    let real = real.map(|data| fs::read(data.join("quirks/CT_small.dcm")).unwrap());
    [made::slice()].into_iter().chain(real).collect()
}

/// Overwrites a value, padded with spaces.
fn put(bytes: &mut [u8], tag: [u16; 2], vr: &str, value: &str) {
    let at = value_at(bytes, tag, vr);
    let length = usize::from(u16::from_le_bytes([bytes[at - 2], bytes[at - 1]]));
    bytes[at..at + length].copy_from_slice(format!("{value:<length$}").as_bytes());
}

/// A copy of a slice at `z` with an instance UID of its own.
fn slice_at(template: &[u8], z: f64, instance: u8) -> Vec<u8> {
    let mut bytes = template.to_vec();
    put(&mut bytes, [0x0020, 0x0032], "DS", &format!("-158.1\\-179.0\\{z:.3}"));
    put(&mut bytes, [0x0008, 0x0018], "UI", &format!("1.2.3.{instance}\0"));
    bytes
}

/// A folder of slices at these heights.
fn stack(template: &[u8], heights: &[f64]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (index, &z) in heights.iter().enumerate() {
        let name = format!("{:02}.dcm", heights.len() - index); // names say the opposite of positions
        fs::write(folder.path().join(name), slice_at(template, z, index as u8)).unwrap();
    }
    folder
}

/// Invariant: No bytes from outside cause a panic: DICOM files, frames, requests.
#[test]
fn crafted_files_end_in_a_volume_or_an_error() {
    for (made, seed) in [(made::slice(), 1), (made::rle_slice(), 2)] {
        load_damaged_copies(&made, "a made file", seed, 300);
    }
    let Some(folder) = unpacked("the fuzzing corpus", "fuzz", &[]) else { return };
    let mut files = Vec::new();
    list(&folder, &mut files);
    assert!(files.len() >= 200, "{} files", files.len());
    for file in &files {
        match load(file) {
            Ok(loaded) => assert!(loaded.volume.grid().voxel_count() < 1 << 26, "{}", file.display()),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    // And all at once.
    relief_dicom::discover(&folder, Strictness::Lenient, &|_| ()).unwrap();
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.path().is_dir() { list(&entry.path(), files) } else { files.push(entry.path()) }
    }
}

#[test]
fn every_prefix_of_a_file_is_an_error() {
    for bytes in templates("prefixes of a file") {
        let folder = tempfile::tempdir().unwrap();
        // Behind the pixels of the real slice is padding.
        let pixels = value_at(&bytes, [0x7FE0, 0x0010], "OW") + 4 + 128 * 128 * 2;
        for length in (0..700).chain((700..=bytes.len()).step_by(97)).chain([pixels - 1, pixels]) {
            let outcome = load_bytes(folder.path(), &bytes[..length]);
            assert_eq!(outcome.is_ok(), length >= pixels, "{length} bytes");
        }
    }
}

#[test]
fn prefixes_and_flipped_bits_of_compressed_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    for file in [
        "quirks/J2K_pixelrep_mismatch.dcm",
        "quirks/bad_sequence.dcm",
        "codecs/CTImage_RLELossless_1.2.840.10008.1.2.5.dcm",
        "codecs/CTImage_JPEGProcess2_4_1.2.840.10008.1.2.4.51.dcm",
        "codecs/CTImage_JPEGProcess10_12_1.2.840.10008.1.2.4.55.dcm",
        "codecs/CTImage_JPEGProcess1_1.2.840.10008.1.2.4.50.dcm",
        #[cfg(feature = "jpeg-ls")]
        "codecs/CTImage_JPEGLSLossless_1.2.840.10008.1.2.4.80.dcm",
        "codecs/CTImage_DeflatedExplicitVRLittleEndian_1.2.840.10008.1.2.1.99.dcm",
        "codecs/CT2_HTJ2K_assembled.dcm",
    ] {
        let Some(data) = shared_data("a damaged compressed file", &[file]) else { continue };
        let bytes = fs::read(data.join(file)).unwrap();
        for part in 1..12 {
            let _ = load_bytes(folder.path(), &bytes[..bytes.len() * part / 12]);
        }
        load_damaged_copies(&bytes, file, 1, 24);
    }
}

/// Loads copies of a file with three flipped bits each: all end in a volume of bounded size or an
/// error.
fn load_damaged_copies(bytes: &[u8], name: &str, seed: u64, copies: usize) {
    let folder = tempfile::tempdir().unwrap();
    let mut random = seed;
    for copy in 0..copies {
        let mut damaged = bytes.to_vec();
        // Every other copy is damaged only in its header, which is a small part of most files.
        let end = if copy % 2 == 0 { bytes.len() } else { bytes.len().min(1400) };
        for _ in 0..3 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = 132 + (random >> 33) as usize % (end - 132);
            damaged[at] ^= 1 << (random >> 20 & 7);
        }
        match load_bytes(folder.path(), &damaged) {
            Ok(loaded) => assert!(loaded.volume.grid().voxel_count() <= 1 << 26, "{name}"),
            Err(error) => assert!(!error.to_string().is_empty(), "{name}"),
        }
    }
}

/// Invariant: No bytes from outside cause a panic: DICOM files, frames, requests.
#[test]
fn flipped_bits_of_a_header_never_panic() {
    for bytes in templates("damaged headers") {
        let folder = tempfile::tempdir().unwrap();
        for at in (132..value_at(&bytes, [0x7FE0, 0x0010], "OW")).step_by(3) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0xFF;
            let _ = load_bytes(folder.path(), &damaged);
        }
    }
}

#[test]
fn an_unusable_attribute_is_named_with_what_was_found() {
    for bytes in templates("unusable attributes") {
        let folder = tempfile::tempdir().unwrap();
        for (tag, vr, value, expected) in [
            ([0x0020, 0x0032], "DS", "\\\\", "ImagePositionPatient (0020,0032): found"),
            ([0x0020, 0x0037], "DS", "9.0", "ImageOrientationPatient (0020,0037): found"),
            ([0x0028, 0x0030], "DS", "0\\0", "PixelSpacing (0028,0030): found"),
            ([0x0028, 0x1053], "DS", "x", "RescaleSlope (0028,1053): found"),
            ([0x0028, 0x1052], "DS", "x", "RescaleIntercept (0028,1052): found"),
            ([0x0028, 0x0010], "US", "\0\0", "Rows (0028,0010): found 0, expected 1 to 65535"),
            ([0x0028, 0x0100], "US", "\x20\0", "BitsAllocated (0028,0100): found 32, expected 8 or 16"),
            (
                [0x0028, 0x0101],
                "US",
                "\x11\0",
                "BitsStored (0028,0101): found 17, expected 1 to BitsAllocated",
            ),
            ([0x0028, 0x0002], "US", "\x03\0", "SamplesPerPixel (0028,0002): found 3, expected 1"),
            ([0x0028, 0x0011], "US", "\0\x7F", "Pixel Data (7FE0,0010): found 32768 bytes, expected 8323072"),
        ] {
            let mut damaged = bytes.clone();
            put(&mut damaged, tag, vr, value);
            let error = load_bytes(folder.path(), &damaged).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("damaged.dcm"), "{expected}: {error}");
        }
    }
}

/// Invariant: Slices are ordered by position and orientation only, never by file name, instance
/// number or thickness.
#[test]
fn slices_are_ordered_by_position_whatever_their_names_say() {
    for template in templates("order of slices") {
        let folder = stack(&template, &[30.0, 10.0, 20.0, 0.0]);
        let loaded = load(folder.path()).unwrap();
        assert_eq!(loaded.warnings, []);
        let grid = loaded.volume.grid();
        assert_eq!((grid.dims(), grid.origin().xyz.z), ([128, 128, 4], 0.0));
        assert!((grid.spacing_mm()[2] - 10.0).abs() < 1e-9);
    }
}

#[test]
fn monochrome1_leaves_hu_alone() {
    for template in templates("MONOCHROME1") {
        let folder = tempfile::tempdir().unwrap();
        let plain = load_bytes(folder.path(), &template).unwrap();
        let mut inverted = template.clone();
        put(&mut inverted, [0x0028, 0x0004], "CS", "MONOCHROME1");
        let inverted = load_bytes(folder.path(), &inverted).unwrap();
        assert_eq!(inverted.volume.voxels_hu(), plain.volume.voxels_hu());
        assert_eq!(plain.volume.range_hu(), (-896, 1167)); // both slices have these, by the stored values of one
    }
}

#[test]
fn rescale_applies_per_slice() {
    for template in templates("rescale per slice") {
        let folder = stack(&template, &[0.0, 1.0]);
        let mut third = slice_at(&template, 2.0, 40);
        put(&mut third, [0x0028, 0x1052], "DS", "-1000");
        put(&mut third, [0x0028, 0x1053], "DS", "2");
        fs::write(folder.path().join("third.dcm"), third).unwrap();
        let loaded = load(folder.path()).unwrap();
        for (i, j) in [(3, 7), (64, 64), (120, 90)] {
            let stored = loaded.volume.hu([i, j, 0]) + 1024;
            assert_eq!(loaded.volume.hu([i, j, 2]), stored * 2 - 1000);
        }
    }
}

#[test]
fn one_bad_file_among_many_is_a_warning_and_under_strict_an_error() {
    for template in templates("a bad file among many") {
        let folder = stack(&template, &[0.0, 1.0, 2.0, 3.0]);
        fs::write(folder.path().join("cut.dcm"), &slice_at(&template, 4.0, 7)[..20_000]).unwrap();
        let found = relief_dicom::discover(folder.path(), Strictness::Lenient, &|_| ()).unwrap();
        let warnings = found.warnings();
        assert_eq!(warnings.len(), 1);
        assert_eq!(warnings[0].code, WarningCode::BadFile);
        assert!(
            warnings[0].message.contains("cut.dcm: Pixel Data (7FE0,0010): found"),
            "{}",
            warnings[0].message
        );
        assert_eq!(load(folder.path()).unwrap().volume.grid().dims(), [128, 128, 4]);
        let error = load_with(folder.path(), Strictness::Strict).unwrap_err();
        assert!(
            matches!(error, Error::Strict { count: 1, .. }) && error.to_string().contains("cut.dcm"),
            "{error}"
        );
    }
}

#[test]
fn a_missing_slice_is_interpolated_with_the_largest_error_in_mm() {
    for template in templates("a missing slice") {
        let folder = stack(&template, &[0.0, 2.0, 4.0, 8.0, 10.0]);
        let loaded = load(folder.path()).unwrap();
        assert_eq!(loaded.warnings.len(), 1);
        assert_eq!(loaded.warnings[0].code, WarningCode::UnevenSpacing);
        // An even grid of five slices has steps of 2.5 mm: 4 mm is 1 mm off.
        assert!(loaded.warnings[0].message.contains("1.000 mm off"), "{}", loaded.warnings[0].message);
        let grid = loaded.volume.grid();
        assert_eq!(grid.dims(), [128, 128, 6]);
        assert!((grid.spacing_mm()[2] - 2.0).abs() < 1e-9);
    }
}

#[test]
fn rounded_positions_are_left_as_they_are() {
    for template in templates("rounded positions") {
        let heights: Vec<f64> =
            (0..30).map(|k| (f64::from(k) * 0.625 * 1e3).round() / 1e3 + 0.001 * f64::from(k % 2)).collect();
        assert_eq!(load(stack(&template, &heights).path()).unwrap().warnings, []);
    }
}

#[test]
fn a_duplicated_position_is_left_out_and_named() {
    for template in templates("duplicated positions") {
        let folder = stack(&template, &[0.0, 1.0, 1.0, 2.0, 3.0, 4.0]);
        let loaded = load(folder.path()).unwrap();
        assert_eq!(loaded.volume.grid().dims(), [128, 128, 5]);
        assert_eq!(loaded.warnings[0].code, WarningCode::DuplicatePosition);
        let message = &loaded.warnings[0].message;
        assert!(
            message.contains(".dcm: ImagePositionPatient (0020,0032): found [-158.1, -179, 1]"),
            "{message}"
        );
        assert!(matches!(load_with(folder.path(), Strictness::Strict), Err(Error::Strict { .. })));
        // When half of them repeat, no choice is the right one.
        let folder = stack(&template, &[0.0, 1.0, 2.0, 0.0, 1.0, 2.0]);
        assert!(matches!(load(folder.path()), Err(Error::Ambiguous { duplicates: 3, slices: 6, .. })));
    }
}

#[test]
fn phases_at_equal_positions_are_separated_by_acquisition() {
    for template in templates("phases of one series") {
        let folder = stack(&template, &[0.0, 1.0, 2.0]);
        for k in 0..3 {
            let mut slice = slice_at(&template, f64::from(k), 60 + k);
            put(&mut slice, [0x0020, 0x0012], "IS", "7");
            fs::write(folder.path().join(format!("phase-{k}.dcm")), slice).unwrap();
        }
        let found = relief_dicom::discover(folder.path(), Strictness::Lenient, &|_| ()).unwrap();
        assert_eq!(found.series.len(), 2);
        for series in &found.series {
            let loaded = relief_dicom::load(series, Strictness::Strict, &|_| ()).unwrap();
            assert_eq!((loaded.volume.grid().dims(), loaded.warnings.len()), ([128, 128, 3], 0));
        }
    }
}

#[test]
fn a_copy_of_a_file_is_left_out() {
    for template in templates("copies of files") {
        let folder = stack(&template, &[0.0, 1.0, 2.0]);
        let backup = folder.path().join("backup");
        fs::create_dir(&backup).unwrap();
        for name in ["01.dcm", "02.dcm", "03.dcm"] {
            fs::copy(folder.path().join(name), backup.join(name)).unwrap();
        }
        let loaded = load(folder.path()).unwrap();
        assert_eq!(loaded.volume.grid().dims(), [128, 128, 3]);
        assert_eq!(loaded.warnings[0].code, WarningCode::DuplicateFile);
        assert!(loaded.warnings[0].message.starts_with("3 image(s)"), "{}", loaded.warnings[0].message);
    }
}

#[test]
fn other_orientations_and_matrix_sizes_become_series_of_their_own() {
    for template in templates("mixed series") {
        let folder = stack(&template, &[0.0, 1.0, 2.0]);
        let mut coronal = slice_at(&template, 9.0, 50);
        put(&mut coronal, [0x0020, 0x0037], "DS", "1\\0\\0\\0\\0\\-1");
        fs::write(folder.path().join("coronal.dcm"), coronal).unwrap();
        let mut smaller = slice_at(&template, 10.0, 51);
        put(&mut smaller, [0x0028, 0x0010], "US", "\x40\0");
        fs::write(folder.path().join("smaller.dcm"), smaller).unwrap();
        let found = relief_dicom::discover(folder.path(), Strictness::Lenient, &|_| ()).unwrap();
        let dims: Vec<[usize; 3]> = found.series.iter().map(relief_dicom::SeriesEntry::dims).collect();
        assert_eq!(dims, [[128, 128, 3], [128, 128, 1], [128, 64, 1]]);
        let uids: Vec<&str> =
            found.series.iter().map(|series| series.uid().rsplit('#').next().unwrap()).collect();
        assert_eq!(uids, ["1", "2", "3"]);
        let error = found.select(None).unwrap_err().to_string();
        assert!(error.contains("128 x 128 x 3") && error.contains("128 x 64 x 1"), "{error}");
    }
}

#[test]
fn a_codec_failure_leaves_a_gap_and_a_warning() {
    let Some(archive) = unpacked("a damaged compressed slice", "totalseg-abdomen-j2k", &[]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    list(&archive, &mut files);
    files.sort();
    for (index, file) in files.iter().enumerate() {
        let mut bytes = fs::read(file).unwrap();
        if index == 10 {
            let at = bytes.windows(4).position(|window| window == [0xFF, 0x4F, 0xFF, 0x51]).unwrap();
            bytes[at + 8..at + 12].copy_from_slice(&60_000u32.to_be_bytes()); // a width nobody asked for
        }
        fs::write(folder.path().join(format!("{index}.dcm")), bytes).unwrap();
    }
    let loaded = load(folder.path()).unwrap();
    let codes: Vec<WarningCode> = loaded.warnings.iter().map(|warning| warning.code).collect();
    assert_eq!(codes, [WarningCode::BadFile, WarningCode::UnevenSpacing]);
    assert!(
        loaded.warnings[0].message.contains("10.dcm: the compressed image is 60000 x 512"),
        "{:?}",
        loaded.warnings
    );
    assert_eq!(loaded.volume.grid().dims(), [512, 512, 20]); // the gap is filled
    assert!(matches!(load_with(folder.path(), Strictness::Strict), Err(Error::Strict { count: 1, .. })));
}

#[test]
fn paths_that_lead_nowhere_say_so() {
    let error = load(Path::new("no/such/path")).unwrap_err().to_string();
    assert!(error.contains("cannot read no/such/path"), "{error}");
    let empty = tempfile::tempdir().unwrap();
    let error = load(empty.path()).unwrap_err().to_string();
    assert!(error.contains("no CT slices in") && error.contains("looked at 0 file(s)"), "{error}");
    fs::write(empty.path().join("note.txt"), "no image").unwrap();
    let error = load(empty.path()).unwrap_err().to_string();
    assert!(error.contains("note.txt: not a DICOM file: found bytes 6E 6F"), "{error}");
    fs::write(empty.path().join("broken.zip"), b"PK\x03\x04 and no more").unwrap();
    assert!(matches!(load(&empty.path().join("broken.zip")), Err(Error::Container { .. })));
}
