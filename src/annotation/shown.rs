//! The sets that are drawn over a picture.

use relief_base::OutOfRange;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use super::item::Set;

/// The sets whose items are drawn. As JSON: `false`, `true`, names with commas between them, or a
/// list of names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ShownSets {
    /// Nothing is drawn.
    #[default]
    Nothing,
    /// All sets that the author may see.
    All,
    /// These sets, as far as the author may see them.
    Sets(Vec<String>),
}

/// Why a choice of sets is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShownSetsError {
    /// A name that no set can have.
    #[error(transparent)]
    Name(#[from] OutOfRange),
    /// Neither true nor false nor names.
    #[error("expected true, false, or names of sets")]
    NotNames,
    /// No set, or too many.
    #[error("{found} sets, allowed: 1 to {}", ShownSets::MOST)]
    Count {
        /// The number of named sets.
        found: usize,
    },
}

impl ShownSets {
    /// Most sets that can be named.
    pub const MOST: usize = 64;

    /// Parses `true`, `false`, or names with commas between them.
    ///
    /// # Errors
    /// When a name is not a valid name of a set, or there are more than [`ShownSets::MOST`].
    pub fn parse(word: &str) -> Result<Self, ShownSetsError> {
        match word {
            "true" => Ok(Self::All),
            "false" => Ok(Self::Nothing),
            names => Self::of_names(names.split(',').map(str::trim)),
        }
    }

    /// These sets.
    ///
    /// # Errors
    /// As [`ShownSets::parse`].
    pub fn of_names<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Self, ShownSetsError> {
        let checked = names.into_iter().map(|name| Set::check_name(name).map(|()| name.to_owned()));
        let names = checked.collect::<Result<Vec<_>, _>>()?;
        if names.is_empty() || names.len() > Self::MOST {
            return Err(ShownSetsError::Count { found: names.len() });
        }
        Ok(Self::Sets(names))
    }

    /// Whether nothing is drawn.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        *self == Self::Nothing
    }

    /// Whether the items of this set are drawn.
    #[must_use]
    pub fn has(&self, set: &str) -> bool {
        match self {
            Self::Nothing => false,
            Self::All => true,
            Self::Sets(names) => names.iter().any(|name| name == set),
        }
    }
}

impl Serialize for ShownSets {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Nothing => serializer.serialize_bool(false),
            Self::All => serializer.serialize_bool(true),
            Self::Sets(names) => names.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for ShownSets {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let shown = match Value::deserialize(deserializer)? {
            Value::Bool(shown) => Ok(if shown { Self::All } else { Self::Nothing }),
            Value::String(names) => Self::parse(&names),
            Value::Array(names) => {
                let names: Option<Vec<&str>> = names.iter().map(Value::as_str).collect();
                names.ok_or(ShownSetsError::NotNames).and_then(Self::of_names)
            }
            _ => Err(ShownSetsError::NotNames),
        };
        shown.map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_named_in_three_ways_and_checked() {
        let read = |json: &str| serde_json::from_str::<ShownSets>(json);
        for (json, shown) in
            [("true", ShownSets::All), ("\"true\"", ShownSets::All), ("false", ShownSets::Nothing)]
        {
            assert_eq!(read(json).unwrap(), shown);
        }
        let two = ShownSets::Sets(vec!["a".to_owned(), "b.1".to_owned()]);
        assert_eq!(
            (read("\"a, b.1\"").unwrap(), read("[\"a\",\"b.1\"]").unwrap()),
            (two.clone(), two.clone())
        );
        assert_eq!(serde_json::to_string(&two).unwrap(), r#"["a","b.1"]"#);
        assert!(two.has("a") && !two.has("c") && ShownSets::All.has("c") && !ShownSets::Nothing.has("c"));
        for (json, says) in [
            ("1", "names of sets"),
            ("[]", "0 sets, allowed: 1 to 64"),
            ("[1]", "names of sets"),
            ("\"a b\"", "letters, digits"),
            ("\"\"", "letters, digits"),
        ] {
            let refused = read(json).unwrap_err().to_string();
            assert!(refused.contains(says), "{json}: {refused}");
        }
    }
}
