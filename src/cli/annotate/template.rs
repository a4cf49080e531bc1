//! `relief annotate template`: the items expected of a patient, and the progress of sets.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde_json::json;

use super::super::output::{print_json, say};
use super::log_options::{AuthorArguments, Log, LogArguments};
use super::{import, series, table};
use relief_annotation::{Change, Completeness, Edit, FrameOfReference, Item, Set, Template};
use relief_exchange::{Format, ReadContext};
use relief_store::{Filter, StoreError};

/// Keep lists of expected items, apply them to sets, and see how far sets are
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A template is JSON: a name, and items in the order in which they are placed.
  {\"name\": \"skull\", \"items\": [
    {\"name\": \"nasion\", \"description\": \"where both nasal bones meet the frontal bone\", \"rgb\": [1, 0.6, 0]},
    {\"name\": \"orbital distance\", \"kind\": \"line\"}]}
An item may have a description, a concept (code, scheme, meaning), an rgb and a kind: point, line, angle, curve, plane, region or
mesh. A file of 3D Slicer's markups is a template as well: points without a place are what its templates are made of.
aortic-root, cephalometry, pelvis and spine come with the program; `add` puts another one of such a name in its place.

Examples:
  relief annotate --db ann.db template add skull.json
  relief annotate --db ann.db template add skull.mrk.json --name skull
  relief annotate --db ann.db template apply skull --set anna --series head
  relief annotate --db ann.db template show cephalometry
  relief annotate --db ann.db template status skull --set anna,ben")]
pub(super) struct TemplateArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    Add(AddArguments),
    List(ListArguments),
    Show(ShowArguments),
    Apply(Box<ApplyArguments>),
    Status(StatusArguments),
}

/// Keep a template from a file, in the place of one of the same name
#[derive(Debug, clap::Args)]
struct AddArguments {
    /// The template
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Another name than the file says
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    #[command(flatten)]
    who: AuthorArguments,
}

/// List the templates of the log, and those that come with the program
#[derive(Debug, clap::Args)]
struct ListArguments {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Print a template as JSON
#[derive(Debug, clap::Args)]
struct ShowArguments {
    /// Name of the template
    #[arg(value_name = "NAME")]
    name: String,
}

/// Add the missing items of a template to a set, without positions
#[derive(Debug, clap::Args)]
struct ApplyArguments {
    /// Name of the template
    #[arg(value_name = "NAME")]
    name: String,
    /// The set that gets the items
    #[arg(long, value_name = "SET", default_value = Set::DEFAULT)]
    set: String,
    #[command(flatten)]
    series: series::SeriesArguments,
    #[command(flatten)]
    who: AuthorArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Count defined, missing and skipped items of a template
#[derive(Debug, clap::Args)]
struct StatusArguments {
    /// Name of the template
    #[arg(value_name = "NAME")]
    name: String,
    /// Of these sets; of all that it was applied to otherwise
    #[arg(long = "set", value_name = "SET", value_delimiter = ',')]
    sets: Vec<String>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &TemplateArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    match &arguments.action {
        Action::Add(arguments) => add(arguments, log),
        Action::List(arguments) => list(arguments, log),
        Action::Show(arguments) => {
            say!("{}", template(&log.open_existing()?, &arguments.name)?.json().trim_end());
            Ok(())
        }
        Action::Apply(arguments) => apply(arguments, log),
        Action::Status(arguments) => status(arguments, log),
    }?;
    Ok(ExitCode::SUCCESS)
}

/// The log's template of this name, or one that comes with the program.
fn template(log: &Log, name: &str) -> anyhow::Result<Template> {
    let text = match (log.wait(log.store().template(name)), Template::ready_json(name)) {
        (Err(StoreError::NoTemplate { .. }), Some(ready)) => ready.to_owned(),
        (text, _) => text?,
    };
    Template::read(text.as_bytes()).with_context(|| format!("the template {name} cannot be read"))
}

fn add(arguments: &AddArguments, log: &LogArguments) -> anyhow::Result<()> {
    let author = arguments.who.name()?;
    let bytes = read_whole(&arguments.file)?;
    let mut template =
        read(arguments, &bytes).with_context(|| format!("{} is no template", arguments.file.display()))?;
    if let Some(name) = &arguments.name {
        template.name.clone_from(name);
        template.validate()?;
    }
    let log = log.open()?;
    log.wait(log.store().put_template(&template.name, &template.json(), &author))?;
    say!("{}: {} items", template.name, template.items.len());
    Ok(())
}

/// A template of our own, or of the items in a file of another tool.
fn read(arguments: &AddArguments, bytes: &[u8]) -> anyhow::Result<Template> {
    let Some(format) = Format::of(&arguments.file, bytes) else {
        return Ok(Template::read(bytes)?);
    };
    let name = arguments.name.clone().unwrap_or_else(|| import::stem(&arguments.file));
    let context = ReadContext {
        author: "template",
        set: Set::DEFAULT,
        list: &name,
        frame_of_reference: None,
        grid: None,
        series: None,
    };
    let read = relief_exchange::read(format, bytes, &context)?;
    for warning in &read.warnings {
        eprintln!("warning: {}: {warning}", arguments.file.display());
    }
    Ok(Template::of_items(&name, &read.items)?)
}

/// The bytes of a file that is not longer than a template is.
fn read_whole(path: &Path) -> anyhow::Result<Vec<u8>> {
    use std::io::Read;
    let read = || {
        let mut bytes = Vec::new();
        std::fs::File::open(path)?.take(Template::MOST_BYTES as u64 + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_err(|error: std::io::Error| error).with_context(|| format!("cannot read {}", path.display()))
}

fn list(arguments: &ListArguments, log: &LogArguments) -> anyhow::Result<()> {
    let log = log.open_existing()?;
    let kept = log.wait(log.store().templates())?;
    let ready: Vec<_> =
        Template::ready_names().filter(|name| kept.iter().all(|known| known != name)).collect();
    let names = kept.iter().map(String::as_str).chain(ready.iter().copied());
    let templates: Vec<Template> = names.map(|name| template(&log, name)).collect::<anyhow::Result<_>>()?;
    if arguments.json {
        return print_json(&json!({ "templates": &templates[..kept.len()], "ready": ready }));
    }
    let line = |of: &Template| [of.name.clone(), of.items.len().to_string(), of.description.clone()];
    table::print(["template", "items", ""], &templates.iter().map(line).collect::<Vec<_>>());
    Ok(())
}

fn apply(arguments: &ApplyArguments, log: &LogArguments) -> anyhow::Result<()> {
    let author = arguments.who.name()?;
    let log = log.open_existing()?;
    let template = template(&log, &arguments.name)?;
    let present = items_of(&log, &arguments.set)?;
    let frame = match arguments.series.load()? {
        Some(series) => Some(series.frame),
        None => only_frame(&present)
            .with_context(|| format!("which patient is it in the set {}?", arguments.set))?,
    };
    let of_patient = present.iter().filter(|item| item.frame_of_reference == frame);
    let missing = template.missing(&arguments.set, &author, frame.as_ref(), of_patient)?;
    let added: Vec<String> = missing.iter().map(|item| item.name.clone()).collect();
    if !missing.is_empty() {
        let changes = missing.into_iter().map(|item| Change::Create { item: Box::new(item) }).collect();
        let edit = Edit { author: author.clone(), reason: format!("template {}", template.name), changes };
        log.wait(log.store().apply(&edit))?;
    }
    remember(&log, &arguments.set, &template.name, &author)?;
    let items = items_of(&log, &arguments.set)?;
    let complete = template.completeness(items.iter().filter(|item| item.frame_of_reference == frame));
    if arguments.json {
        return print_json(&json!({ "set": arguments.set, "added": added, "complete": complete }));
    }
    say!("{} added to the set {}", added.len(), arguments.set);
    print(&[(arguments.set.clone(), complete)]);
    Ok(())
}

/// Says of a set that knows no template that this is its.
fn remember(log: &Log, name: &str, template: &str, author: &str) -> anyhow::Result<()> {
    let known = log.wait(log.store().sets())?.into_iter().find(|set| set.name == name);
    let set = known.unwrap_or(Set { name: name.to_owned(), reader: None, blinded: false, template: None });
    if set.template.is_none() {
        log.wait(log.store().put_set(&Set { template: Some(template.to_owned()), ..set }, author))?;
    }
    Ok(())
}

fn items_of(log: &Log, set: &str) -> anyhow::Result<Vec<Item>> {
    let filter = Filter { sets: Some(vec![set.to_owned()]), ..Filter::default() };
    Ok(log.wait(log.store().list(&filter))?.items.into_iter().map(|found| found.item).collect())
}

/// The frame of reference of all items; none of none.
fn only_frame(items: &[Item]) -> anyhow::Result<Option<FrameOfReference>> {
    let mut frames = items.iter().map(|item| &item.frame_of_reference);
    let Some(first) = frames.next() else { return Ok(None) };
    if frames.any(|frame| frame != first) {
        bail!("its items are of several frames of reference; say which patient with --series PATH");
    }
    Ok(first.clone())
}

fn status(arguments: &StatusArguments, log: &LogArguments) -> anyhow::Result<()> {
    let log = log.open_existing()?;
    let template = template(&log, &arguments.name)?;
    let mut sets = arguments.sets.clone();
    if sets.is_empty() {
        let known = log.wait(log.store().sets())?;
        sets.extend(
            known.into_iter().filter(|set| set.template.as_ref() == Some(&template.name)).map(|set| set.name),
        );
    }
    let mut found: Vec<(String, Completeness)> = Vec::new();
    for set in sets {
        let items = items_of(&log, &set)?;
        let mut frames: Vec<&Option<FrameOfReference>> = Vec::new();
        for item in &items {
            if !frames.contains(&&item.frame_of_reference) {
                frames.push(&item.frame_of_reference);
            }
        }
        if frames.is_empty() {
            found.push((set, template.completeness([])));
            continue;
        }
        for frame in frames {
            let of_patient = items.iter().filter(|item| item.frame_of_reference == *frame);
            found.push((set.clone(), template.completeness(of_patient)));
        }
    }
    if arguments.json {
        let sets: Vec<_> =
            found.iter().map(|(set, complete)| json!({ "set": set, "complete": complete })).collect();
        return print_json(&json!({ "template": template.name, "sets": sets }));
    }
    if found.is_empty() {
        say!("no set has the template {}", template.name);
    } else {
        print(&found);
    }
    Ok(())
}

fn print(found: &[(String, Completeness)]) {
    let line = |(set, of): &(String, Completeness)| {
        let counts = [of.defined, of.missing, of.skipped].map(|count| count.to_string());
        let [defined, missing, skipped] = counts;
        [set.clone(), defined, missing, skipped, of.next.clone().unwrap_or_default()]
    };
    table::print(
        ["set", "defined", "missing", "skipped", "next"],
        &found.iter().map(line).collect::<Vec<_>>(),
    );
}
