//! Volumes beyond what fits are refused by their headers, before they are read.
//!
//! Needs an adapter. With `RELIEF_REQUIRE_ADAPTER=1` a missing one fails; otherwise each test says
//! that it skipped.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use crate::common;
#[path = "../dicom/made.rs"]
mod dicom_made;

use std::process::Command;

use common::software_adapter;

/// Standard error of `relief render` with these arguments, which has to fail and to leave no file
/// behind.
fn refusal(rows_and_columns: [u16; 2], frames: u32, arguments: &[&str]) -> Option<String> {
    software_adapter("large volumes")?;
    let folder = tempfile::tempdir().unwrap();
    // A claim: there is room for each fragment's header and nothing more.
    let claim = dicom_made::compressed(frames, rows_and_columns, vec![0; 1 << 17]);
    std::fs::write(folder.path().join("made.dcm"), claim).unwrap();
    let out = folder.path().join("out.png");
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.env("RELIEF_ADAPTER", "software").args(["render", "--layout", "color", "--series"]);
    let output = command.arg(folder.path()).arg("--out").arg(&out).args(arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(!out.exists());
    Some(String::from_utf8(output.stderr).unwrap())
}

/// Invariant: Volumes stay within the memory limits of host and adapter: the least recently used is
/// evicted, and a volume that cannot fit is refused by its dimensions.
#[test]
fn two_thousand_slices_of_2048_by_2048_are_refused_before_they_are_read() {
    let Some(message) = refusal([2048; 2], 2000, &[]) else { return };
    let parts = [
        "the volume has [2048, 2048, 2000] voxels and needs 16777216000 bytes",
        "2147483648 are available",
        "--downsample 2",
    ];
    for part in parts {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
    // The rest of it has room.
    let Some(message) = refusal([2048; 2], 2000, &["--downsample", "2"]) else { return };
    assert!(!message.contains("are available"), "{message}");
}

#[test]
fn a_volume_over_the_memory_that_is_allowed_is_refused_before_it_is_read() {
    let Some(message) = refusal([512; 2], 1000, &["--gpu-memory", "100MiB"]) else { return };
    // 2 bytes a voxel, a brick a byte, and the transfer table.
    let needed = 512 * 512 * 1000 * 2 + 128 * 128 * 250 + 65_536;
    for part in
        [&format!("needs {needed} bytes"), "104857600 are available", "--downsample 2", "--gpu-memory"]
    {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
}

#[test]
fn a_volume_beyond_the_machines_memory_is_refused() {
    // 128 GiB of slices become 2 GiB on the adapter, but have to be read first.
    let Some(message) = refusal([4096; 2], 4096, &["--downsample", "4"]) else { return };
    assert!(message.contains("needs 131072 MiB") && message.contains("MiB are allowed"), "{message}");
}

#[test]
fn a_side_beyond_the_adapters_is_refused() {
    let Some(message) = refusal([512, 5000], 2, &["--gpu-memory", "64TiB"]) else { return };
    assert!(message.contains("[5000, 512, 2] voxels") && message.contains("along a side"), "{message}");
}
