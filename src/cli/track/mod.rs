//! `relief track`: poses of a Wiimote from its reports, live or recorded.

mod design;
mod display;
mod experiment;
mod intents;
mod outcome;
mod plots;
mod publish;
pub(crate) mod scene;
mod simulate;
pub(crate) mod source;
mod views;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use display::{Display, Sink};
use intents::Intents;
use publish::{PublishArguments, Published, Publisher};
use relief_tracking::{
    Beacon, FilterKind, MotionDensity, PoseRecord, Sensitivity, SolverKind, Tracker, TrackerOptions,
    quantised_noise,
};
use scene::TrackSceneArguments;
use source::{Event, LiveOptions, Source};

/// Track a Wiimote: from the blobs its camera sees to poses, as JSON lines or OpenIGTLink.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, after_help = AFTER_HELP)]
pub(super) struct TrackArguments {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    follow: FollowArguments,
}

const AFTER_HELP: &str = "\
Poses are beacon_from_sensor: where the camera is in the beacon's frame, mm, and how it is turned (x right, y down, z forward).
On a terminal a table shows the newest; elsewhere, and with --json, each pose is one JSON object on a line.

Examples:
  relief track simulate --out rec.jsonl                     a hand that points at the recommended beacon
  relief track --reports rec.jsonl --out poses.jsonl --intents intents.jsonl
  relief track --reports hidraw --beacon beacon.toml --sensor camera.yaml --igtl 127.0.0.1:18944
  relief track experiment                                   the 2009 paper's experiment, simulated
  relief track beacon                                       the recommended beacon as a file";

#[derive(Debug, clap::Subcommand)]
enum Action {
    Simulate(simulate::TrackSimulateArguments),
    Experiment(experiment::TrackExperimentArguments),
    Design(design::TrackDesignArguments),
    Views(views::TrackViewsArguments),
    /// Print the recommended beacon as a beacon.toml
    Beacon,
}

#[derive(Debug, clap::Args)]
struct FollowArguments {
    /// Source of reports: a recording (- is stdin), hidraw, /dev/hidrawN, or tcp://HOST:PORT,
    /// which sends a recording
    #[arg(long, value_name = "SOURCE")]
    reports: Option<String>,
    #[command(flatten)]
    scene: TrackSceneArguments,
    #[command(flatten)]
    filter: FilterArguments,
    /// Sensitivity of the camera, 1 to 6: the highest that sees no stray light
    #[arg(long, value_name = "LEVEL", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=6))]
    sensitivity: u8,
    /// Ask for blobs in full, with their outlines and brightness: half the rate, no MotionPlus
    #[arg(long, conflicts_with = "gyro")]
    full: bool,
    /// File of poses, JSON lines
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// File for the meaning of buttons and movements, JSON lines: the intents of a live session
    #[arg(long, value_name = "FILE")]
    intents: Option<PathBuf>,
    /// How a hand's movements become intents: gain, dead zones, rates
    #[arg(long, value_name = "HAND.json", requires = "intents")]
    hand: Option<PathBuf>,
    /// Record the reports of a live source
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print JSON lines on a terminal too
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    publish: PublishArguments,
    /// Publish the pose as it will be this much later
    #[arg(long, value_name = "MS", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=50))]
    predict_ms: u8,
    /// Play a recording at the speed at which it was made
    #[arg(long)]
    realtime: bool,
}

#[derive(Debug, clap::Args)]
struct FilterArguments {
    /// Method that finds the pose of a single frame
    #[arg(long, value_enum, default_value_t = Solver::Lm)]
    solver: Solver,
    /// The filter that joins frames
    #[arg(long, value_enum, default_value_t = Filter::ErrorState)]
    filter: Filter,
    /// Every frame on its own: --filter none
    #[arg(long, conflicts_with = "filter")]
    no_filter: bool,
    /// How the Wiimote moves
    #[arg(long, value_enum, default_value_t = MotionModel::Hand)]
    motion: MotionModel,
    /// Use the rates of a MotionPlus
    #[arg(long)]
    gyro: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Solver {
    /// Least squared pixel errors
    Lm,
    /// The linearised energy of the 2009 paper, by an interior-point method of our own
    #[value(alias = "paper")]
    InteriorPoint,
    /// The same by IPOPT, in builds with the cargo feature of that name; in others as
    /// interior-point
    Ipopt,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Filter {
    /// On pixels, gravity and rates
    ErrorState,
    /// The paper's, on poses
    Pose,
    /// Every frame on its own
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum MotionModel {
    /// In a hand
    Hand,
    /// On a robot's arm or a tripod
    Arm,
}

impl Solver {
    /// Without IPOPT, our own solver of the same energy is used, with a warning.
    fn kind(self) -> SolverKind {
        match self {
            Self::Lm => SolverKind::Lm,
            Self::InteriorPoint => SolverKind::Paper,
            #[cfg(feature = "ipopt")]
            Self::Ipopt => SolverKind::Ipopt,
            #[cfg(not(feature = "ipopt"))]
            Self::Ipopt => {
                tracing::warn!(
                    "this build has no IPOPT (cargo feature ipopt): --solver ipopt is solved as --solver interior-point, \
                     the same energy by a solver of our own"
                );
                SolverKind::Paper
            }
        }
    }
}

impl FilterArguments {
    fn options(&self, noise_px: f64) -> TrackerOptions {
        let filter = match self.filter {
            _ if self.no_filter => FilterKind::None,
            Filter::None => FilterKind::None,
            Filter::ErrorState => FilterKind::ErrorState,
            Filter::Pose => FilterKind::Pose,
        };
        TrackerOptions {
            filter,
            solver: self.solver.kind(),
            noise_px: quantised_noise(noise_px),
            motion: if self.motion == MotionModel::Arm { MotionDensity::ARM } else { MotionDensity::HAND },
            use_gyroscope: self.gyro,
            ..TrackerOptions::default()
        }
    }
}

pub(super) fn run(arguments: TrackArguments) -> anyhow::Result<ExitCode> {
    match arguments.action {
        Some(Action::Simulate(arguments)) => simulate::run(&arguments),
        Some(Action::Experiment(arguments)) => experiment::run(&arguments),
        Some(Action::Design(arguments)) => design::run(&arguments),
        Some(Action::Views(arguments)) => views::run(&arguments),
        Some(Action::Beacon) => {
            crate::output::say!("{}", Beacon::recommended().write().trim_end());
            Ok(ExitCode::SUCCESS)
        }
        None => follow(&arguments.follow),
    }
}

fn follow(arguments: &FollowArguments) -> anyhow::Result<ExitCode> {
    let Some(reports) = &arguments.reports else {
        eprintln!(
            "relief track: --reports SOURCE is missing: a recording, hidraw, /dev/hidrawN or tcp://HOST:PORT"
        );
        return Ok(ExitCode::from(2));
    };
    let (beacon, camera) = (arguments.scene.beacon()?, arguments.scene.camera()?);
    let options = arguments.filter.options(arguments.scene.noise_px());
    let mut tracker = Tracker::new(camera, beacon, options);
    let live = LiveOptions {
        sensitivity: Sensitivity::of_level(arguments.sensitivity).unwrap_or_default(),
        gyroscope: arguments.filter.gyro,
        full: arguments.full,
        realtime: arguments.realtime,
        record: arguments.record.clone(),
    };
    let mut source = Source::open(reports, &live)?;
    let publisher = Publisher::start(&arguments.publish)?;
    let mut display = Display::new(Sink::choose(arguments.out.as_deref(), arguments.json)?);
    let hand = arguments.hand.as_deref();
    let mut intents = arguments.intents.as_deref().map(|path| Intents::create(path, hand)).transpose()?;
    let ahead_s = f64::from(arguments.predict_ms) * 1e-3;
    let mut failure = None;
    loop {
        match source.next() {
            Ok(Some(Event::Report(t_ns, report))) => {
                intents.as_mut().map_or(Ok(()), |intents| intents.report(t_ns, &report))?;
                let start = Instant::now();
                let Some(sample) = tracker.push(t_ns, &report) else { continue };
                let solve_us = start.elapsed().as_secs_f64() * 1e6;
                intents.as_mut().map_or(Ok(()), |intents| intents.sample(&sample))?;
                let pose =
                    if ahead_s > 0.0 { tracker.predicted(ahead_s).or(sample.pose) } else { sample.pose };
                let pose = sample.pose.and(pose);
                let unix_ns = t_ns + u64::from(arguments.predict_ms) * 1_000_000;
                publisher.publish(Published { unix_ns, pose });
                display.show(&PoseRecord::new(&sample, solve_us))?;
            }
            Ok(Some(Event::Calibration(accelerometer, gyroscope))) => {
                tracker.calibrate(accelerometer, gyroscope);
            }
            Ok(None) => break,
            Err(error) => {
                failure = Some(error);
                break;
            }
        }
    }
    // A broken recording gives no complete result, so the output file is not created.
    if let Some(error) = failure {
        return Err(error);
    }
    source.finish()?;
    intents.map_or(Ok(()), Intents::finish)?;
    display.finish(tracker.dropped())?;
    Ok(ExitCode::SUCCESS)
}
