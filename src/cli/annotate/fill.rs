//! `relief annotate fill`: a region between closed curves.

use std::process::ExitCode;

use anyhow::bail;
use serde_json::json;

use super::super::series::SeriesArguments;
use super::log_options::LogArguments;
use super::structure::{NewArguments, Scan, find, keep_new, report};
use relief_annotation::Contour;
use relief_annotation::Geometry;
use relief_annotation::fill_contours;

/// Fill closed curves on one or several levels
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Curves are planar to 2 mm and parallel to 5 degrees. On a level the even-odd rule says what is inside, so that curves within
curves are holes; between levels the shape goes over from one to the next. The region ends with the outermost levels.

Examples:
  relief annotate --db ann.db fill liver-1 liver-2 liver-3 --series abdomen --name liver")]
pub(super) struct FillArguments {
    /// Closed curves, by id or name
    #[arg(value_name = "ITEM", required = true)]
    items: Vec<String>,
    #[command(flatten)]
    series: SeriesArguments,
    #[command(flatten)]
    new: NewArguments,
    /// Print one JSON object: the item and its measures
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &FillArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let mut contours = Vec::new();
    for wanted in &arguments.items {
        let found = find(&log, wanted, "curve")?;
        let Some(contour) = found.item.geometry.as_ref().and_then(Contour::of) else {
            let kind = found.item.geometry.as_ref().map_or("nothing", Geometry::kind);
            bail!("item {wanted:?} is a {kind}, expected a closed curve");
        };
        contours.push(contour);
    }
    let scan = Scan::load(&arguments.series)?;
    let mask = fill_contours(scan.volume.grid(), &contours)?;
    if mask.voxels() == 0 {
        bail!("no voxel of the volume lies within the curves; are they of the same scan?");
    }
    let kept = relief_exchange::content_of_region(&mask, &arguments.new.name, None)?;
    let item = keep_new(&log, &arguments.new, Some(scan.frame), kept, Geometry::Region)?;
    report(&item, &json!({ "voxels": mask.voxels(), "curves": contours.len() }), arguments.json)?;
    Ok(ExitCode::SUCCESS)
}
