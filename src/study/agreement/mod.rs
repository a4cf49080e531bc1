//! How well several readers agree: errors, bias, intraclass correlation, limits of agreement.
//!
//! The statistics of `relief annotate compare`, from items only. It draws nothing, reads no
//! database and uses no voxels. Space: patient LPS, mm; differences are along L (to the left), P
//! (to the back) and S (to the head).
//!
//! | word | meaning |
//! |---|---|
//! | reader | a person, or a program, who placed items |
//! | reading | the items of one reader at one time: a set |
//! | target | the landmark to place: items of one name in all readings |
//! | case | the targets of one patient: of one frame of reference |
//! | reference | where a target should be: at the truth where there is one, else at the mean of the readers |

mod bland_altman;
mod compare;
mod icc;
mod matching;
mod quantile;
mod quantity;
mod reading;
mod spread;
#[cfg(test)]
mod tests;

pub use bland_altman::{BlandAltman, bland_altman};
pub use compare::{Comparison, Landmark, Missing, Placed, ReadingErrors, compare_readings};
pub use icc::{Icc, icc_2_1};
pub use matching::Absence;
pub use quantity::{Agreement, MeasureRow, Pairing, ReadingMeasures, Relation};
pub use reading::{Reading, Study};
pub use spread::{Ellipsoid, ErrorSummary};

use serde::{Serialize, Serializer};

/// A finite result, or the reason why it is missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Figure<T> {
    /// The result.
    Known(T),
    /// The reason why it is missing.
    Unknown(Undefined),
}

/// Why a figure is not defined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Undefined {
    /// A correlation needs things that differ.
    #[error("{found} targets were placed by all readers, needed: at least 2")]
    FewSubjects {
        /// The number that all raters measured.
        found: usize,
    },
    /// Agreement needs at least two readers.
    #[error("{found} readings, needed: at least 2")]
    FewRaters {
        /// The number found.
        found: usize,
    },
    /// Everything was measured alike, so there is nothing to tell apart.
    #[error("the values of the readings do not differ")]
    NoSpread,
    /// Limits need differences.
    #[error("{found} targets were placed by both readers, needed: at least 2")]
    FewPairs {
        /// The number that both measured.
        found: usize,
    },
}

/// Why readings cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AgreementError {
    /// A single reading has nothing to be compared with.
    #[error("one set to compare, needed: at least 2, or 1 and a truth")]
    Alone,
    /// A set is named twice.
    #[error("the set {set} is named twice")]
    Twice {
        /// Its name.
        set: String,
    },
    /// A set has no items.
    #[error("the set {set} has no items")]
    Empty {
        /// Its name.
        set: String,
    },
    /// No target is in two readings.
    #[error("the sets {} share no item: items are matched by name, and {first:?} of {} is in no other set", sets.join(", "), sets[0])]
    NothingInCommon {
        /// Their names, the truth's last.
        sets: Vec<String>,
        /// The name of an item of the first.
        first: String,
    },
    /// Items of different patients.
    #[error("the sets {} have different frames of reference, so their positions cannot be compared", sets.join(", "))]
    DifferentFrames {
        /// Their names.
        sets: Vec<String>,
    },
}

impl<T> Figure<T> {
    /// The result, where there is one.
    pub fn known(&self) -> Option<&T> {
        match self {
            Self::Known(value) => Some(value),
            Self::Unknown(_) => None,
        }
    }
}

/// The result's own JSON, or `{"undefined": "why"}`.
impl<T: Serialize> Serialize for Figure<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Known(value) => value.serialize(serializer),
            Self::Unknown(why) => {
                use serde::ser::SerializeMap;
                let mut map = serializer.serialize_map(Some(1))?;
                map.serialize_entry("undefined", &why.to_string())?;
                map.end()
            }
        }
    }
}
