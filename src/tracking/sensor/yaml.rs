//! As much YAML as camera files hold: nested maps of scalars and lists of numbers.
//!
//! Not a YAML parser: no anchors, no quoting beyond plain quotes, no lists of maps. It reads what
//! OpenCV's file storage writes (whose first line, `%YAML:1.0`, is no valid YAML) and what ROS
//! writes, lists over several lines included. A tag such as `!!opencv-matrix` is skipped.

use std::collections::BTreeMap;

/// A longer file is not a camera file.
pub(super) const MAX_BYTES: usize = 65_536;
const MAX_DEPTH: usize = 8;

/// Values by their path, keys joined by `/`: `camera_matrix/rows`.
pub(super) type Flat = BTreeMap<String, Value>;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Text(String),
    List(Vec<String>),
}

/// Text that is not the YAML of a camera file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {what}")]
pub struct YamlError {
    /// Line, from 1.
    pub line: usize,
    /// The fault at that place.
    pub what: &'static str,
}

struct Open {
    indent: usize,
    path: String,
}

pub(super) fn parse(text: &str) -> Result<Flat, YamlError> {
    if text.len() > MAX_BYTES {
        return Err(YamlError { line: 1, what: "the file has more than 65536 bytes" });
    }
    let mut flat = Flat::new();
    let mut open: Vec<Open> = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((at, raw)) = lines.next() {
        let line = at + 1;
        let content = without_comment(raw).trim_end();
        let body = content.trim_start();
        if body.is_empty() || body.starts_with('%') || matches!(body, "---" | "...") {
            continue;
        }
        let indent = content.len() - body.len();
        if let Some(item) = body.strip_prefix("- ") {
            let path = open.last().map(|open| open.path.clone());
            let path = path.ok_or(YamlError { line, what: "a list that belongs to no key" })?;
            push_item(&mut flat, path, item.trim());
            continue;
        }
        let (key, value) = body.split_once(':').ok_or(YamlError { line, what: "expected `key: value`" })?;
        open.retain(|parent| parent.indent < indent);
        if open.len() >= MAX_DEPTH {
            return Err(YamlError { line, what: "maps are nested too deeply" });
        }
        let path =
            open.last().map_or_else(|| key.trim().to_owned(), |o| format!("{}/{}", o.path, key.trim()));
        open.push(Open { indent, path: path.clone() });
        let value = without_tag(value.trim());
        if let Some(list) = value.strip_prefix('[') {
            let list =
                whole_list(list, &mut lines).ok_or(YamlError { line, what: "a list without its `]`" })?;
            flat.insert(path, Value::List(list));
        } else if !value.is_empty() {
            flat.insert(path, Value::Text(unquoted(value).to_owned()));
        }
    }
    Ok(flat)
}

/// The items up to `]`, which may be lines away.
fn whole_list<'a>(first: &str, lines: &mut impl Iterator<Item = (usize, &'a str)>) -> Option<Vec<String>> {
    let mut inside = first.to_owned();
    while !inside.contains(']') {
        inside.push(' ');
        inside.push_str(without_comment(lines.next()?.1));
    }
    let items = inside.split(']').next()?.split(',').map(str::trim);
    Some(items.filter(|item| !item.is_empty()).map(|item| unquoted(item).to_owned()).collect())
}

fn push_item(flat: &mut Flat, path: String, item: &str) {
    let item = unquoted(item).to_owned();
    match flat.entry(path).or_insert_with(|| Value::List(Vec::new())) {
        Value::List(items) => items.push(item),
        text @ Value::Text(_) => *text = Value::List(vec![item]),
    }
}

fn without_comment(line: &str) -> &str {
    let starts = |at: usize| at == 0 || line.as_bytes()[at - 1].is_ascii_whitespace();
    let comment = line.match_indices('#').map(|(at, _)| at).find(|at| starts(*at));
    comment.map_or(line, |at| &line[..at])
}

fn without_tag(value: &str) -> &str {
    if value.starts_with("!!") { value.split_once(' ').map_or("", |(_, rest)| rest.trim()) } else { value }
}

fn unquoted(value: &str) -> &str {
    let inside = |quote| value.strip_prefix(quote).and_then(|rest: &str| rest.strip_suffix(quote));
    inside('"').or_else(|| inside('\'')).unwrap_or(value)
}
