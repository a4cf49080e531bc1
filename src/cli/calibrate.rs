//! `relief calibrate`: the camera in a Wiimote, from a recording of a beacon.

use std::fmt::Write;
use std::io::{BufReader, Read};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use crate::output::{print_json, say, write_whole};
use crate::text_file::read_text;
use relief_tracking::choose_views;
use relief_tracking::{
    Beacon, BlobIdentifier, Calibration, CalibrationModel, Calibrations, CameraFormat, InputReport, Pinhole,
    RecordingReader, TimedReport, calibrate_camera, decode_ir, moving_views,
};

/// Calibrate a Wiimote's camera from a recording in which it moves around a beacon.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Move slowly around the beacon for some minutes: from left, right, above and below, near and far (half a metre tells most),
rolled both ways, with the LEDs everywhere in the picture. Sets of views that tell too little are refused, with the reason.
The beacon may be flat, if no turn or mirror image of it looks the same: a sheet with four LEDs in an uneven quadrangle.

Examples:
  relief track --reports hidraw --record survey.jsonl
  relief calibrate --reports survey.jsonl --beacon beacon.toml --out camera.yaml
  relief track simulate --path survey --seconds 120 --out survey.jsonl      to try it without a Wiimote")]
pub(super) struct CalibrateArguments {
    /// The recording: reports as JSON lines
    #[arg(long, value_name = "FILE")]
    reports: PathBuf,
    /// The LEDs; the recommended beacon by default
    #[arg(long, value_name = "BEACON.toml")]
    beacon: Option<PathBuf>,
    /// File to make: YAML of the camera
    #[arg(long, value_name = "CAMERA.yaml")]
    out: PathBuf,
    /// Parameters to calibrate
    #[arg(long, value_enum, default_value_t = CameraModelChoice::Square)]
    model: CameraModelChoice,
    /// Whose YAML
    #[arg(long, value_enum, default_value_t = Format::Opencv)]
    format: Format,
    /// Use at most N views, those that differ most [default: all views in which the remote moved]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(12..=2000))]
    views: Option<u16>,
    /// Factory calibration of the camera: the first 42 bytes or more of the remote's EEPROM.
    /// Recordings of a Wiimote contain it
    #[arg(long, value_name = "EEPROM.bin")]
    prior: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum CameraModelChoice {
    /// One focal length and the principal point
    Square,
    /// Two focal lengths and the principal point
    Pinhole,
    /// These and the skew
    Skew,
    /// Two focal lengths, the principal point and k1
    Radial,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// %YAML:1.0 of OpenCV's file storage
    Opencv,
    /// camera_info of ROS
    Ros,
}

#[derive(serde::Serialize)]
struct CalibrationReport<'a> {
    out: &'a std::path::Path,
    camera_matrix: [f64; 9],
    distortion: [f64; 5],
    sigma_fx_fy_skew_cx_cy_k1_k2: [f64; 7],
    /// 49 numbers, row by row.
    covariance: Vec<f64>,
    focal_distance_correlation: f64,
    start_fx_cx_cy: [f64; 3],
    frames: usize,
    views: usize,
    rms_px: f64,
    held_out_rms_px: f64,
    noise_px: f64,
    tilt_deg: f64,
    coverage: [f64; 2],
    view_rms_px: &'a [f64],
}

pub(super) fn run(arguments: &CalibrateArguments) -> anyhow::Result<ExitCode> {
    let beacon = match &arguments.beacon {
        Some(path) => Beacon::read(&read_text(path)?)
            .with_context(|| format!("{} is not a beacon file", path.display()))?,
        None => Beacon::recommended(),
    };
    let name = arguments.reports.display();
    let file = std::fs::File::open(&arguments.reports).with_context(|| format!("cannot read {name}"))?;
    let timed: Vec<_> = RecordingReader::new(BufReader::new(file))
        .collect::<Result<_, _>>()
        .with_context(|| format!("{name} is not a recording"))?;
    let nominal = nominal(arguments, &timed)?;
    let mut identifier = BlobIdentifier::new(beacon, nominal);
    let views: Vec<_> = timed.iter().filter_map(|timed| identifier.push(timed.t_ns, &timed.report)).collect();
    let frames = views.len();
    let moved = moving_views(views);
    let chosen = match arguments.views {
        Some(count) => choose_views(moved, usize::from(count)),
        None => moved,
    };
    let model = match arguments.model {
        CameraModelChoice::Square => CalibrationModel::Square,
        CameraModelChoice::Pinhole => CalibrationModel::Pinhole,
        CameraModelChoice::Skew => CalibrationModel::Skew,
        CameraModelChoice::Radial => CalibrationModel::Radial,
    };
    let found = calibrate_camera(&chosen, &nominal, model)
        .with_context(|| format!("{frames} frames of {name} with four LEDs do not calibrate the camera"))?;
    let format = if arguments.format == Format::Ros { CameraFormat::Ros } else { CameraFormat::OpenCv };
    write_whole(&arguments.out, relief_tracking::write_camera(&found.camera, format).as_bytes())?;
    if arguments.json {
        let mut report = report(arguments, &found, frames, chosen.len());
        report.start_fx_cx_cy = [nominal.fx, nominal.cx, nominal.cy];
        print_json(&report)?;
    } else {
        say!("{frames} frames with four LEDs, {} views used.\n{}", chosen.len(), table_of(&found));
        say!("Wrote {}.", arguments.out.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Start of the adjustment: a typical Wiimote, or the factory calibration.
fn nominal(arguments: &CalibrateArguments, recording: &[TimedReport]) -> anyhow::Result<Pinhole> {
    let factory = match &arguments.prior {
        Some(path) => {
            let name = path.display();
            let mut bytes = Vec::new();
            let file = std::fs::File::open(path).with_context(|| format!("cannot read {name}"))?;
            file.take(1 << 16).read_to_end(&mut bytes).with_context(|| format!("cannot read {name}"))?;
            let known = Calibrations::decode(&bytes).with_context(|| format!("{name} is no EEPROM"))?;
            let without = "has no camera's calibration whose checksum is right";
            Some(known.ir.with_context(|| format!("{name} {without}"))?)
        }
        None => recording.iter().find_map(|timed| match &timed.report {
            InputReport::Memory(memory) if memory.address == 0 && memory.error == 0 => {
                decode_ir(memory.bytes().first_chunk()?)
            }
            _ => None,
        }),
    };
    Ok(factory.map_or(Pinhole::TYPICAL, |factory| Pinhole::of_factory(&factory)))
}

fn report<'a>(
    arguments: &'a CalibrateArguments,
    found: &'a Calibration,
    frames: usize,
    views: usize,
) -> CalibrationReport<'a> {
    let k = &found.camera;
    CalibrationReport {
        out: &arguments.out,
        camera_matrix: [k.fx, k.skew, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        distortion: k.distortion,
        sigma_fx_fy_skew_cx_cy_k1_k2: found.sigma,
        covariance: found.covariance.iter().copied().collect(), // symmetric
        focal_distance_correlation: found.focal_distance_correlation,
        start_fx_cx_cy: [0.0; 3],
        frames,
        views,
        rms_px: found.rms_px,
        held_out_rms_px: found.held_out_rms_px,
        noise_px: found.noise_px,
        tilt_deg: found.tilt.to_degrees(),
        coverage: found.coverage,
        view_rms_px: &found.view_rms_px,
    }
}

/// The calibrated parameters with their standard deviations, and the residuals.
pub(super) fn table_of(found: &Calibration) -> String {
    let k = &found.camera;
    let values = [
        ("fx", k.fx),
        ("fy", k.fy),
        ("skew", k.skew),
        ("cx", k.cx),
        ("cy", k.cy),
        ("k1", k.distortion[0]),
        ("k2", k.distortion[1]),
    ];
    let mut text = String::new();
    for ((name, value), sigma) in values.into_iter().zip(found.sigma).filter(|(_, sigma)| *sigma > 0.0) {
        let _ = writeln!(text, "  {name:5}{value:12.4} ± {sigma:.4}");
    }
    let worst = found.view_rms_px.iter().copied().fold(0.0, f64::max);
    let _ = write!(
        text,
        "  errors {:.3} px rms, held-out views {:.3} px, worst view {worst:.3} px; noise {:.3} px\n  \
         views {:.0} degrees apart, blobs over {:.0} x {:.0} % of the picture; fx and distance correlate by {:.3}",
        found.rms_px,
        found.held_out_rms_px,
        found.noise_px,
        found.tilt.to_degrees(),
        found.coverage[0] * 100.0,
        found.coverage[1] * 100.0,
        found.focal_distance_correlation
    );
    text
}
