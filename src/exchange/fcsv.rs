//! 3D Slicer's older lists of points, `.fcsv`: read in every version, written in LPS.
//!
//! Comments at the head say the coordinate system: `0` or `RAS`, `1` or `LPS`; RAS where none does.
//! Columns are those of the line `# columns`, or those that Slicer 4 and later write. Newer
//! versions write two more than they name: the status of the position (2 for a defined one) and
//! whether Slicer made the point itself. A text with commas or quotes is quoted.

use std::collections::HashSet;
use std::fmt::Write;

use super::delimited::{Columns, Row};
use super::reading::{self, Reading, mirrored, point};
use super::{ExchangeError, Format, Imported, ReadContext};
use relief_annotation::{Geometry, Item};

const FORMAT: Format = Format::Fcsv;
const COLUMNS: &str = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID";
/// Behind those that a file names.
const UNNAMED: &str = "positionstatus,autocreated";
/// Of files without a version: Slicer 3.
const OLDEST: &str = "label,x,y,z,sel,vis";

/// The values in the comments.
struct Head {
    is_ras: bool,
    says_system: bool,
    columns: Columns,
}

/// Reads a list of points.
///
/// # Errors
/// As [`super::read`]; places are lines and columns.
pub(super) fn read(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let text = reading::text(FORMAT, bytes)?;
    let head = head(text)?;
    let mut reading = Reading::new(FORMAT, context);
    if !head.says_system {
        reading.warn("", "the file names no coordinate system: it is taken for RAS, as 3D Slicer takes it");
    }
    let mut ids = HashSet::new();
    head.columns.rows(text, b',', Some(b'#'), |row| {
        if row.is_blank() {
            return Ok(());
        }
        let id = row.text("id").trim();
        if !id.is_empty() && !ids.insert(id.to_owned()) {
            return Err(row.error("id", "there twice".to_owned(), "each id once"));
        }
        read_row(&mut reading, &row, head.is_ras)
    })?;
    Ok(reading.finish())
}

fn head(text: &str) -> Result<Head, ExchangeError> {
    let (mut is_ras, mut says_system, mut names, mut is_versioned) = (true, false, None, false);
    for (line, comment) in (1..).zip(text.lines()).filter_map(|(n, line)| Some((n, line.strip_prefix('#')?)))
    {
        let Some((key, value)) = comment.split_once('=') else { continue };
        let value = value.trim();
        match key.trim() {
            "CoordinateSystem" => {
                says_system = true;
                is_ras = match value {
                    "0" | "RAS" => true,
                    "1" | "LPS" => false,
                    _ => {
                        let found = format!("{value:?}");
                        let place = format!("line {line}, CoordinateSystem");
                        return Err(ExchangeError::value(
                            FORMAT,
                            place,
                            found,
                            "LPS, RAS, 0 (RAS) or 1 (LPS)",
                        ));
                    }
                };
            }
            "columns" => names = Some((line, value)),
            "Markups fiducial file version" => is_versioned = true,
            _ => {}
        }
    }
    let (line, names) = names.unwrap_or((1, if is_versioned { COLUMNS } else { OLDEST }));
    let all = names.split(',').chain(UNNAMED.split(',').filter(|_| names.starts_with("id,")));
    let columns = Columns::new(FORMAT, all);
    if let Some(lacking) = ["x", "y", "z"].into_iter().find(|name| !columns.has(name)) {
        let found = format!("without {lacking}");
        return Err(ExchangeError::value(FORMAT, format!("line {line}, columns"), found, COLUMNS));
    }
    Ok(Head { is_ras, says_system, columns })
}

fn read_row(reading: &mut Reading<'_>, row: &Row<'_>, is_ras: bool) -> Result<(), ExchangeError> {
    let is_defined = match row.text("positionstatus").trim() {
        "" | "2" => true,
        "0" | "1" => false,
        text => return Err(row.error("15 (position status)", format!("{text:?}"), "0, 1 or 2")),
    };
    let xyz = row.position(["x", "y", "z"])?;
    let at_mm = point(if is_ras { mirrored(xyz) } else { xyz });
    let label = row.text("label");
    let name = if label.is_empty() {
        format!("{}-{}", reading.context.list, reading.count() + 1)
    } else {
        label.to_owned()
    };
    let mut item = reading.item(&name, is_defined.then_some(Geometry::Point { at_mm }))?;
    item.description = row.text("desc").to_owned();
    item.visible = row.flag("vis", true)?;
    item.locked = row.flag("lock", false)?;
    row.flag("sel", true)?;
    if let Ok(id) = row.text("id").trim().parse() {
        item.id = id;
    }
    reading.push(&row.place(), item)
}

/// Writes points.
///
/// # Errors
/// None; every format may have some.
pub(super) fn write(items: &[&Item]) -> Result<Vec<u8>, ExchangeError> {
    let mut text =
        format!("# Markups fiducial file version = 5.11\n# CoordinateSystem = LPS\n# columns = {COLUMNS}\n");
    for item in items {
        let at = item.point();
        let [x, y, z] = at.map_or([0.0; 3], |at| at.xyz.to_array());
        let [visible, locked] = [item.visible, item.locked].map(u8::from);
        let status = if at.is_some() { 2 } else { 0 };
        let [label, description] =
            [&item.name, &item.description].map(|text| quoted(&text.replace(['\n', '\t'], " ")));
        let id = item.id;
        let _ =
            writeln!(text, "{id},{x},{y},{z},0,0,0,1,{visible},1,{locked},{label},{description},,{status},0");
    }
    Ok(text.into_bytes())
}

/// In quotes where it must be.
fn quoted(text: &str) -> String {
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
