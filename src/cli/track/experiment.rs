//! `relief track experiment`: the robot-arm experiment of the 2009 paper, in simulation.

use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use rayon::prelude::*;

use crate::calibrate::table_of;
use crate::output::{print_json, say, write_whole};
use crate::text_file::read_text;
use crate::track::outcome::{ExperimentReport, WayReport};
use crate::track::plots;
use relief_tracking::{
    Beacon, Calibration, ExperimentOutcome, ExperimentRun, ExperimentSetting, FilterKind, Pinhole,
    SolverKind, TrackingMethod, run_experiment, simulate_survey,
};

/// Repeat the paper's experiment in simulation: a robot's arm turns and shifts a Wiimote before a
/// beacon.
///
/// Five runs of 21 stops: turns of 10 degrees about the sensor's X and Y axes, shifts of 10 cm
/// along the beacon's X, Y and Z. The paper states neither its beacon nor its distance, so its
/// numbers stand beside ours for orientation.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Ways: the paper's (linearised energy, plain Kalman filter on poses, f = 1320 px) on a sensor whose f differs; ours with the
same f; ours with a camera calibrated from a simulated survey, frame by frame and filtered; ours with the true camera. Errors
are means of their sizes. The bound is the posterior Cramer-Rao bound of the run, for a camera that is known exactly.

Examples:
  relief track experiment
  relief track experiment --distance-mm 1500 --focal-error 1 --out results")]
pub(crate) struct TrackExperimentArguments {
    /// From the beacon's middle to the sensor
    #[arg(long, value_name = "MM", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(500..=3000))]
    distance_mm: u32,
    /// The LEDs; the recommended beacon by default
    #[arg(long, value_name = "BEACON.toml")]
    beacon: Option<PathBuf>,
    /// Difference of the sensor's focal length from 1320 px, %
    #[arg(long, value_name = "PERCENT", default_value_t = 3.0, value_parser = percent, allow_negative_numbers = true)]
    focal_error: f64,
    /// Noise of a blob's coordinates before they are rounded, px
    #[arg(long, value_name = "PX", default_value_t = 0.5)]
    noise_px: f64,
    /// Repeats of each run: a run has 21 stops, which say an rms error to 15 %
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Folder for table.csv, points.csv, a plot of each run and one of all means (SVG and PNG)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn percent(text: &str) -> Result<f64, String> {
    let percent: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (-20.0..=20.0).contains(&percent) { Ok(percent) } else { Err("allowed: -20 to 20".to_owned()) }
}

/// The focal length that the paper took for every remote.
const PAPER_FOCAL_PX: f64 = 1320.0;

pub(crate) fn run(arguments: &TrackExperimentArguments) -> anyhow::Result<ExitCode> {
    let beacon = match &arguments.beacon {
        Some(path) => Beacon::read(&read_text(path)?)
            .with_context(|| format!("{} is not a beacon file", path.display()))?,
        None => Beacon::recommended(),
    };
    anyhow::ensure!(
        arguments.noise_px.is_finite() && (0.0..=5.0).contains(&arguments.noise_px),
        "--noise-px is {}, allowed: 0 to 5",
        arguments.noise_px
    );
    let mut setting = ExperimentSetting::new(
        Pinhole::simple(PAPER_FOCAL_PX * (1.0 + arguments.focal_error / 100.0)),
        arguments.seed,
    );
    setting.beacon = beacon;
    setting.distance_mm = f64::from(arguments.distance_mm);
    setting.sensing.noise_px = arguments.noise_px;
    setting.repeats = arguments.repeats;
    let calibration =
        simulate_survey(&setting).context("the simulated survey did not calibrate the camera")?;
    tracing::info!("calibrated:\n{}", table_of(&calibration));
    let ways = ways(&calibration, setting.camera);
    let perform_all = |way: &TrackingMethod| WayReport {
        way: way.name,
        outcomes: ExperimentRun::ALL.par_iter().map(|run| run_experiment(&setting, *run, way)).collect(),
    };
    let report = ExperimentReport {
        distance_mm: setting.distance_mm,
        noise_px: setting.sensing.noise_px,
        repeats: setting.repeats,
        true_focal_px: setting.camera.fx,
        calibrated_focal_px: calibration.camera.fx,
        runs: ExperimentRun::ALL.map(ExperimentRun::name).to_vec(),
        paper_mean: ExperimentRun::ALL.map(ExperimentRun::paper_mean).to_vec(),
        paper_deviation: ExperimentRun::ALL.map(ExperimentRun::paper_deviation).to_vec(),
        ways: ways.iter().map(perform_all).collect(),
    };
    if let Some(folder) = &arguments.out {
        write_files(folder, &report)?;
    }
    if arguments.json {
        print_json(&report)?;
    } else {
        print_table(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn ways(calibration: &Calibration, truth: Pinhole) -> [TrackingMethod; 5] {
    let fixed = Pinhole::simple(PAPER_FOCAL_PX);
    let camera = calibration.camera;
    let (solver, filter) = (SolverKind::Lm, FilterKind::ErrorState);
    [
        TrackingMethod {
            name: "paper's way, f = 1320",
            camera: fixed,
            solver: SolverKind::Paper,
            filter: FilterKind::Pose,
        },
        TrackingMethod { name: "ours, f = 1320", camera: fixed, solver, filter },
        TrackingMethod { name: "calibrated, no filter", camera, solver, filter: FilterKind::None },
        TrackingMethod { name: "calibrated, filtered", camera, solver, filter },
        TrackingMethod { name: "true camera, filtered", camera: truth, solver, filter },
    ]
}

fn print_table(report: &ExperimentReport) {
    say!(
        "Robot-arm experiment at {:.0} mm, {} times; noise {} px and whole pixels; f = {:.1} px, calibrated {:.1} px.",
        report.distance_mm,
        report.repeats,
        report.noise_px,
        report.true_focal_px,
        report.calibrated_focal_px
    );
    say!("Mean error (standard deviation); rms over the Cramer-Rao bound of the run in brackets.\n");
    say!("{:24}{}", "", report.runs.iter().map(|run| format!("{run:>22}")).collect::<String>());
    let published: String = report
        .paper_mean
        .iter()
        .zip(&report.paper_deviation)
        .map(|(mean, deviation)| format!("{:>22}", format!("{mean:.3} ({deviation:.2})       ")))
        .collect();
    say!("{:24}{published}", "published (2009)");
    for way in &report.ways {
        let cells: String = way.outcomes.iter().map(|outcome| format!("{:>22}", cell(outcome))).collect();
        say!("{:24}{cells}", way.way);
    }
    let lost: usize = report.ways.iter().flat_map(|way| &way.outcomes).map(|outcome| outcome.lost).sum();
    say!("\nFrames without a pose, of all ways and runs: {lost}");
}

fn cell(outcome: &ExperimentOutcome) -> String {
    format!("{:.3} ({:.3}) [{:.2}]", outcome.mean, outcome.deviation, outcome.rms / outcome.bound)
}

fn write_files(folder: &std::path::Path, report: &ExperimentReport) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut table = "way,run,mean,deviation,rms,bound,lost\n".to_owned();
    let mut points = "way,run,truth,error\n".to_owned();
    for (at, run) in report.runs.iter().enumerate() {
        let _ =
            writeln!(table, "published,{run},{},{},,,", report.paper_mean[at], report.paper_deviation[at]);
    }
    for way in &report.ways {
        let name = way.way.replace(',', "");
        for (run, outcome) in report.runs.iter().zip(&way.outcomes) {
            let ExperimentOutcome { mean, deviation, rms, bound, lost, .. } = outcome;
            let _ = writeln!(table, "{name},{run},{mean},{deviation},{rms},{bound},{lost}");
            for point in &outcome.points {
                let _ = writeln!(points, "{name},{run},{},{}", point.truth, point.error);
            }
        }
    }
    write_whole(&folder.join("table.csv"), table.as_bytes())?;
    write_whole(&folder.join("points.csv"), points.as_bytes())?;
    plots::write(folder, report)
}
