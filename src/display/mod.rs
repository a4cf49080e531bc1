//! (to come)
/// (to come)
#[derive(Clone, Debug, Default, serde::Deserialize)]
pub struct DisplaySettings {}
