//! Which adapter is wanted.

/// Which adapter is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The most capable: a discrete GPU before an integrated one, before a virtual one, before
    /// software.
    #[default]
    Best,
    /// A software rasteriser: what golden images are compared on.
    Software,
    /// The first whose name or driver contains this text, in any case.
    Named(String),
}

impl AdapterChoice {
    /// Reads `best`, `software` or a part of an adapter's name.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        match text {
            "" | "best" => Self::Best,
            "software" => Self::Software,
            name => Self::Named(name.to_owned()),
        }
    }
}

impl std::fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Best => f.write_str("rendering"),
            Self::Software => f.write_str("rendering in software"),
            Self::Named(part) => write!(f, "rendering with {part:?} in its name or driver"),
        }
    }
}
