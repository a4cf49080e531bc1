//! Errors of a file are reported; no file makes the reader panic or allocate memory that the file
//! does not fill.

use super::{NRRD_FIELDS, file_of, gzipped, labels_of, nifti, nrrd};

#[test]
fn small_files_of_both_formats_are_read() {
    let voxels = [0, 1, 2, 2, 0, 9];
    for (name, bytes) in [
        ("a.nii", nifti([3, 2, 1], &voxels)),
        ("a.nii.gz", gzipped(&nifti([3, 2, 1], &voxels))),
        ("misnamed", gzipped(&nifti([3, 2, 1], &voxels))),
        ("a.nrrd", nrrd(NRRD_FIELDS, &voxels)),
        ("b.nrrd", nrrd(&NRRD_FIELDS.replace("raw", "gzip"), &gzipped(&voxels))),
    ] {
        let map = labels_of(name, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        let labels: Vec<u16> = map.segments().iter().map(|segment| segment.label).collect();
        assert_eq!((map.grid().dims(), labels), ([3, 2, 1], vec![1, 2, 9]), "{name}");
        assert_eq!(map.grid().spacing_mm(), [2.0; 3]);
    }
}

#[test]
fn nifti_2_and_big_endian_files_are_read() {
    let mut bytes = vec![0u8; 544];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &540i32.to_be_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &512i16.to_be_bytes());
    for (n, dim) in [3i64, 2, 1, 1, 1, 1, 1, 1].into_iter().enumerate() {
        put(16 + 8 * n, &dim.to_be_bytes());
    }
    put(168, &544i64.to_be_bytes());
    put(348, &1i32.to_be_bytes());
    for (row, at) in [400, 432, 464].into_iter().enumerate() {
        put(at + 8 * row, &1.5f64.to_be_bytes());
        put(at + 24, &7f64.to_be_bytes());
    }
    put(500, &2i32.to_be_bytes());
    bytes.extend([0x01, 0x00, 0x00, 0x05]);
    let map = labels_of("second.nii", &bytes).unwrap();
    let labels: Vec<u16> = map.segments().iter().map(|segment| segment.label).collect();
    assert_eq!(labels, [5, 256]);
    assert_eq!(map.grid().origin().xyz.to_array(), [-7.0, -7.0, 7.0]);
    assert_eq!(map.grid().spacing_mm(), [1.5; 3]);
}

#[test]
fn every_beginning_of_a_file_is_refused() {
    let (nii, nrrd) = (nifti([3, 2, 1], &[1; 6]), nrrd(NRRD_FIELDS, &[1; 6]));
    for whole in [nii, nrrd] {
        let packed = gzipped(&whole);
        for bytes in [&whole, &packed] {
            for cut in 0..bytes.len() {
                let outcome = labels_of("cut", &bytes[..cut]);
                // The last eight bytes of gzip are a check behind the last voxel.
                assert!(outcome.is_err() || cut + 10 > bytes.len(), "{cut} of {} bytes", bytes.len());
            }
        }
    }
}

#[test]
fn flipped_bits_end_in_an_error_or_a_map() {
    let gz = nrrd(&NRRD_FIELDS.replace("raw", "gzip"), &gzipped(&[1; 6]));
    for whole in [nifti([3, 2, 1], &[1; 6]), nrrd(NRRD_FIELDS, &[1; 6]), gz] {
        for at in 0..whole.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] ^= flip;
                let _ = labels_of("flipped", &damaged);
            }
        }
    }
}

/// Invariant: Label maps of other programs lie where those programs put them; damaged files, and
/// files that claim too much, end in an error.
#[test]
fn files_that_claim_more_than_they_hold_cost_what_they_hold() {
    // 2^30 voxels claimed, six present: cut short, without an allocation of a gigabyte.
    let huge = nifti([1024, 1024, 1024], &[1; 6]);
    let refused = labels_of("huge.nii", &huge).unwrap_err();
    assert!(refused.contains("found 6 bytes, expected 1073741824"), "{refused}");
    let larger = nifti([32767, 32767, 32767], &[1; 6]);
    let refused = labels_of("larger.nii.gz", &gzipped(&larger)).unwrap_err();
    assert!(refused.contains("allowed: at most 2147483648"), "{refused}");
    let layers = NRRD_FIELDS
        .replace("sizes: 3 2 1", "sizes: 64 1048576 1048576 1048576")
        .replace("directions: ", "directions: none ");
    assert!(labels_of("layers.nrrd", &nrrd(&layers, &[])).unwrap_err().contains("product addressable"));
    // A header without an end.
    let endless = gzipped(&[b"NRRD0004\n".as_slice(), &b"a: b\n".repeat(1 << 20)].concat());
    assert!(labels_of("endless.nrrd", &endless).unwrap_err().contains("more than 4194304 bytes"));
    let (_folder, path) = file_of("bomb.nii.gz", &gzipped(&nifti([512, 512, 64], &vec![0; 1 << 24])));
    let small = relief_dicom::FormatLimits { voxels: 1 << 23 };
    let refused = relief_dicom::read_labels_within(small, &path).unwrap_err().to_string();
    assert!(refused.contains("16777216 voxels, allowed: at most 8388608"), "{refused}");
}

/// Units of the axes of space (NRRD format, "space units"); the header's directions are 2.
#[test]
fn space_units_of_nrrd_are_obeyed() {
    for (units, mm) in [
        ("\"mm\" \"mm\" \"mm\"", [2.0, 2.0, 2.0]),
        ("\"um\" \"\u{b5}m\" \"microns\"", [2e-3, 2e-3, 2e-3]),
        ("\"cm\" \"m\" \"nm\"", [20.0, 2000.0, 2e-6]),
        ("\"\" \"\" \"\"", [2.0, 2.0, 2.0]),
        ("cm cm cm", [20.0, 20.0, 20.0]),
    ] {
        let fields = format!("{NRRD_FIELDS}space units: {units}\n");
        let map = labels_of("units.nrrd", &nrrd(&fields, &[1; 6]))
            .unwrap_or_else(|error| panic!("{units}: {error}"));
        let found = map.grid().spacing_mm();
        assert!(
            found.iter().zip(mm).all(|(found, mm)| (found / mm - 1.0).abs() < 1e-12),
            "{units}: {found:?}"
        );
    }
}

#[test]
fn invalid_fields_are_named_with_the_allowed_values() {
    let with = |at: usize, value: &[u8]| {
        let mut bytes = nifti([3, 2, 1], &[1; 6]);
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    let float = |values: [f32; 6]| {
        with(70, &16i16.to_le_bytes())
            .drain(..352)
            .chain(values.into_iter().flat_map(f32::to_le_bytes))
            .collect::<Vec<u8>>()
    };
    let field = |from: &str, to: &str| nrrd(&NRRD_FIELDS.replace(from, to), &[1; 6]);
    let cases: Vec<(Vec<u8>, &[&str])> = vec![
        (b"PK\x03\x04 a zip".to_vec(), &["neither NIfTI nor NRRD", "50 4B 03 04"]),
        (Vec::new(), &["begins with nothing"]),
        (with(344, b"ni1"), &["magic is ni1", "same file"]),
        (with(42, &0i16.to_le_bytes()), &["dim[1] is 0", "1 to 1048576"]),
        (with(48, &4i16.to_le_bytes()).tap(|b| b[40] = 4), &["dim[4] is 4", "take one out"]),
        (with(254, &0i16.to_le_bytes()), &["qform_code and sform_code is 0", "where its voxels lie"]),
        (with(280, &f32::NAN.to_le_bytes()), &["are not linearly independent"]),
        (with(70, &128i16.to_le_bytes()), &["datatype is 128"]),
        (with(108, &100f32.to_le_bytes()), &["vox_offset is 100", "352"]),
        (with(123, &[5]), &["xyzt_units is 5"]),
        (float([0.0, 1.0, 2.5, 0.0, 0.0, 0.0]), &["voxel 2 is 2.5", "0 to 65535"]),
        (float([0.0, -1.0, 0.0, 0.0, 0.0, 0.0]), &["voxel 1 is -1"]),
        (float([f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]), &["voxel 0 is NaN"]),
        (field("type: uchar", "type: block"), &["type is block"]),
        (field("encoding: raw", "encoding: bzip2"), &["encoding is bzip2", "raw, gzip"]),
        (field("encoding: raw", "encoding: raw\ndata file: /etc/passwd"), &["data file", "attached"]),
        (field("sizes: 3 2 1", "sizes: 3 2"), &["sizes is 3 2"]),
        (field("(2,0,0) (0,2,0) (0,0,2)", "(2,0,0) (0,2,0)"), &["space directions", "three vectors"]),
        (field("(2,0,0) (0,2,0) (0,0,2)", "(2,0,0) (0,2,0) (0,2,0)"), &["are not linearly independent"]),
        (field("type: uchar", "type: ushort"), &["endian is not there", "little, big"]),
        (field("encoding: raw", "encoding: raw\nbyte skip: -1"), &["byte skip is -1"]),
        (
            field("encoding: raw", "encoding: raw\nspace units: \"mm\" \"mm\" \"inch\""),
            &["space units is", "mm"],
        ),
        (
            field("encoding: raw", "encoding: raw\nspace units: \"mm\" \"mm\""),
            &["space units is", "three of"],
        ),
    ];
    for (bytes, parts) in cases {
        let message = labels_of("wrong", &bytes).unwrap_err();
        for part in parts {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
    }
    assert!(super::read(std::path::Path::new("nowhere.nii")).unwrap_err().contains("nowhere.nii"));
}

/// Changes a value in passing.
trait Tap: Sized {
    fn tap(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }
}

impl Tap for Vec<u8> {}
