//! Limits on memory and work: a size that a small file claims or unpacks to is refused before
//! memory is allocated.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::dicom::made;

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::dicom::made::SIZE;
use relief_dicom::{Discovery, Error, LoadLimits, Loaded, Strictness};

fn discover(path: &Path) -> Discovery {
    relief_dicom::discover(path, Strictness::Lenient, &|_| ()).unwrap()
}

fn load_within(voxel_bytes: u64, path: &Path) -> Result<Loaded, Error> {
    let limits = LoadLimits { voxel_bytes };
    relief_dicom::load_within(limits, discover(path).select(None)?, Strictness::Lenient, &|_| ())
}

/// A folder with one file of these bytes.
fn folder_of(bytes: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("made.dcm"), bytes).unwrap();
    folder
}

#[test]
fn a_volume_may_have_as_many_bytes_as_allowed_and_no_more() {
    let folder = folder_of(&made::slice());
    let bytes = (SIZE * SIZE * 2) as u64;
    assert_eq!(discover(folder.path()).series[0].voxel_bytes(), bytes);
    assert_eq!(load_within(bytes, folder.path()).unwrap().volume.voxels_hu().len(), SIZE * SIZE);
    let error = load_within(bytes - 1, folder.path()).unwrap_err();
    assert!(
        matches!(error, Error::TooLarge { needed, allowed } if needed == bytes && allowed == bytes - 1),
        "{error}"
    );
}

#[test]
fn the_grid_over_an_uneven_stack_is_limited_as_well() {
    let folder = tempfile::tempdir().unwrap();
    for (index, z) in [0.0, 1.0, 2.0, 8.0].into_iter().enumerate() {
        fs::write(folder.path().join(format!("{index}.dcm")), made::slice_at(z, index)).unwrap();
    }
    let slice = (SIZE * SIZE * 2) as u64;
    assert_eq!(load_within(slice * 9, folder.path()).unwrap().volume.grid().dims(), [SIZE, SIZE, 9]);
    let error = load_within(slice * 9 - 1, folder.path()).unwrap_err();
    assert!(matches!(error, Error::TooLarge { needed, .. } if needed == slice * 9), "{error}");
}

/// Invariant: Memory is bounded before it is allocated: volumes, zip entries, scans of an image.
#[test]
fn frames_that_are_only_claimed_are_refused() {
    // Half a megabyte, enough for a fragment's header for each frame, claims eight terabytes.
    let folder = folder_of(&made::compressed(65_535, [8192; 2], vec![0; 1 << 19]));
    let error =
        relief_dicom::load(&discover(folder.path()).series[0], Strictness::Lenient, &|_| ()).unwrap_err();
    let needed = 8192 * 8192 * 65_535 * 2;
    assert!(
        matches!(error, Error::TooLarge { needed: found, allowed } if found == needed && allowed == 16 << 30),
        "{error}"
    );
    let message = error.to_string();
    assert!(message.contains("needs 8388480 MiB") && message.contains("16384 MiB are allowed"), "{message}");
    // The largest image that attributes can express is not decoded.
    let folder = folder_of(&made::compressed(65_535, [65_535; 2], vec![0; 1 << 19]));
    let error = load_within(u64::MAX, folder.path()).unwrap_err().to_string();
    assert!(error.contains("found a frame of 65535 x 65535 pixels, expected at most 67108864"), "{error}");
}

#[test]
fn a_file_that_shrinks_between_its_header_and_its_pixels_is_an_error() {
    let folder = folder_of(&made::rle_slice());
    let found = discover(folder.path());
    let load = || relief_dicom::load(&found.series[0], Strictness::Lenient, &|_| ());
    let hu: Vec<i16> = made::stored().iter().map(|stored| stored + made::INTERCEPT).collect();
    assert_eq!(load().unwrap().volume.voxels_hu(), hu);
    let file = fs::OpenOptions::new().write(true).open(folder.path().join("made.dcm")).unwrap();
    for length in [2000, 1000, 400, 0] {
        file.set_len(length).unwrap();
        assert!(matches!(load(), Err(Error::NothingDecoded { slices: 1, .. })), "{length} bytes");
    }
}

/// A zip of one entry whose size in the zip's directory is `claimed`.
fn zip_with_claim(content: &[u8], claimed: Option<u32>) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    writer.start_file("slice.dcm", zip::write::SimpleFileOptions::default()).unwrap();
    writer.write_all(content).unwrap();
    let mut bytes = writer.finish().unwrap().into_inner();
    if let Some(claimed) = claimed {
        let entry = bytes.windows(4).rposition(|window| window == b"PK\x01\x02").unwrap();
        bytes[entry + 24..entry + 28].copy_from_slice(&claimed.to_le_bytes());
    }
    bytes
}

/// Invariant: Memory is bounded before it is allocated: volumes, zip entries, scans of an image.
#[test]
fn a_zip_entry_is_unpacked_up_to_its_stated_size_and_a_large_one_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study.zip");
    let slice = made::slice();
    fs::write(&path, zip_with_claim(&slice, None)).unwrap();
    assert_eq!(load_within(1 << 20, &path).unwrap().volume.grid().dims(), [SIZE, SIZE, 1]);
    let bomb = vec![0; 1 << 24]; // packs to a thousandth of its size
    for (content, claimed, expected) in [
        (&slice, 2_000_000_000, "slice.dcm: found a zip entry of 1907 MiB, expected at most 1024 MiB"),
        (&slice, 1000, "slice.dcm: cannot be read: File is larger than its declared"),
        (&bomb, 132, "slice.dcm: cannot be read: File is larger than its declared"),
    ] {
        fs::write(&path, zip_with_claim(content, Some(claimed))).unwrap();
        let error = load_within(1 << 20, &path).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}
