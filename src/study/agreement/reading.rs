//! The sets of a comparison, and who placed their items.

use serde::Serialize;

use relief_annotation::Item;

/// The items of one reader at one time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// The set's name.
    pub set: String,
    /// Whose it is: readings of one name are repeats.
    pub reader: String,
    /// Its items, in order.
    #[serde(skip)]
    pub items: Vec<Item>,
}

/// The sets to compare.
#[derive(Clone, Debug)]
pub struct Study {
    /// Two or more, or one where there is a truth.
    pub readings: Vec<Reading>,
    /// The expected places of all items.
    pub truth: Option<Reading>,
}
