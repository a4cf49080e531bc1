//! Shared by the tests of this module: items, and reproducible normal numbers.

#[path = "../../../tests/readers/normal.rs"]
mod normal;

pub(super) use normal::Normal;

use relief_annotation::{Geometry, Item};
use relief_base::Point;

pub(super) fn named(name: &str, geometry: Option<Geometry>) -> Item {
    Item::new(name, "anna", geometry).unwrap()
}

pub(super) fn point(name: &str, x: f64) -> Item {
    at(name, [x, 0.0, 0.0])
}

pub(super) fn at(name: &str, [x, y, z]: [f64; 3]) -> Item {
    named(name, Some(Geometry::Point { at_mm: Point::new(x, y, z) }))
}
