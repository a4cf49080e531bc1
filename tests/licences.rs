//! Keeps the licences of all dependencies permissive.
//!
//! Asks cargo for the packages that are built on this machine, tests and build scripts included, and reads
//! their licence expressions (SPDX). Packages of other systems are judged where they are built. IPOPT itself, a library that
//! the feature `ipopt` links dynamically, is no package: it is under the Eclipse Public License 2.0, as TRACKING.md says.
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

/// Licences that ask for no more than their own text to be kept. IJG is that of the JPEG group, Unicode-3.0
/// that of character tables.
const LICENCES: &[&str] = &[
    "MIT",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "MPL-2.0",
    "CC0-1.0",
    "IJG",
    "Unicode-3.0",
];

#[test]
fn dependencies_have_permissive_licences() {
    all_are_permissive(dependencies(&[]).expect("cargo tree"));
}

#[test]
fn dependencies_of_optional_features_have_permissive_licences() {
    match dependencies(&["--all-features"]) {
        Ok(packages) => all_are_permissive(packages),
        Err(error) => eprintln!("SKIPPED: licences of optional features ({})", error.replace('\n', " ")),
    }
}

fn all_are_permissive(packages: Vec<(String, String)>) {
    let found: Vec<_> = packages.into_iter().filter(|(_, licence)| !is_permissive(licence)).collect();
    assert!(found.is_empty(), "not among {LICENCES:?}: {found:?}");
}

#[test]
fn licence_expressions_are_read_as_they_bind() {
    for good in [
        "MIT",
        "GPL-3.0 OR MIT",
        "MIT/Apache-2.0",
        "(MIT OR GPL-2.0) AND ISC",
        "Apache-2.0 WITH LLVM-exception OR MIT",
    ] {
        assert!(is_permissive(good), "{good}");
    }
    for bad in [
        "",
        "GPL-3.0",
        "MIT AND GPL-3.0",
        "(GPL-2.0 OR GPL-3.0) AND MIT",
        "MIT AND (ISC",
        "Apache-2.0 WITH X",
        "MIT)",
    ] {
        assert!(!is_permissive(bad), "{bad}");
    }
}

/// Every package that is built into Relief or its tests on this machine, with its licence; or why cargo cannot tell: it
/// has not downloaded all of them.
fn dependencies(more: &[&str]) -> Result<Vec<(String, String)>, String> {
    let arguments =
        ["tree", "--locked", "--offline", "--edges", "all", "--prefix", "none", "--format", "{p}|{l}"];
    let output = std::process::Command::new(env!("CARGO"))
        .args(arguments)
        .args(more)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    if !output.status.success() {
        return Err(format!("cargo tree: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let lines = String::from_utf8(output.stdout).expect("cargo writes UTF-8");
    let packages: Vec<_> = lines.lines().filter_map(|line| line.split_once('|')).collect();
    assert!(packages.len() > 50, "cargo tree names only {} packages", packages.len());
    let read =
        |(name, licence): (&str, &str)| (name.to_owned(), licence.replace("(*)", "").trim().to_owned());
    Ok(packages.into_iter().map(read).collect())
}

/// Whether a licence expression (SPDX; `/` is an old way to write OR) can be met by the permissive licences
/// alone.
fn is_permissive(expression: &str) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<_> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    either(&mut rest) && rest.is_empty()
}

fn either(rest: &mut &[&str]) -> bool {
    let mut permissive = both(rest);
    while let Some(("OR", after)) = rest.split_first().map(|(word, after)| (*word, after)) {
        *rest = after;
        permissive |= both(rest);
    }
    permissive
}

fn both(rest: &mut &[&str]) -> bool {
    let mut permissive = one(rest);
    while let Some(("AND", after)) = rest.split_first().map(|(word, after)| (*word, after)) {
        *rest = after;
        permissive &= one(rest);
    }
    permissive
}

fn one(rest: &mut &[&str]) -> bool {
    let Some((word, after)) = rest.split_first() else { return false };
    *rest = after;
    if *word == "(" {
        let permissive = either(rest);
        let closed = rest.first() == Some(&")");
        *rest = &rest[usize::from(closed)..];
        return permissive && closed;
    }
    if rest.first() == Some(&"WITH") {
        // An exception would have to be read first; packages that have one offer a plain licence beside it.
        *rest = &rest[rest.len().min(2)..];
        return false;
    }
    LICENCES.contains(word)
}
