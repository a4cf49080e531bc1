//! `relief annotate sets`: whose items are in which set.

use std::process::ExitCode;

use serde_json::json;

use super::super::output::{print_json, say};
use super::log_options::{AuthorArguments, LogArguments};
use super::table;
use relief_annotation::Set;
use relief_store::Filter;

/// List sets, make them, and say whose they are
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
A set holds the items of one reader, or of one purpose. A set that items name needs no making: it
is open to every author then. Only its reader sees a blinded set, and sees no other: for readers who are to be
compared.

Examples:
  relief annotate --db ann.db sets
  relief annotate --db ann.db sets put anna --reader anna --blinded --template skull
  relief annotate --db ann.db sets --history        who made them what they are"
)]
pub(super) struct SetsArguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Every change of sets and templates, the oldest first
    #[arg(long)]
    history: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    Put(PutArguments),
}

/// Make a set, or make it another one
#[derive(Debug, clap::Args)]
struct PutArguments {
    /// 1 to 64 letters, digits and - _ .
    #[arg(value_name = "NAME")]
    name: String,
    /// Reader of the set [default: any]
    #[arg(long, value_name = "NAME")]
    reader: Option<String>,
    /// Only its reader sees it, and its reader only it
    #[arg(long, requires = "reader")]
    blinded: bool,
    /// Template that its items are expected by
    #[arg(long, value_name = "NAME")]
    template: Option<String>,
    #[command(flatten)]
    who: AuthorArguments,
}

pub(super) fn run(arguments: &SetsArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    if let Some(Action::Put(put)) = &arguments.action {
        let author = put.who.name()?;
        let PutArguments { name, reader, blinded, template, .. } = put;
        let set =
            Set { name: name.clone(), reader: reader.clone(), blinded: *blinded, template: template.clone() };
        let log = log.open()?;
        log.wait(log.store().put_set(&set, &author))?;
        return Ok(ExitCode::SUCCESS);
    }
    let log = log.open_existing()?;
    if arguments.history {
        let lines = log.wait(log.store().audit())?;
        if arguments.json {
            print_json(&json!({ "audit": lines }))?;
        } else {
            let cells = lines.iter().map(|line| {
                let kind = format!("{:?}", line.kind).to_lowercase();
                let (seq, time) = (line.seq.to_string(), line.time.to_string());
                [seq, time, line.author.clone(), kind, line.name.clone(), line.body.clone()]
            });
            table::print(["seq", "time", "author", "what", "name", "is"], &cells.collect::<Vec<_>>());
        }
        return Ok(ExitCode::SUCCESS);
    }
    list(arguments, &log)
}

fn list(arguments: &SetsArguments, log: &super::log_options::Log) -> anyhow::Result<ExitCode> {
    let sets = log.wait(log.store().sets())?;
    let items = log.wait(log.store().list(&Filter::default()))?.items;
    let count = |set: &Set| items.iter().filter(|found| found.item.set == set.name).count();
    if arguments.json {
        let sets: Vec<_> = sets.iter().map(|set| json!({ "set": set, "items": count(set) })).collect();
        print_json(&json!({ "sets": sets }))?;
        return Ok(ExitCode::SUCCESS);
    }
    if sets.is_empty() {
        say!("no sets");
        return Ok(ExitCode::SUCCESS);
    }
    let line = |set: &Set| {
        let blinded = if set.blinded { "blinded" } else { "" };
        let [reader, template] = [&set.reader, &set.template].map(|name| name.clone().unwrap_or_default());
        [set.name.clone(), count(set).to_string(), reader, template, blinded.to_owned()]
    };
    table::print(["set", "items", "reader", "template", ""], &sets.iter().map(line).collect::<Vec<_>>());
    Ok(ExitCode::SUCCESS)
}
