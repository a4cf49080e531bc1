//! The report as one HTML page: no script, no other file, nothing from a network.

use std::fmt::Write;

use super::super::super::drawing::escaped;
use super::plots;
use super::svg::{Svg, minus};
use relief_study::{Agreement, Comparison, ErrorSummary, Figure, Pairing, Relation};

const STYLE: &str = include_str!("style.css");
/// Most pairs of sets that have plots; the table has all.
const MOST_PLOTS: usize = 15;

/// The whole page.
pub(super) fn page(comparison: &Comparison) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>How well the readers agree</title>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n"
    );
    head(&mut page, comparison);
    if comparison.all.is_some() {
        errors(&mut page, comparison);
        sides(&mut page, comparison);
        landmarks(&mut page, comparison);
    }
    measures(&mut page, comparison);
    agreement(&mut page, comparison);
    limits(&mut page, comparison);
    missing(&mut page, comparison);
    notes(&mut page, comparison);
    page.push_str("</main>\n</body>\n</html>\n");
    page
}

fn head(page: &mut String, comparison: &Comparison) {
    let sets: Vec<String> = comparison.readings.iter().map(|reading| escaped(&reading.set)).collect();
    let from = match &comparison.truth {
        Some(truth) => format!("Errors are told from the set {}, which counts as the truth.", escaped(truth)),
        None => {
            "There is no truth: errors are told from the mean of the readers, which flatters them.".to_owned()
        }
    };
    let _ = writeln!(page, "<h1>How well the readers agree</h1>\n<p>{}. {from}</p>", sets.join(", "));
    let placed_by_all =
        comparison.landmarks.iter().filter(|landmark| landmark.placed.iter().all(Option::is_some)).count();
    let mut figures = vec![(sets.len().to_string(), String::new(), "sets".to_owned())];
    if comparison.cases > 1 {
        figures.push((comparison.cases.to_string(), String::new(), "patients".to_owned()));
    }
    if !comparison.landmarks.is_empty() {
        let of = format!(" of {}", comparison.landmarks.len());
        figures.push((placed_by_all.to_string(), of, "landmarks placed by all".to_owned()));
    }
    if let Some(all) = &comparison.all {
        for (value, what) in [
            (all.median_mm, "median error"),
            (all.p95_mm, "95 % of errors below"),
            (all.max_mm, "greatest error"),
        ] {
            figures.push((format!("{value:.2}"), " mm".to_owned(), what.to_owned()));
        }
    }
    figures.push((comparison.missing.len().to_string(), String::new(), "missing".to_owned()));
    page.push_str("<div class=\"figures\">\n");
    for (value, unit, what) in figures {
        let _ = writeln!(page, "<div><b>{value}<small>{unit}</small></b><span>{what}</span></div>");
    }
    page.push_str("</div>\n");
}

/// A table from its heading and its lines of cells; cells that begin with `<td` are as they are.
fn table(page: &mut String, heading: &[&str], words: usize, lines: impl IntoIterator<Item = Vec<String>>) {
    let class = |at: usize| if at < words { " class=\"words\"" } else { "" };
    page.push_str("<div class=\"scroll\"><table>\n<thead><tr>");
    for (at, name) in heading.iter().enumerate() {
        let _ = write!(page, "<th{}>{name}</th>", class(at));
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for line in lines {
        page.push_str("<tr>");
        for (at, cell) in line.iter().enumerate() {
            if cell.starts_with("<td") {
                page.push_str(cell);
            } else {
                let _ = write!(page, "<td{}>{cell}</td>", class(at));
            }
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</tbody>\n</table></div>\n");
}

fn millimetres(value: f64) -> String {
    signed(value, 2)
}

/// With a real minus sign, and no sign before nothing.
fn signed(value: f64, decimals: usize) -> String {
    let shown = format!("{value:.decimals$}");
    match shown.strip_prefix('-') {
        Some(digits) if digits.chars().all(|letter| matches!(letter, '0' | '.')) => digits.to_owned(),
        _ => minus(&shown),
    }
}

fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "\u{2013}".to_owned(), millimetres)
}

/// Count, lengths, bias and deviations of errors.
fn summary_cells(errors: &ErrorSummary) -> Vec<String> {
    let ErrorSummary { mean_mm, median_mm, p95_mm, max_mm, rms_mm, .. } = *errors;
    let mut cells = vec![errors.count.to_string()];
    cells.extend([mean_mm, median_mm, p95_mm, max_mm, rms_mm].map(millimetres));
    cells.extend(errors.bias_mm.map(millimetres));
    cells.extend((0..3).map(|axis| optional(errors.deviation_mm.map(|deviation| deviation[axis]))));
    cells
}

const SUMMARY: [&str; 12] =
    ["n", "mean", "median", "95 %", "max", "rms", "bias L", "bias P", "bias S", "SD L", "SD P", "SD S"];

fn errors(page: &mut String, comparison: &Comparison) {
    page.push_str("<section>\n<h2>Errors of the sets</h2>\n<p>How far each landmark is from where it should be, in mm. The bar is \
                   the median, the dashed one the 95th percentile. Bias and standard deviation are along the patient's axes: L to \
                   the left, P to the back, S to the head.</p>\n");
    page.push_str(&plots::by_set(comparison));
    let line = |name: &str, errors: &Option<ErrorSummary>| {
        let mut cells = vec![escaped(name)];
        match errors {
            Some(errors) => cells.extend(summary_cells(errors)),
            None => {
                cells.push("<td class=\"none\" colspan=\"12\">no landmark with a reference</td>".to_owned());
            }
        }
        cells
    };
    let sets = comparison.errors.iter().map(|of| line(&of.set, &of.errors));
    let all = (comparison.errors.len() > 1).then(|| line("all", &comparison.all));
    let heading: Vec<&str> = ["set"].into_iter().chain(SUMMARY).collect();
    table(page, &heading, 1, sets.chain(all));
    page.push_str("</section>\n");
}

fn key(page: &mut String, comparison: &Comparison) {
    page.push_str("<ul class=\"key\">");
    for (at, reading) in comparison.readings.iter().enumerate() {
        let mut mark = Svg::new([14.0, 14.0]);
        mark.mark(at, [7.0, 7.0], "");
        let _ = write!(page, "<li>{}{}</li>", mark.finish(&reading.set), escaped(&reading.set));
    }
    page.push_str("</ul>\n");
}

fn sides(page: &mut String, comparison: &Comparison) {
    page.push_str("<section>\n<h2>Errors from three sides</h2>\n<p>Each mark is a landmark, zero is where it should be. Crosses are \
                   the biases, outlines hold 95 % of a set's further errors, where it has four or more and if they are normal.</p>\n");
    key(page, comparison);
    page.push_str(&plots::from_three_sides(comparison));
    let line = |of: &relief_study::ReadingErrors| {
        let ellipsoid = of.ellipsoid?;
        let mut cells = vec![escaped(&of.set)];
        for (axis, direction) in ellipsoid.semi_axes_mm.iter().zip(ellipsoid.directions) {
            let [l, p, s] = direction.map(millimetres);
            cells.push(format!("{} <small>({l}, {p}, {s})</small>", millimetres(*axis)));
        }
        Some(cells)
    };
    let lines: Vec<_> = comparison.errors.iter().filter_map(line).collect();
    if !lines.is_empty() {
        page.push_str("<h3>Halves of the ellipsoids' axes, mm, with their directions (L, P, S)</h3>\n");
        table(page, &["set", "longest", "middle", "shortest"], 1, lines);
    }
    page.push_str("</section>\n");
}

fn landmarks(page: &mut String, comparison: &Comparison) {
    page.push_str("<section>\n<h2>Errors of the landmarks</h2>\n");
    key(page, comparison);
    let (plot, left_out) = plots::by_landmark(comparison);
    page.push_str(&plot);
    if left_out > 0 {
        let _ = writeln!(
            page,
            "<p class=\"note\">The plot has those with the greatest mean errors; the table has {left_out} more.</p>"
        );
    }
    let lines = comparison.landmarks.iter().map(|landmark| {
        let mut cells = vec![escaped(&plots::label_of(comparison, landmark))];
        match &landmark.errors {
            Some(errors) => cells.extend(summary_cells(errors)),
            None => cells.push("<td class=\"none\" colspan=\"12\">placed by one set alone</td>".to_owned()),
        }
        cells
    });
    let heading: Vec<&str> = ["landmark"].into_iter().chain(SUMMARY).collect();
    table(page, &heading, 1, lines);
    page.push_str("</section>\n");
}

fn measures(page: &mut String, comparison: &Comparison) {
    if comparison.measures.is_empty() {
        return;
    }
    page.push_str("<section>\n<h2>Measures</h2>\n<p>Lengths, angles, areas and volumes of the other items, with the reference and \
                   each set's difference from it.</p>\n");
    let sets: Vec<String> = comparison.readings.iter().map(|reading| escaped(&reading.set)).collect();
    let heading: Vec<&str> =
        ["item", "measure", "unit", "reference"].into_iter().chain(sets.iter().map(String::as_str)).collect();
    let lines = comparison.measures.iter().map(|row| {
        let name = plots::label(comparison.cases > 1, row.case, &row.list, &row.name);
        let mut cells =
            vec![escaped(&name), row.measure.to_owned(), row.unit.to_owned(), optional(row.reference)];
        cells.extend(row.values.iter().map(|value| match (value, row.reference) {
            (Some(value), Some(reference)) => {
                let plus = if value > &reference { "+" } else { "" };
                format!("{plus}{}", millimetres(value - reference))
            }
            (Some(value), None) => format!("({})", millimetres(*value)),
            (None, _) => "\u{2013}".to_owned(),
        }));
        cells
    });
    table(page, &heading, 3, lines);
    page.push_str("</section>\n");
}

fn agreement(page: &mut String, comparison: &Comparison) {
    if comparison.agreements.is_empty() {
        return;
    }
    page.push_str("<section>\n<h2>Intraclass correlation</h2>\n<p>ICC(2,1): two-way random effects, absolute agreement, single \
                   rater, with its 95 % confidence interval. It weighs the readers' differences against the distances between the \
                   landmarks, so it is close to 1 wherever these are far apart: read it beside the single rater's standard \
                   deviation.</p>\n");
    let line = |of: &Agreement| {
        let who = match &of.reader {
            Some(reader) => format!("within {}", escaped(reader)),
            None => "between readers".to_owned(),
        };
        let mut cells = vec![who, escaped(&of.sets.join(", ")), of.quantity.to_owned()];
        match &of.icc {
            Figure::Known(icc) => cells.extend([
                icc.subjects.to_string(),
                format!("<td><b>{}</b></td>", signed(icc.icc, 4)),
                format!("{} to {}", signed(icc.ci95[0], 4), signed(icc.ci95[1], 4)),
                format!("{} {}", millimetres(icc.single_deviation), of.unit),
            ]),
            Figure::Unknown(why) => cells.push(format!("<td class=\"none\" colspan=\"4\">{why}</td>")),
        }
        cells
    };
    let heading = ["", "sets", "of", "n", "ICC(2,1)", "95 % interval", "single rater's SD"];
    table(page, &heading, 3, comparison.agreements.iter().map(line));
    page.push_str("</section>\n");
}

fn limits(page: &mut String, comparison: &Comparison) {
    if comparison.pairings.is_empty() {
        return;
    }
    page.push_str("<section>\n<h2>Limits of agreement</h2>\n<p>Bland and Altman: differences over means. The line is the bias, the \
                   dashed ones are the limits between which 95 % of the differences lie, the bands are their 95 % confidence \
                   intervals.</p>\n");
    let mut pairs: Vec<(Relation, &str, &str)> = Vec::new();
    for pairing in &comparison.pairings {
        let pair = (pairing.relation, pairing.first.as_str(), pairing.second.as_str());
        if !pairs.contains(&pair) {
            pairs.push(pair);
        }
    }
    for (relation, first, second) in pairs.iter().take(MOST_PLOTS) {
        let of = |is_point: bool| -> Vec<&Pairing> {
            let is_of = |p: &&Pairing| {
                (p.relation, &*p.first, &*p.second) == (*relation, *first, *second)
                    && matches!(p.quantity, "L" | "P" | "S") == is_point
                    && !p.points.is_empty()
            };
            comparison.pairings.iter().filter(is_of).collect()
        };
        let _ = writeln!(page, "<h3>{} less {}</h3>", escaped(first), escaped(second));
        let (points, others) = (of(true), of(false));
        if points.is_empty() && others.is_empty() {
            page.push_str("<p class=\"note\">nothing in common</p>\n");
        }
        for pairings in [&points[..]].into_iter().chain(others.chunks(3)).filter(|of| !of.is_empty()) {
            page.push_str(&plots::limits(pairings));
        }
    }
    if pairs.len() > MOST_PLOTS {
        let _ =
            writeln!(page, "<p class=\"note\">{} more pairs are in the table.</p>", pairs.len() - MOST_PLOTS);
    }
    let line = |of: &Pairing| {
        let mut cells = vec![
            format!("{} \u{2212} {}", escaped(&of.first), escaped(&of.second)),
            format!("{}, {}", of.quantity, of.unit),
        ];
        let between = |[low, high]: [f64; 2]| format!("{} to {}", millimetres(low), millimetres(high));
        match &of.limits {
            Figure::Known(limits) => cells.extend([
                limits.count.to_string(),
                format!("<td><b>{}</b></td>", millimetres(limits.bias)),
                between(limits.bias_ci95),
                millimetres(limits.deviation),
                between(limits.limits),
                between(limits.lower_ci95),
                between(limits.upper_ci95),
            ]),
            Figure::Unknown(why) => cells.push(format!("<td class=\"none\" colspan=\"7\">{why}</td>")),
        }
        cells
    };
    let heading = [
        "difference",
        "of",
        "n",
        "bias",
        "95 % interval",
        "SD",
        "limits",
        "lower limit, 95 %",
        "upper limit, 95 %",
    ];
    table(page, &heading, 2, comparison.pairings.iter().map(line));
    page.push_str("</section>\n");
}

fn missing(page: &mut String, comparison: &Comparison) {
    if comparison.missing.is_empty() {
        return;
    }
    page.push_str("<section>\n<h2>What is missing</h2>\n");
    let line = |of: &relief_study::Missing| {
        let name = plots::label(comparison.cases > 1, of.case, &of.list, &of.name);
        vec![escaped(&of.set), escaped(&name), of.why.words().to_owned()]
    };
    table(page, &["set", "item", "why"], 3, comparison.missing.iter().map(line));
    page.push_str("</section>\n");
}

fn notes(page: &mut String, comparison: &Comparison) {
    let reference = if comparison.truth.is_some() {
        ""
    } else {
        " The mean of the readers has their own errors in it: of k readers without bias, errors from it are smaller than errors from \
         the truth by the factor \u{221a}(1 \u{2212} 1/k), and a bias that all share is not seen."
    };
    let patients = if comparison.cases > 1 {
        " Numbers before names count the patients, which are told apart by their frames of reference."
    } else {
        ""
    };
    let _ = writeln!(
        page,
        "<section>\n<h2>How this was computed</h2>\n<p class=\"note\">Items are matched by name, and by list where a set has a name in \
         several. What a set lacks is left out of its figures and of nobody else's, except for intraclass correlations, which take \
         what all their sets have.{reference}{patients}</p>\n<p class=\"note\">ICC(2,1): Shrout and Fleiss 1979, McGraw and Wong \
         1996 (F method). Limits of agreement: Bland and Altman 1999. Ellipsoids: Chew 1966. Percentiles: interpolated between \
         neighbours. Between readers, the first set of each is compared; within a reader, all of theirs.</p>\n</section>"
    );
}
