//! `relief track simulate`: a recording of a Wiimote that is not there, with its truth.

use std::path::PathBuf;
use std::process::ExitCode;

use super::output::{print_json, say, write_whole};
use super::track::SceneArguments;
use crate::tracking::report::recording::recording_line;
use crate::tracking::sensor::ThinLens;
use crate::tracking::simulate::{Delivery, Hand, Hidden, Simulation, Survey};

/// Make a recording of a Wiimote in a hand that points at the beacon, so that all can be tried without one.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
--sensor is the true camera and --beacon the true beacon; track with others to see what miscalibration does. Equal arguments
make equal files.

Examples:
  relief track simulate --out rec.jsonl --truth truth.jsonl
  relief track simulate --distance-mm 2000 --mishaps --hide 0:2:3 --out rec.jsonl")]
pub(super) struct Arguments {
    /// File to make: reports as JSON lines
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// File of the true poses, JSON lines
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scene: SceneArguments,
    /// Length of the recording
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=3600))]
    seconds: u16,
    /// What the hand does
    #[arg(long, value_enum, default_value_t = Moves::Point)]
    path: Moves,
    /// Mean distance from the beacon, when it points
    #[arg(long, value_name = "MM", default_value_t = 1400, value_parser = clap::value_parser!(u32).range(300..=10_000))]
    distance_mm: u32,
    /// Lose, double and swap reports, and let their times jitter
    #[arg(long)]
    mishaps: bool,
    /// Hide LED number N (from 0) from one second to another; may be given several times
    #[arg(long, value_name = "N:FROM:TO", value_parser = parse_hidden)]
    hide: Vec<Hidden>,
    /// A lens that is sharp at one distance alone: focal length, aperture and focused distance, mm. Elsewhere LEDs are larger
    /// blobs, that merge sooner
    #[arg(long, value_name = "FOCAL,APERTURE,FOCUS", value_parser = parse_lens)]
    lens: Option<[f64; 3]>,
    /// With a MotionPlus
    #[arg(long)]
    gyro: bool,
    /// Blobs in full, each picture in two reports
    #[arg(long, conflicts_with = "gyro")]
    full: bool,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Moves {
    /// It points at the beacon, and sways
    Point,
    /// It moves around the beacon and over the whole picture, for calibrations
    Survey,
}

#[derive(serde::Serialize)]
struct Truth {
    t_ns: u64,
    position_mm: [f64; 3],
    orientation_xyzw: [f64; 4],
}

#[derive(serde::Serialize)]
struct Report<'a> {
    out: &'a std::path::Path,
    reports: usize,
    seconds: u16,
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let beacon = arguments.scene.beacon()?;
    let mut simulation = Simulation::new(beacon.clone(), arguments.seed);
    simulation.camera = arguments.scene.camera()?;
    simulation.sensing.noise_px = arguments.scene.noise_px();
    if let Some(lens) = arguments.lens {
        simulation.sensing.lens = Some(lens_of(lens, simulation.camera.fx)?);
    }
    simulation.hidden.clone_from(&arguments.hide);
    simulation.gyroscope = arguments.gyro;
    simulation.full = arguments.full;
    if arguments.mishaps {
        simulation.delivery = Delivery::RADIO;
    }
    let seconds = f64::from(arguments.seconds);
    let hand = Hand::before(&beacon, f64::from(arguments.distance_mm), arguments.seed);
    let made = match arguments.path {
        Moves::Point => simulation.record(&hand, seconds),
        Moves::Survey => simulation.record(&Survey::around(&beacon, arguments.seed), seconds),
    };
    let line = |t_ns: u64, bytes: &[u8]| recording_line(t_ns, bytes) + "\n";
    let reports: String = made.iter().map(|made| line(made.t_ns, &made.report.encode())).collect();
    write_whole(&arguments.out, reports.as_bytes())?;
    if let Some(truth) = &arguments.truth {
        let mut lines = String::new();
        for made in &made {
            let pose = &made.truth;
            let (position_mm, orientation_xyzw) = (pose.position.into(), pose.orientation_xyzw());
            let truth = Truth { t_ns: made.t_ns, position_mm, orientation_xyzw };
            lines += &serde_json::to_string(&truth)?;
            lines.push('\n');
        }
        write_whole(truth, lines.as_bytes())?;
    }
    let report =
        Report { out: &arguments.out, reports: made.len(), seconds: arguments.seconds, seed: arguments.seed };
    if arguments.json {
        print_json(&report)?;
    } else {
        say!("Made {} reports of {} s in {}.", report.reports, report.seconds, report.out.display());
        say!("Next: relief track --reports {} --json", report.out.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn parse_lens(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let three = numbers.as_deref().and_then(|numbers| numbers.as_array::<3>().copied());
    three.ok_or_else(|| "expected FOCAL,APERTURE,FOCUS in mm, such as 4,2,1500".to_owned())
}

/// The lens whose pixels are as wide as the camera's focal length says.
fn lens_of([focal_mm, aperture_mm, focus_mm]: [f64; 3], focal_px: f64) -> anyhow::Result<ThinLens> {
    let behind_mm = ThinLens::new(focal_mm, aperture_mm, focus_mm, 1.0)?.sensor_distance_mm();
    Ok(ThinLens::new(focal_mm, aperture_mm, focus_mm, behind_mm / focal_px)?)
}

fn parse_hidden(text: &str) -> Result<Hidden, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let &[led, from, to] = parts.as_slice() else {
        return Err("expected N:FROM:TO, such as 0:2:3".to_owned());
    };
    let seconds = |text: &str| text.parse::<f64>().ok().filter(|s| s.is_finite());
    match (led.parse(), seconds(from), seconds(to)) {
        (Ok(led), Some(from), Some(to)) if from < to && led < crate::tracking::MAX_LEDS => {
            Ok(Hidden { led, seconds: [from, to] })
        }
        _ => Err("expected N:FROM:TO with N from 0 to 5 and FROM before TO, in seconds".to_owned()),
    }
}
