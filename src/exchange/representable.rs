//! The values that a format can represent.

/// The values that a format can represent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Representable {
    /// Kinds of geometries.
    pub(super) kinds: &'static [&'static str],
    /// Items without a place.
    pub(super) undefined: bool,
    /// Whether a target was skipped deliberately.
    pub(super) skipped: bool,
    pub(super) name: bool,
    pub(super) description: bool,
    pub(super) line_breaks: bool,
    pub(super) quotes: bool,
    pub(super) color: bool,
    pub(super) concept: bool,
    pub(super) locked: bool,
    pub(super) visible: bool,
    pub(super) lists: bool,
    /// Author, time and way of placing.
    pub(super) history: bool,
}

const POINTS: &[&str] = &["point"];

impl Representable {
    pub(super) const EVERYTHING: Self = Self {
        kinds: &["point", "line", "angle", "curve", "plane"],
        undefined: true,
        skipped: true,
        name: true,
        description: true,
        line_breaks: true,
        quotes: true,
        color: true,
        concept: true,
        locked: true,
        visible: true,
        lists: true,
        history: true,
    };
    pub(super) const TABLE: Self = Self {
        kinds: POINTS,
        line_breaks: false,
        quotes: false,
        skipped: false,
        color: false,
        concept: false,
        lists: false,
        history: false,
        ..Self::EVERYTHING
    };

    /// Only names and colours.
    const NAMES: Self = Self {
        undefined: false,
        description: false,
        line_breaks: true,
        quotes: true,
        color: true,
        locked: false,
        visible: false,
        ..Self::TABLE
    };

    /// Positions without any text.
    pub(super) const POSITIONS: Self = Self {
        quotes: true,
        undefined: false,
        name: false,
        description: false,
        locked: false,
        visible: false,
        ..Self::TABLE
    };

    /// Label maps.
    pub(super) const REGIONS: Self = Self { kinds: &["region"], ..Self::NAMES };

    /// Files of triangles.
    pub(super) const MESHES: Self = Self { kinds: &["mesh"], color: false, ..Self::NAMES };
}
