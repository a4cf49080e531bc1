//! Parts that tables of text share: rows with their lines, and fields with their columns.

use super::{ExchangeError, Format};

/// Columns of a table, by name.
pub(super) struct Columns {
    format: Format,
    names: Vec<String>,
}

/// A row of a table.
pub(super) struct Row<'a> {
    columns: &'a Columns,
    record: csv::StringRecord,
    line: u64,
}

impl Columns {
    /// Columns are found by these names, in lower case.
    pub(super) fn new<'n>(format: Format, names: impl IntoIterator<Item = &'n str>) -> Self {
        let names = names.into_iter().map(|name| name.trim().trim_matches('"').to_lowercase()).collect();
        Self { format, names }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// The rows of a text, without lines that begin with `comment`.
    pub(super) fn rows(
        &self,
        text: &str,
        delimiter: u8,
        comment: Option<u8>,
        mut take: impl FnMut(Row<'_>) -> Result<(), ExchangeError>,
    ) -> Result<(), ExchangeError> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(delimiter)
            .comment(comment)
            .from_reader(text.as_bytes());
        for record in reader.records() {
            let record = record.map_err(|error| ExchangeError::Syntax {
                format: self.format,
                place: error
                    .position()
                    .map_or_else(|| "a row".to_owned(), |at| format!("line {}", at.line())),
                source: error.into(),
            })?;
            let line = record.position().map_or(0, |at| line_of(text, at, comment));
            take(Row { columns: self, record, line })?;
        }
        Ok(())
    }
}

/// The line that a record begins on. Its position is where the reader began to look for it:
/// comments and empty lines come first.
fn line_of(text: &str, at: &csv::Position, comment: Option<u8>) -> u64 {
    let rest = usize::try_from(at.byte()).ok().and_then(|byte| text.get(byte..)).unwrap_or_default();
    let is_none =
        |line: &&str| line.is_empty() || (comment.is_some() && line.as_bytes().first().copied() == comment);
    at.line() + rest.lines().take_while(is_none).count() as u64
}

impl Row<'_> {
    pub(super) fn place(&self) -> String {
        format!("line {}", self.line)
    }

    /// A field; empty where the row has none.
    pub(super) fn text(&self, column: &str) -> &str {
        let index = self.columns.names.iter().position(|name| name == column);
        index.and_then(|index| self.record.get(index)).unwrap_or("")
    }

    pub(super) fn is_blank(&self) -> bool {
        self.record.iter().all(|field| field.trim().is_empty())
    }

    /// Three numbers.
    pub(super) fn position(&self, columns: [&str; 3]) -> Result<[f64; 3], ExchangeError> {
        let mut xyz = [0.0; 3];
        for (value, column) in xyz.iter_mut().zip(columns) {
            let text = self.text(column).trim();
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            *value = number.ok_or_else(|| self.error(column, format!("{text:?}"), "a finite number"))?;
        }
        Ok(xyz)
    }

    /// Yes or no; `otherwise` for an empty cell.
    pub(super) fn flag(&self, column: &str, otherwise: bool) -> Result<bool, ExchangeError> {
        match self.text(column).trim() {
            "" => Ok(otherwise),
            "0" => Ok(false),
            "1" => Ok(true),
            text if text.eq_ignore_ascii_case("false") => Ok(false),
            text if text.eq_ignore_ascii_case("true") => Ok(true),
            text => Err(self.error(column, format!("{text:?}"), "0 or 1")),
        }
    }

    pub(super) fn error(&self, column: &str, found: String, allowed: &str) -> ExchangeError {
        ExchangeError::value(
            self.columns.format,
            format!("line {}, column {column}", self.line),
            found,
            allowed,
        )
    }
}
