//! `relief annotate accuracy`: how near landmarks come to where they are, by the whole chain, in simulation.

mod chain;
mod hand;
mod plot;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use crate::cli::adapter::AdapterArguments;
use crate::cli::output::{print_json, say, write_whole};
use crate::volume::phantom::{Kind, Recipe};

/// Place the head phantom's 20 known landmarks with a simulated Wiimote, and tell by how much they are missed.
///
/// The remote is tracked as in `relief track experiment`: half a pixel of noise, whole pixels, a camera that was calibrated from a
/// survey, the usual filter. The hand rests; the cursor is where the user wants it on average, and what is left is its noise at the
/// moment of placing.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Ways: `ray` picks the frame's pixel under the cursor; `tip` sets the landmark down at the cursor in free space. A lever is
how far the tip is before the remote's camera (`tip_mm`): the noise of a pose turns about the beacon, so a lever as long as the
distance to the beacon is the steadiest. Snapping goes along the viewing ray: to the tissue's surface, or to the steepest edge.

Examples:
  relief annotate accuracy
  relief annotate accuracy --distance-mm 1500 --json
  relief annotate accuracy --out results                  accuracy.svg and accuracy.png")]
pub(super) struct Arguments {
    /// From the beacon to the remote
    #[arg(long, value_name = "MM", default_value_t = 1200, value_parser = clap::value_parser!(u32).range(500..=3000))]
    distance_mm: u32,
    /// How often each landmark is placed
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// How far snapping may move a landmark
    #[arg(long, value_name = "MM", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=20))]
    radius_mm: u32,
    /// Voxels across the phantom
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(64..=512))]
    size: u32,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Folder for a plot (SVG and PNG)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What came of it.
#[derive(Debug, serde::Serialize)]
struct Report {
    distance_mm: f64,
    landmarks: usize,
    repeats: u32,
    radius_mm: f64,
    ways: Vec<Way>,
}

/// One way to place landmarks.
#[derive(Debug, serde::Serialize)]
struct Way {
    /// `ray` or `tip`.
    way: &'static str,
    /// From the remote's camera to the tip, mm.
    lever_mm: f64,
    /// `none`, `surface` or `gradient`.
    snap: &'static str,
    median_mm: f64,
    p95_mm: f64,
    max_mm: f64,
    /// Placings where there was nothing under the cursor, or nothing to snap to: those keep their place where they have one.
    missed: usize,
    errors_mm: Vec<f64>,
}

/// The lever that views begin with, mm.
const USUAL_LEVER_MM: f64 = 150.0;

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let recipe = Recipe::new(Kind::Head).with_size(arguments.size as usize)?;
    let phantom = recipe.make();
    let mut renderer = arguments.adapter.open_renderer_for(recipe.dims())?;
    let distance_mm = f64::from(arguments.distance_mm);
    let radius_mm = f64::from(arguments.radius_mm);
    let count = phantom.truth.landmarks.len() * arguments.repeats as usize;
    let levers = [USUAL_LEVER_MM, distance_mm];
    let noise = hand::noise(distance_mm, &levers, count, arguments.seed)?;
    let mut ways: Vec<Way> = Vec::new();
    for way in ["ray", "tip"] {
        for lever_mm in levers {
            for snap in ["none", "surface", "gradient"] {
                let (median_mm, p95_mm, max_mm) = (f64::NAN, f64::NAN, f64::NAN);
                let errors_mm = Vec::with_capacity(count);
                ways.push(Way { way, lever_mm, snap, median_mm, p95_mm, max_mm, missed: 0, errors_mm });
            }
        }
    }
    for (at, landmark) in phantom.truth.landmarks.iter().enumerate() {
        let shown = chain::Shown::new(&mut renderer, &phantom.volume, landmark)
            .with_context(|| format!("cannot show {}", landmark.name))?;
        for repeat in 0..arguments.repeats as usize {
            let offsets = &noise[at * arguments.repeats as usize + repeat];
            shown.place(&phantom.volume, offsets, radius_mm, &mut ways);
        }
    }
    ways.iter_mut().for_each(Way::summarise);
    let landmarks = phantom.truth.landmarks.len();
    let report = Report { distance_mm, landmarks, repeats: arguments.repeats, radius_mm, ways };
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let drawing = plot::draw(&report);
        write_whole(&folder.join("accuracy.svg"), drawing.svg().as_bytes())?;
        write_whole(&folder.join("accuracy.png"), &drawing.png()?)?;
    }
    if arguments.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

impl Way {
    fn summarise(&mut self) {
        let mut sorted = self.errors_mm.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize).copied();
        let at = |share: f64| at(share).unwrap_or(f64::NAN);
        (self.median_mm, self.p95_mm, self.max_mm) = (at(0.5), at(0.95), at(1.0));
    }
}

fn print(report: &Report) {
    say!(
        "{} landmarks of the head, {} times each, with a remote {:.0} mm before the beacon; snapping within {} mm.\n",
        report.landmarks,
        report.repeats,
        report.distance_mm,
        report.radius_mm
    );
    say!(
        "{:6}{:>10}  {:10}{:>10}{:>10}{:>10}{:>8}",
        "way",
        "lever",
        "snap",
        "median",
        "95 %",
        "most",
        "missed"
    );
    for way in &report.ways {
        say!(
            "{:6}{:>7.0} mm  {:10}{:>7.2} mm{:>7.2} mm{:>7.2} mm{:>8}",
            way.way,
            way.lever_mm,
            way.snap,
            way.median_mm,
            way.p95_mm,
            way.max_mm,
            way.missed
        );
    }
}
