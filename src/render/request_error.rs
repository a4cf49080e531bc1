//! A value of a request that is out of range.

/// A value of a request that is out of range: its path, the value and the permitted values.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{path} is {found}, allowed: {allowed}")]
pub struct RequestError {
    /// Key path as in the JSON form, such as `camera.projection.perspective.vertical_fov_deg`.
    pub path: String,
    /// The value found.
    pub found: String,
    /// The values that are allowed.
    pub allowed: String,
}

impl RequestError {
    pub(super) fn new(path: &str, found: &impl ToString, allowed: &str) -> Self {
        Self { path: path.to_owned(), found: found.to_string(), allowed: allowed.to_owned() }
    }
}
