//! Which depth a semi-transparent ray has: the rules by name. `docs/DEPTH.md` draws each of them.
//!
//! What a rule means is in `shaders/lib/depth_rules.wgsl` and its twin `reference::depth_rules`. Opacity is that of one
//! sample; what a sample adds to the accumulated opacity is its weight.

/// Which depth a semi-transparent ray has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthRule {
    /// The first visible point: where opacity leaves zero.
    FirstHit,
    /// Where accumulated opacity crosses this fraction of the ray's final opacity.
    Threshold {
        /// Share of the final opacity, above 0 and up to 1.
        fraction: f64,
    },
    /// Where opacity first comes up to its greatest value on the ray.
    MaxOpacity,
    /// Where what is added to the accumulated opacity first comes up to its greatest value.
    MostContributing,
    /// The mean depth, each sample by what it adds to the accumulated opacity.
    Expected,
    /// What you see is what you pick (Wiebel, Vos, Foerster and Hege, IEEE TVCG 18(12), 2012): the start of the interval with the
    /// largest rise of accumulated opacity.
    Wysiwyp,
    /// Two depths: that of the first layer, and with its own colours that of what lies behind it. Each is where the
    /// layer's own accumulated opacity crosses this fraction of its final one.
    TwoLayer {
        /// Share of a layer's final opacity, above 0 and up to 1.
        fraction: f64,
    },
}

impl DepthRule {
    /// The fraction where none is given.
    pub const USUAL_FRACTION: f64 = 0.5;

    /// The names in requests and on the command line, in the order of menus.
    pub const NAMES: [&str; 7] =
        ["threshold", "first-hit", "max-opacity", "most-contributing", "expected", "wysiwyp", "two-layer"];

    /// The rule of this name with the usual fraction, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let fraction = Self::USUAL_FRACTION;
        match name {
            "first-hit" => Some(Self::FirstHit),
            "threshold" => Some(Self::Threshold { fraction }),
            "max-opacity" => Some(Self::MaxOpacity),
            "most-contributing" => Some(Self::MostContributing),
            "expected" => Some(Self::Expected),
            "wysiwyp" => Some(Self::Wysiwyp),
            "two-layer" => Some(Self::TwoLayer { fraction }),
            _ => None,
        }
    }

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::FirstHit => "first-hit",
            Self::Threshold { .. } => "threshold",
            Self::MaxOpacity => "max-opacity",
            Self::MostContributing => "most-contributing",
            Self::Expected => "expected",
            Self::Wysiwyp => "wysiwyp",
            Self::TwoLayer { .. } => "two-layer",
        }
    }

    /// The share of the final opacity, for rules that have one.
    #[must_use]
    pub const fn fraction(self) -> Option<f64> {
        match self {
            Self::Threshold { fraction } | Self::TwoLayer { fraction } => Some(fraction),
            _ => None,
        }
    }

    /// The same rule with another fraction; `None` for rules that have none.
    #[must_use]
    pub const fn with_fraction(self, fraction: f64) -> Option<Self> {
        match self {
            Self::Threshold { .. } => Some(Self::Threshold { fraction }),
            Self::TwoLayer { .. } => Some(Self::TwoLayer { fraction }),
            _ => None,
        }
    }

    /// Whether a picture has a second layer behind the first.
    #[must_use]
    pub const fn has_back_layer(self) -> bool {
        matches!(self, Self::TwoLayer { .. })
    }

    /// The shader's `DEPTH_RULE`.
    pub(super) const fn code(self) -> u32 {
        match self {
            Self::FirstHit => 0,
            Self::Threshold { .. } => 1,
            Self::MaxOpacity => 2,
            Self::MostContributing => 3,
            Self::Expected => 4,
            Self::Wysiwyp => 5,
            Self::TwoLayer { .. } => 6,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pipelines::{RAYCAST, TableStorage, stage_sources};
    use super::*;

    #[test]
    fn names_come_back_and_fractions_belong_to_two_rules() {
        for name in DepthRule::NAMES {
            let rule = DepthRule::from_name(name).unwrap();
            assert_eq!(rule.name(), name);
            assert_eq!(rule.with_fraction(0.25).and_then(DepthRule::fraction), rule.fraction().map(|_| 0.25));
        }
        assert_eq!(DepthRule::from_name("nearest"), None);
    }

    #[test]
    fn codes_mirror_the_shader() {
        let source = stage_sources(TableStorage::Uniform, RAYCAST).join("\n");
        let module = naga::front::wgsl::parse_str(&source).expect("the shader parses");
        for name in DepthRule::NAMES {
            let constant_name = format!("DEPTH_{}", name.to_uppercase().replace('-', "_"));
            let found = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(&constant_name));
            let (_, constant) = found.expect(&constant_name);
            let code = DepthRule::from_name(name).unwrap().code();
            let value = &module.global_expressions[constant.init];
            assert!(
                matches!(value, naga::Expression::Literal(naga::Literal::U32(n)) if *n == code),
                "{constant_name} is {value:?} in the shader, {code} here"
            );
        }
    }
}
