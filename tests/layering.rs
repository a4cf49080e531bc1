//! Keeps the module map: imports go down only, and each outside crate stays where it belongs.
//!
//! Reads `src/**/*.rs` as tokens, without comments and strings, and finds every path that leaves its own
//! module: `crate::x`, `super::` chains that reach the root, in `use` trees as in expressions, and names of
//! outside crates. It is no compiler: macros are read as they are written, and paths made by macros are not
//! seen. Unit tests in `src` obey the same rules as the code beside them.

use std::collections::BTreeMap;
use std::path::Path;

/// Every module of the library and its rank. A module may use modules of lower ranks, and itself.
const RANKS: &[(&str, u32)] = &[
    ("units", 0),
    ("space", 0),
    ("volume", 1),
    ("transfer", 1),
    ("camera", 1),
    ("tracking", 1),
    ("annotation", 1),
    ("gpu", 2),
    ("dicom", 2),
    ("formats", 2),
    ("display", 2),
    ("interaction", 2),
    ("mesh", 2),
    ("segmentation", 2),
    ("placing", 2),
    ("store", 2),
    ("render", 3),
    ("live", 3),
    ("exchange", 3),
    ("session", 4),
    ("server", 5),
    ("client", 5),
    ("batch", 5),
    ("cli", 6),
];

/// Pairs (user, used) of one rank that are allowed all the same.
const SAME_RANK: &[(&str, &str)] = &[];

const NETWORK: &[&str] = &["server", "client", "batch", "cli"];

/// Outside crates that belong to some modules only; a name that ends in `_` stands for every crate that
/// begins so.
const CRATES: &[(&str, &[&str])] = &[
    ("wgpu", &["gpu", "render"]),
    ("naga", &["gpu", "render"]),
    ("dicom_", &["dicom"]),
    ("axum", NETWORK),
    ("tokio", &["server", "client", "batch", "cli", "store"]),
    ("tokio_tungstenite", NETWORK),
    ("winit", &["client"]),
    ("softbuffer", &["client"]),
    ("tower", NETWORK),
    ("tower_http", NETWORK),
    ("nalgebra", &["tracking", "annotation"]),
    ("statrs", &["annotation", "cli"]),
    ("ipopt", &["tracking"]),
    ("async_nats", &["batch"]),
    ("object_store", &["batch"]),
    ("anyhow", &["cli"]),
    ("clap", &["cli"]),
    ("quick_xml", &["transfer", "formats", "exchange"]),
    ("sqlx", &["store"]),
    ("indicatif", &["cli"]),
    ("tiny_skia", &["cli"]),
    ("tracing_subscriber", &["cli"]),
];

#[test]
fn imports_go_down_only() {
    let found = violations_in_sources(&sources(), |v| matches!(v, Violation::Module(_)));
    assert!(found.is_empty(), "{} imports go up or sideways:\n{}", found.len(), found.join("\n"));
}

#[test]
fn outside_crates_stay_in_their_modules() {
    let found = violations_in_sources(&sources(), |v| matches!(v, Violation::Crate(_)));
    assert!(found.is_empty(), "{} uses of crates out of place:\n{}", found.len(), found.join("\n"));
}

/// The table in `lib.rs`, which people read, says the same as `RANKS`, which this test keeps.
#[test]
fn documented_ranks_are_the_ranks_kept() {
    let sources = sources();
    let library = &sources.iter().find(|(path, _)| path == "src/lib.rs").expect("src/lib.rs is there").1;
    let documented = ranks_in_documentation(library);
    assert!(!documented.is_empty(), "src/lib.rs has no table of ranks");
    for line in library.lines() {
        if let Some(module) = line.strip_prefix("pub mod ").and_then(|rest| rest.strip_suffix(';')) {
            assert_eq!(
                documented.get(module),
                rank(module).as_ref(),
                "rank of `{module}` in the table of src/lib.rs"
            );
        }
    }
}

/// The checker itself: each of these made-up files breaks one rule, which must be found.
#[test]
fn checker_finds_violations() {
    let bad = [
        ("src/volume/grid.rs", "use crate::render::Frame;", "volume (rank 1) uses render (rank 3)"),
        ("src/units.rs", "fn f() { crate::space::g() }", "units (rank 0) uses space (rank 0)"),
        ("src/gpu/mod.rs", "use crate::{units::A, dicom::{B, C}};", "gpu (rank 2) uses dicom (rank 2)"),
        ("src/camera/orbit.rs", "use super::super::cli::Arguments;", "camera (rank 1) uses cli (rank 6)"),
        (
            "src/camera/orbit.rs",
            "mod tests { use super::super::super::server; }",
            "camera (rank 1) uses server",
        ),
        ("src/camera/mod.rs", "use super::{units::A, session};", "camera (rank 1) uses session (rank 4)"),
        ("src/camera/a/b.rs", "use super::{c, super::super::display::D};", "camera (rank 1) uses display"),
        ("src/render/mod.rs", "use crate::*;", "`crate::*`"),
        ("src/render/mod.rs", "use crate::Volume;", "`crate::Volume`"),
        ("src/novelty.rs", "", "novelty has no rank"),
        ("src/main.rs", "fn main() { relief_render::go(); }", "uses render"),
        ("src/display/mod.rs", "use wgpu::Device;", "wgpu"),
        ("src/display/mod.rs", "use wgpu as graphics;", "wgpu"),
        ("src/display/mod.rs", "fn f(d: &::wgpu::Device) {}", "wgpu"),
        ("src/display/mod.rs", "use {exr, dicom_object as d};", "dicom_object"),
        ("src/render/mod.rs", "#[tokio::test] async fn f() {}", "tokio"),
        ("src/render/mod.rs", "extern crate anyhow;", "anyhow"),
    ];
    for (path, source, expected) in bad {
        let found = violations_in_sources(&[(path.to_owned(), source.to_owned())], |_| true);
        assert!(found.len() == 1 && found[0].contains(expected), "{path}: {source}\n found {found:?}");
    }
}

#[test]
fn checker_allows_what_is_allowed() {
    let good = [
        ("src/render/mod.rs", "use crate::{camera::Camera, units::{ViewDepth, self}}; use wgpu::Device;"),
        ("src/render/passes/cast.rs", "use super::super::request::Mode; pub(in crate::render) fn f() {}"),
        ("src/volume/grid.rs", "mod tests { use super::*; use super::super::Volume; }"),
        (
            "src/volume/mod.rs",
            "//! See [`crate::render`].\n/* crate::cli::x /* nested */ wgpu::Y */ // tokio::z",
        ),
        (
            "src/volume/mod.rs",
            r##"const A: &str = "crate::cli"; const B: &str = r#"wgpu::"x"#; const C: char = '"';"##,
        ),
        ("src/volume/mod.rs", "fn f<'a>(x: &'a str) -> &'a str { x.crate_name(); self::grid::y(x) }"),
        ("src/cli/mod.rs", "mod render; fn f() { render::run(); crate::render::g(); anyhow::bail!(\"\") }"),
        ("src/main.rs", "fn main() -> ExitCode { relief_cli::main() }"),
        ("src/lib.rs", "pub mod camera; pub use camera::Camera;"),
    ];
    for (path, source) in good {
        let found = violations_in_sources(&[(path.to_owned(), source.to_owned())], |_| true);
        assert!(found.is_empty(), "{path}: {source}\n found {found:?}");
    }
}

#[test]
#[should_panic(expected = "no source files")]
fn checker_refuses_to_pass_over_nothing() {
    violations_in_sources(&[], |_| true);
}

enum Violation {
    Module(String),
    Crate(String),
}

/// All of `src` as (path from the package's root, text), in a fixed order.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    for entry in walkdir::WalkDir::new(root.join("src")).sort_by_file_name() {
        let entry = entry.expect("src can be read");
        if entry.path().extension().is_some_and(|extension| extension == "rs") {
            let path = entry.path().strip_prefix(root).expect("walked from the root");
            let path = path.to_string_lossy().replace('\\', "/");
            sources.push((path, std::fs::read_to_string(entry.path()).expect("sources are UTF-8")));
        }
    }
    sources
}

/// Every violation of the wanted kind, as `path:line: what`.
fn violations_in_sources(sources: &[(String, String)], wanted: impl Fn(&Violation) -> bool) -> Vec<String> {
    assert!(!sources.is_empty(), "no source files: nothing would be checked");
    let mut lines = Vec::new();
    for (path, source) in sources {
        for (line, violation) in violations(path, source) {
            if wanted(&violation) {
                let (Violation::Module(text) | Violation::Crate(text)) = violation;
                lines.push(format!("{path}:{line}: {text}"));
            }
        }
    }
    lines.dedup(); // one statement may import several things from one place
    lines
}

/// Violations of one file with their lines.
fn violations(path: &str, source: &str) -> Vec<(usize, Violation)> {
    let module = module_path(path);
    let owner = module.first().copied();
    let mut found = Vec::new();
    if let Some(owner) = owner.filter(|owner| *owner != "main" && rank(owner).is_none()) {
        found
            .push((1, Violation::Module(format!("{owner} has no rank; give it one in DESIGN and in RANKS"))));
    }
    for (line, target) in references(module.len(), &tokens(source)) {
        let violation = match target {
            Target::Module(used) => module_violation(owner, &used).map(Violation::Module),
            Target::Crate(name) => crate_violation(owner, &name).map(Violation::Crate),
        };
        found.extend(violation.map(|violation| (line, violation)));
    }
    found
}

fn rank(module: &str) -> Option<u32> {
    RANKS.iter().find(|(name, _)| *name == module).map(|(_, rank)| *rank)
}

/// `owner` is `None` for the root, `main` for the binary.
fn module_violation(owner: Option<&str>, used: &str) -> Option<String> {
    let Some(used_rank) = rank(used) else {
        return Some(format!("`crate::{used}` does not say which module it uses"));
    };
    match owner {
        None => None,
        Some("main") => {
            (used != "cli").then(|| format!("the binary uses {used}; it may use `relief_cli` alone"))
        }
        Some(owner) if owner == used || SAME_RANK.contains(&(owner, used)) => None,
        Some(owner) => {
            let owner_rank = rank(owner)?; // reported once for the file
            (used_rank >= owner_rank)
                .then(|| format!("{owner} (rank {owner_rank}) uses {used} (rank {used_rank})"))
        }
    }
}

fn crate_violation(owner: Option<&str>, name: &str) -> Option<String> {
    let matches = |rule: &str| if rule.ends_with('_') { name.starts_with(rule) } else { name == rule };
    let (_, homes) = CRATES.iter().find(|(rule, _)| matches(rule))?;
    let owner = owner.unwrap_or("the root");
    (!homes.contains(&owner))
        .then(|| format!("{owner} uses the crate {name}, which belongs in {}", homes.join(", ")))
}

/// `src/volume/grid.rs` is `[volume, grid]`; `src/lib.rs` is the root, `[]`.
fn module_path(path: &str) -> Vec<&str> {
    let inner = path.trim_start_matches("src/").trim_end_matches(".rs");
    inner.split('/').filter(|part| *part != "mod" && *part != "lib").collect()
}

/// The ranks of a table like ``| 0 | [`units`], [`space`] |`` in a module's documentation.
fn ranks_in_documentation(library: &str) -> BTreeMap<&str, u32> {
    let mut ranks = BTreeMap::new();
    for line in library.lines().filter_map(|line| line.strip_prefix("//! | ")) {
        let Some((rank, modules)) = line.split_once(" | ") else { continue };
        let Ok(rank) = rank.trim().parse::<u32>() else { continue };
        ranks.extend(modules.split('`').skip(1).step_by(2).map(|module| (module, rank)));
    }
    ranks
}

#[derive(Debug, PartialEq)]
enum Target {
    /// A module of the library's root, or whatever else a path names there.
    Module(String),
    /// The first name of a path that is not relative to this crate.
    Crate(String),
}

/// What the paths of a file name outside their own module. `depth` is that of the file's module below the
/// root.
fn references(depth: usize, tokens: &[Token]) -> Vec<(usize, Target)> {
    let mut found = Vec::new();
    let mut braces = 0_usize;
    let mut inline_modules = Vec::new(); // the brace depth at which each opens
    let mut i = 0;
    while i < tokens.len() {
        let text = |offset: usize| tokens.get(i + offset).map_or("", |token: &Token| token.text.as_str());
        match text(0) {
            "{" => braces += 1,
            "}" => {
                braces = braces.saturating_sub(1);
                inline_modules.pop_if(|opened| *opened == braces);
            }
            "mod" if text(2) == "{" => inline_modules.push(braces),
            _ => {}
        }
        if let Some(start) = path_start(tokens, i) {
            let mut paths = Vec::new();
            let end = read_paths(tokens, start, &mut Vec::new(), &mut paths);
            let depth = depth + inline_modules.len();
            found.extend(paths.iter().filter_map(|path| Some((tokens[start].line, resolve(depth, path)?))));
            i = end.max(i + 1);
        } else {
            i += 1;
        }
    }
    found
}

/// Where the path that begins at token `i` has its first name, if one begins there: after `use` and `extern
/// crate`, or at a name followed by `::`.
fn path_start(tokens: &[Token], i: usize) -> Option<usize> {
    let text = |i: usize| tokens.get(i).map_or("", |token| token.text.as_str());
    let before = if i > 0 { text(i - 1) } else { "" };
    match text(i) {
        "use" => Some(i + 1),
        "extern" if text(i + 1) == "crate" => Some(i + 2),
        name if is_name(name) && text(i + 1) == "::" && before != "." && before != "in" => Some(i),
        _ => None,
    }
}

/// Reads a path or a tree of paths from token `i` on; returns the token after it.
fn read_paths(
    tokens: &[Token],
    mut i: usize,
    prefix: &mut Vec<String>,
    paths: &mut Vec<Vec<String>>,
) -> usize {
    let text = |i: usize| tokens.get(i).map_or("", |token| token.text.as_str());
    let outer = prefix.len();
    loop {
        match text(i) {
            "::" => i += 1, // between names, and before a path that begins at the outside crates
            "{" => {
                i += 1;
                while !matches!(text(i), "}" | "") {
                    i = read_paths(tokens, i, prefix, paths);
                    while !matches!(text(i), "," | "}" | "") {
                        i += 1; // `as name`
                    }
                    i += usize::from(text(i) == ",");
                }
                prefix.truncate(outer);
                return i + 1;
            }
            name if is_name(name) || name == "*" => {
                prefix.push(name.to_owned());
                i += 1;
                if text(i) != "::" {
                    break;
                }
            }
            _ => break, // `::<T>`
        }
    }
    paths.push(prefix.clone());
    prefix.truncate(outer);
    i
}

/// What a path names from a module `depth` below the root; `None` where it stays inside that module's
/// ancestors.
fn resolve(depth: usize, path: &[String]) -> Option<Target> {
    let mut names = path.iter().map(String::as_str).filter(|name| *name != "self").peekable();
    match *names.peek()? {
        "crate" | "relief" => Some(Target::Module(names.nth(1)?.to_owned())),
        "super" => {
            let mut climbed = 0;
            while names.next_if_eq(&"super").is_some() {
                climbed += 1;
            }
            let at_root = climbed >= depth;
            at_root.then(|| names.next())?.map(|name| Target::Module(name.to_owned()))
        }
        name => Some(Target::Crate(name.to_owned())),
    }
}

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// A name, `::`, or one other character, with its line (from 1).
struct Token {
    text: String,
    line: usize,
}

/// The tokens of a source without blanks, comments, strings, characters and numbers' digits kept apart from
/// names.
fn tokens(source: &str) -> Vec<Token> {
    let mut tokens = Vec::new();
    let (mut rest, mut line) = (source, 1);
    while let Some(first) = rest.chars().next() {
        let (text, length) = if let Some(length) = skipped_length(rest) {
            ("", length)
        } else if first.is_alphanumeric() || first == '_' {
            let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
            (&rest[..length], length)
        } else if rest.starts_with("::") {
            ("::", 2)
        } else {
            (&rest[..first.len_utf8()], first.len_utf8())
        };
        if !text.is_empty() {
            tokens.push(Token { text: text.to_owned(), line });
        }
        line += rest[..length].matches('\n').count();
        rest = &rest[length..];
    }
    tokens
}

/// Length of the blank, comment, string or character literal at the start, if there is one.
fn skipped_length(rest: &str) -> Option<usize> {
    if rest.starts_with(char::is_whitespace) {
        return Some(rest.find(|c: char| !c.is_whitespace()).unwrap_or(rest.len()));
    }
    if rest.starts_with("//") {
        return Some(rest.find('\n').unwrap_or(rest.len()));
    }
    if rest.starts_with("/*") {
        return Some(block_comment_length(rest));
    }
    if let Some(length) = raw_string_length(rest) {
        return Some(length);
    }
    let quoted = rest.strip_prefix(['b', 'c']).unwrap_or(rest);
    let prefix = rest.len() - quoted.len();
    if quoted.starts_with('"') {
        return Some(prefix + quoted_length(quoted, '"'));
    }
    // A quote and a name without a closing quote is a lifetime.
    let mut characters = quoted.chars();
    let is_character = characters.next() == Some('\'')
        && (characters.next() == Some('\\') || characters.next() == Some('\''));
    is_character.then(|| prefix + quoted_length(quoted, '\''))
}

fn quoted_length(rest: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        if c == quote && !escaped {
            return at + 1;
        }
        escaped = c == '\\' && !escaped;
    }
    rest.len()
}

fn block_comment_length(rest: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < rest.len() {
        if rest[at..].starts_with("/*") {
            depth += 1;
            at += 2;
        } else if rest[at..].starts_with("*/") {
            depth -= 1;
            at += 2;
        } else {
            at += rest[at..].chars().next().map_or(1, char::len_utf8);
        }
        if depth == 0 {
            break;
        }
    }
    at
}

fn raw_string_length(rest: &str) -> Option<usize> {
    let after_r =
        rest.strip_prefix("br").or_else(|| rest.strip_prefix("cr")).or_else(|| rest.strip_prefix('r'))?;
    let hashes = after_r.len() - after_r.trim_start_matches('#').len();
    let body = after_r[hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    let body_start = rest.len() - body.len();
    Some(body_start + body.find(&end).map_or(body.len(), |at| at + end.len()))
}
