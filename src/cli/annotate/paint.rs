//! `relief annotate paint`: balls of voxels that come into a region, or go.

use std::process::ExitCode;

use anyhow::bail;
use serde_json::json;

use super::super::series::SeriesArguments;
use super::log_options::{Log, LogArguments};
use super::structure::{NewArguments, Scan, find, keep, keep_new, mask_of, parse_place, report};
use relief_annotation::Stroke;
use relief_annotation::paint_strokes;
use relief_annotation::{Change, Geometry, Item, Versioned};
use relief_base::{Patient, Point};
use relief_store::Filter;
use relief_volume::Mask;

/// Paint a region with balls: a new region, or an existing one to add to or erase from
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A voxel is painted where at least half of it lies in the ball; a ball smaller than a voxel paints the one that it lies in. Where
the log has a region of that name (or id), it is changed; else a new one is made.

Examples:
  relief annotate --db ann.db paint --series head --at 10,-40,3 --radius-mm 6 --name lesion
  relief annotate --db ann.db paint --series head --at 12,-40,3 --radius-mm 3 --erase --name lesion")]
pub(super) struct PaintArguments {
    #[command(flatten)]
    series: SeriesArguments,
    /// Centre of a ball, patient LPS mm; may be given several times
    #[arg(long = "at", value_name = "X,Y,Z", required = true, allow_hyphen_values = true, value_parser = parse_place)]
    at: Vec<Point<Patient>>,
    /// Its radius, mm
    #[arg(long, value_name = "MM")]
    radius_mm: f64,
    /// Take voxels out instead of in
    #[arg(long)]
    erase: bool,
    #[command(flatten)]
    new: NewArguments,
    /// Print one JSON object: the item, its measures, and the number of changed voxels
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &PaintArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let scan = Scan::load(&arguments.series)?;
    let log = log.open()?;
    let existing = existing(&log, &arguments.new.name)?;
    let mut mask = match &existing {
        Some(found) => mask_of(&log, &found.item)?,
        None => Mask::empty(scan.volume.grid().clone()),
    };
    let stroke = if arguments.erase { Stroke::Erase } else { Stroke::Add };
    let mut changed = 0;
    for center in &arguments.at {
        changed += paint_strokes(&mut mask, *center, arguments.radius_mm, stroke)?;
    }
    if mask.voxels() == 0 {
        bail!("nothing would be left of the region; delete the item instead, or paint within the volume");
    }
    let kept = relief_exchange::content_of_region(&mask, &arguments.new.name, None)?;
    let item = match existing {
        None => keep_new(&log, &arguments.new, Some(scan.frame), kept, Geometry::Region)?,
        Some(found) => {
            let mut item = found.item;
            item.geometry = Some(Geometry::Region(kept.summary));
            let change = Change::Update { item: Box::new(item.clone()), version: found.version };
            keep(&log, &arguments.new.by, (kept.media_type, &kept.bytes), change)?;
            item
        }
    };
    report(&item, &json!({ "voxels": mask.voxels(), "changed": changed }), arguments.json)?;
    Ok(ExitCode::SUCCESS)
}

/// The region that is painted on, if there is one.
fn existing(log: &Log, name: &str) -> anyhow::Result<Option<Versioned>> {
    let listing = log.wait(log.store().list(&Filter::default()))?;
    let is_it = |item: &Item| {
        let is_region = matches!(item.geometry, Some(Geometry::Region(_)));
        is_region && (item.name == name || item.id.to_string() == name)
    };
    if listing.items.iter().any(|found| is_it(&found.item)) {
        find(log, name, "region").map(Some)
    } else {
        Ok(None)
    }
}
