//! `relief annotate list`: the items as they are now.

use std::process::ExitCode;

use serde_json::json;

use super::super::output::{print_json, say};
use super::log_options::LogArguments;
use super::table;
use relief_annotation::measures;
use relief_store::Filter;

/// List the items as they are now, by set, list and order
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Places are in patient LPS mm. An item that has a length, an angle, an area or a volume shows it.

Examples:
  relief annotate --db ann.db list
  relief annotate --db ann.db list --set anna,ben
  relief annotate --db ann.db list --json | jq '.items[].item.name'")]
pub(super) struct ListArguments {
    /// Only items of these sets
    #[arg(long = "set", value_name = "NAME", value_delimiter = ',')]
    sets: Vec<String>,
    /// Print one JSON object: the log's last event, and each item with its version and measures
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &ListArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let sets = (!arguments.sets.is_empty()).then(|| arguments.sets.clone());
    let listing = log.wait(log.store().list(&Filter { sets, ..Filter::default() }))?;
    if arguments.json {
        let items: Vec<_> = listing
            .items
            .iter()
            .map(|found| {
                let measures = found.item.geometry.as_ref().map_or_else(Vec::new, measures);
                json!({ "version": found.version, "item": found.item, "measures": measures })
            })
            .collect();
        print_json(&json!({ "seq": listing.seq, "items": items }))?;
        return Ok(ExitCode::SUCCESS);
    }
    let lines = listing.items.iter().map(|found| {
        let item = &found.item;
        let marks = [(item.locked, "locked"), (!item.visible, "hidden")];
        let marks: Vec<_> = marks.into_iter().filter_map(|(is, mark)| is.then_some(mark)).collect();
        [
            item.set.clone(),
            item.list.clone(),
            item.name.clone(),
            table::kind(item).to_owned(),
            table::extent(item),
            item.author.clone(),
            found.version.to_string(),
            item.id.to_string(),
            marks.join(" "),
        ]
    });
    let lines: Vec<_> = lines.collect();
    if lines.is_empty() {
        say!("no items");
    } else {
        table::print(["set", "list", "name", "kind", "extent", "author", "version", "id", ""], &lines);
    }
    Ok(ExitCode::SUCCESS)
}
