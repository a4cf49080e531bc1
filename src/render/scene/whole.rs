//! Whole numbers of a scene, which JSON may also write as `3.0`.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, Visitor};

/// A whole number of 32 bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole(pub(super) u32);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WholeVisitor)
    }
}

struct WholeVisitor;

impl Visitor<'_> for WholeVisitor {
    type Value = Whole;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number of 0 to {}", u32::MAX)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Whole, E> {
        let number = u32::try_from(value);
        number.map(Whole).map_err(|_| E::invalid_value(de::Unexpected::Unsigned(value), &self))
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Whole, E> {
        if value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value) {
            return Ok(Whole(value as u32));
        }
        Err(E::invalid_value(de::Unexpected::Float(value), &self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_may_have_a_point_and_no_fraction() {
        let read = |text: &str| serde_json::from_str::<Whole>(text).map(|whole| whole.0);
        for (text, number) in [("7", 7), ("7.0", 7), ("4294967295", u32::MAX), ("-0.0", 0), ("1e3", 1000)] {
            assert_eq!(read(text).unwrap(), number, "{text}");
        }
        for text in ["7.5", "-1", "4294967296", "4294967296.0", "1e300", "\"7\"", "null"] {
            let refusal = read(text).unwrap_err().to_string();
            assert!(refusal.contains("whole number of 0 to 4294967295"), "{text}: {refusal}");
        }
    }
}
