//! Simulated readers: the comparison returns the parameters of the simulation.

use relief_annotation::{Geometry, Item, State};
use relief_base::Point;
use relief_study::{Absence, AgreementError, Comparison, Figure, Reading, Relation, Study, compare_readings};

use crate::readers::normal::Normal;

fn item(name: &str, geometry: Geometry) -> Item {
    Item::new(name, "anna", Some(geometry)).unwrap()
}

fn landmark(name: &str, [x, y, z]: [f64; 3]) -> Item {
    item(name, Geometry::Point { at_mm: Point::new(x, y, z) })
}

fn reading(set: &str, reader: &str, items: Vec<Item>) -> Reading {
    Reading { set: set.to_owned(), reader: reader.to_owned(), items }
}

fn study(readings: Vec<Reading>, truth: Option<Reading>) -> Result<Comparison, AgreementError> {
    compare_readings(Study { readings, truth })
}

/// The number of landmarks of a head.
fn head(count: usize, normal: &mut Normal) -> Vec<[f64; 3]> {
    (0..count).map(|_| [60.0, 80.0, 70.0].map(|size| size * normal.next())).collect()
}

/// A reader who places with this bias and standard deviation along L, P and S.
fn placed(truth: &[[f64; 3]], bias: [f64; 3], deviation: f64, normal: &mut Normal) -> Vec<Item> {
    let place = |(at, truth): (usize, &[f64; 3])| {
        let mm = std::array::from_fn(|axis| truth[axis] + bias[axis] + deviation * normal.next());
        landmark(&format!("landmark {at}"), mm)
    };
    truth.iter().enumerate().map(place).collect()
}

#[test]
fn known_bias_and_variance_of_readers_are_found() {
    const COUNT: usize = 3000;
    let mut normal = Normal::new(1);
    let truth = head(COUNT, &mut normal);
    let (bias, deviation) = ([0.8, -0.3, 0.0], 0.5);
    let found = study(
        vec![
            reading("a", "a", placed(&truth, bias, deviation, &mut normal)),
            reading("b", "b", placed(&truth, [0.0; 3], deviation, &mut normal)),
        ],
        Some(reading("truth", "truth", placed(&truth, [0.0; 3], 0.0, &mut normal))),
    )
    .unwrap();
    // Standard errors are 0.5 / sqrt(3000) = 0.009 mm.
    let a = found.errors[0].errors.unwrap();
    for (found, made) in a.bias_mm.iter().zip(bias) {
        assert!((found - made).abs() < 0.03, "{a:?}");
    }
    for found in a.deviation_mm.unwrap() {
        assert!((found - deviation).abs() < 0.03, "{a:?}");
    }
    // Lengths of unbiased normal errors have Maxwell's distribution: mean sqrt(8/pi), median
    // 1.5382, 95 % at 2.7955.
    let b = found.errors[1].errors.unwrap();
    for (length, of_unit) in [
        (b.mean_mm, (8.0 / std::f64::consts::PI).sqrt()),
        (b.median_mm, 1.5382),
        (b.p95_mm, 2.7955),
        (b.rms_mm, 3_f64.sqrt()),
    ] {
        assert!(
            (length / (of_unit * deviation) - 1.0).abs() < 0.04,
            "{length} mm, of a unit {of_unit}: {b:?}"
        );
    }
    let ellipsoid = found.errors[1].ellipsoid.unwrap();
    for axis in ellipsoid.semi_axes_mm {
        assert!((axis / (deviation * 7.8147_f64.sqrt()) - 1.0).abs() < 0.05, "{ellipsoid:?}");
    }
    // Differences of the two have the bias and sqrt(2) of the deviation.
    let pairing = found.pairings.iter().find(|p| p.relation == Relation::Inter && p.quantity == "L").unwrap();
    let limits = pairing.limits.known().unwrap();
    assert!(
        (limits.bias - 0.8).abs() < 0.05 && (limits.deviation - 0.5 * 2_f64.sqrt()).abs() < 0.03,
        "{limits:?}"
    );
    assert_eq!((pairing.points.len(), limits.count), (COUNT, COUNT));
    // ICC(2,1): the landmarks' variance over all variance; two readers 0.8 mm apart have the
    // variance 0.32 mm2.
    let agreement = &found.agreements[0];
    assert_eq!((agreement.relation, agreement.quantity), (Relation::Inter, "L"));
    let icc = agreement.icc.known().unwrap();
    let expected = 3600.0 / (3600.0 + 0.32 + 0.25);
    assert!((icc.icc - expected).abs() < 1e-5 && icc.ci95[0] <= icc.icc, "{icc:?}, expected {expected}");
    let single = (0.25_f64 + 0.32).sqrt();
    assert!((icc.single_deviation - single).abs() < 0.03, "{icc:?}, expected {single}");
}

/// Without a reference set, errors are measured from the readers' mean: with two readers, half of
/// their distance.
#[test]
fn without_a_truth_the_mean_of_the_readers_is_the_reference() {
    let a =
        vec![landmark("x", [0.0, 0.0, 0.0]), landmark("y", [10.0, 0.0, 0.0]), landmark("alone", [5.0; 3])];
    let b = vec![landmark("x", [0.0, 2.0, 0.0]), landmark("y", [10.0, 4.0, 0.0])];
    let found = study(vec![reading("a", "a", a.clone()), reading("b", "b", b.clone())], None).unwrap();
    assert_eq!(found.truth, None);
    assert_eq!(found.landmarks[0].reference_mm, Some([0.0, 1.0, 0.0]));
    assert_eq!(found.landmarks[1].placed[1].unwrap().error_mm, Some([0.0, 2.0, 0.0]));
    assert_eq!(found.landmarks[2].reference_mm, None);
    assert_eq!(found.errors[0].errors.unwrap().bias_mm, [0.0, -1.5, 0.0]);
    assert_eq!((found.missing.len(), found.missing[0].why), (1, Absence::Absent));
    // Repeats of a reader weigh as one: the mean of readers, not of sets.
    let again = reading("b.2", "b", b);
    let found =
        study(vec![reading("a", "a", a), reading("b.1", "b", again.items.clone()), again], None).unwrap();
    assert_eq!(found.landmarks[0].reference_mm, Some([0.0, 1.0, 0.0]));
}

#[test]
fn repeats_of_a_reader_are_within_and_first_sets_between() {
    let mut normal = Normal::new(2);
    let truth = head(200, &mut normal);
    let mut reader = |set: &str, reader_name: &str, bias, deviation| {
        reading(set, reader_name, placed(&truth, [bias, 0.0, 0.0], deviation, &mut normal))
    };
    let readings = vec![
        reader("a.1", "a", 0.0, 0.2),
        reader("a.2", "a", 0.0, 0.2),
        reader("b.1", "b", 3.0, 0.2),
        reader("b.2", "b", 3.0, 0.2),
    ];
    let found = study(readings, None).unwrap();
    let single = |relation, reader: Option<&str>| {
        let of = |a: &&relief_study::Agreement| {
            a.relation == relation && a.reader.as_deref() == reader && a.quantity == "L"
        };
        let agreement = found.agreements.iter().find(of).unwrap();
        (agreement.sets.clone(), agreement.icc.known().unwrap().single_deviation)
    };
    let (sets, within) = single(Relation::Intra, Some("a"));
    assert!(sets == ["a.1", "a.2"] && (within - 0.2).abs() < 0.03, "{sets:?} {within}");
    let (sets, between) = single(Relation::Inter, None);
    // Readers 3 mm apart have the variance 4.5.
    assert!(sets == ["a.1", "b.1"] && (between - (4.5_f64 + 0.04).sqrt()).abs() < 0.05, "{sets:?} {between}");
    let pairs: Vec<_> = found
        .pairings
        .iter()
        .filter(|pairing| pairing.quantity == "S")
        .map(|pairing| (pairing.relation, &*pairing.first, &*pairing.second))
        .collect();
    assert_eq!(
        pairs,
        [(Relation::Inter, "a.1", "b.1"), (Relation::Intra, "a.1", "a.2"), (Relation::Intra, "b.1", "b.2")]
    );
}

#[test]
fn lines_and_angles_are_compared_by_their_measures() {
    let line = |name: &str, length| {
        item(
            name,
            Geometry::Line { ends_mm: [Point::new(1.0, 2.0, 3.0), Point::new(1.0, 2.0 + length, 3.0)] },
        )
    };
    let angle = |degrees: f64| {
        let (y, x) = degrees.to_radians().sin_cos();
        let points_mm = [Point::new(1.0, 0.0, 0.0), Point::new(0.0, 0.0, 0.0), Point::new(x, y, 0.0)];
        item("gonial", Geometry::Angle { points_mm })
    };
    let a = vec![line("width", 100.0), line("height", 50.0), line("depth", 70.0), angle(120.0)];
    let b = vec![line("width", 101.0), line("height", 50.5), line("depth", 71.5), angle(124.0)];
    let truth = vec![line("width", 100.5), line("height", 50.0), angle(121.0)];
    let found =
        study(vec![reading("a", "a", a), reading("b", "b", b)], Some(reading("truth", "truth", truth)))
            .unwrap();
    assert!(found.landmarks.is_empty() && found.all.is_none());
    let of = |set: &str, measure: &str| {
        found.measure_errors.iter().find(|error| error.set == set && error.measure == measure).unwrap()
    };
    assert_eq!((of("a", "length").count, of("a", "length").bias), (2, -0.25), "the truth has no depth");
    assert!((of("b", "angle").bias - 3.0).abs() < 1e-9, "{:?}", of("b", "angle"));
    assert_eq!((of("b", "length").mean, of("b", "length").max), (0.5, 0.5));
    let icc = |quantity: &str| found.agreements.iter().find(|a| a.quantity == quantity).unwrap().icc;
    assert_eq!(icc("length").known().unwrap().subjects, 3);
    let Figure::Unknown(why) = icc("angle") else { panic!("one angle has no correlation") };
    assert_eq!(why.to_string(), "1 targets were placed by all readers, needed: at least 2");
    assert!(found.missing.iter().any(|missing| missing.set == "truth" && missing.name == "depth"));
}

#[test]
fn too_few_items_give_a_reason_in_place_of_figures() {
    let x = || vec![landmark("x", [1.0; 3])];
    let says = |readings: Vec<Reading>, truth, says: &str| {
        let refused = study(readings, truth).unwrap_err().to_string();
        assert!(refused.contains(says), "{refused}");
    };
    says(vec![reading("a", "a", x())], None, "one set to compare");
    says(vec![reading("a", "a", x()), reading("b", "b", vec![])], None, "the set b has no items");
    says(vec![reading("a", "a", x()), reading("a", "b", x())], None, "the set a is named twice");
    says(
        vec![reading("a", "a", x()), reading("b", "b", vec![landmark("y", [1.0; 3])])],
        None,
        "the sets a, b share no item: items are matched by name, and \"x\" of a is in no other set",
    );
    let framed = |frame: &str| {
        let frame_of_reference = Some(relief_annotation::FrameOfReference(frame.to_owned()));
        vec![Item { frame_of_reference, ..landmark("x", [1.0; 3]) }]
    };
    let frames = study(vec![reading("a", "a", framed("1.2.3")), reading("b", "b", framed("4.5.6"))], None);
    let refused = frames.unwrap_err().to_string();
    assert!(refused.contains("different frames of reference") && !refused.contains("1.2.3"), "{refused}");
}

/// Invariant: Statistics of readers are numbers or reasons, never NaN.
///
/// One landmark, constant readers, skipped items: every figure is a number, or words say why it is
/// missing.
#[test]
fn figures_of_readers_are_always_finite() {
    let skipped = || Item { state: State::Skipped, ..Item::new("z", "anna", None).unwrap() };
    let same = || (0..4).map(|at| landmark(&format!("p{at}"), [1.0, 2.0, 3.0])).collect::<Vec<_>>();
    let one = |x| vec![landmark("x", [x, 0.0, 0.0]), skipped()];
    for readings in [
        vec![reading("a", "a", one(1.0)), reading("b", "b", one(1.5))],
        vec![reading("a", "a", one(1.0)), reading("b", "b", one(1.0))],
        vec![reading("a", "a", same()), reading("b", "b", same())],
        vec![reading("a.1", "a", same()), reading("a.2", "a", same())],
    ] {
        let found = study(readings, None).unwrap();
        // JSON has no NaN: serde writes null for one, and nothing but lacking values may be null.
        let json = serde_json::to_value(&found).unwrap();
        for agreement in json["agreements"].as_array().unwrap() {
            let icc = &agreement["icc"];
            assert!(icc["undefined"].is_string() || icc["icc"].is_number(), "{agreement}");
        }
        for pairing in json["pairings"].as_array().unwrap() {
            let limits = &pairing["limits"];
            assert!(limits["undefined"].is_string() || limits["lower_ci95"][0].is_number(), "{pairing}");
        }
        assert!(json["all"]["rms_mm"].is_number() && json["all"]["p95_mm"].is_number(), "{json}");
    }
}
