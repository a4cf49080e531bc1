//! The error of a value that is not allowed, in a request, a file's header or an argument.

/// A value that is not allowed: its name, the value and the allowed values.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path} is {found}, allowed: {allowed}")]
pub struct OutOfRange {
    /// The value's name: in JSON its key path, such as `camera.projection.perspective.vertical_fov_deg`.
    pub path: String,
    /// The value found.
    pub found: String,
    /// The allowed values, with their unit.
    pub allowed: String,
}

impl OutOfRange {
    /// The error of the value `found` with the name `path`.
    pub fn new(path: impl Into<String>, found: impl std::fmt::Display, allowed: impl Into<String>) -> Self {
        Self { path: path.into(), found: found.to_string(), allowed: allowed.into() }
    }

    /// The same error with a longer path: `points_mm` within `items[3]` is `items[3].points_mm`.
    #[must_use]
    pub fn within(self, parent: &str) -> Self {
        Self { path: format!("{parent}.{}", self.path), ..self }
    }
}
