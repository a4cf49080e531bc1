//! Standard output and written files, for all subcommands: closed pipes, full disks, the umask.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const RELIEF: &str = env!("CARGO_BIN_EXE_relief");
/// A series that is made in no time.
const SMALL: [&str; 4] = ["--kind", "ramp", "--size", "16"];

fn make_series(folder: &Path) {
    let status =
        Command::new(RELIEF).arg("phantom").args(SMALL).arg("--out").arg(folder).output().unwrap().status;
    assert!(status.success());
}

/// Runs with a stdout whose reader has closed it.
fn run_unread(arguments: &[&str]) -> Output {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    Command::new(RELIEF).args(arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap()
}

#[test]
fn a_reader_that_has_gone_away_is_no_error() {
    let parent = tempfile::tempdir().unwrap();
    let series = parent.path().join("series");
    make_series(&series);
    let (series, other) = (series.to_str().unwrap(), parent.path().join("other"));
    let phantom = [&["phantom", "--out", other.to_str().unwrap()], &SMALL[..]].concat();
    for arguments in [&["inspect", series][..], &["inspect", series, "--json"], &phantom] {
        let output = run_unread(arguments);
        let reported = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), &*reported), (Some(0), ""), "{arguments:?}");
    }
    assert!(other.join("truth.json").is_file(), "the work is done all the same");
    assert_eq!(run_unread(&["inspect", "no/such/path"]).status.code(), Some(1), "other errors still count");
}

#[test]
#[cfg(target_os = "linux")]
fn results_that_cannot_be_written_are_an_error() {
    let parent = tempfile::tempdir().unwrap();
    let series = parent.path().join("series");
    make_series(&series);
    for options in [&[][..], &["--json"]] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output =
            Command::new(RELIEF).arg("inspect").arg(&series).args(options).stdout(full).output().unwrap();
        let reported = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{reported}");
        assert!(reported.starts_with("relief: cannot write to stdout: "), "{reported}");
    }
}

#[test]
fn a_series_is_as_private_as_the_umask_says() {
    let parent = tempfile::tempdir().unwrap();
    for (umask, folder, file) in [("077", 0o700, 0o600), ("022", 0o755, 0o644), ("002", 0o775, 0o664)] {
        let place = parent.path().join(umask);
        let script = format!("umask {umask}; exec \"$0\" \"$@\"");
        let mut shell = Command::new("sh");
        shell.args(["-c", &script, RELIEF, "phantom"]).args(SMALL).arg("--out").arg(&place);
        assert!(shell.output().unwrap().status.success());
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&place), folder, "umask {umask}");
        for name in ["slice-00001.dcm", "truth.json"] {
            assert_eq!(mode(&place.join(name)), file, "umask {umask}: {name}");
        }
    }
}
