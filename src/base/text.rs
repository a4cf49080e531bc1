//! Text of outside origin on its way to people: terminals and spreadsheets act on some characters.

use std::borrow::Cow;

/// A text without control characters, for terminals: each becomes its escape, such as `\u{1b}`.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_active) {
        return Cow::Borrowed(text);
    }
    let escaped = text.chars().map(|letter| {
        if is_active(letter) { letter.escape_unicode().to_string() } else { letter.to_string() }
    });
    Cow::Owned(escaped.collect())
}

/// Control characters, and those that reorder the text around them.
fn is_active(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A text as a cell of CSV: spreadsheets take cells that begin with `=`, `+`, `-` or `@` for
/// formulas, so these get an apostrophe before them. Numbers stay as they are.
#[must_use]
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if is_formula(text) || is_formula(text.trim_start_matches('\'')) {
        Cow::Owned(format!("'{text}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// The text of a cell that [`csv_cell`] made.
#[must_use]
pub fn of_csv_cell(cell: &str) -> &str {
    let bare = cell.strip_prefix('\'');
    bare.filter(|text| is_formula(text.trim_start_matches('\''))).unwrap_or(cell)
}

fn is_formula(text: &str) -> bool {
    text.starts_with(['=', '+', '-', '@', '\t', '\r']) && text.parse::<f64>().is_err()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_get_no_control_characters() {
        assert_eq!(printable("chest 5 mm"), "chest 5 mm");
        assert_eq!(printable("a\u{1b}[2Jb\r\n\u{202e}"), "a\\u{1b}[2Jb\\u{d}\\u{a}\\u{202e}");
    }

    #[test]
    fn formulas_become_texts_and_come_back() {
        for (text, cell) in [
            ("=1+1", "'=1+1"),
            ("@SUM(A1)", "'@SUM(A1)"),
            ("-lateral", "'-lateral"),
            ("+", "'+"),
            ("'=x", "''=x"),
            ("-1.5", "-1.5"),
            ("Nasion", "Nasion"),
            ("'quoted'", "'quoted'"),
            ("", ""),
        ] {
            assert_eq!(csv_cell(text), cell);
            assert_eq!(of_csv_cell(cell), text);
        }
    }
}
