//! `relief inspect`: describes a series, a 2D-plus-depth frame, a film of frames, a panel or what a
//! DICOM archive has, and reports errors.

#[cfg(feature = "archives")]
mod archive;
mod film;
pub(crate) mod frame;
mod panel;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use data_encoding::HEXLOWER;
use serde::Serialize;

use crate::against_true::AgainstTrue;
use crate::archive::ArchiveArguments;
use crate::output::say;
use crate::{output, source};
use relief_base::printable;
use relief_dicom::{Loaded, Phase, SeriesEntry, Skipped, Warning};

/// Describe a CT series, or decode 2D-plus-depth frames, and report errors
///
/// A film is decoded by ffmpeg, and each of its frames is checked. A .json file is a panel with
/// lenses, also the calibration of a Looking Glass. Of a DICOM archive, the series that match are
/// listed, each with the address that --series takes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief inspect chest
  relief inspect chest.nii.gz
  relief inspect frame.png --json
  relief render --series chest --layout views-9x1 --view-span 4 --views true --out true.png
  relief inspect frame.png --against-true true.png --view-span 4 --map map.png
  relief inspect session.mkv
  relief inspect panel.json
  relief inspect 'dicomweb+https://ct-server/dicom-web?PatientID=4711&Modality=CT' --archive-login-file login")]
pub(super) struct InspectArguments {
    /// CT series (folder, file, DICOMDIR or zip), a volume (.nii, .nii.gz, .nrrd), a 2D-plus-depth frame
    /// (PNG), a film of frames (.mkv, .mp4 and others), a panel (.json) or a DICOM archive
    /// (dicomweb+https://HOST/ROOT, with /studies/UID or ?ATTRIBUTE=VALUE if wanted)
    #[arg(value_name = "SERIES|VOLUME|FRAME.png|FILM|PANEL.json|ARCHIVE")]
    path: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Fail on any defective file instead of leaving it out with a warning
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    against_true: AgainstTrue,
    /// Eye separations between the outermost views of --against-true: 1 for two views and 2 for more where left out
    #[arg(long, value_name = "EYES", requires = "against_true")]
    view_span: Option<f64>,
    /// The ffmpeg that decodes films
    #[arg(long, value_name = "PATH", env = "RELIEF_FFMPEG", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Show names and ids of patients in the list of an archive
    #[arg(long)]
    show_patient_data: bool,
    #[command(flatten)]
    archive: ArchiveArguments,
}

#[derive(Debug, Serialize)]
struct InspectReport {
    series: Vec<SeriesReport>,
    skipped: Vec<Skipped>,
}

/// A series as `--json` shows it: geometry of the volume, hash of the stack as read.
#[derive(Debug, Serialize)]
struct SeriesReport {
    uid: String,
    modality: String,
    dims: [usize; 3],
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
    /// Columns are the voxel axes in LPS; row-major.
    direction: [f64; 9],
    hu_range: [i16; 2],
    /// The type of the values: HU, or RescaleType as the files have it.
    value_type: String,
    stack_sha256: String,
    transfer_syntax: String,
    /// Its number among the phases of one region, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    phase: Option<Phase>,
    /// What distinguishes its slices from others of the same SeriesInstanceUID.
    differs: Vec<String>,
    warnings: Vec<Warning>,
}

#[expect(clippy::needless_pass_by_value, reason = "every subcommand takes its arguments")]
pub(super) fn run(arguments: InspectArguments) -> anyhow::Result<ExitCode> {
    #[cfg(feature = "archives")]
    if let Some(address) = archive_address(&arguments.path)? {
        let InspectArguments { archive, show_patient_data, json, .. } = &arguments;
        return archive::run(&address, &archive.access()?, *show_patient_data, *json);
    }
    if is_png(&arguments.path) {
        return frame::run(&arguments.path, &arguments.against_true, arguments.view_span, arguments.json);
    }
    arguments.against_true.refuse("is for 2D-plus-depth frames (.png)")?;
    if film::is_film(&arguments.path) {
        return film::run(&arguments.path, &arguments.ffmpeg, arguments.json);
    }
    if arguments.path.is_file()
        && arguments.path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"))
    {
        return panel::run(&arguments.path, arguments.json);
    }
    let report = report(&arguments)?;
    if arguments.json {
        output::print_json(&report)?;
    } else {
        print(&report);
    }
    if report.series.is_empty() {
        eprintln!("relief: no CT series in {} can be loaded", arguments.path.display());
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

/// The address of an archive, if the path is one.
#[cfg(feature = "archives")]
fn archive_address(path: &Path) -> anyhow::Result<Option<relief_archive::ArchiveAddress>> {
    let text = path.to_str().filter(|text| text.starts_with(relief_archive::SCHEME));
    Ok(text.map(str::parse).transpose()?)
}

/// By its signature, since frames are often served and saved without extension.
fn is_png(path: &Path) -> bool {
    let mut signature = [0; 8];
    if !path.is_file() {
        return false; // opening a pipe would wait for its writer
    }
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut signature));
    read.is_ok() && signature == *b"\x89PNG\r\n\x1a\n"
}

fn report(arguments: &InspectArguments) -> anyhow::Result<InspectReport> {
    if relief_dicom::is_volume_file(&arguments.path) {
        let series = SeriesReport::of_volume(&source::read_file(&arguments.path)?);
        return Ok(InspectReport { series: vec![series], skipped: Vec::new() });
    }
    let strictness = source::strictness(arguments.strict);
    let found = source::discover(&arguments.path, strictness)?;
    let mut report = InspectReport { series: Vec::new(), skipped: found.skipped.clone() };
    for entry in &found.series {
        match source::load_entry(entry, strictness) {
            Ok(loaded) => report.series.push(SeriesReport::new(entry, &loaded)),
            Err(error) if arguments.strict => return Err(error),
            // One series that cannot be loaded must not hide the others.
            Err(error) => {
                let reason = output::report(&error);
                report.skipped.push(Skipped { file: entry.summary(), reason, defect: None });
            }
        }
    }
    Ok(report)
}

impl SeriesReport {
    fn new(entry: &SeriesEntry, loaded: &Loaded) -> Self {
        Self {
            uid: entry.uid().to_owned(),
            modality: entry.modality().to_owned(),
            transfer_syntax: entry.transfer_syntax(),
            phase: entry.phase(),
            differs: entry.differs().to_vec(),
            value_type: entry.value_type().to_owned(),
            ..Self::of_volume(loaded)
        }
    }

    /// A volume of another format than DICOM, which has no series.
    fn of_volume(loaded: &Loaded) -> Self {
        let grid = loaded.volume.grid();
        let (low, high) = loaded.volume.range_hu();
        Self {
            uid: String::new(),
            modality: String::new(),
            dims: grid.dims(),
            spacing_mm: grid.spacing_mm(),
            origin_mm: grid.origin().xyz.to_array(),
            direction: grid.direction(),
            hu_range: [low, high],
            value_type: "HU".to_owned(),
            stack_sha256: HEXLOWER.encode(&loaded.stack_sha256()),
            transfer_syntax: String::new(),
            phase: None,
            differs: Vec::new(),
            warnings: loaded.warnings.clone(),
        }
    }
}

fn print(report: &InspectReport) {
    for series in &report.series {
        print_series(series);
    }
    if !report.skipped.is_empty() {
        say!("skipped");
        for skipped in &report.skipped {
            say!("  {}: {}", printable(&skipped.file), printable(&skipped.reason));
        }
    }
}

fn print_series(series: &SeriesReport) {
    let millimetres = |values: [f64; 3]| values.map(|mm| format!("{mm:.4}")).join(" x ");
    let [nx, ny, nz] = series.dims;
    say!(
        "series            {}",
        if series.uid.is_empty() { "(empty UID)".into() } else { printable(&series.uid) }
    );
    let or_none = |text: &str| if text.is_empty() { "(none)".into() } else { printable(text).to_string() };
    say!("  modality        {}", or_none(&series.modality));
    say!("  voxels          {nx} x {ny} x {nz}");
    say!("  spacing         {} mm", millimetres(series.spacing_mm));
    say!("  first voxel     {} mm, LPS", series.origin_mm.map(|mm| format!("{mm:.3}")).join(", "));
    for (axis, name) in ["i", "j", "k"].into_iter().enumerate() {
        let components = [0, 3, 6].map(|row| format!("{:.6}", series.direction[row + axis]));
        say!("  axis {name}          {}", components.join(", "));
    }
    let [low, high] = series.hu_range;
    let unit = match series.value_type.as_str() {
        "HU" => "HU".to_owned(),
        other => format!("of RescaleType {}, not HU", printable(other)),
    };
    say!("  values          {low} to {high} {unit}");
    say!("  stack SHA-256   {}", series.stack_sha256);
    say!("  transfer syntax {}", or_none(&series.transfer_syntax));
    if let Some(phase) = series.phase {
        say!("  phase           {} of {}", phase.number, phase.count);
    }
    for differs in &series.differs {
        say!("  stack           {}", printable(differs));
    }
    for warning in &series.warnings {
        say!("  warning         {}", printable(&warning.message));
    }
    say!();
}
