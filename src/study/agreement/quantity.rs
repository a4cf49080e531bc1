//! A number that all readings measured of many targets, and how well they agree on it.

use serde::Serialize;

use super::Figure;
use super::bland_altman::{BlandAltman, bland_altman};
use super::icc::{Icc, icc_2_1};
use super::reading::Reading;

/// Values of one kind: a coordinate, or a measure such as a length.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    /// `L`, `P`, `S`, or the measure's name.
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    pub(super) rows: Vec<Row>,
}

/// The values of one target.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// The target, of those that were matched.
    pub(super) target: usize,
    /// Of each reading.
    pub(super) values: Vec<Option<f64>>,
    pub(super) truth: Option<f64>,
}

/// Between whom an agreement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Relation {
    /// Between a set and the truth.
    Truth,
    /// Between readers, of each its first set.
    Inter,
    /// Between one reader's sets.
    Intra,
}

impl Relation {
    /// As in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Inter => "inter",
            Self::Intra => "intra",
            Self::Truth => "truth",
        }
    }
}

/// The intraclass correlation of one quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Between whom.
    pub relation: Relation,
    /// Whose repeats, of [`Relation::Intra`].
    pub reader: Option<String>,
    /// The sets that were compared.
    pub sets: Vec<String>,
    /// `L`, `P`, `S`, or a measure's name.
    pub quantity: &'static str,
    /// UCUM.
    pub unit: &'static str,
    /// ICC(2,1).
    pub icc: Figure<Icc>,
}

/// Bland and Altman's comparison of one quantity in two sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pairing {
    /// Between whom.
    pub relation: Relation,
    /// The first set: differences are its values less the second's.
    pub first: String,
    /// The second set, or the truth's.
    pub second: String,
    /// `L`, `P`, `S`, or a measure's name.
    pub quantity: &'static str,
    /// UCUM.
    pub unit: &'static str,
    /// Bias and limits.
    pub limits: Figure<BlandAltman>,
    /// Means and differences, for plots.
    #[serde(skip)]
    pub points: Vec<[f64; 2]>,
}

/// A measure of one target, as the sets have it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasureRow {
    /// The patient, from 1.
    pub case: usize,
    /// The target's list, where its name alone is ambiguous.
    pub list: String,
    /// The target's name.
    pub name: String,
    /// `length`, `angle`, `area` or `volume`.
    pub measure: &'static str,
    /// UCUM.
    pub unit: &'static str,
    /// The truth's, or the mean of the readers; none where only one has it and there is no truth.
    pub reference: Option<f64>,
    /// Of each set.
    pub values: Vec<Option<f64>>,
}

/// The differences of a set's measures from their references.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReadingMeasures {
    /// The set.
    pub set: String,
    /// `length`, `angle`, `area` or `volume`.
    pub measure: &'static str,
    /// UCUM.
    pub unit: &'static str,
    /// The number of those with a reference.
    pub count: usize,
    /// Mean difference, value less reference.
    pub bias: f64,
    /// Mean size of the differences.
    pub mean: f64,
    /// Greatest size.
    pub max: f64,
}

/// ICC(2,1) between readers and within each reader who has several sets.
pub(super) fn agreements(readings: &[Reading], quantity: &Quantity) -> Vec<Agreement> {
    let of = |relation, reader: Option<&String>, columns: &[usize]| {
        let ratings: Vec<Vec<f64>> = quantity
            .rows
            .iter()
            .filter_map(|row| columns.iter().map(|&column| row.values[column]).collect())
            .collect();
        Agreement {
            relation,
            reader: reader.cloned(),
            sets: columns.iter().map(|&column| readings[column].set.clone()).collect(),
            quantity: quantity.name,
            unit: quantity.unit,
            icc: icc_2_1(&ratings),
        }
    };
    let readers = readers(readings);
    let firsts: Vec<usize> = readers.iter().map(|(_, sets)| sets[0]).collect();
    let inter = (firsts.len() > 1).then(|| of(Relation::Inter, None, &firsts));
    let repeated = readers.iter().filter(|(_, sets)| sets.len() > 1);
    inter.into_iter().chain(repeated.map(|(reader, sets)| of(Relation::Intra, Some(reader), sets))).collect()
}

/// Limits of agreement: of every set with the truth, where there is one; of every two readers; of
/// every two sets of a reader.
pub(super) fn pairings(readings: &[Reading], truth: Option<&Reading>, quantity: &Quantity) -> Vec<Pairing> {
    let of = |relation, first: usize, second: &str, other: &dyn Fn(&Row) -> Option<f64>| {
        let pairs: Vec<[f64; 2]> =
            quantity.rows.iter().filter_map(|row| Some([row.values[first]?, other(row)?])).collect();
        Pairing {
            relation,
            first: readings[first].set.clone(),
            second: second.to_owned(),
            quantity: quantity.name,
            unit: quantity.unit,
            limits: bland_altman(&pairs),
            points: pairs.iter().map(|[a, b]| [f64::midpoint(*a, *b), a - b]).collect(),
        }
    };
    let mut found = Vec::new();
    if let Some(truth) = truth {
        found.extend((0..readings.len()).map(|at| of(Relation::Truth, at, &truth.set, &|row| row.truth)));
    }
    let readers = readers(readings);
    let mut every_two = |relation, columns: &[usize]| {
        for (at, &first) in columns.iter().enumerate() {
            for &second in &columns[at + 1..] {
                found.push(of(relation, first, &readings[second].set, &|row| row.values[second]));
            }
        }
    };
    every_two(Relation::Inter, &readers.iter().map(|(_, sets)| sets[0]).collect::<Vec<_>>());
    readers.iter().for_each(|(_, sets)| every_two(Relation::Intra, sets));
    found
}

/// Every reader with the positions of their readings, in order.
fn readers(readings: &[Reading]) -> Vec<(&String, Vec<usize>)> {
    let mut readers: Vec<(&String, Vec<usize>)> = Vec::new();
    for (at, reading) in readings.iter().enumerate() {
        match readers.iter_mut().find(|(reader, _)| **reader == reading.reader) {
            Some((_, sets)) => sets.push(at),
            None => readers.push((&reading.reader, vec![at])),
        }
    }
    readers
}

/// The mean of the readers' means; none of fewer than two values.
pub(super) fn mean_of_readers<T>(readings: &[Reading], values: &[Option<T>]) -> Option<T>
where
    T: Copy + std::ops::Add<Output = T> + std::ops::Div<f64, Output = T>,
{
    if values.iter().flatten().count() < 2 {
        return None;
    }
    let mean = |values: &[T]| {
        let sum = values.iter().copied().reduce(|a, b| a + b)?;
        Some(sum / values.len() as f64)
    };
    let of_reader = |(_, sets): (&String, Vec<usize>)| {
        mean(&sets.iter().filter_map(|&at| values[at]).collect::<Vec<_>>())
    };
    mean(&readers(readings).into_iter().filter_map(of_reader).collect::<Vec<_>>())
}
