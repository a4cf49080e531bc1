//! Links between the documents resolve, and the sources that they name exist.
//!
//! Anchors of headings follow the usual renderers of Markdown: lower case, hyphens for spaces, no
//! punctuation.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every Markdown file of the root and of `docs`, by its path from the root.
fn documents(root: &Path) -> BTreeMap<String, String> {
    let folders = [root.to_owned(), root.join("docs")];
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap());
    let paths = entries.map(|entry| entry.unwrap().path());
    let documents = paths.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let read = |path: PathBuf| {
        let name = path.strip_prefix(root).unwrap().to_string_lossy().into_owned();
        (name, std::fs::read_to_string(path).unwrap())
    };
    documents.map(read).collect()
}

/// The path from the root of a link in a document.
fn resolved(document: &str, target: &str) -> String {
    let mut path: Vec<&str> = document.split('/').collect();
    path.pop();
    for part in target.split('/') {
        match part {
            ".." => drop(path.pop()),
            part => path.push(part),
        }
    }
    path.join("/")
}

/// The text without its blocks of code.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

fn anchors(text: &str) -> Vec<String> {
    let headings = prose(text).filter(|line| line.starts_with('#'));
    let name = |line: &str| -> String {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(name).collect()
}

/// The targets of links and pictures, `](target)`.
fn targets(text: &str) -> Vec<&str> {
    let links = prose(text).flat_map(|line| line.split("](").skip(1));
    links.filter_map(|rest| rest.split_once(')').map(|(target, _)| target)).collect()
}

/// Invariant: Links between documents resolve.
#[test]
fn links_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documents = documents(root);
    let mut broken = Vec::new();
    let mut count = 0;
    for (name, text) in &documents {
        for target in targets(text).into_iter().filter(|target| !target.starts_with("http")) {
            count += 1;
            let (file, anchor) = target.split_once('#').map_or((target, None), |(f, a)| (f, Some(a)));
            let file = if file.is_empty() { name.clone() } else { resolved(name, file) };
            let is_there = root.join(&file).exists();
            let found = anchor.is_none_or(|anchor| {
                documents.get(&file).is_some_and(|text| anchors(text).iter().any(|name| name == anchor))
            });
            if !is_there || !found {
                broken.push(format!("{name}: {target}"));
            }
        }
    }
    assert!(count > 30, "links were found: {count}");
    assert_eq!(broken, Vec::<String>::new());
}

/// The text in back quotes that is a path of a source.
fn sources(text: &str) -> Vec<&str> {
    let quoted = prose(text).flat_map(|line| line.split('`').skip(1).step_by(2));
    let folders = ["src/", "shaders/", "tests/", "scripts/"];
    let is_source = |name: &str| folders.iter().any(|folder| name.starts_with(folder));
    quoted.map(|name| name.split([' ', ':']).next().unwrap_or(name)).filter(|name| is_source(name)).collect()
}

/// Sources that documents name exist.
#[test]
fn named_sources_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documents = documents(root);
    // The history of changes names sources of its time.
    let current = documents.iter().filter(|(name, _)| *name != "CHANGELOG.md");
    let named: Vec<_> =
        current.flat_map(|(name, text)| sources(text).into_iter().map(move |s| (name, s))).collect();
    let missing: Vec<_> = named.iter().filter(|(_, source)| !root.join(source).exists()).collect();
    assert!(named.len() > 30, "sources were found: {}", named.len());
    assert!(missing.is_empty(), "{missing:?}");
}
