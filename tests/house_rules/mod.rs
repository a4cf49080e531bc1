//! Rules of the project that no compiler and no linter checks.
//!
//! Every file begins with a description; files and functions are short; no mark of unfinished work,
//! path of one machine or address of a registry is left; scripts are runnable; shaders parse;
//! README and ARCHITECTURE list every subcommand and crate; crates use the dependencies that they
//! declare; the index of invariants is current.
//! Each rule is a function from files to complaints, and is tested with files that break it.

mod api;
mod circles;
mod invariants;
mod manifests;
mod rule;

use std::path::{Path, PathBuf};

const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 70;

/// Folders that are read, besides the files at the root.
const FOLDERS: &[&str] = &["src", "tests", "shaders", "scripts", "golden", "docs", ".ci"];

/// A text file: its path from the package's root and its content.
struct File {
    path: String,
    text: String,
    executable: bool,
}

type Rule = fn(&[File]) -> Vec<String>;

macro_rules! rules {
    ($($name:ident),* $(,)?) => {$(
        #[test]
        fn $name() {
            let found = rule::$name(&project());
            assert!(found.is_empty(), "{} complaints:\n{}", found.len(), found.join("\n"));
        }
    )*};
}

rules! {
    files_say_what_they_are,
    files_and_functions_are_short,
    nothing_unfinished_is_left,
    no_machine_is_named,
    scripts_are_runnable,
    shaders_parse,
    root_documents_are_there,
    readme_knows_every_subcommand,
    invariants_are_indexed,
    public_api_is_listed,
    crates_are_in_the_table,
    declared_dependencies_are_used,
    imports_make_no_circles,
    pages_export_what_is_imported,
}

#[test]
fn rules_about_files_find_what_breaks_them() {
    let long_file = "//! Long.\n".to_owned() + &"\n".repeat(MAX_FILE_LINES);
    let long_function = format!("//! Long.\nfn f() {{\n{}}}\n", "    g();\n".repeat(MAX_FUNCTION_LINES));
    let unfinished = format!("//! Head.\n// {}: finish\n", concat!("TO", "DO"));
    let machine = format!("//! Head.\nconst A: &str = \"{}x\";\n", concat!("/ho", "me/"));

    breaks(rule::files_say_what_they_are, &[("src/a.rs", "use b;")]);
    breaks(rule::files_say_what_they_are, &[("shaders/a.wgsl", "fn f() {}")]);
    keeps(rule::files_say_what_they_are, &[("src/a.rs", "//! Says."), ("shaders/a.wgsl", "// Says.")]);
    breaks(rule::files_and_functions_are_short, &[("src/a.rs", &long_file)]);
    breaks(rule::files_and_functions_are_short, &[("src/a.rs", &long_function)]);
    let restricted = long_function.replace("fn f", "pub(crate) fn f");
    breaks(rule::files_and_functions_are_short, &[("src/a.rs", &restricted)]);
    keeps(rule::files_and_functions_are_short, &[("src/a.rs", "//! A.\nfn f() {\n}")]);
    breaks(rule::nothing_unfinished_is_left, &[("src/a.rs", &unfinished)]);
    keeps(rule::nothing_unfinished_is_left, &[("scripts/a", "mktemp XXXXXX")]);
    breaks(rule::no_machine_is_named, &[("src/a.rs", &machine)]);
    breaks(rule::no_machine_is_named, &[("scripts/a", "curl https://example.org\n")]);
    breaks(rule::no_machine_is_named, &[("scripts/a", "curl http://buildhost/x\n")]);
    breaks(rule::no_machine_is_named, &[("scripts/a", "x=postgres://a:b@db.example.org:5432/x\n")]);
    keeps(
        rule::no_machine_is_named,
        &[("scripts/a", "curl http://127.0.0.1:80/ http://relief postgres://a@$host/b\n")],
    );
    keeps(rule::no_machine_is_named, &[("src/a.rs", "//! https://example.org/home/x, ../home/x")]);
    keeps(
        rule::no_machine_is_named,
        &[("scripts/a.yaml", "nats://nats:4222 s3://views http://127.0.0.1:80")],
    );
    breaks(rule::no_machine_is_named, &[("scripts/a.yaml", "s3://views, from https://example.org")]);
    breaks(rule::scripts_are_runnable, &[("scripts/a", "#!/bin/sh\ntrue\n")]);
    breaks(rule::scripts_are_runnable, &[("scripts/not-executable", "#!/bin/sh\n# A.\n")]);
    breaks(rule::scripts_are_runnable, &[("scripts/a", "# Names no interpreter.\n")]);
    breaks(rule::scripts_are_runnable, &[("scripts/a.json", "{\"title\": \"A\"}")]);
    keeps(
        rule::scripts_are_runnable,
        &[("scripts/a", "#!/bin/sh\n# A.\n"), ("scripts/a.sh", "# Sourced.\n")],
    );
    keeps(rule::scripts_are_runnable, &[("scripts/a.json", "{\"description\": \"A.\"}")]);
    breaks(rule::shaders_parse, &[("shaders/a.wgsl", "fn f( {}")]);
    breaks(rule::shaders_parse, &[("src/a.rs", "//! No shader at all.")]);
    keeps(rule::shaders_parse, &[("shaders/a.wgsl", "fn f() { g(); }"), ("shaders/lib/b.wgsl", "fn g() {}")]);
    let stage = ("shaders/a.wgsl", "fn f() { g(); }");
    keeps(rule::shaders_parse, &[stage, ("shaders/a/b.wgsl", "fn g() {}"), ("shaders/c.wgsl", "fn g() {}")]);
    breaks(rule::shaders_parse, &[stage, ("shaders/b/b.wgsl", "fn g() {}")]);
    let page = ("src/server/page/a.js", "export function f() {}\nexport const K = 1;\n");
    breaks(rule::pages_export_what_is_imported, &[page]);
    breaks(
        rule::pages_export_what_is_imported,
        &[page, ("src/server/page/b.js", "import { f } from \"./a.js\";")],
    );
    keeps(
        rule::pages_export_what_is_imported,
        &[page, ("src/server/page/b.js", "import { f,\n  K as k } from \"./a.js\";")],
    );
}

#[test]
fn circles_of_imports_are_found_through_facades_and_inner_modules() {
    let root = ("src/a/lib.rs", "mod b;\nmod c;\npub use b::B;\nuse c::C;");
    let facade = ("src/a/b/mod.rs", "mod d;\npub struct B;\nfn f() -> d::D { d::D }");
    let child = ("src/a/b/d.rs", "pub struct D;\nfn f(b: crate::B) {}");
    let c = ("src/a/c.rs", "pub struct C;");
    keeps(rule::imports_make_no_circles, &[root, ("src/a/b/mod.rs", "pub struct B;"), c]);
    keeps(rule::imports_make_no_circles, &[root, facade, child, c]);
    let through_c = ("src/a/c.rs", "use super::b::d::D;\npub struct C;");
    let child = ("src/a/b/d.rs", "pub struct D;\nmod inner {\n    use super::super::super::C;\n}");
    breaks(rule::imports_make_no_circles, &[root, facade, child, through_c]);
    let inside = ("src/a/b/d.rs", "pub struct D;\npub struct C;\nmod inner {\n    use super::C;\n}");
    keeps(rule::imports_make_no_circles, &[root, facade, inside, through_c]);
    let in_tests = ("src/a/b/d.rs", "pub struct D;\n#[cfg(test)]\nmod tests {\n    use crate::C;\n}");
    keeps(rule::imports_make_no_circles, &[root, facade, in_tests, through_c]);
}

#[test]
fn rules_about_documents_find_what_breaks_them() {
    let cli = (
        "src/cli/lib.rs",
        "enum Command {\n    /// Docs.\n    Phantom(phantom::Arguments),\n    GoldenCheck,\n}\n",
    );
    breaks(rule::root_documents_are_there, &[("README.md", "x")]);
    keeps(rule::root_documents_are_there, &ROOT_DOCUMENTS.map(|name| (name, "x")));
    breaks(rule::readme_knows_every_subcommand, &[("README.md", "relief phantom"), cli]);
    breaks(rule::readme_knows_every_subcommand, &[("README.md", "relief phantom"), ("src/cli/lib.rs", "")]);
    keeps(
        rule::readme_knows_every_subcommand,
        &[("README.md", "`relief phantom`, relief golden-check"), cli],
    );
    let tagged = ("tests/a.rs", "/// Invariant: One.\n#[test]\nfn down() {}\n");
    let index = "- One. Kept by: `tests/a.rs::down`\n";
    breaks(rule::invariants_are_indexed, &[("docs/INVARIANTS.md", index)]);
    breaks(rule::invariants_are_indexed, &[tagged, ("docs/INVARIANTS.md", "- Another.")]);
    let made = invariants::index(&made_up(&[tagged]));
    assert!(made.contains("One.") && made.contains("`tests/a.rs::down`"), "{made}");
    keeps(rule::invariants_are_indexed, &[tagged, ("docs/INVARIANTS.md", &made)]);

    let root = ("src/a/lib.rs", "mod b;\n\npub use b::{C, d};\n");
    let module = (
        "src/a/b.rs",
        "pub struct C;\n\nimpl C {\n    pub fn e(&self) -> u8 {\n        1\n    }\n}\n\npub fn d() {}\nfn f() {}\n",
    );
    let listed = api::listing(&made_up(&[root, module]));
    assert_eq!(listed, "relief_a\n    struct C\n        fn e(&self) -> u8\n    fn d() {}\n");
    keeps(rule::public_api_is_listed, &[root, module, ("docs/public-api.txt", &listed)]);
    let changed = module.1.replace("-> u8", "-> u16");
    breaks(rule::public_api_is_listed, &[root, ("src/a/b.rs", &changed), ("docs/public-api.txt", &listed)]);

    let map = ("ARCHITECTURE.md", "| crate | content | depends on |\n|---|---|---|\n| `a` | x | b |\n");
    let manifest =
        ("src/a/Cargo.toml", "[dependencies]\nrelief-b.workspace = true\nrelief-c.workspace = true\n");
    keeps(rule::crates_are_in_the_table, &[map, manifest]);
    breaks(rule::crates_are_in_the_table, &[map, ("src/d/Cargo.toml", "")]);
    breaks(rule::crates_are_in_the_table, &[map, ("src/a/Cargo.toml", "[dependencies]\n")]);

    let user = ("src/a/b/c.rs", "use relief_b::B;\nfn f() -> relief_c::C {}\n");
    keeps(rule::declared_dependencies_are_used, &[manifest, user]);
    breaks(rule::declared_dependencies_are_used, &[manifest, ("src/a/lib.rs", "use relief_b::B;\n")]);
    breaks(rule::declared_dependencies_are_used, &[manifest, ("src/d/lib.rs", user.1)]);
    let root = ("Cargo.toml", "[target.'cfg(unix)'.dev-dependencies]\nx-y = { version = \"1\" }\n");
    keeps(rule::declared_dependencies_are_used, &[root, ("tests/a/mod.rs", "x_y::f();")]);
    breaks(rule::declared_dependencies_are_used, &[root, ("tests/bench/lib.rs", "x_y::f();")]);
}

/// The rule finds something in these made-up files.
fn breaks(rule: Rule, files: &[(&str, &str)]) {
    assert!(!rule(&made_up(files)).is_empty(), "nothing was found in {files:?}");
}

/// The rule finds nothing in these made-up files.
fn keeps(rule: Rule, files: &[(&str, &str)]) {
    assert_eq!(rule(&made_up(files)), Vec::<String>::new(), "{files:?}");
}

const ROOT_DOCUMENTS: [&str; 7] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "LICENSE-MIT",
    "LICENSE-APACHE",
];

/// The project's text files. Pictures and other binary files are left out.
fn project() -> Vec<File> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(root).expect("the root can be read").flatten() {
        // `.git` is a file in a second worktree.
        let is_project_file = entry.path().is_file() && entry.file_name() != ".git";
        paths.extend(is_project_file.then(|| entry.path()));
    }
    for folder in FOLDERS.iter().map(|folder| root.join(folder)).filter(|folder| folder.exists()) {
        let files = walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().flatten();
        paths.extend(files.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path));
    }
    let files: Vec<_> = paths.iter().filter_map(|path| read(root, path)).collect();
    assert!(files.len() > 20, "only {} files were found: the rules would check nothing", files.len());
    files
}

fn read(root: &Path, path: &Path) -> Option<File> {
    let text = String::from_utf8(std::fs::read(path).expect("files can be read")).ok()?;
    let inner = path.strip_prefix(root).expect("walked from the root");
    Some(File { path: inner.to_string_lossy().replace('\\', "/"), text, executable: is_executable(path) })
}

#[cfg(unix)]
fn is_executable(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    std::fs::metadata(path).is_ok_and(|metadata| metadata.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_executable(_path: &Path) -> bool {
    true // not a property of files here
}

fn made_up(files: &[(&str, &str)]) -> Vec<File> {
    let file = |(path, text): &(&str, &str)| File {
        path: (*path).to_owned(),
        text: (*text).to_owned(),
        executable: !path.contains("not-executable"),
    };
    files.iter().map(file).collect()
}

fn find<'a>(files: &'a [File], path: &str) -> Option<&'a str> {
    files.iter().find(|file| file.path == path).map(|file| file.text.as_str())
}

fn extension(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.rsplit_once('.').map_or("", |(_, extension)| extension)
}

/// Whether `word` stands in `text` with no letter, digit or underscore on either side.
fn holds_word(text: &str, word: &str) -> bool {
    let inside = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        let (before, after) = (&text[..at], &text[at + word.len()..]);
        !before.ends_with(inside) && !after.starts_with(inside)
    })
}
