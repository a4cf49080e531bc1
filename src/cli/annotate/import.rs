//! `relief annotate import`: files of other tools into the log, as one edit.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde::Serialize;

use super::super::choices::formats;
use super::super::output::{print_json, say};
use super::log_options::{ByArguments, Log, LogArguments};
use super::{series, table};
use relief_annotation::{Change, Edit, Item, ItemId, Set, Versioned};
use relief_exchange::{ExistingItems, Format, Imported, Merged, ReadContext};
use relief_store::Filter;

/// The largest file that is opened.
const MOST_BYTES: u64 = 4 << 30;

/// Read annotations from files of other tools, as one edit
#[derive(Debug, clap::Args)]
#[command(after_help = "\
All files together are one edit, which undo takes back: one that is damaged changes nothing. Without --format, a file's name and
beginning say what it is. docs/ANNOTATIONS.md has what each format holds.

With --series, items belong to that series, and points outside of its volume are warned of, with a hint where they are a mirror
image (RAS for LPS). Items that are in the log already, by their ids or by list, name and place, stay as they are, and the answer says
how many. With --update those that differ are changed in name, description, place, lock and visibility; with --duplicate all come in
again under new ids.

Examples:
  relief annotate --db ann.db import skull.mrk.json --series head --author anna
  relief annotate --db ann.db import *.fcsv --set anna --reason 'second session' --dry-run
  relief annotate --db ann.db import edited-in-slicer.mrk.json --update")]
pub(super) struct ImportArguments {
    /// Files to read
    #[arg(value_name = "IN", required = true)]
    files: Vec<PathBuf>,
    #[arg(long, value_name = "FORMAT", help = formats("Format of the files, where their names do not say", |_| true))]
    format: Option<Format>,
    #[command(flatten)]
    series: series::SeriesArguments,
    /// The set that items come into
    #[arg(long, value_name = "NAME", default_value = Set::DEFAULT)]
    set: String,
    /// The list that items are, where the file does not say; its name otherwise
    #[arg(long, value_name = "NAME")]
    list: Option<String>,
    #[command(flatten)]
    by: ByArguments,
    /// Change the items that a file was made of, where they differ
    #[arg(long)]
    update: bool,
    /// Import items again that exist already, under new ids
    #[arg(long, conflicts_with = "update")]
    duplicate: bool,
    /// Read and tell, and change nothing
    #[arg(long)]
    dry_run: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct ImportReport {
    files: Vec<FileReport>,
    created: usize,
    updated: usize,
    unchanged: usize,
    /// Existing items that differ, and stay unchanged.
    skipped: usize,
    dry_run: bool,
    items: Vec<ItemReport>,
}

#[derive(Debug, Serialize)]
struct FileReport {
    file: String,
    format: &'static str,
    items: usize,
    warnings: Vec<String>,
}

#[derive(Debug, Serialize)]
struct ItemReport {
    id: ItemId,
    set: String,
    list: String,
    name: String,
    kind: &'static str,
}

pub(super) fn run(arguments: &ImportArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let author = arguments.by.who.name()?;
    Set::check_name(&arguments.set)?;
    let series = arguments.series.load()?;
    let mut files = Vec::new();
    let mut all = Imported { items: Vec::new(), contents: Vec::new(), warnings: Vec::new() };
    for path in &arguments.files {
        let list = arguments.list.clone().unwrap_or_else(|| stem(path));
        let context = ReadContext {
            author: &author,
            set: &arguments.set,
            list: &list,
            frame_of_reference: series.as_ref().map(|series| &series.frame),
            grid: series.as_ref().map(|series| &series.grid),
            series: series.as_ref().and_then(|series| series.reference.as_ref()),
        };
        let (format, read) = read(path, arguments.format, &context)
            .with_context(|| format!("cannot import {}", path.display()))?;
        files.push(FileReport {
            file: path.display().to_string(),
            format: format.name(),
            items: read.items.len(),
            warnings: read.warnings,
        });
        all.items.extend(read.items);
        all.contents.extend(read.contents);
    }
    let open = if arguments.dry_run { existing(log)? } else { Some(log.open()?) };
    let known = open.as_ref().map_or_else(|| Ok(Vec::new()), known_items)?;
    let present = match (arguments.update, arguments.duplicate) {
        (true, _) => ExistingItems::Update,
        (_, true) => ExistingItems::Duplicate,
        _ => ExistingItems::Keep,
    };
    let merged = Merged::of(all.items, known, present)?;
    if let (Some(note), Some(file)) = (merged.note("--update", "--duplicate"), files.last_mut()) {
        file.warnings.push(note);
    }
    let report = ImportReport::new(files, &merged, arguments.dry_run);
    let changes = merged.changes;
    if let (Some(log), false, false) = (&open, arguments.dry_run, changes.is_empty()) {
        for (_, media_type, bytes) in &all.contents {
            log.wait(log.store().put_content(media_type, bytes))?;
        }
        log.wait(log.store().apply(&Edit { author, reason: arguments.by.reason.clone(), changes }))?;
    }
    report.show(arguments.json)
}

/// The log, if it exists: reading it must not create one.
fn existing(log: &LogArguments) -> anyhow::Result<Option<Log>> {
    if log.is_there() { log.open_existing().map(Some) } else { Ok(None) }
}

fn known_items(log: &Log) -> anyhow::Result<Vec<Versioned>> {
    let listing = log.wait(log.store().list(&Filter::default()))?;
    Ok(listing.items)
}

/// The file's name without what its format adds to it.
pub(super) fn stem(path: &Path) -> String {
    let name =
        path.file_name().map_or_else(|| "import".to_owned(), |name| name.to_string_lossy().into_owned());
    let lower = name.to_lowercase();
    let ends = [".mrk.json", ".seg.nrrd", ".nii.gz"].into_iter().find(|end| lower.ends_with(end));
    let length = ends.map_or_else(|| name.rfind('.').unwrap_or(name.len()), |end| name.len() - end.len());
    name.chars().take(name[..length].chars().count().clamp(1, Item::LONGEST_NAME)).collect()
}

fn read(
    path: &Path,
    format: Option<Format>,
    context: &ReadContext<'_>,
) -> anyhow::Result<(Format, Imported)> {
    let length = std::fs::metadata(path)?.len();
    if length > MOST_BYTES {
        bail!("the file has {length} bytes, allowed: at most {MOST_BYTES}");
    }
    let bytes = std::fs::read(path)?;
    let known = format.or_else(|| Format::of(path, &bytes));
    let format =
        known.context("neither its name nor its first bytes tell its format; name it with --format")?;
    Ok((format, relief_exchange::read(format, &bytes, context)?))
}

impl ImportReport {
    fn new(files: Vec<FileReport>, merged: &Merged, dry_run: bool) -> Self {
        let Merged { changes, unchanged, skipped, .. } = merged;
        let is_new = |change: &&Change| matches!(change, Change::Create { .. });
        let created = changes.iter().filter(is_new).count();
        let items = changes.iter().filter_map(|change| match change {
            Change::Create { item } | Change::Update { item, .. } => Some(ItemReport {
                id: item.id,
                set: item.set.clone(),
                list: item.list.clone(),
                name: item.name.clone(),
                kind: table::kind(item),
            }),
            Change::Delete { .. } => None,
        });
        let (updated, items) = (changes.len() - created, items.collect());
        Self { created, updated, unchanged: *unchanged, skipped: *skipped, dry_run, items, files }
    }

    fn show(&self, json: bool) -> anyhow::Result<ExitCode> {
        for file in &self.files {
            for warning in &file.warnings {
                eprintln!("warning: {}: {warning}", file.file);
            }
        }
        if json {
            print_json(self)?;
            return Ok(ExitCode::SUCCESS);
        }
        let line = |file: &FileReport| [file.items.to_string(), file.format.to_owned(), file.file.clone()];
        table::print(["items", "format", "file"], &self.files.iter().map(line).collect::<Vec<_>>());
        let Self { created, updated, unchanged, skipped, .. } = self;
        let would = if self.dry_run { "would be " } else { "" };
        say!("{created} {would}created, {updated} {would}updated, {unchanged} unchanged, {skipped} skipped");
        Ok(ExitCode::SUCCESS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_called_as_its_file() {
        for (path, name) in [
            ("a/skull.mrk.json", "skull"),
            ("F_1.FCSV", "F_1"),
            ("seg.v2.nii.gz", "seg.v2"),
            ("points", "points"),
            (".csv", "."),
        ] {
            assert_eq!(stem(Path::new(path)), name, "{path}");
        }
    }
}
