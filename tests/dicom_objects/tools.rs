//! Programs by others: where they are, how they are run, and the message if they are missing.

#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs Python with the peers; `None` after saying aloud that `what` was not tested.
pub(crate) fn python(what: &str, script: &str, arguments: &[&Path]) -> Option<String> {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {what} (RELIEF_PEERS_PYTHON is not set)");
        return None;
    };
    let output =
        Command::new(python).arg("-W").arg("ignore").arg("-c").arg(script).args(arguments).output().unwrap();
    Some(said(&output))
}

/// The output of a program that must succeed.
fn said(output: &Output) -> String {
    let [out, err] =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success(), "{out}\n{err}");
    out
}

/// A program of dcmtk or dicom3tools: of scripts/setup-peers, else of the system.
fn dicom_tool(what: &str, name: &str) -> Option<PathBuf> {
    let own = std::env::var_os("RELIEF_DICOM_TOOLS").map(|folder| PathBuf::from(folder).join(name));
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found = own.into_iter().chain(std::env::split_paths(&folders).map(|folder| folder.join(name)));
    let found = found.into_iter().find(|path| path.is_file());
    if found.is_none() {
        eprintln!("SKIPPED: {what} ({name} is not there, see scripts/setup-peers)");
    }
    found
}

/// The output of dsrdump for a report, or its refusal; `None` where dsrdump is missing.
pub(crate) fn dsrdump(what: &str, file: &Path) -> Option<Result<String, String>> {
    let tool = dicom_tool(what, "dsrdump")?;
    let output = Command::new(tool).arg(file).output().unwrap();
    let text =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let is_bad = text.lines().any(|line| line.starts_with("E:") || line.starts_with("F:"));
    Some(if output.status.success() && !is_bad { Ok(text) } else { Err(text) })
}

/// The errors and warnings of dciodvfy about an object; `None` where it is not there.
pub(crate) fn dciodvfy(what: &str, file: &Path) -> Option<(Vec<String>, Vec<String>)> {
    let tool = dicom_tool(what, "dciodvfy")?;
    let output = Command::new(tool).arg("-new").arg(file).output().unwrap();
    let text =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let of = |kind: &str| text.lines().filter(|line| line.starts_with(kind)).map(str::to_owned).collect();
    assert!(!text.trim().is_empty(), "dciodvfy names the object at least");
    Some((of("Error"), of("Warning")))
}

/// The report as OHIF reads it; `None` after saying aloud that OHIF is missing.
pub(crate) fn ohif(what: &str, file: &Path) -> Option<serde_json::Value> {
    let Some(folder) = std::env::var_os("RELIEF_OHIF") else {
        eprintln!("SKIPPED: {what} (RELIEF_OHIF is not set, see scripts/setup-peers)");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dicom_objects/ohif.mjs");
    let output = Command::new("node").arg(script).arg(folder).arg(file).output().unwrap();
    let text = said(&output);
    let last = text.lines().last().unwrap_or_default();
    Some(serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {text}")))
}

/// A file of these bytes in a folder of its own.
pub(crate) fn file_of(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}
