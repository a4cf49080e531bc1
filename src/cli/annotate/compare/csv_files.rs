//! The report's tables as CSV, for spreadsheets and statistics programs.

use anyhow::Context;
use csv::Writer;

use relief_base::csv_cell;
use relief_study::{Absence, Comparison, Ellipsoid, ErrorSummary, Figure, Undefined};

/// Names and contents of the files.
pub(super) fn files(comparison: &Comparison) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    Ok(vec![
        ("landmarks.csv", landmarks(comparison)?),
        ("errors.csv", errors(comparison)?),
        ("icc.csv", icc(comparison)?),
        ("bland-altman.csv", bland_altman(comparison)?),
        ("measures.csv", measures(comparison)?),
        ("missing.csv", missing(comparison)?),
    ])
}

/// A table from its heading and its lines.
fn table<const N: usize>(
    heading: [&str; N],
    lines: impl IntoIterator<Item = Vec<String>>,
) -> anyhow::Result<Vec<u8>> {
    let mut writer = Writer::from_writer(Vec::new());
    writer.write_record(heading)?;
    for line in lines {
        debug_assert_eq!(line.len(), N);
        writer.write_record(line.iter().map(|cell| csv_cell(cell).into_owned()))?;
    }
    writer.into_inner().context("cannot make a table")
}

fn cell(value: Option<f64>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

fn cells<const N: usize>(values: Option<[f64; N]>) -> impl Iterator<Item = String> {
    (0..N).map(move |at| cell(values.map(|values| values[at])))
}

fn landmarks(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let mut lines = Vec::new();
    for landmark in &comparison.landmarks {
        for (reading, placed) in comparison.readings.iter().zip(&landmark.placed) {
            let Some(placed) = placed else { continue };
            let mut line = vec![
                landmark.case.to_string(),
                landmark.list.clone(),
                landmark.name.clone(),
                reading.reader.clone(),
                reading.set.clone(),
            ];
            line.extend(cells(Some(placed.at_mm)));
            line.extend(cells(landmark.reference_mm));
            line.extend(cells(placed.error_mm));
            line.push(cell(placed.distance_mm));
            lines.push(line);
        }
    }
    let heading = [
        "case",
        "list",
        "landmark",
        "reader",
        "set",
        "l_mm",
        "p_mm",
        "s_mm",
        "reference_l_mm",
        "reference_p_mm",
        "reference_s_mm",
        "error_l_mm",
        "error_p_mm",
        "error_s_mm",
        "distance_mm",
    ];
    table(heading, lines)
}

/// Of each set, of each landmark and of all.
fn errors(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let line = |first: [&str; 5], errors: Option<&ErrorSummary>, ellipsoid: Option<&Ellipsoid>| {
        let errors = errors?;
        let mut line: Vec<String> = first.map(str::to_owned).to_vec();
        line.push(errors.count.to_string());
        line.extend(cells(Some(errors.bias_mm)));
        line.extend(cells(errors.deviation_mm));
        let ErrorSummary { mean_mm, median_mm, p95_mm, max_mm, rms_mm, .. } = errors;
        line.extend([mean_mm, median_mm, p95_mm, max_mm, rms_mm].map(f64::to_string));
        line.extend(cells(ellipsoid.map(|ellipsoid| ellipsoid.semi_axes_mm)));
        for at in 0..3 {
            line.extend(cells(ellipsoid.map(|ellipsoid| ellipsoid.directions[at])));
        }
        Some(line)
    };
    let mut lines = Vec::new();
    for of in &comparison.errors {
        lines.extend(line(["set", &of.set, "", "", ""], of.errors.as_ref(), of.ellipsoid.as_ref()));
    }
    lines.extend(line(["all", "", "", "", ""], comparison.all.as_ref(), None));
    for of in &comparison.landmarks {
        let first = ["landmark", "", &of.case.to_string(), &of.list, &of.name];
        lines.extend(line(first, of.errors.as_ref(), of.ellipsoid.as_ref()));
    }
    let heading = [
        "of",
        "set",
        "case",
        "list",
        "landmark",
        "count",
        "bias_l_mm",
        "bias_p_mm",
        "bias_s_mm",
        "deviation_l_mm",
        "deviation_p_mm",
        "deviation_s_mm",
        "mean_mm",
        "median_mm",
        "p95_mm",
        "max_mm",
        "rms_mm",
        "ellipsoid_a_mm",
        "ellipsoid_b_mm",
        "ellipsoid_c_mm",
        "a_l",
        "a_p",
        "a_s",
        "b_l",
        "b_p",
        "b_s",
        "c_l",
        "c_p",
        "c_s",
    ];
    table(heading, lines)
}

fn why<T>(figure: &Figure<T>) -> String {
    match figure {
        Figure::Known(_) => String::new(),
        Figure::Unknown(why) => Undefined::to_string(why),
    }
}

fn icc(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let line = |of: &relief_study::Agreement| {
        let icc = of.icc.known();
        let count = |of: Option<usize>| of.map(|count| count.to_string()).unwrap_or_default();
        vec![
            of.relation.name().to_owned(),
            of.reader.clone().unwrap_or_default(),
            of.sets.join(" "),
            of.quantity.to_owned(),
            of.unit.to_owned(),
            cell(icc.map(|icc| icc.icc)),
            cell(icc.map(|icc| icc.ci95[0])),
            cell(icc.map(|icc| icc.ci95[1])),
            count(icc.map(|icc| icc.subjects)),
            count(icc.map(|icc| icc.raters)),
            cell(icc.map(|icc| icc.single_deviation)),
            why(&of.icc),
        ]
    };
    let heading = [
        "relation",
        "reader",
        "sets",
        "quantity",
        "unit",
        "icc_2_1",
        "low_95",
        "high_95",
        "subjects",
        "raters",
        "single_deviation",
        "undefined",
    ];
    table(heading, comparison.agreements.iter().map(line))
}

fn bland_altman(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let line = |of: &relief_study::Pairing| {
        let limits = of.limits.known();
        let mut line = vec![
            of.relation.name().to_owned(),
            of.first.clone(),
            of.second.clone(),
            of.quantity.to_owned(),
            of.unit.to_owned(),
            of.points.len().to_string(),
            cell(limits.map(|limits| limits.bias)),
        ];
        line.extend(cells(limits.map(|limits| limits.bias_ci95)));
        line.push(cell(limits.map(|limits| limits.deviation)));
        line.extend(cells(limits.map(|limits| limits.limits)));
        line.extend(cells(limits.map(|limits| limits.lower_ci95)));
        line.extend(cells(limits.map(|limits| limits.upper_ci95)));
        line.push(why(&of.limits));
        line
    };
    let heading = [
        "relation",
        "first",
        "second",
        "quantity",
        "unit",
        "count",
        "bias",
        "bias_low_95",
        "bias_high_95",
        "deviation",
        "lower_limit",
        "upper_limit",
        "lower_limit_low_95",
        "lower_limit_high_95",
        "upper_limit_low_95",
        "upper_limit_high_95",
        "undefined",
    ];
    table(heading, comparison.pairings.iter().map(line))
}

fn measures(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let mut lines = Vec::new();
    for row in &comparison.measures {
        for (reading, value) in comparison.readings.iter().zip(&row.values) {
            let difference = value.zip(row.reference).map(|(value, reference)| value - reference);
            let (case, list, name) = (row.case.to_string(), row.list.clone(), row.name.clone());
            let numbers = [*value, row.reference, difference].map(cell);
            let mut line = vec![case, list, name, row.measure.to_owned(), row.unit.to_owned()];
            line.extend([reading.reader.clone(), reading.set.clone()]);
            line.extend(numbers);
            lines.push(line);
        }
    }
    let heading =
        ["case", "list", "item", "measure", "unit", "reader", "set", "value", "reference", "difference"];
    table(heading, lines)
}

fn missing(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let line = |of: &relief_study::Missing| {
        let why = Absence::words(of.why).to_owned();
        vec![of.set.clone(), of.case.to_string(), of.list.clone(), of.name.clone(), why]
    };
    table(["set", "case", "list", "item", "why"], comparison.missing.iter().map(line))
}
