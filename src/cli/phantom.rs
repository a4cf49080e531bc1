//! `relief phantom`: a procedural CT series and its truth, written as DICOM files.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::{ProgressBar, ProgressStyle};

use crate::output::{self, say};
use relief_dicom::{ExistingFolder, SeriesFolder, SeriesLabels, write_seg_nrrd};
use relief_volume::{Phantom, PhantomKind, PhantomRecipe};

/// Make a procedural CT series with its truth: DICOM slices and truth.json in a folder.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The folder appears whole or not at all. Equal arguments make equal files, byte for byte.

Examples:
  relief phantom --out head                        a head, 256 x 256 x 220 voxels
  relief phantom --size 512 --seed 7 --out head    finer, with other noise and folds
  relief phantom --kind sphere --out sphere        a ball whose depth is known in closed form")]
pub(super) struct PhantomArguments {
    /// Folder to make.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The phantom to make.
    #[arg(long, default_value = "head", value_parser = kind_parser())]
    kind: PhantomKind,
    /// Voxels across, 16 to 1024 [default: 256 for head, sphere and slab; 64 for ramp and axes].
    #[arg(long, value_name = "N", value_parser = parse_size)]
    size: Option<usize>,
    /// Seed of the noise and the irregular shapes.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Replace the folder if it holds an earlier series of this command.
    #[arg(long)]
    force: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct PhantomReport<'a> {
    kind: &'a str,
    folder: &'a std::path::Path,
    truth: PathBuf,
    landmarks: Option<PathBuf>,
    labels: Option<PathBuf>,
    slices: usize,
    dims: [usize; 3],
    spacing_mm: [f64; 3],
    size: usize,
    seed: u64,
    stack_sha256: &'a str,
    seconds: f64,
}

pub(super) fn run(arguments: PhantomArguments) -> anyhow::Result<ExitCode> {
    let PhantomArguments { out, kind, size, seed, force, json } = arguments;
    let started = Instant::now();
    let recipe = PhantomRecipe::new(kind).with_size(size.unwrap_or(kind.default_size()))?.with_seed(seed);
    let existing = if force { ExistingFolder::Replace } else { ExistingFolder::Keep };
    let folder = SeriesFolder::create(&out, existing)?; // refuse before the work, not after it
    let bar = progress_bar(2 * recipe.dims()[2]);
    let advance = |slices: usize| bar.inc(slices as u64);
    bar.set_message(format!("making the {}", kind.name()));
    let Phantom { volume, truth } = recipe.make_reporting(&advance);
    bar.set_message("writing");
    folder.write_slices(&volume, &labels(kind, seed), &advance)?;
    folder.write_file("truth.json", &serde_json::to_vec_pretty(&truth)?)?;
    if !truth.landmarks.is_empty() {
        folder.write_file("landmarks.csv", truth.landmark_table().as_bytes())?;
    }
    let organs = recipe.label_map();
    if let Some(map) = &organs {
        folder.write_file("labels.seg.nrrd", &write_seg_nrrd(map)?)?;
    }
    folder.finish()?;
    bar.finish_and_clear();
    let report = PhantomReport {
        kind: kind.name(),
        folder: &out,
        truth: out.join("truth.json"),
        landmarks: (!truth.landmarks.is_empty()).then(|| out.join("landmarks.csv")),
        labels: organs.map(|_| out.join("labels.seg.nrrd")),
        slices: truth.dims[2],
        dims: truth.dims,
        spacing_mm: truth.spacing_mm,
        size: truth.size,
        seed,
        stack_sha256: &truth.stack_sha256,
        seconds: started.elapsed().as_secs_f64(),
    };
    if json {
        output::print_json(&report)?;
    } else {
        print_text(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn print_text(report: &PhantomReport<'_>) {
    let ([nx, ny, nz], [sx, sy, sz]) = (report.dims, report.spacing_mm);
    let folder = report.folder.display();
    say!("Made the {} phantom in {folder} in {:.1} s.", report.kind, report.seconds);
    say!("  {} DICOM slices: {nx} x {ny} x {nz} voxels of {sx:.4} x {sy:.4} x {sz:.4} mm", report.slices);
    say!("  truth.json: its materials, surfaces and landmarks in patient mm");
    if report.landmarks.is_some() {
        say!("  landmarks.csv: its landmarks, for relief annotate import");
    }
    if report.labels.is_some() {
        say!("  labels.seg.nrrd: its organs, for --labels");
    }
    say!("Next: relief render --series {folder} --preset bone --out {}.png", report.kind);
}

/// Drawn on a terminal only; elsewhere the work is short enough to stay silent.
fn progress_bar(steps: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len} slices, {eta} left");
    ProgressBar::new(steps as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

fn labels(kind: PhantomKind, seed: u64) -> SeriesLabels {
    let name = kind.name().to_uppercase();
    SeriesLabels {
        patient_name: format!("PHANTOM^{name}"),
        patient_id: format!("PHANTOM-{name}-{seed}"),
        description: format!("Procedural phantom: {}", kind.name()),
        body_part: if kind == PhantomKind::Head { "HEAD".to_owned() } else { String::new() },
        window_hu: if kind == PhantomKind::Head { (40, 400) } else { (0, 2000) },
    }
}

fn kind_parser() -> impl TypedValueParser<Value = PhantomKind> {
    PossibleValuesParser::new(PhantomKind::ALL.map(PhantomKind::name))
        .try_map(|name| name.parse::<PhantomKind>())
}

fn parse_size(text: &str) -> Result<usize, String> {
    let size = text.parse().map_err(|error| format!("{error}"))?;
    let recipe = PhantomRecipe::new(PhantomKind::Head).with_size(size);
    recipe.map(|_| size).map_err(|error| error.to_string())
}
