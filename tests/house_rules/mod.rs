//! Rules of the project that no compiler and no linter checks.
//!
//! Every file begins with a description; files and functions are short; no mark of unfinished work, path of one machine or address
//! of a registry is left; scripts are runnable; shaders parse; README and ARCHITECTURE list every subcommand and crate; the index of
//! invariants is current. Each rule is a function from files to complaints, and is tested with files that break it.

mod api;
mod invariants;

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
    keeps(
        rule::scripts_are_runnable,
        &[("scripts/a", "#!/bin/sh\n# A.\n"), ("scripts/a.sh", "# Sourced.\n")],
    );
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

mod rule {
    use super::{
        File, MAX_FILE_LINES, MAX_FUNCTION_LINES, ROOT_DOCUMENTS, api, extension, find, holds_word,
        invariants,
    };

    pub(super) fn files_say_what_they_are(files: &[File]) -> Vec<String> {
        let heads = [("rs", "//! "), ("wgsl", "// ")];
        let mut found = Vec::new();
        for (kind, head) in heads {
            for file in
                files.iter().filter(|file| extension(&file.path) == kind && !file.text.starts_with(head))
            {
                found.push(format!(
                    "{} does not begin with a comment ({head}) that says what it is",
                    file.path
                ));
            }
        }
        found
    }

    pub(super) fn files_and_functions_are_short(files: &[File]) -> Vec<String> {
        let mut found = Vec::new();
        for file in files.iter().filter(|file| matches!(extension(&file.path), "rs" | "wgsl")) {
            let lines = file.text.lines().count();
            if lines >= MAX_FILE_LINES {
                found.push(format!("{} has {lines} lines; the most is {}", file.path, MAX_FILE_LINES - 1));
            }
            for (at, length) in
                functions(&file.text).into_iter().filter(|(_, length)| *length > MAX_FUNCTION_LINES)
            {
                found.push(format!(
                    "{}:{at}: a function of {length} lines; the most is {MAX_FUNCTION_LINES}",
                    file.path
                ));
            }
        }
        found
    }

    /// Line and length of each function. The formatter puts its closing brace under its beginning.
    fn functions(text: &str) -> Vec<(usize, usize)> {
        let lines: Vec<_> = text.lines().collect();
        let mut functions = Vec::new();
        for (start, line) in lines.iter().enumerate() {
            let code = line.trim_start();
            // `pub(crate) fn f(`: the parenthesis of the visibility is not that of the parameters.
            let item = code
                .strip_prefix("pub(")
                .and_then(|rest| rest.split_once(") "))
                .map_or(code, |(_, item)| item);
            let is_function = item.split(['(', '<']).next().is_some_and(|head| holds_word(head, "fn"));
            if !is_function || code.starts_with("//") || code.ends_with([';', '}']) {
                continue;
            }
            let close = format!("{}}}", &line[..line.len() - code.len()]);
            if let Some(length) = lines[start..].iter().position(|line| *line == close) {
                functions.push((start + 1, length + 1));
            }
        }
        functions
    }

    pub(super) fn nothing_unfinished_is_left(files: &[File]) -> Vec<String> {
        // Put together here, so that this file does not find itself.
        let marks = [
            concat!("TO", "DO"),
            concat!("FIX", "ME"),
            concat!("XX", "X"),
            concat!("HA", "CK"),
            concat!("(to ", "come)"),
        ];
        complaints(files, |_, line| marks.into_iter().find(|mark| holds_word(line, mark)).map(str::to_owned))
    }

    pub(super) fn no_machine_is_named(files: &[File]) -> Vec<String> {
        let roots =
            [concat!("/ho", "me/"), concat!("/ro", "ot/"), concat!("/wo", "rk/"), concat!("/Us", "ers/")];
        complaints(files, |file, line| {
            let path = roots.into_iter().find(|root| {
                let outside = |c: char| !(c.is_alphanumeric() || matches!(c, '.' | '_' | '-' | '}'));
                line.match_indices(root).any(|(at, _)| line[..at].chars().next_back().is_none_or(outside))
            });
            // Where packages come from is the machine's configuration, not the project's. Services are no such places.
            let is_script = file.path.starts_with("scripts/") || file.path.starts_with(".ci/");
            path.or_else(|| is_script.then(|| outside_host(line)).flatten()).map(str::to_owned)
        })
    }

    /// Placeholders, and services in a network of their own.
    const OWN_HOSTS: [&str; 6] = ["HOST", "localhost", "0.0.0.0", "relief", "nats", "postgres"];

    /// The host of an address that is neither this machine, nor a service's name in a network of its own, nor a variable.
    fn outside_host(line: &str) -> Option<&str> {
        line.match_indices("://").find_map(|(at, mark)| {
            let rest = &line[at + mark.len()..];
            let authority = rest.split(|c: char| c.is_whitespace() || "/\"'`\\);".contains(c)).next()?;
            let host = authority.rsplit('@').next()?.split(':').next()?;
            let is_loopback = host.parse::<std::net::Ipv4Addr>().is_ok_and(|host| host.is_loopback());
            let is_own = host.is_empty() || host.starts_with(['$', '%', '}']) || OWN_HOSTS.contains(&host);
            let is_bucket = line[..at].ends_with("s3");
            (!is_own && !is_loopback && !is_bucket).then_some(host)
        })
    }

    pub(super) fn scripts_are_runnable(files: &[File]) -> Vec<String> {
        let mut found = Vec::new();
        for file in
            files.iter().filter(|file| file.path.starts_with("scripts/") || file.path.starts_with(".ci/"))
        {
            let is_run = extension(&file.path).is_empty();
            let mut lines = file.text.lines();
            if is_run && !(file.executable && lines.next().is_some_and(|line| line.starts_with("#!"))) {
                found.push(format!("{} is not executable or names no interpreter", file.path));
            }
            if !lines.next().is_some_and(|line| line.starts_with("# ")) {
                found.push(format!("{} does not begin with a comment that says what it does", file.path));
            }
        }
        found
    }

    /// Each stage parses as it is, or together with all of `shaders/lib`; declarations may come in any order.
    pub(super) fn shaders_parse(files: &[File]) -> Vec<String> {
        let shaders = files.iter().filter(|file| extension(&file.path) == "wgsl");
        let (library, others): (Vec<_>, Vec<_>) =
            shaders.partition(|file| file.path.starts_with("shaders/lib/"));
        // One of the tables joins each stage: with none of them a stage has to do without.
        let (tables, stages): (Vec<_>, Vec<_>) =
            others.into_iter().partition(|file| file.path.starts_with("shaders/table/"));
        // A folder beside a stage has parts of that stage alone.
        let (parts, stages): (Vec<_>, Vec<_>) =
            stages.into_iter().partition(|file| file.path.matches('/').count() > 1);
        let parts_of = |stage: &str| -> String {
            let folder = stage.replace(".wgsl", "/");
            let own = parts.iter().filter(|part| part.path.starts_with(&folder));
            own.map(|part| part.text.as_str()).collect()
        };
        let tables: Vec<&str> = tables.iter().map(|file| file.text.as_str()).collect();
        let tables = if tables.is_empty() { vec![""] } else { tables };
        if stages.is_empty() {
            return vec!["there are no shaders".to_owned()];
        }
        let library: String = library.iter().map(|file| file.text.as_str()).collect();
        let mut found = Vec::new();
        for (stage, table) in stages.iter().flat_map(|stage| tables.iter().map(move |table| (stage, table))) {
            let whole = format!("{}\n{}\n{table}\n{library}", stage.text, parts_of(&stage.path));
            let parses = |source: &str| naga::front::wgsl::parse_str(source).is_ok();
            if !parses(&stage.text) && !parses(&whole) {
                let error = naga::front::wgsl::parse_str(&whole).err();
                found.extend(error.map(|error| error.emit_to_string_with_path(&whole, &stage.path)));
            }
        }
        found
    }

    pub(super) fn root_documents_are_there(files: &[File]) -> Vec<String> {
        let missing = ROOT_DOCUMENTS.iter().filter(|name| find(files, name).is_none_or(str::is_empty));
        missing.map(|name| format!("{name} is not there")).collect()
    }

    pub(super) fn readme_knows_every_subcommand(files: &[File]) -> Vec<String> {
        let (Some(readme), Some(cli)) = (find(files, "README.md"), find(files, "src/cli/lib.rs")) else {
            return vec!["README.md or src/cli/lib.rs is not there".to_owned()];
        };
        let commands = subcommands(cli);
        if commands.is_empty() {
            return vec!["src/cli/lib.rs: no subcommand in `enum Command`".to_owned()];
        }
        let missing = commands.iter().filter(|command| !holds_word(readme, &format!("relief {command}")));
        missing.map(|command| format!("README.md does not mention `relief {command}`")).collect()
    }

    /// The variants of `enum Command` as the command line spells them: `GoldenCheck` is `golden-check`.
    fn subcommands(cli: &str) -> Vec<String> {
        let variants = cli.lines().skip_while(|line| !line.contains("enum Command {")).skip(1);
        let variants = variants.take_while(|line| *line != "}").map(str::trim);
        let names = variants.filter(|line| line.starts_with(char::is_uppercase));
        names.map(|line| kebab(line.split(|c: char| !c.is_alphanumeric()).next().unwrap_or(line))).collect()
    }

    fn kebab(name: &str) -> String {
        let mut kebab = String::new();
        for c in name.chars() {
            if c.is_uppercase() && !kebab.is_empty() {
                kebab.push('-');
            }
            kebab.extend(c.to_lowercase());
        }
        kebab
    }

    /// The index of invariants lists every test that is tagged with `Invariant:`.
    pub(super) fn invariants_are_indexed(files: &[File]) -> Vec<String> {
        is_current(files, invariants::INDEX, invariants::index(files))
    }

    /// The listing of the public API is that of the sources.
    pub(super) fn public_api_is_listed(files: &[File]) -> Vec<String> {
        is_current(files, api::LISTING, api::listing(files))
    }

    /// A generated file has this text. With `RELIEF_BLESS` set it is written instead (see `scripts/bless`).
    fn is_current(files: &[File], path: &str, text: String) -> Vec<String> {
        if text.is_empty() {
            return vec![format!("there is nothing to list in {path}")];
        }
        if find(files, path) == Some(text.as_str()) {
            return Vec::new();
        }
        if std::env::var_os("RELIEF_BLESS").is_some() {
            let place = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
            std::fs::write(place, text).expect("generated files can be written");
            return Vec::new();
        }
        vec![format!("{path} is out of date; run scripts/bless and review the difference")]
    }

    /// ARCHITECTURE.md has a row for every crate, and the dependencies in it are in the crate's manifest.
    pub(super) fn crates_are_in_the_table(files: &[File]) -> Vec<String> {
        let map = find(files, "ARCHITECTURE.md").unwrap_or_default();
        let rows: Vec<Vec<&str>> = map.lines().map(|line| line.split('|').map(str::trim).collect()).collect();
        let mut found = Vec::new();
        for file in files {
            let folder = file.path.strip_prefix("src/").and_then(|path| path.strip_suffix("/Cargo.toml"));
            let Some(name) = folder else { continue };
            let row = rows.iter().find(|row| row.get(1) == Some(&format!("`{name}`").as_str()));
            let Some(row) = row else {
                found.push(format!("ARCHITECTURE.md has no row for the crate `{name}`"));
                continue;
            };
            let used = row.get(3).copied().unwrap_or_default();
            for used in used.split(',').map(str::trim).filter(|used| !["all", "–", ""].contains(used)) {
                if !file.text.contains(&format!("relief-{used}.workspace")) {
                    found.push(format!("ARCHITECTURE.md: `{name}` does not depend on `{used}`"));
                }
            }
        }
        found
    }

    /// Every exported name of the pages is imported by another module.
    pub(super) fn pages_export_what_is_imported(files: &[File]) -> Vec<String> {
        let is_script = |file: &&File| matches!(extension(&file.path), "js" | "mjs");
        let scripts = files.iter().filter(is_script);
        let imported: std::collections::HashSet<&str> = scripts
            .flat_map(|file| file.text.split("import {").skip(1))
            .flat_map(|names| names.split('}').next().unwrap_or_default().split(','))
            .filter_map(|name| name.split_whitespace().next())
            .collect();
        complaints(files, |file, line| {
            let of_page = file.path.starts_with("src/server/page/") && extension(&file.path) == "js";
            let declared = line.strip_prefix("export ").filter(|_| of_page)?;
            let mut words = declared.split(|c: char| !(c.is_alphanumeric() || "_$".contains(c)));
            let kind = words.find(|word| ["function", "const", "class", "let"].contains(word))?;
            let name = words.find(|word| !word.is_empty())?;
            (!imported.contains(name)).then(|| format!("no page imports the {kind} {name}"))
        })
    }

    fn complaints(files: &[File], complaint: impl Fn(&File, &str) -> Option<String>) -> Vec<String> {
        let mut found = Vec::new();
        for file in files {
            let lines = file.text.lines().enumerate();
            let lines = lines.filter_map(|(at, line)| Some((at + 1, complaint(file, line)?)));
            found.extend(lines.map(|(at, what)| format!("{}:{at}: {what}", file.path)));
        }
        found
    }
}

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
