//! `relief annotate accuracy`: how near landmarks come to where they are, by the whole chain, in
//! simulation.

mod plot;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use crate::adapter::AdapterArguments;
use crate::output::{print_json, say, write_whole};
use relief_study::{AccuracyReport, AccuracySettings, PointerKind, measure_accuracy};
use relief_volume::{PhantomKind, PhantomRecipe};

/// Place the head phantom's 20 known landmarks with a simulated Wiimote or another pointer, and
/// tell by how much they are missed.
///
/// The remote is tracked as in `relief track experiment`: half a pixel of noise, rounding to
/// pixels, a camera calibrated from a survey, the default filter. The hand trembles and drifts; the
/// user looks at the cursor, moves it to the landmark, presses A, corrects, and releases. Errors
/// are distances from the true landmark.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Ways: `tip` sets the landmark down at the cursor in free space, and snapping goes to the nearest boundary or edge; `ray` picks what the
frame shows under the cursor, and snapping goes along the viewing ray. Each landmark is looked at from the nearest of the six standard
views in which it is seen. Where something hides it in all six, rays meet what lies before it; with --cut the clip plane cuts that away,
to 1 to 3 mm before the landmark. A boundary's level is the program's own, from the voxels around.

Mappings: `default` is what a session begins with (while A is held, a quarter of the way of the hand's mean); `direct` is the same
without that; `lever` is direct with a tip as far before the remote as the beacon is.

The tremor's acceleration is the most common one of 97 people's hands (M. Wade, M. Gresty and L. Findley, Arch Neurol 39, 1982: a peak of
0.01 g, from 0.0015 to 0.035 g). Drift, eyes and skill are assumptions.

Pointers: `tracker` is a tool of an optical tracker (OpenIGTLink) with 0.25 mm and 0.2 degrees of noise at 60 Hz, `opentrack` one of a webcam
with 0.5 mm and 0.3 degrees at 30 Hz, each with the space bar as button A; `spacemouse` moves the cursor at its speed of 60 mm/s at full
deflection; `phone` moves it across the picture, and its angles are rounded to 0.1 degrees as in browsers.

Examples:
  relief annotate accuracy
  relief annotate accuracy --distance-mm 1500 --tremor-g 0.035 --json
  relief annotate accuracy --seed 1,2,3,4,5 --repeats 10
  relief annotate accuracy --pointer tracker,opentrack,spacemouse,phone
  relief annotate accuracy --out results                  accuracy.svg and accuracy.png")]
pub(super) struct AccuracyArguments {
    /// Devices: wiimote, tracker, opentrack, spacemouse, phone; several with commas between
    #[arg(long = "pointer", value_name = "NAME,..", default_value = "wiimote", value_delimiter = ',', value_parser = pointer)]
    pointers: Vec<PointerKind>,
    /// From the beacon to the remote
    #[arg(long, value_name = "MM", default_value_t = 1200, value_parser = clap::value_parser!(u32).range(500..=3000))]
    distance_mm: u32,
    /// Number of placements of each landmark
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Largest movement of a landmark by snapping
    #[arg(long, value_name = "MM", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=20))]
    radius_mm: u32,
    /// Peak acceleration of the hand's tremor, standard gravities
    #[arg(long, value_name = "G", default_value_t = 0.01, value_parser = gravities)]
    tremor_g: f64,
    /// Voxels across the phantom
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(64..=512))]
    size: u32,
    /// Cut away what hides a landmark in all views
    #[arg(long)]
    cut: bool,
    /// Seed of all that is random; several, with commas between, tell how much is chance
    #[arg(long = "seed", value_name = "N,..", default_value = "1", value_delimiter = ',')]
    seeds: Vec<u64>,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Folder for a plot (SVG and PNG)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn pointer(text: &str) -> Result<PointerKind, String> {
    let names = PointerKind::ALL.map(PointerKind::name).join(", ");
    PointerKind::ALL.into_iter().find(|one| one.name() == text).ok_or(format!("pointers are {names}"))
}

fn gravities(text: &str) -> Result<f64, String> {
    let gravities: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (0.0..=0.2).contains(&gravities) { Ok(gravities) } else { Err("allowed: 0 to 0.2".to_owned()) }
}

pub(super) fn run(arguments: &AccuracyArguments) -> anyhow::Result<ExitCode> {
    let recipe = PhantomRecipe::new(PhantomKind::Head).with_size(arguments.size as usize)?;
    let phantom = recipe.make();
    let mut renderer = arguments.adapter.open_renderer_for(recipe.dims())?;
    let settings = AccuracySettings {
        pointers: arguments.pointers.clone(),
        distance_mm: f64::from(arguments.distance_mm),
        repeats: arguments.repeats,
        radius_mm: f64::from(arguments.radius_mm),
        tremor_g: arguments.tremor_g,
        cut: arguments.cut,
        seeds: arguments.seeds.clone(),
    };
    let report = measure_accuracy(&settings, &phantom, &mut renderer)?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let sheet = plot::draw(&report)?;
        write_whole(&folder.join("accuracy.svg"), sheet.svg().as_bytes())?;
        write_whole(&folder.join("accuracy.png"), &sheet.png()?)?;
    }
    if arguments.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn print(report: &AccuracyReport) {
    let AccuracyReport { distance_mm, landmarks, repeats, seeds, radius_mm, tremor_g, cut, hidden, ways } =
        report;
    say!(
        "{landmarks} landmarks of the head, {repeats} times each for each of {} seeds, with the hand {distance_mm:.0} mm before the display; a tremor of {tremor_g} g;",
        seeds.len()
    );
    say!(
        "snapping within {radius_mm} mm; of {cut} landmarks what hides them in all standard views is cut away, {hidden} stay hidden.\n"
    );
    say!(
        "{:12}{:6}{:10}{:>10}  {:10}{:>10}{:>10}{:>10}{:>8}",
        "pointer",
        "way",
        "mapping",
        "lever",
        "snap",
        "median",
        "95 %",
        "most",
        "missed"
    );
    for way in ways {
        say!(
            "{:12}{:6}{:10}{:>7.0} mm  {:10}{:>7.2} mm{:>7.2} mm{:>7.2} mm{:>8}",
            way.pointer.name(),
            way.way,
            way.mapping,
            way.lever_mm,
            way.snap,
            way.median_mm,
            way.p95_mm,
            way.max_mm,
            way.missed
        );
    }
}
