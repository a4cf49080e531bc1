//! `relief golden`: compares pictures with approved ones; approves new ones; begins a folder of them.
//!
//! Exit status of `check`: 0 when every picture is as expected, 1 when one is not, a golden is
//! missing, or there is nothing to compare. Only `bless` writes goldens.

use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};

use crate::output::{print_json, say, write_whole};
use relief_golden::{
    Artefacts, Blessing, CaseReport, Change, CheckReport, Collection, Comparison, Difference, Harness,
    Verdict, starter_case,
};
use relief_render::{AdapterChoice, AdapterKind, Renderer};

/// Compare pictures of phantoms and series with approved ones, or approve new ones.
///
/// It works in any project: docs/GOLDEN.md begins at the beginning. Goldens are compared on a
/// software adapter, whose pictures do not depend on the machine.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief golden init                       begins a folder golden with a first case
  relief golden init --series data/chest   the same with a series
  relief golden check                      every case of the folder golden
  relief golden check camera clip/box      a suite and a case
  relief golden bless camera/front         the present picture becomes the expected one: look at it first")]
pub(super) struct GoldenArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    Init(InitArguments),
    Check(CheckArguments),
    Bless(BlessArguments),
}

/// Begin a folder of cases with a first one, first/front
#[derive(Debug, clap::Args)]
struct InitArguments {
    /// A CT series or a volume file to show; a phantom of a head when left out
    #[arg(long, value_name = "PATH")]
    series: Option<PathBuf>,
    /// The folder
    #[arg(long, value_name = "DIR", default_value = DEFAULT_DIR)]
    dir: PathBuf,
}

/// Render the cases and compare them; failures leave pictures and numbers under target/golden
#[derive(Debug, clap::Args)]
struct CheckArguments {
    /// Suites (camera) and cases (camera/front); all when none is given
    #[arg(value_name = "CASE")]
    cases: Vec<String>,
    #[command(flatten)]
    place: SuiteArguments,
    /// Print the findings as one JSON object
    #[arg(long)]
    json: bool,
}

/// Make the present pictures the expected ones
#[derive(Debug, clap::Args)]
struct BlessArguments {
    /// Suites (camera) and cases (camera/front)
    #[arg(value_name = "CASE", required_unless_present = "all")]
    cases: Vec<String>,
    /// Every case
    #[arg(long, conflicts_with = "cases")]
    all: bool,
    #[command(flatten)]
    place: SuiteArguments,
}

#[derive(Debug, clap::Args)]
struct SuiteArguments {
    /// Folder of the cases, DIR/SUITE/CASE/case.toml
    #[arg(long, value_name = "DIR", default_value = DEFAULT_DIR)]
    dir: PathBuf,
    /// Folder for the pictures of failures
    #[arg(long, value_name = "DIR", default_value = "target/golden")]
    out: PathBuf,
    /// The renderer: software, a software driver such as lavapipe, or cpu, which needs no driver. Bless
    /// and check on the same
    #[arg(long, value_name = "NAME", default_value = "software", env = "RELIEF_ADAPTER")]
    adapter: String,
}

const DEFAULT_DIR: &str = "golden";

pub(super) fn run(arguments: GoldenArguments) -> anyhow::Result<ExitCode> {
    match arguments.action {
        Action::Init(arguments) => init(&arguments),
        Action::Check(arguments) => check(&arguments),
        Action::Bless(arguments) => bless(&arguments),
    }
}

impl SuiteArguments {
    fn artefacts(&self) -> Artefacts {
        let mut bless = "relief golden bless".to_owned();
        if self.dir.as_os_str() != DEFAULT_DIR {
            bless = format!("{bless} --dir {}", self.dir.display());
        }
        Artefacts::new(self.out.clone(), bless)
    }
}

/// The first case.
const FIRST_CASE: [&str; 2] = ["first", "front"];

fn init(arguments: &InitArguments) -> anyhow::Result<ExitCode> {
    let InitArguments { series, dir } = arguments;
    if Collection::open(dir).is_ok() {
        bail!("{} has cases already; `relief golden check --dir {0}` compares them", dir.display());
    }
    let case = dir.join(FIRST_CASE[0]).join(FIRST_CASE[1]);
    if let Some(path) = series.as_deref().filter(|path| !path.exists()) {
        bail!("there is no series at {}", path.display());
    }
    let series = series.as_deref().map(|path| from_case(dir, path)).transpose()?;
    std::fs::create_dir_all(&case).with_context(|| format!("cannot create {}", case.display()))?;
    for (name, text) in starter_case(series.as_deref()) {
        let path = case.join(name);
        write_whole(&path, text.as_bytes())?;
        say!("{}", path.display());
    }
    let place =
        if dir.as_os_str() == DEFAULT_DIR { String::new() } else { format!(" --dir {}", dir.display()) };
    say!("\nNext: relief golden bless --all{place}, look at the pictures, and commit the folder.");
    Ok(ExitCode::SUCCESS)
}

/// A path from the folder of a case, which is two folders below `dir`.
fn from_case(dir: &Path, path: &Path) -> anyhow::Result<PathBuf> {
    let is_below = |path: &Path| path.components().all(|part| matches!(part, Component::Normal(_)));
    if !(is_below(dir) && path.is_relative()) {
        return Ok(std::path::absolute(path)?);
    }
    let up: PathBuf = std::iter::repeat_n("..", dir.components().count() + FIRST_CASE.len()).collect();
    Ok(up.join(path))
}

fn check(arguments: &CheckArguments) -> anyhow::Result<ExitCode> {
    let collection = Collection::open(&arguments.place.dir)?.select(&arguments.cases)?;
    let artefacts = arguments.place.artefacts();
    let report = open_harness(&arguments.place.adapter)?.check(&collection, &artefacts)?;
    if arguments.json {
        print_json(&report)?;
    } else {
        print_report(&report, &artefacts);
    }
    Ok(if report.passed() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn open_harness(adapter: &str) -> anyhow::Result<Harness> {
    let choice = if adapter.is_empty() { AdapterChoice::Software } else { AdapterChoice::parse(adapter) };
    let renderer =
        Renderer::open(&choice).context("the renderer cannot start; --adapter cpu needs no driver")?;
    let harness = Harness::new(renderer);
    if harness.adapter().kind > AdapterKind::Software {
        eprintln!(
            "relief: {} is no software adapter; goldens are made on one, so expect small differences",
            harness.adapter()
        );
    }
    Ok(harness)
}

fn print_report(report: &CheckReport, artefacts: &Artefacts) {
    for case in &report.cases {
        say!("{:<10}{}", verdict(case), case.case);
        for problem in &case.problems {
            say!("            {problem}");
        }
        if case.verdict == Verdict::Failed {
            say!("            see {}", artefacts.folder(&case.case).display());
            say!("            if the new picture is right: {}", case.bless);
        }
    }
    let (failed, all) = (report.failures().count(), report.cases.len());
    let near = report.cases.iter().filter(|case| case.verdict == Verdict::Within).count();
    let near = if near > 0 { format!(" ({near} within tolerance)") } else { String::new() };
    say!("\n{} of {all} golden images are as expected{near} on {}", all - failed, report.adapter);
    if failed > 0 {
        say!("side by side: {}", artefacts.index().display());
    }
}

const fn verdict(case: &CaseReport) -> &'static str {
    match case.verdict {
        Verdict::Identical => "ok",
        Verdict::Within => "ok (near)",
        Verdict::Failed => "FAILED",
    }
}

fn bless(arguments: &BlessArguments) -> anyhow::Result<ExitCode> {
    let collection = Collection::open(&arguments.place.dir)?.select(&arguments.cases)?;
    let mut harness = open_harness(&arguments.place.adapter)?;
    for id in collection.ids() {
        let case = collection.read(id)?;
        for Blessing { path, change, bytes } in harness.bless(&case)? {
            say!("{:<30} {} {}", id.to_string(), path.display(), describe(&change));
            if !matches!(change, Change::Unchanged) {
                write_whole(&path, &bytes)?;
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn describe(change: &Change) -> String {
    match change {
        Change::New => "is new".to_owned(),
        Change::Unchanged => "stays".to_owned(),
        Change::Damaged => "replaces a file that cannot be read".to_owned(),
        Change::Replaced(comparison) => format!("changes: {}", extent(comparison)),
    }
}

fn extent(comparison: &Comparison) -> String {
    match &comparison.difference {
        Difference::Size { expected_px: [w, h], actual_px: [new_w, new_h] } => {
            format!("from {w}x{h} to {new_w}x{new_h}")
        }
        Difference::Color(color) => {
            format!("{} of {} pixels, the most by {}/255", color.differing, color.pixels, color.max_steps)
        }
        Difference::Depth(depth) => format!(
            "{} of {} depths, the most by {:.4} mm, and {} hits",
            depth.differing, depth.pixels, depth.max_mm, depth.hit_mismatches
        ),
    }
}
