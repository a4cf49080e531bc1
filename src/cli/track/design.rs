//! `relief track design`: layouts of LEDs, scored and searched.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use indicatif::ProgressBar;

use crate::output::{print_json, say, write_whole};
use crate::text_file::read_text;
use relief_tracking::{Beacon, DesignConditions, DesignScore, score_design, search_design};

/// Score a beacon or search for a better one: how unambiguous its views are, and how accurate poses
/// are.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Views are from 1 to 2 m, within 30 degrees sideways, up and down and in roll, with half a pixel of noise, whole pixels, up
known to 3 degrees, and blobs in any order. The margin is the chi-square by which the best rival is worse in the worst
twentieth of the views; 25 is needed to be identified. The recommended beacon came of such a search.

Examples:
  relief track design                                  score the recommended beacon
  relief track design --beacon mine.toml --views 2000
  relief track design --search 300 --size-mm 240,160,120 --out beacon.toml")]
pub(crate) struct TrackDesignArguments {
    /// The LEDs that are scored; the recommended beacon by default
    #[arg(long, value_name = "BEACON.toml", conflicts_with = "search")]
    beacon: Option<PathBuf>,
    /// Search among this many layouts instead
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000), requires = "out")]
    search: Option<u32>,
    /// The box that a layout has to fit in: width, height, depth
    #[arg(long, value_name = "W,H,D", value_delimiter = ',', default_values_t = [240.0, 160.0, 120.0])]
    size_mm: Vec<f64>,
    /// File for the best layout
    #[arg(long, value_name = "BEACON.toml")]
    out: Option<PathBuf>,
    /// Views of each layout
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(20..=1_000_000))]
    views: u32,
    /// Without knowing up
    #[arg(long)]
    no_gravity: bool,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct DesignReport {
    leds_mm: Vec<[f64; 3]>,
    views: u32,
    score: DesignScore,
}

pub(crate) fn run(arguments: &TrackDesignArguments) -> anyhow::Result<ExitCode> {
    let mut conditions = DesignConditions {
        views: arguments.views as usize,
        seed: arguments.seed,
        ..DesignConditions::default()
    };
    if arguments.no_gravity {
        conditions.gravity_sigma = None;
    }
    let (beacon, found) = match arguments.search {
        Some(layouts) => search_for(arguments, layouts as usize, &conditions)?,
        None => {
            let beacon = match &arguments.beacon {
                Some(path) => Beacon::read(&read_text(path)?)
                    .with_context(|| format!("{} is not a beacon file", path.display()))?,
                None => Beacon::recommended(),
            };
            let found = score_design(&beacon, &conditions);
            (beacon, found)
        }
    };
    if let Some(out) = &arguments.out {
        write_whole(out, beacon.write().as_bytes())?;
    }
    let leds_mm = beacon.leds().iter().map(|led| (*led).into()).collect();
    let report = DesignReport { leds_mm, views: arguments.views, score: found };
    if arguments.json {
        print_json(&report)?;
    } else {
        print_text(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn search_for(
    arguments: &TrackDesignArguments,
    layouts: usize,
    conditions: &DesignConditions,
) -> anyhow::Result<(Beacon, DesignScore)> {
    let size: [f64; 3] = arguments.size_mm.as_slice().try_into().context("--size-mm takes three numbers")?;
    anyhow::ensure!(
        size.iter().all(|mm| (20.0..=1000.0).contains(mm)),
        "--size-mm is {size:?}, allowed: 20 to 1000 each"
    );
    let bar = ProgressBar::new(layouts as u64);
    let found = search_design(size, layouts, conditions, &|tried| bar.set_position(tried as u64));
    bar.finish_and_clear();
    found.context("no layout was better than none; try more, or a larger box")
}

fn print_text(report: &DesignReport) {
    for (at, [x, y, z]) in report.leds_mm.iter().enumerate() {
        say!("LED {}  {x:7.1} {y:7.1} {z:7.1} mm", at + 1);
    }
    let DesignScore { right, wrong, ambiguous, unexplained, merged, margin, position_mm, turn_deg } =
        report.score;
    say!("{} views: {right} identified, {wrong} wrongly, {ambiguous} ambiguous,", report.views);
    say!("  {unexplained} unexplained, {merged} with two LEDs in one blob");
    say!("margin in the worst twentieth: {margin:.0}");
    say!("one frame is known to {position_mm:.1} mm and {turn_deg:.2} degrees (bound, rms)");
}
