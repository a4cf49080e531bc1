//! Choices of options, made from the tables of the closed sets: parsers that list them, and help
//! texts.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use relief_display::Layout;
use relief_exchange::Format;
use relief_render::{DepthRule, FramingRule, Quality, TableRule};

/// The depth rules, each with its summary in the long help.
pub(super) fn depth_rules() -> impl TypedValueParser<Value = DepthRule> {
    let values = DepthRule::TABLE.map(|entry| PossibleValue::new(entry.name).help(entry.summary));
    PossibleValuesParser::new(values).map(|name| DepthRule::from_name(&name).unwrap_or_default()) // the parser has checked the name
}

/// The choices of a camera's framing.
pub(super) fn framing_rules() -> impl TypedValueParser<Value = FramingRule> {
    let values = FramingRule::ALL.map(|rule| PossibleValue::new(rule.name()));
    PossibleValuesParser::new(values).map(|name| FramingRule::from_name(&name).unwrap_or_default()) // the parser has checked the name
}

/// How closely a picture is sampled.
pub(super) fn qualities() -> impl TypedValueParser<Value = Quality> {
    let values = Quality::ALL.map(|quality| PossibleValue::new(quality.name()));
    PossibleValuesParser::new(values).map(|name| Quality::from_name(&name).unwrap_or_default()) // the parser has checked the name
}

/// Whether the table is shown.
pub(super) fn table_rules() -> impl TypedValueParser<Value = TableRule> {
    let values = TableRule::ALL.map(|rule| PossibleValue::new(rule.name()));
    PossibleValuesParser::new(values).map(|name| TableRule::from_name(&name).unwrap_or_default()) // the parser has checked the name
}

/// `what`, with the layouts for which `is_listed` holds.
pub(super) fn layouts(what: &str, is_listed: impl Fn(Layout) -> bool) -> String {
    let names: Vec<_> =
        Layout::ALL.into_iter().filter(|layout| is_listed(*layout)).map(Layout::name).collect();
    format!("{what}: {}", names.join(", "))
}

/// `what`, with the annotation formats for which `is_listed` holds.
pub(super) fn formats(what: &str, is_listed: impl Fn(Format) -> bool) -> String {
    let names: Vec<_> =
        Format::ALL.into_iter().filter(|format| is_listed(*format)).map(Format::name).collect();
    format!("{what}: {}", names.join(", "))
}
