//! `relief annotate refine`: smooths a region, fills its holes, keeps its largest part.

use std::process::ExitCode;

use anyhow::bail;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use serde_json::json;

use super::log_options::{ByArguments, LogArguments};
use super::structure::{find, keep, mask_of, report};
use relief_annotation::{Change, Geometry, RefineStep, refine_region};

/// Smooth a region, fill its holes, or keep its largest part
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Steps are done in their order, as one edit that can be undone. smooth takes steps, bridges and specks of a voxel; fill-holes takes
in what the region encloses; keep-largest drops all parts but the largest.

Examples:
  relief annotate --db ann.db refine skull --step keep-largest
  relief annotate --db ann.db refine lesion --step fill-holes,smooth --author anna")]
pub(super) struct RefineArguments {
    /// The region, by id or name
    #[arg(value_name = "ITEM")]
    item: String,
    /// Steps with commas between them: smooth, fill-holes, keep-largest
    #[arg(long = "step", value_name = "STEPS", value_delimiter = ',', required = true, value_parser = steps())]
    steps: Vec<RefineStep>,
    #[command(flatten)]
    by: ByArguments,
    /// Print one JSON object: the item, its measures, and its number of voxels before
    #[arg(long)]
    json: bool,
}

fn steps() -> impl TypedValueParser<Value = RefineStep> {
    let values = RefineStep::ALL.map(|step| PossibleValue::new(step.name()));
    PossibleValuesParser::new(values).map(|name| RefineStep::from_name(&name).unwrap_or(RefineStep::Smooth)) // the parser has checked the name
}

pub(super) fn run(arguments: &RefineArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let found = find(&log, &arguments.item, "region")?;
    let before = mask_of(&log, &found.item)?;
    let refined = arguments.steps.iter().fold(before.clone(), |mask, step| refine_region(&mask, *step));
    if refined.voxels() == 0 {
        bail!("nothing would be left of the region; delete the item instead");
    }
    let mut item = found.item;
    if refined != before {
        let kept = relief_exchange::content_of_region(&refined, &item.name, item.rgb)?;
        item.geometry = Some(Geometry::Region(kept.summary));
        let change = Change::Update { item: Box::new(item.clone()), version: found.version };
        keep(&log, &arguments.by, (kept.media_type, &kept.bytes), change)?;
    }
    let counts = json!({ "voxels": refined.voxels(), "voxels_before": before.voxels() });
    report(&item, &counts, arguments.json)?;
    Ok(ExitCode::SUCCESS)
}
