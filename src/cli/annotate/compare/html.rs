//! The report as one HTML page without scripts, other files or network access.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::plots;
use crate::plot::{PlotError, minus};
use relief_study::{Agreement, Comparison, ErrorSummary, Figure, Missing, Pairing, ReadingErrors, Relation};

const STYLE: &str = include_str!("style.css");
/// Most pairs of sets that have plots; the table has all.
const MOST_PLOTS: usize = 15;

/// The whole page.
///
/// # Errors
/// If a plot cannot be drawn.
pub(super) fn page(comparison: &Comparison) -> Result<String, PlotError> {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { "Agreement between readers" }
                meta name="viewport" content="width=device-width, initial-scale=1";
                style { (PreEscaped(STYLE)) }
            }
            body {
                main {
                    (heading(comparison))
                    @if comparison.all.is_some() {
                        (set_errors(comparison)?)
                        (error_directions(comparison)?)
                        (landmark_errors(comparison)?)
                    }
                    @if !comparison.measures.is_empty() { (measures(comparison)) }
                    @if !comparison.agreements.is_empty() { (correlations(comparison)) }
                    @if !comparison.pairings.is_empty() { (limits(comparison)?) }
                    @if !comparison.missing.is_empty() { (missing(comparison)) }
                    (notes(comparison))
                }
            }
        }
    };
    Ok(page.into_string())
}

/// A number in the heading of the page.
struct Headline {
    value: String,
    unit: String,
    label: &'static str,
}

fn headlines(comparison: &Comparison) -> Vec<Headline> {
    let count = |value: usize, label| Headline { value: value.to_string(), unit: String::new(), label };
    let placed_by_all =
        comparison.landmarks.iter().filter(|landmark| landmark.placed.iter().all(Option::is_some)).count();
    let mut headlines = vec![count(comparison.readings.len(), "sets")];
    if comparison.cases > 1 {
        headlines.push(count(comparison.cases, "patients"));
    }
    if !comparison.landmarks.is_empty() {
        let unit = format!(" of {}", comparison.landmarks.len());
        headlines.push(Headline { unit, ..count(placed_by_all, "landmarks placed by all") });
    }
    if let Some(all) = &comparison.all {
        let errors = [
            (all.median_mm, "median error"),
            (all.p95_mm, "95 % of errors below"),
            (all.max_mm, "greatest error"),
        ];
        headlines.extend(errors.map(|(mm, label)| Headline {
            value: format!("{mm:.2}"),
            unit: " mm".to_owned(),
            label,
        }));
    }
    headlines.push(count(comparison.missing.len(), "missing"));
    headlines
}

fn heading(comparison: &Comparison) -> Markup {
    let sets: Vec<&str> = comparison.readings.iter().map(|reading| reading.set.as_str()).collect();
    html! {
        h1 { "Agreement between readers" }
        p {
            (sets.join(", ")) ". "
            @match &comparison.truth {
                Some(truth) => { "Errors are measured from the reference set " (truth) "." }
                None => {
                    "There is no reference set. Errors are measured from the mean of the readers, which makes "
                    "them smaller than true errors."
                }
            }
        }
        div.figures {
            @for Headline { value, unit, label } in headlines(comparison) {
                div { b { (value) small { (unit) } } span { (label) } }
            }
        }
    }
}

/// A cell of a table.
enum Cell {
    Text(String),
    Strong(String),
    /// A value and a remark in small letters.
    Remark(String, String),
    /// The reason why the rest of the row is empty, over this many columns.
    Unknown(String, usize),
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// A table. Its first `words` columns are text, aligned left.
fn table(heading: &[&str], words: usize, rows: impl IntoIterator<Item = Vec<Cell>>) -> Markup {
    html! {
        div.scroll {
            table {
                thead {
                    tr { @for (at, name) in heading.iter().enumerate() { th.words[at < words] { (name) } } }
                }
                tbody {
                    @for row in rows {
                        tr { @for (at, cell) in row.iter().enumerate() { (table_cell(cell, at < words)) } }
                    }
                }
            }
        }
    }
}

fn table_cell(cell: &Cell, is_text: bool) -> Markup {
    html! {
        @match cell {
            Cell::Text(text) => { td.words[is_text] { (text) } }
            Cell::Strong(text) => { td { b { (text) } } }
            Cell::Remark(text, remark) => { td { (text) " " small { (remark) } } }
            Cell::Unknown(reason, columns) => { td.none colspan=(columns) { (reason) } }
        }
    }
}

fn cells<const N: usize>(texts: [String; N]) -> impl Iterator<Item = Cell> {
    texts.into_iter().map(Cell::Text)
}

fn millimetres(value: f64) -> String {
    signed(value, 2)
}

/// A number with a typographic minus sign, and without a sign if it is rounded to zero.
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

fn interval([low, high]: [f64; 2]) -> String {
    format!("{} to {}", millimetres(low), millimetres(high))
}

const SUMMARY: [&str; 12] =
    ["n", "mean", "median", "95 %", "max", "rms", "bias L", "bias P", "bias S", "SD L", "SD P", "SD S"];

/// The cells of [`SUMMARY`], or the reason why there are no errors.
fn summary(errors: Option<&ErrorSummary>, unknown: &str) -> Vec<Cell> {
    let Some(errors) = errors else { return vec![Cell::Unknown(unknown.to_owned(), SUMMARY.len())] };
    let ErrorSummary { mean_mm, median_mm, p95_mm, max_mm, rms_mm, .. } = *errors;
    let mut row = vec![Cell::Text(errors.count.to_string())];
    row.extend(cells([mean_mm, median_mm, p95_mm, max_mm, rms_mm].map(millimetres)));
    row.extend(cells(errors.bias_mm.map(millimetres)));
    let deviation = |axis| errors.deviation_mm.map(|deviation| deviation[axis]);
    row.extend(cells([0, 1, 2].map(|axis| optional(deviation(axis)))));
    row
}

/// A row of a table of errors.
fn error_row(name: String, errors: Option<&ErrorSummary>, unknown: &str) -> Vec<Cell> {
    let mut row = vec![Cell::Text(name)];
    row.extend(summary(errors, unknown));
    row
}

fn set_errors(comparison: &Comparison) -> Result<Markup, PlotError> {
    const UNKNOWN: &str = "no landmark with a reference";
    let row =
        |name: &str, errors: &Option<ErrorSummary>| error_row(name.to_owned(), errors.as_ref(), UNKNOWN);
    let sets = comparison.errors.iter().map(|of| row(&of.set, &of.errors));
    let all = (comparison.errors.len() > 1).then(|| row("all", &comparison.all));
    let heading: Vec<&str> = ["set"].into_iter().chain(SUMMARY).collect();
    Ok(html! {
        section {
            h2 { "Errors of the sets" }
            p {
                "Distance of each landmark from its reference, in mm. The bar marks the median, the dashed bar the "
                "95th percentile. Bias and standard deviation are along the patient's axes: L to the left, P to the "
                "back, S to the head."
            }
            (plots::by_set(comparison)?)
            (table(&heading, 1, sets.chain(all)))
        }
    })
}

/// The mark of each set in the plots.
fn legend(comparison: &Comparison) -> Markup {
    html! {
        ul.key {
            @for (at, reading) in comparison.readings.iter().enumerate() {
                li { (plots::key(at, &reading.set)) (reading.set) }
            }
        }
    }
}

fn error_directions(comparison: &Comparison) -> Result<Markup, PlotError> {
    let row = |of: &ReadingErrors| {
        let ellipsoid = of.ellipsoid?;
        let mut row = vec![Cell::Text(of.set.clone())];
        for (axis, direction) in ellipsoid.semi_axes_mm.iter().zip(ellipsoid.directions) {
            row.push(Cell::Remark(
                millimetres(*axis),
                format!("({})", direction.map(millimetres).join(", ")),
            ));
        }
        Some(row)
    };
    let rows: Vec<_> = comparison.errors.iter().filter_map(row).collect();
    Ok(html! {
        section {
            h2 { "Errors from three sides" }
            p {
                "Each mark is a landmark; its reference is at zero. Crosses mark the biases. An outline contains 95 % "
                "of a set's further errors if these are normally distributed. It needs four errors."
            }
            (legend(comparison))
            (plots::from_three_sides(comparison)?)
            @if !rows.is_empty() {
                h3 { "Semi-axes of the ellipsoids, mm, with their directions (L, P, S)" }
                (table(&["set", "longest", "middle", "shortest"], 1, rows))
            }
        }
    })
}

fn landmark_errors(comparison: &Comparison) -> Result<Markup, PlotError> {
    let (plot, left_out) = plots::by_landmark(comparison)?;
    let rows = comparison.landmarks.iter().map(|landmark| {
        let name = plots::label_of(comparison, landmark);
        error_row(name, landmark.errors.as_ref(), "placed by one set only")
    });
    let heading: Vec<&str> = ["landmark"].into_iter().chain(SUMMARY).collect();
    Ok(html! {
        section {
            h2 { "Errors of the landmarks" }
            (legend(comparison))
            (plot)
            @if left_out > 0 {
                p.note {
                    "The plot shows the landmarks with the greatest mean errors. The table has " (left_out) " more."
                }
            }
            (table(&heading, 1, rows))
        }
    })
}

fn measures(comparison: &Comparison) -> Markup {
    let sets = comparison.readings.iter().map(|reading| reading.set.as_str());
    let heading: Vec<&str> = ["item", "measure", "unit", "reference"].into_iter().chain(sets).collect();
    let difference = |value: &Option<f64>, reference: Option<f64>| match (value, reference) {
        (Some(value), Some(reference)) => {
            let plus = if *value > reference { "+" } else { "" };
            format!("{plus}{}", millimetres(value - reference))
        }
        (Some(value), None) => format!("({})", millimetres(*value)),
        (None, _) => "\u{2013}".to_owned(),
    };
    let rows = comparison.measures.iter().map(|row| {
        let name = plots::label(comparison.cases > 1, row.case, &row.list, &row.name);
        let mut line: Vec<Cell> =
            cells([name, row.measure.to_owned(), row.unit.to_owned(), optional(row.reference)]).collect();
        line.extend(row.values.iter().map(|value| Cell::Text(difference(value, row.reference))));
        line
    });
    html! {
        section {
            h2 { "Measures" }
            p {
                "Lengths, angles, areas and volumes of the other items: the reference, and the difference of each set "
                "from it."
            }
            (table(&heading, 3, rows))
        }
    }
}

fn correlations(comparison: &Comparison) -> Markup {
    let row = |of: &Agreement| {
        let who = match &of.reader {
            Some(reader) => format!("within {reader}"),
            None => "between readers".to_owned(),
        };
        let mut row: Vec<Cell> = cells([who, of.sets.join(", "), of.quantity.to_owned()]).collect();
        match &of.icc {
            Figure::Known(icc) => row.extend([
                icc.subjects.to_string().into(),
                Cell::Strong(signed(icc.icc, 4)),
                format!("{} to {}", signed(icc.ci95[0], 4), signed(icc.ci95[1], 4)).into(),
                format!("{} {}", millimetres(icc.single_deviation), of.unit).into(),
            ]),
            Figure::Unknown(why) => row.push(Cell::Unknown(why.to_string(), 4)),
        }
        row
    };
    let heading = ["", "sets", "quantity", "n", "ICC(2,1)", "95 % interval", "single rater's SD"];
    html! {
        section {
            h2 { "Intraclass correlation" }
            p {
                "ICC(2,1): two-way random effects, absolute agreement, single rater, with its 95 % confidence interval. "
                "It compares the readers' differences with the distances between the landmarks, so it is close to 1 if "
                "the landmarks are far apart. Read it together with the single rater's standard deviation."
            }
            (table(&heading, 3, comparison.agreements.iter().map(row)))
        }
    }
}

/// Two sets of the limits of agreement.
#[derive(Clone, Copy, PartialEq)]
struct SetPair<'a> {
    relation: Relation,
    first: &'a str,
    second: &'a str,
}

impl<'a> SetPair<'a> {
    fn of(pairing: &'a Pairing) -> Self {
        Self { relation: pairing.relation, first: &pairing.first, second: &pairing.second }
    }
}

/// The plots of a pair: coordinates side by side, other quantities three in a row.
fn pair_plots(comparison: &Comparison, pair: SetPair<'_>) -> Result<Markup, PlotError> {
    let (points, others): (Vec<&Pairing>, Vec<&Pairing>) = comparison
        .pairings
        .iter()
        .filter(|pairing| SetPair::of(pairing) == pair && !pairing.points.is_empty())
        .partition(|pairing| matches!(pairing.quantity, "L" | "P" | "S"));
    Ok(html! {
        h3 { (pair.first) " minus " (pair.second) }
        @if points.is_empty() && others.is_empty() { p.note { "These sets have no common item." } }
        @if !points.is_empty() { (plots::limits(&points)?) }
        @for row in others.chunks(3) { (plots::limits(row)?) }
    })
}

fn limits_row(of: &Pairing) -> Vec<Cell> {
    let mut row: Vec<Cell> =
        cells([format!("{} \u{2212} {}", of.first, of.second), format!("{}, {}", of.quantity, of.unit)])
            .collect();
    match &of.limits {
        Figure::Known(limits) => row.extend([
            limits.count.to_string().into(),
            Cell::Strong(millimetres(limits.bias)),
            interval(limits.bias_ci95).into(),
            millimetres(limits.deviation).into(),
            interval(limits.limits).into(),
            interval(limits.lower_ci95).into(),
            interval(limits.upper_ci95).into(),
        ]),
        Figure::Unknown(why) => row.push(Cell::Unknown(why.to_string(), 7)),
    }
    row
}

fn limits(comparison: &Comparison) -> Result<Markup, PlotError> {
    let mut pairs: Vec<SetPair<'_>> = Vec::new();
    for pair in comparison.pairings.iter().map(SetPair::of) {
        if !pairs.contains(&pair) {
            pairs.push(pair);
        }
    }
    let left_out = pairs.len().saturating_sub(MOST_PLOTS);
    let heading = [
        "difference",
        "quantity",
        "n",
        "bias",
        "95 % interval",
        "SD",
        "limits",
        "lower limit, 95 %",
        "upper limit, 95 %",
    ];
    Ok(html! {
        section {
            h2 { "Limits of agreement" }
            p {
                "Bland and Altman: differences over means. The line is the bias. The dashed lines are the limits between "
                "which 95 % of the differences lie. The bands are 95 % confidence intervals."
            }
            @for pair in pairs.iter().take(MOST_PLOTS) { (pair_plots(comparison, *pair)?) }
            @if left_out > 0 { p.note { "The table has " (left_out) " more pairs." } }
            (table(&heading, 2, comparison.pairings.iter().map(limits_row)))
        }
    })
}

fn missing(comparison: &Comparison) -> Markup {
    let row = |of: &Missing| {
        let name = plots::label(comparison.cases > 1, of.case, &of.list, &of.name);
        cells([of.set.clone(), name, of.why.words().to_owned()]).collect()
    };
    html! {
        section {
            h2 { "Missing items" }
            (table(&["set", "item", "reason"], 3, comparison.missing.iter().map(row)))
        }
    }
}

fn notes(comparison: &Comparison) -> Markup {
    html! {
        section {
            h2 { "Method" }
            p.note {
                "Items are matched by name, and by list if a set has a name in several lists. An item that a set lacks is "
                "left out of that set's figures only. Intraclass correlations use the items that all their sets have."
                @if comparison.truth.is_none() {
                    " The mean of the readers contains their own errors. With k unbiased readers, errors from it are smaller "
                    "than true errors by the factor \u{221a}(1 \u{2212} 1/k). A bias that all readers share stays invisible."
                }
                @if comparison.cases > 1 {
                    " Numbers before names count the patients, which are distinguished by their frames of reference."
                }
            }
            p.note {
                "ICC(2,1): Shrout and Fleiss 1979, McGraw and Wong 1996 (F method). Limits of agreement: Bland and Altman "
                "1999. Ellipsoids: Chew 1966. Percentiles: interpolated between neighbours. Between readers, the first set "
                "of each is compared; within a reader, all sets."
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::STYLE;
    use crate::plot::{INK, PALE, PAPER, RULE, SERIES, STRIPE, WARN};

    /// A colour without a rule would stay as it is by night.
    #[test]
    fn the_style_sheet_replaces_every_colour_of_plots() {
        for color in [INK, PALE, RULE, STRIPE, PAPER, WARN].into_iter().chain(SERIES) {
            let color = format!("#{:02x}{:02x}{:02x}", color.0, color.1, color.2);
            for property in ["fill", "stroke"] {
                let rule = format!("[{property}=\"{color}\"] {{ {property}: var(--");
                assert!(STYLE.contains(&rule), "{rule}");
            }
        }
    }
}
