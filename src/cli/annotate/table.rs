//! Text tables with columns as wide as their content.

use super::super::output::say;
use relief_annotation::{Geometry, Item, State, measures};

/// Most letters of a cell: a name may be long, a line should not.
const WIDEST: usize = 48;

/// Prints a heading and lines; the last column may be as wide as it likes.
pub(super) fn print<const N: usize>(heading: [&str; N], lines: &[[String; N]]) {
    let cells: Vec<[String; N]> =
        lines.iter().map(|line| line.clone().map(|cell| shortened(&cell))).collect();
    let width = |column: usize| {
        let widest = cells.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
        widest.max(heading[column].chars().count())
    };
    let widths: [usize; N] = std::array::from_fn(width);
    let line = |cells: &[String]| {
        let padded = cells.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    say!("{}", line(&heading.map(str::to_owned)));
    for cells in &cells {
        say!("{}", line(cells));
    }
}

fn shortened(cell: &str) -> String {
    // Text that people wrote must not move the cursor.
    let plain: String = cell.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    if plain.chars().count() <= WIDEST {
        return plain;
    }
    plain.chars().take(WIDEST - 3).chain("...".chars()).collect()
}

/// The kind of an item (`point`, `line`, ...), or its state if it has no geometry.
pub(super) fn kind(item: &Item) -> &'static str {
    match (&item.geometry, item.state) {
        (Some(Geometry::Curve { closed: true, .. }), _) => "closed curve",
        (Some(geometry), _) => geometry.kind(),
        (None, State::Skipped) => "skipped",
        (None, _) => "missing",
    }
}

/// The measure of an item, or the position of a point or plane in patient LPS mm.
pub(super) fn extent(item: &Item) -> String {
    let Some(geometry) = &item.geometry else { return String::new() };
    if let Some(measure) = measures(geometry).first() {
        return format!("{:.2} {}", measure.value, measure.unit);
    }
    let first = geometry.points().first();
    first.map_or_else(String::new, |at| format!("({:.2}, {:.2}, {:.2})", at.xyz.x, at.xyz.y, at.xyz.z))
}
