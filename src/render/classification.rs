//! The values of a ray that give a sample its colour and opacity.

/// How a sample of mode composite is classified.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(try_from = "String")]
pub enum Classification {
    /// By the value in the middle of its path.
    #[default]
    Sampled,
    /// By all values that its path passes, linear from end to end: at twice the sample distance as
    /// close to the converged picture, and thin layers between samples are not missed.
    PreIntegrated,
}

impl Classification {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Sampled, Self::PreIntegrated];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sampled => "sampled",
            Self::PreIntegrated => "pre-integrated",
        }
    }

    /// The classification of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|classification| classification.name() == name)
    }
}

impl TryFrom<String> for Classification {
    type Error = UnknownClassification;

    fn try_from(name: String) -> Result<Self, UnknownClassification> {
        Self::from_name(&name).ok_or(UnknownClassification { name })
    }
}

/// An unknown name of a classification.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown classification {name:?}, allowed: {}", Classification::ALL.map(Classification::name).join(", "))]
pub struct UnknownClassification {
    name: String,
}
