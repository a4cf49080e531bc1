//! Hostile files on the command line: each is read in a child process, whose peak memory is
//! compared with a limit. Before its limits, each of these made a reader take gigabytes, run for
//! minutes or abort.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "the measured memory is worth reading")]

#[cfg(target_os = "linux")]
mod isolation;
mod mutated;

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::common::child::{Ended, run};
use crate::common::hostile::{
    DEFLATED_FRAME, JPEG_2000, RLE, Slice, deflated_zeros, element, empty_item, empty_rows, jp2_with_decoy,
    overlapping_zip, repeated, rle_frame, zip_of,
};

const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

/// `relief inspect --json` of a file with these bytes.
fn inspect(name: &str, bytes: &[u8], most_mib: u64) -> Ended {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    inspect_path(&path, most_mib)
}

fn inspect_path(path: &Path, most_mib: u64) -> Ended {
    let ended = run(Command::new(RELIEF).arg("inspect").arg(path).arg("--json"), most_mib);
    assert!(ended.status.code().is_some_and(|code| code < 100), "{}: {}", ended.status, ended.stderr);
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
    eprintln!("{} B: {} MiB", path.metadata().map_or(0, |file| file.len()), ended.peak_mib);
    ended
}

/// The reasons for which files were skipped, or the error.
fn reasons(ended: &Ended) -> String {
    let Ok(report) = serde_json::from_str::<Value>(&ended.stdout) else { return ended.stderr.clone() };
    let skipped = report["skipped"].as_array().unwrap();
    let reasons: Vec<&str> = skipped.iter().map(|one| one["reason"].as_str().unwrap()).collect();
    reasons.join("\n")
}

/// Invariant: A compressed frame takes the memory of its decoded image, whatever it unpacks to.
#[test]
fn compressed_frames_take_the_memory_of_their_image() {
    let slice = Slice::default();
    let deflated = slice.encapsulated(DEFLATED_FRAME, &deflated_zeros(1 << 30));
    let ended = inspect("deflated.dcm", &deflated, 300);
    assert!(reasons(&ended).contains("unpacks to more than the 8192 bytes"), "{}", reasons(&ended));

    for segments in [0xffff_fffe, 0xffff_ffff, 0x7fff_ffff, 0x1000_0000, 16, 15, 0] {
        let frame = rle_frame(segments, [64, 64], &[0; 64]);
        let ended = inspect("rle.dcm", &slice.encapsulated(RLE, &frame), 300);
        let expected = format!("found {segments} segments, expected 2");
        assert!(reasons(&ended).contains(&expected), "{}", reasons(&ended));
    }
    // 128 zeros from two bytes: 512 MiB for each byte of the samples.
    let packed = [0x81, 0].repeat(4 << 20);
    let frame = rle_frame(2, [64, 64 + 4096], &packed);
    let ended = inspect("packbits.dcm", &slice.encapsulated(RLE, &frame), 300);
    assert!(ended.status.success(), "a plane ends when it is full: {}", reasons(&ended));

    let decoy = slice.encapsulated(JPEG_2000, &jp2_with_decoy(64, 30_000));
    let ended = inspect("decoy.dcm", &decoy, 300);
    assert!(reasons(&ended).contains("the compressed image is 30000 x 30000 pixels"), "{}", reasons(&ended));
}

/// Invariant: Elements and items of a data set count in its memory, empty ones too.
#[test]
fn millions_of_empty_elements_and_items_are_refused() {
    for (unit, is_sequence) in [(empty_rows(), false), (empty_item(), true)] {
        let file = repeated(&unit, is_sequence, 64 << 20);
        let ended = inspect("many.dcm", &file, 500);
        let expected = "its elements and items take more than 64 MiB";
        assert!(reasons(&ended).contains(expected), "{} B: {}", file.len(), reasons(&ended));
    }
}

/// Invariant: What a reading keeps of headers has a limit, however many files share few bytes.
#[test]
fn files_that_share_few_bytes_keep_little() {
    let table = element([0x7fe0, 1], "OV", &vec![0; 1 << 24]);
    let slice = |number, late: &[u8]| Slice { number, late: late.to_vec(), ..Slice::default() };
    let file = slice(0, &table).encapsulated(RLE, &rle_frame(2, [64, 66], &[0x81, 0, 0x81, 0]));
    let overlapping = inspect("overlapping.zip", &overlapping_zip(&file, 1000), 300);
    assert!(overlapping.stderr.contains("its entries overlap"), "{}", overlapping.stderr);

    // Offset tables of 16 MiB for one frame each.
    let files = (0..24).map(|n| {
        let frame = rle_frame(2, [64, 66], &[0x81, 0, 0x81, 0]);
        (format!("{n}.dcm"), slice(n, &table).encapsulated(RLE, &frame))
    });
    inspect("tables.zip", &zip_of(files), 300);

    // 65,536 frames of one byte in each of many files.
    let files = (0..60).map(|number| {
        let slice = Slice { rows: 1, bits: 8, frames: Some(65_536), number, ..Slice::default() };
        (format!("{number}.dcm"), slice.native(&vec![0; 65_536]))
    });
    let ended = inspect("frames.zip", &zip_of(files), 1600);
    assert!(reasons(&ended).contains("need more than 1024 MiB"), "{}", reasons(&ended));
}

/// Invariant: A reason shows the beginning of a value, and a UID has at most a line.
#[test]
fn long_values_are_neither_kept_nor_repeated() {
    let uids = [[0x20, 0xd], [0x20, 0xe], [8, 0x18], [0x20, 0x52]];
    let long: Vec<u8> = uids.iter().flat_map(|tag| element(*tag, "UT", &vec![b'1'; 65_536])).collect();
    let unusable = element([0x28, 0x30], "UT", &vec![1; 65_536]);
    for (extra, late) in [(long, vec![]), (vec![], unusable)] {
        let files = (0..300).map(|number| {
            let slice = Slice { extra: extra.clone(), late: late.clone(), number, ..Slice::default() };
            (format!("{number}.dcm"), slice.native(&[0; 8192]))
        });
        let ended = inspect("long.zip", &zip_of(files), 300);
        assert!(reasons(&ended).contains("65536 bytes, expected at most 1024"), "{:.300}", reasons(&ended));
        assert!(ended.stdout.len() < 200_000, "{} bytes of output", ended.stdout.len());
    }
}

/// A pipe has no end to wait for, and links beside each other double a tree at every level.
#[cfg(unix)]
#[test]
fn pipes_and_trees_of_links_end() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    if Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
        let ended = inspect_path(&pipe, 300);
        assert!(ended.stderr.contains("neither a file nor a folder"), "{}", ended.stderr);
    }
    let tree = folder.path().join("tree");
    for level in 0..40 {
        let here = tree.join(format!("level{level}"));
        std::fs::create_dir_all(&here).unwrap();
        for side in ["left", "right"] {
            std::os::unix::fs::symlink(tree.join(format!("level{}", level + 1)), here.join(side)).unwrap();
        }
    }
    let ended = inspect_path(&tree.join("level0"), 500);
    assert!(ended.stderr.contains("found more than 20000 folders"), "{}", ended.stderr);
}

/// A second element `vertex` without properties claims corners that are not there.
#[test]
fn a_ply_file_has_each_element_once() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, log) = (folder.path().join("mesh.ply"), folder.path().join("log.db"));
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element vertex 100\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    std::fs::write(&mesh, format!("{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 50\n")).unwrap();
    let mut command = Command::new(RELIEF);
    command.args(["annotate", "--db"]).arg(&log).arg("import").arg(&mesh).args(["--author", "anna"]);
    let ended = run(&mut command, 300);
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("a second element vertex"), "{}", ended.stderr);
}

/// Rows of one name took the square of their number when they were merged.
#[test]
fn rows_of_one_name_are_merged_in_linear_time() {
    use std::fmt::Write;
    let folder = tempfile::tempdir().unwrap();
    let (table, log) = (folder.path().join("points.csv"), folder.path().join("log.db"));
    let mut rows = "label,l,p,s\n".to_owned();
    (0..20_000).for_each(|n| writeln!(rows, "A,{}.5,0,0", n % 5000).unwrap());
    std::fs::write(&table, rows).unwrap();
    for _ in 0..2 {
        let mut command = Command::new(RELIEF);
        command.args(["annotate", "--db"]).arg(&log).arg("import").arg(&table).args(["--author", "anna"]);
        let ended = run(&mut command, 600);
        assert!(ended.status.success(), "{}", ended.stderr);
    }
}

/// A profile of a picture that unpacks to a gigabyte is not unpacked: pixels do not need it.
#[test]
fn compressed_chunks_of_a_png_that_hold_no_pixels_stay_packed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    image::RgbImage::new(64, 64).save(&path).unwrap();
    let plain = std::fs::read(&path).unwrap();
    let mut profile = b"iCCPa\0\0\x78\x01".to_vec();
    profile.extend(deflated_zeros(1 << 30));
    let mut chunk = u32::try_from(profile.len() - 4).unwrap().to_be_bytes().to_vec();
    chunk.extend_from_slice(&profile);
    let mut crc = flate2::Crc::new();
    crc.update(&profile);
    chunk.extend(crc.sum().to_be_bytes());
    std::fs::write(&path, [&plain[..33], &chunk, &plain[33..]].concat()).unwrap();
    let ended = inspect_path(&path, 300);
    assert!(ended.stdout.contains("iCCP"), "{}{}", ended.stdout, ended.stderr);
}
