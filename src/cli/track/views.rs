//! `relief track views`: random views of a beacon with their poses, for comparisons with other
//! solvers.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;

use crate::output::{say, write_whole};
use crate::track::scene::TrackSceneArguments;
use relief_tracking::{MAX_SEEN, Pinhole, Pose, PoseView, Random, ViewRange, random_sightings};

/// Make random views of a beacon, solve each, and write pixels, poses and truth as JSON.
///
/// Views are from 1 to 2 m, within 30 degrees sideways, up and down and in roll.
/// scripts/compare-track gives the same pixels to OpenCV, PoseLib and IPOPT.
#[derive(Debug, clap::Args)]
pub(crate) struct TrackViewsArguments {
    /// File to make
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    #[command(flatten)]
    scene: TrackSceneArguments,
    /// Number of views
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    count: u32,
    /// Round pixels to whole ones, as a Wiimote does
    #[arg(long)]
    whole_pixels: bool,
    /// Seed of all that is random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

#[derive(serde::Serialize)]
struct File {
    camera_matrix: [f64; 9],
    distortion: [f64; 5],
    leds_mm: Vec<[f64; 3]>,
    views: Vec<FileView>,
}

/// `sensor_from_beacon`: the rotation row by row.
#[derive(serde::Serialize)]
struct FilePose {
    rotation: [f64; 9],
    translation_mm: [f64; 3],
}

#[derive(serde::Serialize)]
struct FileView {
    pixels: Vec<[f64; 2]>,
    pose: FilePose,
    rms_px: f64,
    solve_us: f64,
    truth: FilePose,
}

impl FilePose {
    fn new(pose: &Pose) -> Self {
        let by_columns = pose.rotation.matrix().transpose();
        let mut rotation = [0.0; 9];
        rotation.copy_from_slice(by_columns.as_slice());
        Self { rotation, translation_mm: pose.translation.into() }
    }
}

pub(crate) fn run(arguments: &TrackViewsArguments) -> anyhow::Result<ExitCode> {
    let (beacon, camera) = (arguments.scene.beacon()?, arguments.scene.camera()?);
    let mut random = Random::new(arguments.seed);
    let mut views = Vec::new();
    for at in 0..arguments.count {
        let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
        let mut seen = random_sightings(&beacon, &camera, &truth, arguments.scene.noise_px(), &mut random);
        if arguments.whole_pixels {
            seen.iter_mut().for_each(|sighting| sighting.pixel.apply(|c| *c = c.round()));
        }
        let view = PoseView { camera: &camera, sightings: &seen, noise_px: 0.5, gravity: None };
        let start = Instant::now();
        let solutions = view.solve().with_context(|| format!("view {at} has no pose"))?;
        let solve_us = start.elapsed().as_secs_f64() * 1e6;
        let pose = solutions.best.pose;
        views.push(FileView {
            pixels: seen.iter().map(|sighting| sighting.pixel.into()).collect(),
            pose: FilePose::new(&pose),
            rms_px: view.rms_px(&pose).unwrap_or(f64::NAN),
            solve_us,
            truth: FilePose::new(&truth),
        });
    }
    let Pinhole { fx, fy, skew, cx, cy, distortion } = camera;
    let camera_matrix = [fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let leds_mm = beacon.leds().iter().take(MAX_SEEN).map(|led| (*led).into()).collect();
    let mut times: Vec<f64> = views.iter().map(|view| view.solve_us).collect();
    times.sort_by(f64::total_cmp);
    let file = File { camera_matrix, distortion, leds_mm, views };
    write_whole(&arguments.out, &serde_json::to_vec(&file)?)?;
    say!("Made {} views in {}.", arguments.count, arguments.out.display());
    say!("  {:.0} µs a pose (median), global starts included", times[times.len() / 2]);
    Ok(ExitCode::SUCCESS)
}
