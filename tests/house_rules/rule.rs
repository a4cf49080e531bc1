//! The rules: each returns its complaints about a set of files.

pub(super) use super::circles::imports_make_no_circles;
pub(super) use super::manifests::declared_dependencies_are_used;
use super::{
    File, MAX_FILE_LINES, MAX_FUNCTION_LINES, ROOT_DOCUMENTS, api, extension, find, holds_word, invariants,
};

pub(super) fn files_say_what_they_are(files: &[File]) -> Vec<String> {
    let heads = [("rs", "//! "), ("wgsl", "// ")];
    let mut found = Vec::new();
    for (kind, head) in heads {
        for file in files.iter().filter(|file| extension(&file.path) == kind && !file.text.starts_with(head))
        {
            found.push(format!("{} does not begin with a comment ({head}) that says what it is", file.path));
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
        let item =
            code.strip_prefix("pub(").and_then(|rest| rest.split_once(") ")).map_or(code, |(_, item)| item);
        let is_function = item.split(['(', '<']).next().is_some_and(|head| holds_word(head, "fn"));
        if !is_function || code.starts_with("//") || code.ends_with([';', '}']) {
            continue;
        }
        let indent = &line[..line.len() - code.len()];
        let (body, parameters) = (format!("{indent}}}"), format!("{indent})"));
        // A method that a trait declares has parameters and no body.
        let is_end = |line: &&str| *line == body || line.starts_with(&parameters) && line.ends_with(';');
        if let Some(length) = lines[start..].iter().position(is_end) {
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
    let roots = [concat!("/ho", "me/"), concat!("/ro", "ot/"), concat!("/wo", "rk/"), concat!("/Us", "ers/")];
    complaints(files, |file, line| {
        let path = roots.into_iter().find(|root| {
            let outside = |c: char| !(c.is_alphanumeric() || matches!(c, '.' | '_' | '-' | '}'));
            line.match_indices(root).any(|(at, _)| line[..at].chars().next_back().is_none_or(outside))
        });
        // Where packages come from is the machine's configuration, not the project's. Services are
        // no such places.
        let is_script = file.path.starts_with("scripts/") || file.path.starts_with(".ci/");
        path.or_else(|| is_script.then(|| outside_host(line)).flatten()).map(str::to_owned)
    })
}

/// Placeholders, and services in a network of their own.
const OWN_HOSTS: [&str; 6] = ["HOST", "localhost", "0.0.0.0", "relief", "nats", "postgres"];

/// The host of an address that is neither this machine, nor a service's name in a network of its
/// own, nor a variable.
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
    for file in files.iter().filter(|file| file.path.starts_with("scripts/") || file.path.starts_with(".ci/"))
    {
        let is_run = extension(&file.path).is_empty();
        let mut lines = file.text.lines();
        if is_run && !(file.executable && lines.next().is_some_and(|line| line.starts_with("#!"))) {
            found.push(format!("{} is not executable or names no interpreter", file.path));
        }
        // JSON has no comments.
        let says_what = match extension(&file.path) {
            "json" => file.text.contains("\"description\": \""),
            _ => lines.next().is_some_and(|line| line.starts_with("# ")),
        };
        if !says_what {
            found.push(format!("{} does not begin with a comment that says what it does", file.path));
        }
    }
    found
}

/// Each stage parses as it is, or together with all of `shaders/lib`; declarations may come in any
/// order.
pub(super) fn shaders_parse(files: &[File]) -> Vec<String> {
    let shaders = files.iter().filter(|file| extension(&file.path) == "wgsl");
    let (library, others): (Vec<_>, Vec<_>) = shaders.partition(|file| file.path.starts_with("shaders/lib/"));
    // One of the tables joins each stage: with none of them a stage has to do without.
    let (tables, stages): (Vec<_>, Vec<_>) =
        others.into_iter().partition(|file| file.path.starts_with("shaders/table/"));
    // A folder beside a stage has parts of that stage only.
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

/// A generated file has this text. With `RELIEF_BLESS` set it is written instead (see
/// `scripts/bless`).
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

/// ARCHITECTURE.md has a row for every crate, and the dependencies in it are in the crate's
/// manifest.
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
            let is_used =
                [".workspace", " = {"].map(|rest| file.text.contains(&format!("relief-{used}{rest}")));
            if !is_used.contains(&true) {
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
