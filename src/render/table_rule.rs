//! Whether pictures show the table on which the patient lies.

use serde::Deserialize;

/// Whether a picture shows the table. Slices always do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableRule {
    /// Air in its place (see [`relief_volume::Table`]); slices outline it.
    #[default]
    Remove,
    /// The voxels as they are.
    Keep,
}

impl TableRule {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Remove, Self::Keep];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Remove => "remove",
            Self::Keep => "keep",
        }
    }

    /// The rule of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rule| rule.name() == name)
    }
}
