//! `relief annotate grow`: a region from seeds.

use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use super::super::series::SeriesArguments;
use super::log_options::LogArguments;
use super::structure::{NewArguments, Scan, keep_new, parse_place, report};
use relief_annotation::Geometry;
use relief_annotation::grow_region;
use relief_annotation::{Grow, GrowLimits, GrowStage};
use relief_base::{Patient, Point};

/// Grow a region from seeds through voxels with values in a range
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The region is what is connected to the seeds by the faces of voxels. A region that becomes larger than --max-ml has leaked: then
nothing is made. Parts behind bridges thinner than --neck-mm are left out, and voxels farther than --max-radius-mm.

Examples:
  relief annotate --db ann.db grow --series head --seed 0,-88,45 --hu 300,3000 --name skull
  relief annotate --db ann.db grow --series chest --seed 12,-30,-90 --hu 150,600 --max-ml 400 --neck-mm 4 --name aorta")]
pub(super) struct GrowArguments {
    #[command(flatten)]
    series: SeriesArguments,
    /// Start of the region, patient LPS mm; may be given several times
    #[arg(long = "seed", value_name = "X,Y,Z", required = true, allow_hyphen_values = true, value_parser = parse_place)]
    seeds: Vec<Point<Patient>>,
    /// Smallest and largest value that is taken, HU
    #[arg(long, value_name = "LO,HI", allow_hyphen_values = true, value_parser = parse_range)]
    hu: [i16; 2],
    /// Refuse a region larger than this, ml
    #[arg(long, value_name = "ML")]
    max_ml: Option<f64>,
    /// Largest distance from the nearest seed, mm
    #[arg(long, value_name = "MM")]
    max_radius_mm: Option<f64>,
    /// Do not pass bridges thinner than this, mm
    #[arg(long, value_name = "MM")]
    neck_mm: Option<f64>,
    #[command(flatten)]
    new: NewArguments,
    /// Print one JSON object: the item, its measures, and why the region ended
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &GrowArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let scan = Scan::load(&arguments.series)?;
    let limits = GrowLimits {
        max_ml: arguments.max_ml,
        max_radius_mm: arguments.max_radius_mm,
        neck_mm: arguments.neck_mm,
    };
    let what = Grow { seeds: arguments.seeds.clone(), hu: arguments.hu, limits };
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10)).with_style(
        ProgressStyle::with_template("{spinner} {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    let grown = grow_region(&scan.volume, &what, &|progress| {
        let doing = match progress.stage {
            GrowStage::Range => "comparing values",
            GrowStage::Growing => "growing",
            GrowStage::Necks => "looking for thin bridges",
        };
        bar.set_message(format!("{doing}: {} voxels", progress.voxels));
        true
    });
    bar.finish_and_clear();
    let grown = grown?;
    let kept = relief_exchange::content_of_region(&grown.mask, &arguments.new.name, None)?;
    let log = log.open()?;
    let item = keep_new(&log, &arguments.new, Some(scan.frame), kept, Geometry::Region)?;
    let extra = json!({ "voxels": grown.voxels, "ended": grown.ended });
    report(&item, &extra, arguments.json)?;
    Ok(ExitCode::SUCCESS)
}

fn parse_range(text: &str) -> Result<[i16; 2], String> {
    let numbers: Result<Vec<i16>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[low, high]) if low <= high => Ok([low, high]),
        _ => {
            Err("expected two whole numbers from -32768 to 32767, the smaller first, such as 150,600"
                .to_owned())
        }
    }
}
