//! Annotations in the files of other tools: round trips, files of others at their places, and
//! damaged files refused with the position of the error.
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

use crate::common;

mod any;
mod commands;
mod damage;
mod labels;
mod meshes;
mod mirror;
mod objects;
mod peer;
mod real;
mod round;

use relief_annotation::{
    CameraRecord, Concept, Device, FrameOfReference, Geometry, Item, ItemId, Method, Placement, State,
    Timestamp,
};
use relief_base::{Patient, Point};
use relief_exchange::{ExchangeError, ExportedFile, Format, Imported, ReadContext, WriteContext};

/// The formats of text that are written and read here.
const TEXTS: [Format; 6] =
    [Format::MrkJson, Format::Fcsv, Format::Csv, Format::Tsv, Format::Mps, Format::Cornerstone];

const CONTEXT: ReadContext<'static> = ReadContext {
    author: "ben",
    set: "default",
    list: "file",
    frame_of_reference: None,
    grid: None,
    series: None,
};

fn at(x: f64, y: f64, z: f64) -> Point<Patient> {
    Point::new(x, y, z)
}

fn read(format: Format, bytes: impl AsRef<[u8]>) -> Result<Imported, ExchangeError> {
    relief_exchange::read(format, bytes.as_ref(), &CONTEXT)
}

fn write(format: Format, items: &[Item]) -> Result<ExportedFile, ExchangeError> {
    relief_exchange::write(
        format,
        items,
        &WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] },
    )
}

/// The error of a refused file.
fn refused(format: Format, bytes: impl AsRef<[u8]>) -> String {
    read(format, bytes).unwrap_err().to_string()
}

/// A landmark of a list.
fn landmark(name: &str, order: u32, xyz: [f64; 3]) -> Item {
    let at_mm = Point::new(xyz[0], xyz[1], xyz[2]);
    let item = Item::new(name, "anna", Some(Geometry::Point { at_mm })).unwrap();
    Item { order, list: "skull".to_owned(), ..item }
}

/// Landmarks that no mirror leaves as they are: all on one side of each axis, and at different
/// distances.
fn asymmetric() -> Vec<Item> {
    vec![
        landmark("nasion", 0, [1.5, 82.25, 40.125]),
        landmark("left ear", 1, [73.0, 4.5, 12.0]),
        landmark("chin, \"middle\"", 2, [2.0, 70.5, 3.25]),
    ]
}

/// One item of each kind that texts hold, with everything that it may have.
fn everything() -> Vec<Item> {
    let place = Placement {
        method: Method::Tip,
        device: Some(Device {
            kind: "wiimote".to_owned(),
            position_mm: Some([1.0, 2.0, 500.0]),
            orientation_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
        }),
        camera: Some(CameraRecord {
            eye_mm: [0.0, -400.0, 0.0],
            look_at_mm: [0.0; 3],
            up: [0.0, 0.0, 1.0],
            vertical_fov_deg: Some(30.0),
            height_mm: None,
        }),
        snapped_mm: Some([0.5, 0.0, -0.25]),
    };
    let concept =
        Concept { code: "T-1".to_owned(), scheme: "99REL".to_owned(), meaning: "Nasion".to_owned() };
    let item = |name: &str, order, geometry| Item {
        order,
        list: "skull".to_owned(),
        created: "2026-01-31T12:00:00.123Z".parse::<Timestamp>().unwrap(),
        ..Item::new(name, "anna", geometry).unwrap()
    };
    let point = Some(Geometry::Point { at_mm: at(1.5, 82.25, 40.125) });
    let curve = |closed, smooth| {
        let points_mm = vec![at(1.0, 2.0, 3.0), at(11.0, 2.5, 3.0), at(12.0, 14.0, 3.0), at(0.5, 13.0, 3.0)];
        Some(Geometry::Curve { points_mm, closed, smooth })
    };
    let plane = Geometry::Plane {
        center_mm: at(10.0, 20.0, 30.0),
        normal: [0.0, 0.8, -0.6],
        axis: [1.0, 0.0, 0.0],
        size_mm: [40.0, 60.0],
    };
    let first = Item {
        description: "where the nose begins,\nbetween \"both\" eyes".to_owned(),
        rgb: Some([0.25, 0.5, 1.0]),
        concept: Some(concept),
        placement: Some(place),
        locked: true,
        ..item("nasion", 0, point.clone())
    };
    vec![
        first,
        Item { visible: false, ..item("hidden", 1, point) },
        item("missing", 2, None),
        Item { state: State::Skipped, ..item("skipped", 3, None) },
        Item { rgb: Some([1.0, 0.0, 0.0]), locked: true, ..item("width", 4, line()) },
        item(
            "bend",
            5,
            Some(Geometry::Angle { points_mm: [at(9.0, 1.0, 2.0), at(1.0, 1.0, 2.0), at(1.0, 7.0, 3.0)] }),
        ),
        item("open", 6, curve(false, false)),
        Item { description: "a ring".to_owned(), visible: false, ..item("ring", 7, curve(true, true)) },
        item("midsagittal", 8, Some(plane)),
        Item {
            list: String::new(),
            ..item("loose", 9, Some(Geometry::Point { at_mm: at(-3.0, -4.0, -5.5) }))
        },
    ]
}

fn line() -> Option<Geometry> {
    Some(Geometry::Line { ends_mm: [at(1.0, 2.0, 3.0), at(4.0, 6.0, 15.0)] })
}

/// Whether two geometries have the same points but for the last digits.
fn same(a: Option<&Geometry>, b: Option<&Geometry>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return a.is_none() && b.is_none() };
    let near = |a: &Point<Patient>, b: &Point<Patient>| a.distance(*b) < 1e-9 * (1.0 + a.xyz.length());
    let direct = |g: &Geometry| match g {
        Geometry::Plane { normal, axis, size_mm, .. } => {
            [*normal, *axis, [size_mm[0], size_mm[1], 0.0]].concat()
        }
        Geometry::Curve { closed, smooth, .. } => {
            vec![f64::from(u8::from(*closed)), f64::from(u8::from(*smooth))]
        }
        _ => Vec::new(),
    };
    a.kind() == b.kind()
        && a.points().len() == b.points().len()
        && a.points().iter().zip(b.points()).all(|(a, b)| near(a, b))
        && direct(a).iter().zip(direct(b)).all(|(a, b)| (a - b).abs() < 1e-9)
}

fn frame(uid: &str) -> Option<FrameOfReference> {
    Some(FrameOfReference(uid.to_owned()))
}

fn ids(items: &[Item]) -> Vec<ItemId> {
    items.iter().map(|item| item.id).collect()
}

/// Invariant: docs/ANNOTATIONS.md lists every format of files.
#[test]
fn every_format_is_in_the_tables_of_the_documents() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/ANNOTATIONS.md")).unwrap();
    let rows: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with("| `"))
        .filter_map(|line| line.split('|').nth(1))
        .collect();
    for name in Format::ALL.map(Format::name) {
        assert!(
            rows.iter().any(|row| row.contains(&format!("`{name}`"))),
            "{name} is not in docs/ANNOTATIONS.md"
        );
    }
}
