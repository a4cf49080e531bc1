//! `relief track simulate`: a recording of a Wiimote that is not there, with its truth.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::output::{print_json, say, write_whole};
use crate::track::scene::TrackSceneArguments;
use relief_tracking::{
    Buttons, HiddenLed, PointingHand, PressedButton, ReportDelivery, Simulation, SurveyingHand, ThinLens,
    recording_line,
};

/// Make a recording of a Wiimote in a hand that points at the beacon, so that all can be tried
/// without one.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
--sensor is the true camera and --beacon the true beacon; track with others to see what miscalibration does. Equal arguments
make equal files.

Examples:
  relief track simulate --out rec.jsonl --truth truth.jsonl
  relief track simulate --distance-mm 2000 --mishaps --hide 0:2:3 --out rec.jsonl
  relief track simulate --press b:2:5 --press a:6:6.5 --out rec.jsonl")]
pub(crate) struct TrackSimulateArguments {
    /// File to make: reports as JSON lines
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// File of the true poses, JSON lines
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scene: TrackSceneArguments,
    /// Length of the recording
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=3600))]
    seconds: u16,
    /// Movement of the hand
    #[arg(long, value_enum, default_value_t = SimulatedMotion::Point)]
    path: SimulatedMotion,
    /// Mean distance from the beacon, when it points
    #[arg(long, value_name = "MM", default_value_t = 1400, value_parser = clap::value_parser!(u32).range(300..=10_000))]
    distance_mm: u32,
    /// Lose, double and swap reports, and let their times jitter
    #[arg(long)]
    mishaps: bool,
    /// Hide LED number N (from 0) from one second to another; may be given several times
    #[arg(long, value_name = "N:FROM:TO", value_parser = parse_hidden)]
    hide: Vec<HiddenLed>,
    /// Hold a button from one second to another; may be given several times. left, right, up, down,
    /// plus, minus, one, two, a, b, home
    #[arg(long, value_name = "BUTTON:FROM:TO", value_parser = parse_pressed)]
    press: Vec<PressedButton>,
    /// A lens that is sharp at one distance: focal length, aperture and focused distance, mm. At
    /// other distances LEDs are larger blobs that merge sooner
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
enum SimulatedMotion {
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
struct SimulationReport<'a> {
    out: &'a std::path::Path,
    reports: usize,
    seconds: u16,
    seed: u64,
}

pub(crate) fn run(arguments: &TrackSimulateArguments) -> anyhow::Result<ExitCode> {
    let beacon = arguments.scene.beacon()?;
    let mut simulation = Simulation::new(beacon.clone(), arguments.seed);
    simulation.camera = arguments.scene.camera()?;
    simulation.sensing.noise_px = arguments.scene.noise_px();
    if let Some(lens) = arguments.lens {
        simulation.sensing.lens = Some(lens_of(lens, simulation.camera.fx)?);
    }
    simulation.hidden.clone_from(&arguments.hide);
    simulation.pressed.clone_from(&arguments.press);
    simulation.gyroscope = arguments.gyro;
    simulation.full = arguments.full;
    if arguments.mishaps {
        simulation.delivery = ReportDelivery::RADIO;
    }
    let seconds = f64::from(arguments.seconds);
    let hand = PointingHand::before(&beacon, f64::from(arguments.distance_mm), arguments.seed);
    let made = match arguments.path {
        SimulatedMotion::Point => simulation.record(&hand, seconds),
        SimulatedMotion::Survey => {
            simulation.record(&SurveyingHand::around(&beacon, arguments.seed), seconds)
        }
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
    let report = SimulationReport {
        out: &arguments.out,
        reports: made.len(),
        seconds: arguments.seconds,
        seed: arguments.seed,
    };
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

fn parse_hidden(text: &str) -> Result<HiddenLed, String> {
    let expected = "expected N:FROM:TO with N from 0 to 5 and FROM before TO, in seconds, such as 0:2:3";
    let (led, seconds) = parse_while(text).ok_or(expected)?;
    let led = led.parse().ok().filter(|led| *led < relief_tracking::MAX_LEDS).ok_or(expected)?;
    Ok(HiddenLed { led, seconds })
}

fn parse_pressed(text: &str) -> Result<PressedButton, String> {
    let names: Vec<&str> = Buttons::ALL.iter().map(|(_, name)| *name).collect();
    let expected =
        || format!("expected BUTTON:FROM:TO, such as b:2:5, with one of the buttons {}", names.join(", "));
    let (name, seconds) = parse_while(text).ok_or_else(expected)?;
    let button = Buttons::ALL.iter().find(|(_, known)| *known == name).ok_or_else(expected)?;
    Ok(PressedButton { buttons: button.0, seconds })
}

/// `WHAT:FROM:TO`, in seconds.
fn parse_while(text: &str) -> Option<(&str, [f64; 2])> {
    let parts: Vec<&str> = text.split(':').collect();
    let &[what, from, to] = parts.as_slice() else { return None };
    let seconds = |text: &str| text.parse::<f64>().ok().filter(|s| s.is_finite());
    let (from, to) = (seconds(from)?, seconds(to)?);
    (from < to).then_some((what, [from, to]))
}
