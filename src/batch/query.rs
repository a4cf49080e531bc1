//! Queries that select series by their facts: `modality=CT,slices>=40`.
//!
//! Facts are kind, size and spacing of a series, which do not identify a patient. Names, ids, dates
//! and private attributes cannot be queried.

use std::str::FromStr;

use relief_volume::Grid;

/// The facts of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct SeriesFacts {
    /// `CT`, or whatever its files say.
    pub modality: String,
    /// `dicom`, or `volume` for a file of voxels.
    pub format: &'static str,
    /// Columns, rows and slices.
    pub dims: [usize; 3],
    /// Distance between columns and between rows, mm.
    pub pixel_mm: [f64; 2],
    /// Thickness of a slice, or distance between slices, mm; unknown where files do not say.
    pub thickness_mm: Option<f64>,
}

/// Conditions that all have to be met.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Query(Vec<Condition>);

#[derive(Clone, Debug, PartialEq)]
struct Condition {
    key: &'static str,
    relation: Relation,
    wanted: Operand,
}

#[derive(Clone, Debug, PartialEq)]
enum Operand {
    Word(String),
    Number(f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Relation {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

const WORDS: [&str; 2] = ["modality", "format"];
const NUMBERS: [&str; 5] = ["slices", "columns", "rows", "pixel_mm", "thickness_mm"];
/// Those of two characters first.
const RELATIONS: [(&str, Relation); 6] = [
    (">=", Relation::GreaterOrEqual),
    ("<=", Relation::LessOrEqual),
    ("!=", Relation::NotEqual),
    ("=", Relation::Equal),
    (">", Relation::Greater),
    ("<", Relation::Less),
];

impl SeriesFacts {
    /// Of a volume in a file of its own.
    #[must_use]
    pub fn of_grid(grid: &Grid) -> Self {
        let [x, y, z] = grid.spacing_mm();
        let (dims, pixel_mm) = (grid.dims(), [x, y]);
        Self { modality: "CT".to_owned(), format: "volume", dims, pixel_mm, thickness_mm: Some(z) }
    }

    fn word(&self, key: &str) -> &str {
        if key == "modality" { &self.modality } else { self.format }
    }

    fn number(&self, key: &str) -> Option<f64> {
        let [columns, rows, slices] = self.dims.map(|side| side as f64);
        match key {
            "slices" => Some(slices),
            "columns" => Some(columns),
            "rows" => Some(rows),
            "pixel_mm" => Some(self.pixel_mm[0].max(self.pixel_mm[1])),
            _ => self.thickness_mm,
        }
    }
}

impl Query {
    /// Whether there are no conditions.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a series meets all conditions.
    ///
    /// # Errors
    /// The first condition that the series does not meet, and its value.
    pub fn admit(&self, facts: &SeriesFacts) -> Result<(), UnmetCondition> {
        self.0.iter().try_for_each(|condition| condition.admit(facts))
    }
}

impl Condition {
    fn admit(&self, facts: &SeriesFacts) -> Result<(), UnmetCondition> {
        let Self { key, relation, wanted } = self;
        match wanted {
            Operand::Word(word) => {
                let found = facts.word(key);
                let equal = found.eq_ignore_ascii_case(word);
                let is_met = equal == (*relation == Relation::Equal);
                if is_met { Ok(()) } else { Err(UnmetCondition::Value { key, found: found.to_owned() }) }
            }
            Operand::Number(number) => match facts.number(key) {
                None => Err(UnmetCondition::Missing { key }),
                Some(found) if relation.holds(found, *number) => Ok(()),
                Some(found) => Err(UnmetCondition::Value { key, found: found.to_string() }),
            },
        }
    }
}

impl Relation {
    fn holds(self, found: f64, wanted: f64) -> bool {
        match self {
            Self::Equal => (found - wanted).abs() <= 1e-6 * wanted.abs(),
            Self::NotEqual => (found - wanted).abs() > 1e-6 * wanted.abs(),
            Self::Less => found < wanted,
            Self::LessOrEqual => found <= wanted,
            Self::Greater => found > wanted,
            Self::GreaterOrEqual => found >= wanted,
        }
    }
}

impl FromStr for Query {
    type Err = InvalidCondition;

    fn from_str(text: &str) -> Result<Self, InvalidCondition> {
        text.split(',').map(|part| condition(part.trim())).collect::<Result<_, _>>().map(Self)
    }
}

/// Why a series is not selected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnmetCondition {
    /// The value does not meet the condition.
    #[error("{key} is {found}, which --where does not select")]
    Value {
        /// The property.
        key: &'static str,
        /// Its value.
        found: String,
    },
    /// The files do not have the value.
    #[error("its files have no {key}")]
    Missing {
        /// The property.
        key: &'static str,
    },
}

/// A text that is no condition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} {problem}; an example of a condition is slices>=40, and the properties are {}, {}", WORDS.join(", "), NUMBERS.join(", "))]
pub struct InvalidCondition {
    text: String,
    problem: &'static str,
}

fn condition(text: &str) -> Result<Condition, InvalidCondition> {
    let wrong = |problem| InvalidCondition { text: text.to_owned(), problem };
    let at = text.find(['<', '>', '=', '!']).ok_or_else(|| wrong("is not a condition"))?;
    let (key, rest) = text.split_at(at);
    let found = RELATIONS.iter().find_map(|(sign, relation)| Some((*relation, rest.strip_prefix(sign)?)));
    let (relation, value) = found.ok_or_else(|| wrong("is not a condition"))?;
    let (key, value) = (key.trim(), value.trim());
    if let Some(key) = WORDS.into_iter().find(|known| *known == key) {
        let is_word = !value.is_empty() && value.chars().all(|letter| letter.is_ascii_alphanumeric());
        if !is_word || !matches!(relation, Relation::Equal | Relation::NotEqual) {
            return Err(wrong("is not a condition of a word: these are = and !="));
        }
        return Ok(Condition { key, relation, wanted: Operand::Word(value.to_owned()) });
    }
    let key =
        NUMBERS.into_iter().find(|known| *known == key).ok_or_else(|| wrong("has an unknown property"))?;
    let number = value.parse().ok().filter(|number: &f64| number.is_finite());
    let number = number.ok_or_else(|| wrong("does not compare with a number"))?;
    Ok(Condition { key, relation, wanted: Operand::Number(number) })
}
