//! What of a ray's values a sample's colour and opacity come from.

use super::depth_rule::DepthRule;
use super::mode::Mode;
use super::request::RenderRequest;
use crate::request_error::RequestError;

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

/// A name that no classification has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown classification {name:?}, allowed: {}", Classification::ALL.map(Classification::name).join(", "))]
pub struct UnknownClassification {
    name: String,
}

/// Refuses what pre-integration has no meaning for.
pub(super) fn validate(request: &RenderRequest) -> Result<(), RequestError> {
    if request.classification == Classification::Sampled {
        return Ok(());
    }
    let refuse = |allowed: &str| {
        Err(RequestError::new("classification", &Classification::PreIntegrated.name(), allowed))
    };
    if request.mode != Mode::Composite {
        return refuse("sampled in other modes than composite");
    }
    if request.transfer.gradient_opacity().is_some() {
        return refuse("sampled with opacity by gradient");
    }
    if request.labels.is_some() {
        return refuse("sampled in a scene with labels");
    }
    if request.depth.needs_samples() {
        let rules = DepthRule::TABLE.iter().filter(|entry| entry.needs_samples).map(|entry| entry.name);
        return refuse(&format!("sampled with depth rules {}", rules.collect::<Vec<_>>().join(", ")));
    }
    Ok(())
}
