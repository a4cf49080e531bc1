//! Depth rules: which depth a semi-transparent ray has. [`DepthRule::TABLE`] is the one list of
//! them; `docs/DEPTH.md` draws each.
//!
//! The formulas are in `shaders/lib/depth_rules.wgsl` and in its twin,
//! `processor::depth_rules`. Opacity is that of one sample; the weight of a sample is its
//! contribution to the accumulated opacity.

/// The depth of a semi-transparent ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthRule {
    /// The first visible point: where opacity leaves zero.
    FirstHit,
    /// The place at which accumulated opacity crosses this fraction of the ray's final opacity.
    Threshold {
        /// Share of the final opacity, above 0 and up to 1.
        fraction: f64,
    },
    /// The place at which opacity first reaches its greatest value on the ray.
    MaxOpacity,
    /// The place at which the weight first reaches its greatest value on the ray.
    MostContributing,
    /// The mean depth of the samples by weight.
    Expected,
    /// What you see is what you pick (Wiebel, Vos, Foerster and Hege, IEEE TVCG 18(12), 2012): the
    /// start of the interval with the largest rise of accumulated opacity.
    Wysiwyp,
    /// Two layers, each with a depth and colours of its own. The depth of a layer is where its
    /// accumulated opacity crosses this fraction of its final opacity.
    TwoLayer {
        /// Share of a layer's final opacity, above 0 and up to 1.
        fraction: f64,
    },
    /// The depth under which the picture best predicts the views beside it, for displays. The depth
    /// of a ray, which picks use, is that of the default rule.
    Views,
}

/// A row of [`DepthRule::TABLE`].
#[derive(Clone, Copy, Debug)]
pub struct DepthRuleEntry {
    /// The rule, with the default fraction where it has one.
    pub rule: DepthRule,
    /// Its name in requests and on the command line.
    pub name: &'static str,
    /// The rule in a few words.
    pub summary: &'static str,
    /// `DEPTH_RULE` in the shaders. Part of fingerprints: never changed.
    pub(crate) code: u32,
    /// Whether the rule looks at single samples, which pre-integrated classification has not.
    pub(crate) needs_samples: bool,
}

impl Default for DepthRule {
    /// The threshold at half of the final opacity.
    fn default() -> Self {
        Self::Threshold { fraction: Self::USUAL_FRACTION }
    }
}

impl DepthRule {
    /// The fraction where a request gives none.
    pub const USUAL_FRACTION: f64 = 0.5;

    /// All rules, in the order of menus.
    pub const TABLE: [DepthRuleEntry; 8] = {
        const FRACTION: f64 = DepthRule::USUAL_FRACTION;
        const fn entry(
            rule: DepthRule,
            name: &'static str,
            code: u32,
            summary: &'static str,
        ) -> DepthRuleEntry {
            DepthRuleEntry { rule, name, summary, code, needs_samples: false }
        }
        const fn of_samples(entry: DepthRuleEntry) -> DepthRuleEntry {
            DepthRuleEntry { needs_samples: true, ..entry }
        }
        [
            entry(Self::Threshold { fraction: FRACTION }, "threshold", 1, "half of the final opacity"),
            entry(Self::FirstHit, "first-hit", 0, "the first visible point"),
            of_samples(entry(Self::MaxOpacity, "max-opacity", 2, "the greatest opacity")),
            of_samples(entry(Self::MostContributing, "most-contributing", 3, "the greatest weight")),
            entry(Self::Expected, "expected", 4, "the mean by weight"),
            of_samples(entry(Self::Wysiwyp, "wysiwyp", 5, "the start of the largest rise of opacity")),
            entry(Self::TwoLayer { fraction: FRACTION }, "two-layer", 6, "a depth for each of two layers"),
            entry(Self::Views, "views", 1, "the depth that the views beside agree on"),
        ]
    };

    /// The names of all rules, in the order of menus.
    #[must_use]
    pub fn names() -> [&'static str; Self::TABLE.len()] {
        Self::TABLE.map(|entry| entry.name)
    }

    /// The rule of this name, with the default fraction.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::TABLE.iter().find(|entry| entry.name == name).map(|entry| entry.rule)
    }

    /// The row of this rule, whatever its fraction.
    fn entry(self) -> &'static DepthRuleEntry {
        const TABLE: &[DepthRuleEntry] = &DepthRule::TABLE;
        let kind = std::mem::discriminant(&self);
        let found = TABLE.iter().find(|entry| std::mem::discriminant(&entry.rule) == kind);
        found.unwrap_or(&TABLE[0]) // every rule has a row: a test counts them
    }

    /// The name in requests and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.entry().name
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

    /// The rule of single rays: rule `views` has the default one.
    #[must_use]
    pub fn of_rays(self) -> Self {
        if self == Self::Views { Self::default() } else { self }
    }

    /// `DEPTH_RULE` in the shaders.
    pub(super) fn code(self) -> u32 {
        self.entry().code
    }

    /// Whether the rule looks at single samples.
    pub(super) fn needs_samples(self) -> bool {
        self.entry().needs_samples
    }
}

#[cfg(test)]
mod tests {
    use super::super::pipelines::{RAYCAST, stage_sources};
    use super::super::table_storage::TableStorage;
    use super::*;

    #[test]
    fn names_come_back_and_fractions_belong_to_two_rules() {
        for name in DepthRule::names() {
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
        for name in DepthRule::names() {
            if name == DepthRule::Views.name() {
                continue; // rays have another rule
            }
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
