//! `relief annotate log`: who changed what, when and why.

use std::collections::HashMap;
use std::process::ExitCode;

use serde_json::json;

use super::super::output::{print_json, say};
use super::log_options::LogArguments;
use super::table;
use relief_annotation::{Event, EventKind, ItemId};
use relief_store::LogFilter;

/// List every change that was ever made, the oldest first
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Events of one edit have the same number in the column edit: they happened together, and are taken
back together.

Examples:
  relief annotate --db ann.db log
  relief annotate --db ann.db log --by anna --after 100 --limit 20
  relief annotate --db ann.db log --item 0b51f4c4-95e2-4a4f-9e3b-1c1c5d8a7f10 --json")]
pub(super) struct HistoryArguments {
    /// Only events after this number
    #[arg(long, value_name = "SEQ", default_value_t = 0)]
    after: u64,
    /// Only the first N events
    #[arg(long, value_name = "N")]
    limit: Option<u64>,
    /// Only events by this author
    #[arg(long, value_name = "NAME")]
    by: Option<String>,
    /// Only events of this item
    #[arg(long, value_name = "ID")]
    item: Option<ItemId>,
    /// Print one JSON object with all of each event
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &HistoryArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let HistoryArguments { after, limit, by, item, json } = arguments;
    let filter = LogFilter { after: *after, limit: *limit, author: by.clone(), item: *item };
    let events = log.wait(log.store().log(&filter))?;
    if *json {
        print_json(&json!({ "events": events }))?;
    } else if events.is_empty() {
        say!("no events");
    } else {
        print(&events);
    }
    Ok(ExitCode::SUCCESS)
}

fn print(events: &[Event]) {
    // A deleted item has its last name.
    let mut names = HashMap::new();
    let line = |event: &Event| {
        if let Some(item) = &event.item {
            names.insert(event.id, item.name.clone());
        }
        [
            event.seq.to_string(),
            event.edit.to_string(),
            event.time.to_string(),
            event.author.clone(),
            what(event),
            names.get(&event.id).cloned().unwrap_or_default(),
            event.version.to_string(),
            event.id.to_string(),
            event.reason.clone(),
        ]
    };
    let lines: Vec<_> = events.iter().map(line).collect();
    table::print(["seq", "edit", "time", "author", "what", "name", "version", "id", "reason"], &lines);
}

/// A description of an event.
pub(super) fn what(event: &Event) -> String {
    let did = match (&event.item, event.version) {
        (None, _) => "removed",
        (Some(_), 1) => "made",
        (Some(_), _) => "changed",
    };
    let target = event.target.unwrap_or_default();
    match event.kind {
        EventKind::Do => did.to_owned(),
        EventKind::Undo => format!("{did}, taking back {target}"),
        EventKind::Redo => format!("{did}, making {target} again"),
    }
}
