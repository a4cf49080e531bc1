//! Names that outputs, views and series of a batch may have.

/// The rule for names of series and views.
pub(super) const NAMES: &str = "1 to 100 letters, digits, - _ and ., none that other files beside have";

/// Whether a series or a view may be called so. A view's record is NAME.json, its camera
/// NAME.camera.json, its setback NAME.failed.json; beside them a dataset has transforms.json.
pub(super) fn is_name(name: &str) -> bool {
    let is_good = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
    (1..=100).contains(&name.len())
        && name.chars().all(is_good)
        && !name.starts_with('.')
        && name != "transforms"
        && ![".camera", ".failed"].iter().any(|ending| name.ends_with(ending))
}
