//! `relief annotate undo` and `redo`: an author's edits, taken back and made again.

use std::process::ExitCode;

use anyhow::anyhow;
use serde_json::json;

use super::super::output::{print_json, say};
use super::log::what;
use super::log_options::{ByArguments, LogArguments};
use super::table;
use relief_annotation::{Event, Item};
use relief_store::StoreError;

/// Take back an author's newest edit that stands
#[derive(Debug, clap::Args)]
#[command(after_help = "\
One edit at a time, as far back as the log goes: all of its changes, or none where another author
has changed one of its items since; then both versions are shown. Nothing is lost: redo makes the
edit again, until the author makes a new one.

Examples:
  relief annotate --db ann.db undo --author anna --reason 'the wrong side'
  relief annotate --db ann.db undo --times 3")]
pub(super) struct UndoArguments {
    #[command(flatten)]
    step: StepArguments,
}

/// Make again what undo took back
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The edit that was taken back last is made again first. A new edit of the author ends what can be
made again.

Examples:
  relief annotate --db ann.db redo --author anna")]
pub(super) struct RedoArguments {
    #[command(flatten)]
    step: StepArguments,
}

#[derive(Debug, clap::Args)]
struct StepArguments {
    #[command(flatten)]
    by: ByArguments,
    /// Number of edits to undo, one after another
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    times: u32,
    /// Print one JSON object: the events, and of a conflict both versions
    #[arg(long)]
    json: bool,
}

pub(super) fn undo(arguments: &UndoArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    step(&arguments.step, log, true)
}

pub(super) fn redo(arguments: &RedoArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    step(&arguments.step, log, false)
}

fn step(arguments: &StepArguments, log: &LogArguments, back: bool) -> anyhow::Result<ExitCode> {
    let (author, reason) = (arguments.by.who.name()?, &arguments.by.reason);
    let log = log.open_existing()?;
    let mut events = Vec::new();
    for _ in 0..arguments.times {
        let store = log.store();
        let made =
            if back { log.wait(store.undo(&author, reason)) } else { log.wait(store.redo(&author, reason)) };
        match made {
            Ok(made) => events.extend(made),
            // As many as there are.
            Err(StoreError::NothingToUndo | StoreError::NothingToRedo) if !events.is_empty() => break,
            Err(error) => return refuse(&error, &events, arguments.json),
        }
    }
    if arguments.json {
        print_json(&json!({ "events": events }))?;
    } else {
        print(&events);
    }
    Ok(ExitCode::SUCCESS)
}

fn print(events: &[Event]) {
    let line = |event: &Event| {
        let name = event.item.as_ref().map_or_else(String::new, |item| item.name.clone());
        [event.seq.to_string(), what(event), name, event.id.to_string()]
    };
    table::print(["seq", "what", "name", "id"], &events.iter().map(line).collect::<Vec<_>>());
}

/// Prints the steps before the failure and, for a conflict, both versions. Then fails.
fn refuse(error: &StoreError, events: &[Event], json: bool) -> anyhow::Result<ExitCode> {
    if json {
        let mut shown = json!({ "events": events, "error": error.to_string() });
        if let StoreError::Conflict { id, expected, current, yours } = error {
            shown["conflict"] = json!({ "id": id, "expected": expected, "current": current, "yours": yours });
        }
        print_json(&shown)?;
    } else {
        if !events.is_empty() {
            print(events);
        }
        if let StoreError::Conflict { current, yours, .. } = error {
            let line = |whose: &str, item: Option<&Item>| {
                let cells =
                    |item: &Item| [item.name.clone(), table::kind(item).to_owned(), table::extent(item)];
                let [name, kind, extent] =
                    item.map_or_else(|| ["(gone)".to_owned(), String::new(), String::new()], cells);
                [whose.to_owned(), name, kind, extent]
            };
            let now = line("as it is", current.as_ref().map(|current| &current.item));
            let wanted = line("as it would be", yours.as_deref());
            say!("the versions that are in conflict:");
            table::print(["", "name", "kind", "extent"], &[now, wanted]);
        }
    }
    Err(anyhow!("{error}"))
}
