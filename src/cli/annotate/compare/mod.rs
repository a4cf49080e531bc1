//! `relief annotate compare`: how well several readers agree, as tables and as a page with plots.

mod csv_files;
mod html;
mod plots;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use super::super::output::{print_json, say, write_whole};
use super::log_options::{Log, LogArguments};
use super::table;
use relief_annotation::Set;
use relief_store::Filter;
use relief_study::compare_readings;
use relief_study::{
    Agreement, BlandAltman, Comparison, Figure, Icc, Missing, Pairing, Reading, ReadingMeasures, Study,
};

/// Compare sets of several readers: errors, bias, ICC(2,1), limits of agreement
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Items are matched by name, and by list where a set has a name in several. What a reader has not placed is named, and left out.
Errors are distances from the truth, or from the mean of the readers. Sets of one reader (`relief annotate sets`) are repeats; so are
sets whose names differ only after the separator of --repeats. DIR gets report.html, which needs no other file, and the tables
landmarks.csv, errors.csv, icc.csv, bland-altman.csv, measures.csv and missing.csv.

Examples:
  relief annotate --db ann.db compare --sets anna,ben,carla --out report
  relief annotate --db ann.db compare --sets anna,ben --truth phantom --json
  relief annotate --db ann.db compare --sets anna.1,anna.2,ben.1,ben.2 --repeats . --out report")]
pub(super) struct CompareArguments {
    /// The sets to compare, of each reader one or more
    #[arg(long, value_name = "SET,...", required = true, value_delimiter = ',')]
    sets: Vec<String>,
    /// Set that counts as the truth [default: the mean of the readers]
    #[arg(long, value_name = "SET")]
    truth: Option<String>,
    /// Separator in names of sets: the part before its last occurrence is the reader, the part
    /// after it the repeat
    #[arg(long, value_name = "SEPARATOR", value_parser = clap::builder::PossibleValuesParser::new([".", "-", "_"]))]
    repeats: Option<String>,
    /// Folder for the report and its tables
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &CompareArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let known = log.wait(log.store().sets())?;
    let read = |set: &String| read(&log, &known, set, arguments.repeats.as_deref());
    let readings = arguments.sets.iter().map(read).collect::<anyhow::Result<_>>()?;
    let truth = arguments.truth.as_ref().map(read).transpose()?;
    let comparison = compare_readings(Study { readings, truth })?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for (name, bytes) in csv_files::files(&comparison)? {
            write_whole(&folder.join(name), &bytes)?;
        }
        write_whole(&folder.join("report.html"), html::page(&comparison)?.as_bytes())?;
    }
    if arguments.json {
        print_json(&comparison)?;
    } else {
        print(&comparison);
        if let Some(folder) = &arguments.out {
            say!("\nWrote {}.", folder.join("report.html").display());
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn read(log: &Log, known: &[Set], set: &str, separator: Option<&str>) -> anyhow::Result<Reading> {
    let filter = Filter { sets: Some(vec![set.to_owned()]), ..Filter::default() };
    let items = log.wait(log.store().list(&filter))?.items.into_iter().map(|found| found.item).collect();
    let by_name = || separator.and_then(|separator| set.rsplit_once(separator)).map(|(reader, _)| reader);
    let of_set = known.iter().find(|known| known.name == set).and_then(|known| known.reader.clone());
    let reader = of_set.or_else(|| by_name().map(str::to_owned)).unwrap_or_else(|| set.to_owned());
    Ok(Reading { set: set.to_owned(), reader, items })
}

fn print(comparison: &Comparison) {
    let from = comparison.truth.as_deref().unwrap_or("the mean of the readers");
    let number = |value: f64| format!("{value:.2}");
    let lines: Vec<_> = comparison
        .errors
        .iter()
        .filter_map(|of| {
            let errors = of.errors.as_ref()?;
            let [l, p, s] = errors.bias_mm.map(number);
            let [mean, median, p95, max] =
                [errors.mean_mm, errors.median_mm, errors.p95_mm, errors.max_mm].map(number);
            Some([of.set.clone(), errors.count.to_string(), mean, median, p95, max, l, p, s])
        })
        .collect();
    if !lines.is_empty() {
        say!("Errors of landmarks in mm, from {from}; bias along L, P and S.");
        table::print(["set", "n", "mean", "median", "95 %", "max", "L", "P", "S"], &lines);
    }
    let line = |of: &ReadingMeasures| {
        let [bias, mean, max] = [of.bias, of.mean, of.max].map(number);
        [of.set.clone(), format!("{}, {}", of.measure, of.unit), of.count.to_string(), bias, mean, max]
    };
    let lines: Vec<_> = comparison.measure_errors.iter().map(line).collect();
    if !lines.is_empty() {
        say!("\nMeasures, from {from}.");
        table::print(["set", "measure", "n", "bias", "mean", "max"], &lines);
    }
    print_agreement(comparison);
    let line = |of: &Missing| {
        let case = if comparison.cases > 1 { format!("{}: ", of.case) } else { String::new() };
        [of.set.clone(), format!("{case}{}", of.name), of.why.words().to_owned()]
    };
    let lines: Vec<_> = comparison.missing.iter().map(line).collect();
    if !lines.is_empty() {
        say!("\nMissing.");
        table::print(["set", "item", "why"], &lines);
    }
}

fn print_agreement(comparison: &Comparison) {
    let line = |of: &Agreement| {
        let between = || "between readers".to_owned();
        let who = of.reader.as_ref().map_or_else(between, |reader| format!("within {reader}"));
        let figure = match &of.icc {
            Figure::Known(Icc { icc, ci95: [low, high], subjects, single_deviation, .. }) => {
                format!("{icc:.4} ({low:.4} to {high:.4}), n = {subjects}, {single_deviation:.2} {}", of.unit)
            }
            Figure::Unknown(why) => why.to_string(),
        };
        [who, of.quantity.to_owned(), figure]
    };
    let lines: Vec<_> = comparison.agreements.iter().map(line).collect();
    if !lines.is_empty() {
        say!("\nICC(2,1) with its 95 % confidence interval, and the standard deviation of a single rater.");
        table::print(["", "of", ""], &lines);
    }
    let line = |of: &Pairing| {
        let figure = match &of.limits {
            Figure::Known(BlandAltman { bias, limits: [low, high], count, .. }) => {
                format!("{bias:.2} ({low:.2} to {high:.2}) {}, n = {count}", of.unit)
            }
            Figure::Unknown(why) => why.to_string(),
        };
        [format!("{} - {}", of.first, of.second), of.quantity.to_owned(), figure]
    };
    let lines: Vec<_> = comparison.pairings.iter().map(line).collect();
    if !lines.is_empty() {
        say!("\nBias of the first less the second, with the limits of agreement.");
        table::print(["sets", "of", ""], &lines);
    }
}
