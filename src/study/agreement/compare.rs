//! The whole comparison of readings: missing targets, errors of landmarks, agreement on coordinates
//! and measures.

use glam::DVec3;
use serde::Serialize;

use super::matching::{Absence, Target, targets};
use super::quantity::{
    Agreement, MeasureRow, Pairing, Quantity, ReadingMeasures, Row, agreements, mean_of_readers, pairings,
};
use super::reading::{Reading, Study};
use super::{AgreementError, Ellipsoid, ErrorSummary};
use relief_annotation::{Item, measures};

/// How well readers agree. As JSON it is what `relief annotate compare --json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The sets, in order: `placed` and `values` have a place for each.
    pub readings: Vec<Reading>,
    /// The reference set of the errors; the mean of the readers where there is no such set.
    pub truth: Option<String>,
    /// The number of patients.
    pub cases: usize,
    /// The points that at least one reader placed.
    pub landmarks: Vec<Landmark>,
    /// Errors of each set.
    pub errors: Vec<ReadingErrors>,
    /// Errors of all sets together; none where no landmark has a reference.
    pub all: Option<ErrorSummary>,
    /// The landmarks that sets lack.
    pub missing: Vec<Missing>,
    /// Lengths, angles, areas and volumes.
    pub measures: Vec<MeasureRow>,
    /// The differences of each set's measures from their references.
    pub measure_errors: Vec<ReadingMeasures>,
    /// Intraclass correlations of coordinates and measures.
    pub agreements: Vec<Agreement>,
    /// Limits of agreement of coordinates and measures.
    pub pairings: Vec<Pairing>,
}

/// A point that at least one reader placed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Landmark {
    /// The patient, from 1.
    pub case: usize,
    /// Its list, where the name alone is ambiguous.
    pub list: String,
    /// Its name.
    pub name: String,
    /// Its true place, LPS; none where only one set has it and there is no truth.
    pub reference_mm: Option<[f64; 3]>,
    /// Its place in each set.
    pub placed: Vec<Option<Placed>>,
    /// Its errors in all sets.
    pub errors: Option<ErrorSummary>,
    /// The region that holds 95 % of further placements; of four placements or more.
    pub ellipsoid: Option<Ellipsoid>,
}

/// The place of a landmark in a set.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Placed {
    /// LPS.
    pub at_mm: [f64; 3],
    /// From where it should be, along L, P and S.
    pub error_mm: Option<[f64; 3]>,
    /// The error's length.
    pub distance_mm: Option<f64>,
}

/// Errors of one set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReadingErrors {
    /// The set.
    pub set: String,
    /// Of the landmarks that have a reference.
    pub errors: Option<ErrorSummary>,
    /// The region that holds 95 % of further errors; of four errors or more.
    pub ellipsoid: Option<Ellipsoid>,
}

/// Targets that a set lacks and others have.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// The set, or the truth's.
    pub set: String,
    /// The patient, from 1.
    pub case: usize,
    /// The target's list, where its name alone is ambiguous.
    pub list: String,
    /// The target's name.
    pub name: String,
    /// Why it has none.
    pub why: Absence,
}

/// Compares readings with each other and with the truth.
///
/// # Errors
/// When there is nothing to compare: only one set, a set that is empty or named twice, or
/// sets without common targets.
pub fn compare_readings(study: Study) -> Result<Comparison, AgreementError> {
    let Study { readings, truth } = study;
    check(&readings, truth.as_ref())?;
    let items: Vec<Vec<&Item>> =
        readings.iter().chain(&truth).map(|reading| reading.items.iter().collect()).collect();
    let targets = targets(&items.iter().map(Vec::as_slice).collect::<Vec<_>>());
    if !targets.iter().any(|target| target.found.iter().flatten().count() > 1) {
        return Err(nothing_in_common(&readings, truth.as_ref(), &targets));
    }
    let landmarks: Vec<(usize, Landmark)> = targets
        .iter()
        .enumerate()
        .filter_map(|(at, target)| Some((at, landmark(&readings, target)?)))
        .collect();
    let measured = measured(&targets, readings.len());
    let mut quantities = coordinates(&targets, &landmarks, readings.len());
    quantities.extend(measured.iter().cloned());
    quantities.retain(|quantity| !quantity.rows.is_empty());
    let (measures, measure_errors) = measure_rows(&readings, &targets, &measured);
    let mut pairings: Vec<Pairing> =
        quantities.iter().flat_map(|quantity| pairings(&readings, truth.as_ref(), quantity)).collect();
    // By reader, then by target.
    let place = |set: &str| readings.iter().position(|reading| reading.set == set);
    pairings.sort_by_key(|pairing| (pairing.relation, place(&pairing.first), place(&pairing.second)));
    let mut agreements: Vec<Agreement> =
        quantities.iter().flat_map(|quantity| agreements(&readings, quantity)).collect();
    agreements
        .sort_by_key(|agreement| (agreement.relation, agreement.sets.first().and_then(|set| place(set))));
    let landmarks: Vec<Landmark> = landmarks.into_iter().map(|(_, landmark)| landmark).collect();
    let errors: Vec<ReadingErrors> =
        (0..readings.len()).map(|at| reading_errors(&readings[at].set, &landmarks, at)).collect();
    let every: Vec<DVec3> = (0..readings.len()).flat_map(|at| errors_of(&landmarks, at)).collect();
    Ok(Comparison {
        truth: truth.as_ref().map(|truth| truth.set.clone()),
        cases: targets.iter().map(|target| target.case + 1).max().unwrap_or(1),
        all: ErrorSummary::of(&every),
        missing: missing(&readings, truth.as_ref(), &targets),
        agreements,
        pairings,
        landmarks,
        errors,
        measures,
        measure_errors,
        readings,
    })
}

fn check(readings: &[Reading], truth: Option<&Reading>) -> Result<(), AgreementError> {
    if readings.is_empty() || readings.len() == 1 && truth.is_none() {
        return Err(AgreementError::Alone);
    }
    let mut known = std::collections::HashSet::new();
    for reading in readings.iter().chain(truth) {
        let set = reading.set.clone();
        if !known.insert(set.clone()) {
            return Err(AgreementError::Twice { set });
        }
        if reading.items.is_empty() {
            return Err(AgreementError::Empty { set });
        }
    }
    Ok(())
}

fn nothing_in_common(
    readings: &[Reading],
    truth: Option<&Reading>,
    targets: &[Target<'_>],
) -> AgreementError {
    let sets = readings.iter().chain(truth).map(|reading| reading.set.clone()).collect();
    let mut names = std::collections::HashMap::new();
    let in_several_cases = targets.iter().any(|t| names.insert(t.name, t.case).is_some_and(|c| c != t.case));
    if in_several_cases {
        return AgreementError::DifferentFrames { sets };
    }
    let first = readings.first().and_then(|reading| reading.items.first());
    AgreementError::NothingInCommon { sets, first: first.map(|item| item.name.clone()).unwrap_or_default() }
}

/// The target as a landmark, if it is one that a reading placed.
fn landmark(readings: &[Reading], target: &Target<'_>) -> Option<Landmark> {
    let at = |found: &Result<&Item, Absence>| found.ok().and_then(Item::point).map(|point| point.xyz);
    let places: Vec<Option<DVec3>> = target.found[..readings.len()].iter().map(at).collect();
    places.iter().flatten().next()?;
    let truth = target.found.get(readings.len());
    let reference = match truth {
        Some(truth) => at(truth),
        None => mean_of_readers(readings, &places),
    };
    let placed = |place: &Option<DVec3>| {
        let error = reference.zip(*place).map(|(reference, place)| place - reference);
        place.map(|place| Placed {
            at_mm: place.to_array(),
            error_mm: error.map(|error| error.to_array()),
            distance_mm: error.map(DVec3::length),
        })
    };
    let known: Vec<DVec3> = places.iter().flatten().copied().collect();
    let errors: Vec<DVec3> =
        reference.iter().flat_map(|reference| known.iter().map(move |place| place - reference)).collect();
    Some(Landmark {
        case: target.case + 1,
        list: target.list.to_owned(),
        name: target.name.to_owned(),
        reference_mm: reference.map(|reference| reference.to_array()),
        placed: places.iter().map(placed).collect(),
        errors: ErrorSummary::of(&errors),
        ellipsoid: Ellipsoid::of(&known),
    })
}

/// The landmarks' L, P and S.
fn coordinates(targets: &[Target<'_>], landmarks: &[(usize, Landmark)], readings: usize) -> Vec<Quantity> {
    let along = |(axis, name)| {
        let row = |(target, landmark): &(usize, Landmark)| Row {
            target: *target,
            values: landmark.placed.iter().map(|placed| placed.map(|placed| placed.at_mm[axis])).collect(),
            truth: targets[*target]
                .found
                .get(readings)
                .and_then(|found| found.ok()?.point())
                .map(|point| point.xyz.to_array()[axis]),
        };
        Quantity { name, unit: "mm", rows: landmarks.iter().map(row).collect() }
    };
    ["L", "P", "S"].into_iter().enumerate().map(along).collect()
}

/// The measures of targets that are not landmarks, grouped by name.
fn measured(targets: &[Target<'_>], readings: usize) -> Vec<Quantity> {
    let mut quantities: Vec<Quantity> = Vec::new();
    for (at, target) in targets.iter().enumerate() {
        let of = |found: &Result<&Item, Absence>| {
            found.ok().and_then(|item| item.geometry.as_ref()).map(measures).unwrap_or_default()
        };
        let found: Vec<_> = target.found.iter().map(of).collect();
        let mut kinds: Vec<(&str, &str)> = Vec::new();
        for measure in found[..readings].iter().flatten() {
            if !kinds.contains(&(measure.name, measure.unit)) {
                kinds.push((measure.name, measure.unit));
            }
        }
        for (name, unit) in kinds {
            let value =
                |at: usize| found.get(at)?.iter().find(|measure| measure.name == name).map(|m| m.value);
            let row = Row { target: at, values: (0..readings).map(value).collect(), truth: value(readings) };
            match quantities.iter_mut().find(|quantity| quantity.name == name) {
                Some(quantity) => quantity.rows.push(row),
                None => quantities.push(Quantity { name, unit, rows: vec![row] }),
            }
        }
    }
    quantities
}

fn measure_rows(
    readings: &[Reading],
    targets: &[Target<'_>],
    quantities: &[Quantity],
) -> (Vec<MeasureRow>, Vec<ReadingMeasures>) {
    let (mut rows, mut errors) = (Vec::new(), Vec::new());
    for Quantity { name: measure, unit, rows: values } in quantities {
        let from = rows.len();
        for Row { target, values, truth } in values {
            let Target { case, list, name, ref found } = targets[*target];
            let has_truth = found.len() > readings.len();
            let reference = if has_truth { *truth } else { mean_of_readers(readings, values) };
            let (list, name) = (list.to_owned(), name.to_owned());
            let values = values.clone();
            rows.push(MeasureRow { case: case + 1, list, name, measure, unit, reference, values });
        }
        for (at, reading) in readings.iter().enumerate() {
            let difference = |row: &MeasureRow| Some(row.values[at]? - row.reference?);
            let differences: Vec<f64> = rows[from..].iter().filter_map(difference).collect();
            if differences.is_empty() {
                continue;
            }
            let count = differences.len();
            let sizes = || differences.iter().map(|difference| difference.abs());
            errors.push(ReadingMeasures {
                set: reading.set.clone(),
                measure,
                unit,
                count,
                bias: differences.iter().sum::<f64>() / count as f64,
                mean: sizes().sum::<f64>() / count as f64,
                max: sizes().fold(0.0, f64::max),
            });
        }
    }
    (rows, errors)
}

fn errors_of(landmarks: &[Landmark], at: usize) -> impl Iterator<Item = DVec3> {
    landmarks.iter().filter_map(move |landmark| landmark.placed[at]?.error_mm.map(DVec3::from))
}

fn reading_errors(set: &str, landmarks: &[Landmark], at: usize) -> ReadingErrors {
    let errors: Vec<DVec3> = errors_of(landmarks, at).collect();
    ReadingErrors {
        set: set.to_owned(),
        errors: ErrorSummary::of(&errors),
        ellipsoid: Ellipsoid::of(&errors),
    }
}

fn missing(readings: &[Reading], truth: Option<&Reading>, targets: &[Target<'_>]) -> Vec<Missing> {
    let mut found = Vec::new();
    for (at, reading) in readings.iter().chain(truth).enumerate() {
        for target in targets {
            if let Err(why) = target.found[at] {
                let (list, name) = (target.list.to_owned(), target.name.to_owned());
                found.push(Missing { set: reading.set.clone(), case: target.case + 1, list, name, why });
            }
        }
    }
    found
}
