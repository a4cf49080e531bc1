//! The wanted adapter.

/// The wanted adapter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The most capable: a discrete GPU before an integrated one, before a virtual one. Without any,
    /// a renderer takes the processor's own ray caster, and everything else a software rasteriser.
    #[default]
    Best,
    /// The processor's own ray caster, without a graphics driver.
    Processor,
    /// A software rasteriser: what golden images are compared on.
    Software,
    /// The first whose name or driver contains this text, in any case.
    Named(String),
}

impl AdapterChoice {
    /// Reads `best`, `cpu`, `software` or a part of an adapter's name.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        match text {
            "" | "best" => Self::Best,
            "cpu" => Self::Processor,
            "software" => Self::Software,
            name => Self::Named(name.to_owned()),
        }
    }
}

impl std::fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Best => f.write_str("rendering"),
            Self::Processor => f.write_str("rendering on the processor"),
            Self::Software => f.write_str("rendering in software"),
            Self::Named(part) => write!(f, "rendering with {part:?} in its name or driver"),
        }
    }
}
