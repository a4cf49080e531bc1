//! The listing of the public API: for each crate the names that its root exports, with the
//! signatures of functions and methods.
//!
//! Reads formatted sources line by line; it is no compiler. A name that a macro makes is listed
//! without its kind.

use std::collections::{BTreeMap, BTreeSet};

use super::{File, extension};

/// Path of the listing.
pub(super) const LISTING: &str = "docs/public-api.txt";

/// The text of the listing; empty where there is no crate.
pub(super) fn listing(files: &[File]) -> String {
    let mut crates: BTreeMap<&str, Vec<&File>> = BTreeMap::new();
    for file in files.iter().filter(|file| extension(&file.path) == "rs") {
        if let Some((name, _)) = file.path.strip_prefix("src/").and_then(|path| path.split_once('/')) {
            crates.entry(name).or_default().push(file);
        }
    }
    let mut text = String::new();
    for (name, sources) in crates {
        let root = format!("src/{name}/lib.rs");
        let Some(root) = sources.iter().find(|file| file.path == root) else { continue };
        let exported = exports(&root.text);
        let mut items: BTreeMap<String, Item> =
            exported.iter().map(|name| (name.clone(), Item::default())).collect();
        for file in &sources {
            read(&file.text, &mut items);
        }
        text += &format!("relief_{name}\n");
        for (name, Item { declaration, methods }) in &items {
            text += &format!("    {}\n", declaration.as_ref().unwrap_or(name));
            text.extend(methods.iter().map(|method| format!("        {method}\n")));
        }
    }
    text
}

/// An exported name.
#[derive(Default)]
struct Item {
    /// Its first line, without body.
    declaration: Option<String>,
    /// Public functions and constants of its inherent implementations.
    methods: BTreeSet<String>,
}

/// The names that a root exports: by `pub use`, and those that it declares.
fn exports(root: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for statement in root.split("\npub use ").skip(1) {
        let Some((path, _)) = statement.split_once(';') else { continue };
        let list = path.rsplit_once("::").map_or(path, |(_, last)| last);
        let list = path.split_once('{').map_or(list, |(_, list)| list);
        for name in list.trim_end_matches('}').split(',') {
            let name = name.rsplit(" as ").next().unwrap_or(name).trim();
            names.extend((!name.is_empty()).then(|| name.to_owned()));
        }
    }
    names.extend(root.lines().filter_map(declared));
    names
}

/// The name that a line declares at the top of a file, if it is public.
fn declared(line: &str) -> Option<String> {
    let rest = line.strip_prefix("pub ")?;
    let mut words = rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty());
    let kinds = ["struct", "enum", "fn", "const", "trait", "type", "static"];
    let kind = words.find(|word| kinds.contains(word))?;
    let name = words.find(|word| *word != "fn" && *word != "unsafe")?;
    (kind != "use").then(|| name.to_owned())
}

/// Adds the public items of a file.
fn read(text: &str, items: &mut BTreeMap<String, Item>) {
    let lines: Vec<&str> = text.lines().collect();
    let mut of = None;
    for (at, line) in lines.iter().enumerate() {
        let is_block = || lines.get(at + 1).is_some_and(|next| next.ends_with('{'));
        if line.starts_with("#[cfg(test)]") && is_block() {
            return; // unit tests end a file
        }
        if *line == "}" {
            of = None;
        } else if line.starts_with("impl") && line.ends_with('{') && !line.contains(" for ") {
            of = implemented(line);
        } else if let Some(item) = declared(line).and_then(|name| items.get_mut(&name)) {
            item.declaration.get_or_insert_with(|| signature(&lines[at..]));
        } else if let (Some(name), Some(method)) = (&of, line.strip_prefix("    pub "))
            && !method.starts_with('(')
            && let Some(item) = items.get_mut(name)
        {
            item.methods.insert(signature(&lines[at..]).trim_start_matches("pub ").to_owned());
            debug_assert!(!method.is_empty());
        }
    }
}

/// The type of an inherent implementation.
fn implemented(line: &str) -> Option<String> {
    let rest = line.strip_prefix("impl")?;
    let rest = if rest.starts_with('<') { rest.split_once("> ")?.1 } else { rest.trim_start() };
    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    (!name.is_empty()).then_some(name)
}

/// From a declaration to its body or value, on one line.
fn signature(lines: &[&str]) -> String {
    let mut text = String::new();
    for line in lines {
        let line = line.trim();
        let end = line
            .strip_suffix('{')
            .or_else(|| line.strip_suffix(';'))
            .or_else(|| line.split_once(" = ").map(|(head, _)| head));
        text += end.unwrap_or(line).trim_end();
        if end.is_some() || line.ends_with('}') {
            break;
        }
        text += if line.ends_with('(') { "" } else { " " };
    }
    let text = text.replace(", )", ")").replace(" )", ")");
    text.trim_start_matches("pub ").trim().to_owned()
}
