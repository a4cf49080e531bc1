//! 3D Slicer's tables of points: `.csv` and `.tsv`, columns in any order, found by their names.
//!
//! `label`; `l`, `p`, `s` (LPS) or `r`, `a`, `s` (RAS); `defined`, `visible`, `locked` (0 or 1),
//! `description`. Columns `x`, `y`, `z` are refused: they do not say which of the two they are, and
//! the wrong one is the mirror image of the right one.

use super::delimited::{Columns, Row};
use super::reading::{self, Reading, mirrored, point};
use super::{ExchangeError, Format, Imported, ReadContext};
use relief_annotation::{Geometry, Item};
use relief_base::{csv_cell, of_csv_cell};

const LPS: [&str; 3] = ["l", "p", "s"];
const RAS: [&str; 3] = ["r", "a", "s"];
const WRITTEN: [&str; 9] =
    ["label", "l", "p", "s", "defined", "selected", "visible", "locked", "description"];

/// Reads a table of points.
///
/// # Errors
/// As [`super::read`]; places are lines and columns.
pub(super) fn read(
    format: Format,
    bytes: &[u8],
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let text = reading::text(format, bytes)?;
    let first = text.lines().next().unwrap_or("");
    let delimiter = [b'\t', b','].into_iter().find(|byte| first.as_bytes().contains(byte)).unwrap_or(b';');
    let columns = Columns::new(format, first.split(char::from(delimiter)));
    let system = system(format, &columns)?;
    let mut reading = Reading::new(format, context);
    for name in columns
        .names()
        .iter()
        .filter(|name| !WRITTEN.contains(&name.as_str()) && !RAS.contains(&name.as_str()))
    {
        let name: String = name.chars().take(40).collect();
        reading.warn("", &format!("the column {name:?} is left out"));
    }
    let mut is_header = true;
    columns.rows(text, delimiter, None, |row| {
        if std::mem::take(&mut is_header) || row.is_blank() {
            return Ok(());
        }
        read_row(&mut reading, &row, system)
    })?;
    Ok(reading.finish())
}

/// The columns of the coordinates.
fn system(format: Format, columns: &Columns) -> Result<[&'static str; 3], ExchangeError> {
    let has = |system: [&str; 3]| system.into_iter().all(|name| columns.has(name));
    match (has(LPS), has(RAS)) {
        (true, false) => Ok(LPS),
        (false, true) => Ok(RAS),
        (is_both, _) => {
            let found = if is_both {
                "columns of LPS and of RAS".to_owned()
            } else {
                format!("columns {}", columns.names().join(","))
            };
            let allowed = "columns label and l,p,s (LPS) or r,a,s (RAS); x,y,z do not say which";
            Err(ExchangeError::value(format, "line 1", found, allowed))
        }
    }
}

fn read_row(reading: &mut Reading<'_>, row: &Row<'_>, system: [&str; 3]) -> Result<(), ExchangeError> {
    let geometry = if row.flag("defined", true)? {
        let xyz = row.position(system)?;
        Some(Geometry::Point { at_mm: point(if system == RAS { mirrored(xyz) } else { xyz }) })
    } else {
        None
    };
    let label = of_csv_cell(row.text("label"));
    let name = if label.is_empty() {
        format!("{}-{}", reading.context.list, reading.count() + 1)
    } else {
        label.to_owned()
    };
    let mut item = reading.item(&name, geometry)?;
    item.description = of_csv_cell(row.text("description")).to_owned();
    item.visible = row.flag("visible", true)?;
    item.locked = row.flag("locked", false)?;
    reading.push(&row.place(), item)
}

/// Writes points, LPS.
///
/// # Errors
/// Only a lack of memory: the table is written there.
pub(super) fn write(format: Format, items: &[&Item]) -> Result<Vec<u8>, ExchangeError> {
    let delimiter = if format == Format::Tsv { b'\t' } else { b',' };
    let mut writer = csv::WriterBuilder::new().delimiter(delimiter).from_writer(Vec::new());
    let failed = |error: csv::Error| ExchangeError::Syntax {
        format,
        place: "writing".to_owned(),
        source: error.into(),
    };
    writer.write_record(WRITTEN).map_err(failed)?;
    for item in items {
        // A missing place is an empty cell, so that it cannot count as zero in a mean.
        let place = |at: Option<f64>| at.map(|mm| mm.to_string()).unwrap_or_default();
        let [l, p, s] = [0, 1, 2].map(|axis| place(item.point().map(|at| at.xyz[axis])));
        let flag = |yes: bool| if yes { "1" } else { "0" };
        let defined = flag(item.geometry.is_some());
        let [visible, locked] = [item.visible, item.locked].map(flag);
        // Slicer reads neither quotes nor line breaks within a quoted text.
        let [name, description] =
            [&item.name, &item.description].map(|text| text.replace('"', "'").replace('\n', " "));
        let [name, description] = [csv_cell(&name), csv_cell(&description)];
        let row: [&str; 9] = [&name, &l, &p, &s, defined, "1", visible, locked, &description];
        writer.write_record(row).map_err(failed)?;
    }
    writer.into_inner().map_err(|error| failed(error.into_error().into()))
}
