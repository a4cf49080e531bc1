//! `relief annotate export`: items into a file of another tool.

use std::collections::HashMap;
use std::path::PathBuf;
use std::process::ExitCode;

use serde::Serialize;

use super::super::choices::formats;
use super::super::output::{print_json, say, write_whole};
use super::log_options::{Log, LogArguments};
use super::series;
use relief_annotation::{ContentId, Item};
use relief_exchange::{Format, LeftOut, WriteContext, deidentified};
use relief_store::Filter;

/// Write annotations to a file of another tool
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The command reports values that the format cannot represent, with the number of items; docs/ANNOTATIONS.md has a table of formats. The
file appears whole or not at all. All places are in patient LPS mm.

With --series, items of other series are left alone. With --phase, so are items of other phases.

Examples:
  relief annotate --db ann.db export --format mrk.json --out skull.mrk.json
  relief annotate --db ann.db export --format csv --out anna.csv --set anna --list skull
  relief annotate --db ann.db export --format sr --out shared.dcm --series head --deidentify
  relief annotate --db ann.db export --format cornerstone --out head.json --series head --json")]
pub(super) struct ExportArguments {
    #[arg(long, value_name = "FORMAT", help = formats("Format of the file", Format::can_write))]
    format: Format,
    /// The file to write
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    #[command(flatten)]
    series: series::SeriesArguments,
    /// Only items of these sets
    #[arg(long = "set", value_name = "NAME", value_delimiter = ',')]
    sets: Vec<String>,
    /// Only items of this list
    #[arg(long, value_name = "NAME")]
    list: Option<String>,
    /// Leave out who made them and when, descriptions, and in DICOM objects the patient; UIDs are
    /// replaced, the same ones by the same
    #[arg(long)]
    deidentify: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct ExportReport<'a> {
    file: String,
    format: &'static str,
    items: usize,
    left_out: &'a [LeftOut],
}

pub(super) fn run(arguments: &ExportArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let series = arguments.series.load()?;
    let sets = (!arguments.sets.is_empty()).then(|| arguments.sets.clone());
    let listing = log.wait(log.store().list(&Filter { sets, ..Filter::default() }))?;
    let mut items: Vec<Item> = listing.items.into_iter().map(|found| found.item).collect();
    items.retain(|item| arguments.list.as_ref().is_none_or(|list| item.list == *list));
    if let Some(series) = &series {
        items.retain(|item| item.frame_of_reference.as_ref().is_none_or(|frame| *frame == series.frame));
    }
    let contents = contents(&log, &items)?;
    let mut reference = series.as_ref().and_then(|series| series.reference.clone());
    if arguments.deidentify {
        items = deidentified(items);
        reference = reference.map(|reference| reference.deidentified());
    }
    let context = WriteContext {
        contents: &|id| contents.get(id).cloned(),
        grid: series.as_ref().map(|series| &series.grid),
        series: reference.as_ref(),
        phase: series.as_ref().and_then(|series| series.phase),
        warnings: series.as_ref().map_or(&[], |series| &series.warnings),
    };
    let written = relief_exchange::write(arguments.format, &items, &context)?;
    write_whole(&arguments.out, &written.bytes)?;
    let report = ExportReport {
        file: arguments.out.display().to_string(),
        format: arguments.format.name(),
        items: written.items,
        left_out: &written.left_out,
    };
    if arguments.json {
        print_json(&report)?;
    } else {
        say!("{} items in {}", report.items, report.file);
        for LeftOut { what, reason, items } in report.left_out {
            let of = if items.is_empty() { String::new() } else { format!(" of {}", items.len()) };
            say!("  not in it: {what}{of}: {reason}");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The contents that items refer to.
fn contents(log: &Log, items: &[Item]) -> anyhow::Result<HashMap<ContentId, Vec<u8>>> {
    let mut contents = HashMap::new();
    for id in items.iter().filter_map(|item| item.geometry.as_ref()?.content()) {
        if !contents.contains_key(id) {
            let (_, bytes) = log.wait(log.store().content(id))?;
            contents.insert(id.clone(), bytes);
        }
    }
    Ok(contents)
}
