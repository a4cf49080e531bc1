//! The index of invariants: made from the tests whose documentation begins a paragraph with
//! `Invariant:`.

use std::collections::BTreeMap;

use super::{File, extension};

/// Path of the index.
pub(super) const INDEX: &str = "docs/INVARIANTS.md";

/// The text of the index; empty where no test is tagged.
pub(super) fn index(files: &[File]) -> String {
    let mut keepers: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in files.iter().filter(|file| extension(&file.path) == "rs") {
        for (invariant, test) in tagged(&file.text) {
            keepers.entry(invariant).or_default().push(format!("`{}::{test}`", file.path));
        }
    }
    if keepers.is_empty() {
        return String::new();
    }
    let mut text = "# Invariants\n\nGuarantees of the tests. `scripts/bless` makes this page from the tests that begin a paragraph of their \
                    documentation with `Invariant:`.\n\n"
        .to_owned();
    for (invariant, tests) in keepers {
        text += &format!("- {invariant}\n  Kept by: {}\n", tests.join(", "));
    }
    text
}

/// Each tagged paragraph of a file's documentation comments, with the name of the test below it.
fn tagged(text: &str) -> Vec<(String, String)> {
    const TAG: &str = "Invariant: ";
    let mut found = Vec::new();
    let mut open: Vec<String> = Vec::new();
    let mut is_inside = false;
    for line in text.lines().map(str::trim) {
        let comment = line.strip_prefix("/// ").or_else(|| line.strip_prefix("// "));
        if let Some(comment) = comment {
            if let Some(start) = comment.strip_prefix(TAG) {
                open.push(start.to_owned());
                is_inside = true;
            } else if let Some(last) = open.last_mut().filter(|_| is_inside) {
                *last += " ";
                *last += comment;
            }
        } else if line == "///" {
            is_inside = false;
        } else if !line.starts_with("#[") && !open.is_empty() {
            // In a list from which a macro makes tests, only the name is given.
            let name = line.split_once("fn ").map_or(line, |(_, rest)| rest);
            let name: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            found.extend(open.drain(..).map(|invariant| (invariant, name.clone())));
            is_inside = false;
        }
    }
    found
}
