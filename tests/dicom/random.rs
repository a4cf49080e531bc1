//! Random legal series of pydicom: identities, geometry, encodings, character sets, phases.
//!
//! The generator, `random_series.py`, states the volumes that each folder holds. 100 series in each run; RELIEF_RANDOM_SERIES
//! is the number of another run, from RELIEF_RANDOM_SEED on.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test that cannot go on fails, and speaks aloud"
)]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Stdio};

use data_encoding::HEXLOWER;
use relief_dicom::{Loaded, Phase, SeriesEntry, Strictness, discover, load};
use serde_json::Value;

use crate::common::numbers;

fn number(name: &str, usual: usize) -> usize {
    std::env::var(name).map_or(usual, |text| text.parse().unwrap())
}

/// All volumes of a folder, with their phases; an error where one cannot be loaded.
fn volumes(folder: &Path) -> Result<Vec<(Option<Phase>, Loaded)>, String> {
    let found = discover(folder, Strictness::Lenient, &|_| ()).map_err(|error| error.to_string())?;
    let loaded = |entry: &SeriesEntry| {
        let loaded = load(entry, Strictness::Lenient, &|_| ()).map_err(|error| error.to_string())?;
        Ok((entry.phase(), loaded))
    };
    found.series.iter().map(loaded).collect()
}

/// What is wrong with a volume, or nothing.
fn difference(loaded: &Loaded, expected: &Value, is_resampled: bool) -> Option<String> {
    let grid = loaded.volume.grid();
    let near = |what: &str, found: &[f64], tolerance: f64| {
        let expected = numbers(&expected[what]);
        let is_near = found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < tolerance);
        (!is_near).then(|| format!("{what}: {found:?}, expected {expected:?}"))
    };
    if is_resampled {
        return near("spacing_mm", &grid.spacing_mm()[..2], 1e-4);
    }
    near("dims", &grid.dims().map(|side| side as f64), 0.5)
        .or_else(|| near("spacing_mm", &grid.spacing_mm(), 1e-4))
        .or_else(|| near("origin_mm", &grid.origin().xyz.to_array(), 1e-3))
        .or_else(|| near("direction", &grid.direction(), 1e-5))
}

/// What is wrong with a folder, or nothing.
fn wrong(truth: &Value) -> Option<String> {
    let folder = Path::new(truth["folder"].as_str().unwrap());
    let found = match volumes(folder) {
        Ok(found) => found,
        Err(error) => return Some(format!("refused: {error}")),
    };
    let expected = truth["volumes"].as_array().unwrap();
    if found.len() != expected.len() {
        return Some(format!("{} volumes, expected {}", found.len(), expected.len()));
    }
    let owed: BTreeSet<&str> =
        truth["warnings"].as_array().unwrap().iter().map(|code| code.as_str().unwrap()).collect();
    for volume in expected {
        let is_same = |(_, loaded): &&(Option<Phase>, Loaded)| {
            volume["stack_sha256"] == HEXLOWER.encode(&loaded.stack_sha256())
        };
        let Some((phase, loaded)) = found.iter().find(is_same) else {
            return Some("other values".to_owned());
        };
        if let Some(difference) = difference(loaded, volume, owed.contains("uneven-spacing")) {
            return Some(difference);
        }
        let phase = phase.map(|phase| [phase.number, phase.count]);
        if serde_json::json!(phase) != volume["phase"] {
            return Some(format!("phase {phase:?}, expected {}", volume["phase"]));
        }
        let codes: BTreeSet<String> = loaded
            .warnings
            .iter()
            .map(|warning| serde_json::to_value(warning.code).unwrap().as_str().unwrap().to_owned())
            .collect();
        if !codes.iter().map(String::as_str).eq(owed.iter().copied()) {
            return Some(format!("warnings {codes:?}, expected {owed:?}"));
        }
    }
    None
}

/// Truth: the generator, which knows what it wrote.
/// Invariant: Slices become exactly the volumes that they belong to, or an error says why.
#[test]
fn random_series_are_read_as_they_were_written() {
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: random series (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let (count, seed) = (number("RELIEF_RANDOM_SERIES", 100), number("RELIEF_RANDOM_SEED", 0));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dicom/random_series.py");
    let mut failures = Vec::new();
    for first in (seed..seed + count).step_by(100) {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new(&python);
        command.args(["-W", "ignore"]).arg(&script).arg(folder.path());
        command.arg(first.to_string()).arg(100.min(seed + count - first).to_string());
        let output = command.env("PYTHONDONTWRITEBYTECODE", "1").stderr(Stdio::inherit()).output().unwrap();
        assert!(output.status.success());
        for line in String::from_utf8(output.stdout).unwrap().lines() {
            let truth: Value = serde_json::from_str(line).unwrap();
            let wrong = wrong(&truth);
            failures.extend(wrong.map(|wrong| format!("seed {}, {}: {wrong}", truth["seed"], truth["kind"])));
        }
    }
    assert!(failures.is_empty(), "{} of {count} series:\n{}", failures.len(), failures.join("\n"));
}
