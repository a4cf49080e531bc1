//! Dependencies that manifests declare, against the sources that use them.

use super::{File, extension, holds_word};

/// Every dependency of a crate's manifest is named in a source of that crate.
pub(super) fn declared_dependencies_are_used(files: &[File]) -> Vec<String> {
    let mut found = Vec::new();
    for manifest in files.iter().filter(|file| file.path.ends_with("Cargo.toml")) {
        let folder = manifest.path.trim_end_matches("Cargo.toml");
        let sources =
            || files.iter().filter(|file| extension(&file.path) == "rs" && owns(folder, &file.path));
        for name in declared(&manifest.text) {
            let identifier = name.replace('-', "_");
            if !sources().any(|source| holds_word(&source.text, &identifier)) {
                found.push(format!("{} declares {name}, which no source of the crate uses", manifest.path));
            }
        }
    }
    found
}

/// Whether the crate of a folder has a source. The root's are the files of `src/` itself and the
/// tests, but not those of the crate of benchmarks.
fn owns(folder: &str, source: &str) -> bool {
    if !folder.is_empty() {
        return source.starts_with(folder);
    }
    let is_own = source.strip_prefix("src/").is_some_and(|rest| !rest.contains('/'));
    is_own || source.starts_with("tests/") && !source.starts_with("tests/bench/")
}

/// The names in the tables of dependencies of a manifest.
fn declared(manifest: &str) -> Vec<&str> {
    let (mut is_table, mut names) = (false, Vec::new());
    for line in manifest.lines() {
        if let Some(header) = line.strip_prefix('[') {
            is_table = header.ends_with("dependencies]") && header != "workspace.dependencies]";
        } else if is_table && !line.starts_with('#') {
            names.extend(line.split(['.', ' ', '=']).next().filter(|name| !name.is_empty()));
        }
    }
    names
}
