//! The manifests of `scripts/kubernetes`: Kubernetes' schemas take them, and Relief takes the
//! command lines in them.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::path::{Path, PathBuf};
use std::process::Command;

fn manifests() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/kubernetes");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 3, "{files:?}");
    files
}

/// The words of a container's `args`, which these files write one a line.
fn arguments(manifest: &str) -> Vec<String> {
    let lines = manifest.lines().skip_while(|line| line.trim() != "args:").skip(1);
    let words = lines.map_while(|line| line.trim().strip_prefix("- "));
    words.map(|word| word.trim_matches('"').replace("$(JOB_COMPLETION_INDEX)", "0")).collect()
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
///
/// Their files are not on this machine, so the commands fail; but with status 1 and not with 2,
/// which is for wrong arguments.
#[cfg(feature = "full")]
#[test]
fn relief_takes_the_command_lines_of_the_manifests() {
    let expected = [
        ("cannot read /data/jobs.jsonl", ["batch", "run"]),
        ("cannot read the credentials", ["batch", "work"]),
        ("cannot read /data/series/one", ["serve", "--series"]),
    ];
    for (path, (reason, head)) in manifests().iter().zip(expected) {
        let arguments = arguments(&std::fs::read_to_string(path).unwrap());
        assert_eq!(arguments[..2], head, "{}", path.display());
        let ran = Command::new(env!("CARGO_BIN_EXE_relief")).args(&arguments).output().unwrap();
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.code() == Some(1) && said.contains(reason), "{}: {said}", path.display());
    }
}

/// Invariant: No secret of a queue is shown, and Relief accepts the command lines of the Kubernetes
/// manifests.
#[test]
fn schemas_take_the_manifests() {
    let what = "manifests against Kubernetes' schemas";
    let python = std::env::var("RELIEF_MANIFESTS_PYTHON").ok().filter(|python| Path::new(python).exists());
    let Some(python) = python else {
        return eprintln!("SKIPPED: {what} (RELIEF_MANIFESTS_PYTHON is not set, see scripts/setup-services)");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/kubernetes/check.py");
    let check = |files: &[PathBuf]| Command::new(&python).arg(&script).args(files).output().unwrap();
    let checked = check(&manifests());
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    let lines: Vec<serde_json::Value> = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(lines.len(), 3);
    for (path, line) in manifests().iter().zip(&lines) {
        let words: Vec<&str> =
            line["line"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
        let replaced: Vec<_> =
            words[1..].iter().map(|word| word.replace("$(JOB_COMPLETION_INDEX)", "0")).collect();
        assert_eq!(replaced, arguments(&std::fs::read_to_string(path).unwrap()), "{}", path.display());
    }

    // The check itself: it finds errors.
    let good = std::fs::read_to_string(&manifests()[0]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (n, (from, to)) in [
        ("completions: 8", "completions: eight"),
        ("completions: 8", "completions: 9"),
        ("restartPolicy: Never", "restartPolicy: Always"),
        ("backoffLimitPerIndex", "backoffLimitForIndex"),
        ("- name: temporary\n          emptyDir", "- name: other\n          emptyDir"),
        ("values: [1, 2]", "values: [1, 75]"),
    ]
    .into_iter()
    .enumerate()
    {
        assert!(good.contains(from), "{from}");
        let bad = folder.path().join(format!("{n}.yaml"));
        std::fs::write(&bad, good.replace(from, to)).unwrap();
        assert!(!check(&[bad]).status.success(), "{from} as {to} is taken");
    }
}
