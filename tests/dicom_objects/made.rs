//! A series of an asymmetric phantom, and items in it: nothing is where its mirror image would be.

use glam::{DMat3, DVec3};
use relief_annotation::{Concept, FrameOfReference, Geometry, Item, ItemId};
use relief_base::{Patient, Point, Transform};
use relief_dicom::{ExistingFolder, SeriesFolder, SeriesLabels, SeriesReference, Strictness};
use relief_volume::{Grid, Volume};

/// A series in a folder of its own, and what other objects say of it.
pub(crate) struct Made {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) grid: Grid,
    pub(crate) reference: SeriesReference,
    pub(crate) frame_of_reference: String,
}

/// Axes turned about two of them, voxels of three different lengths, and an origin off the middle.
pub(crate) fn oblique_grid(dims: [usize; 3]) -> Grid {
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-0.3);
    let [x, y, z] = [turn.x_axis * 0.7, turn.y_axis * 0.9, turn.z_axis * 1.3];
    Grid::new(dims, Transform::from_axes(x, y, z, DVec3::new(-31.25, 17.5, -205.125))).unwrap()
}

/// The phantom as a series: a ramp that rises differently along each axis.
pub(crate) fn series() -> Made {
    let grid = oblique_grid([10, 12, 7]);
    let ramp =
        (0..7).flat_map(|k| (0..12).flat_map(move |j| (0..10).map(move |i| i + 20 * j + 300 * k - 900)));
    let volume = Volume::new(grid.clone(), ramp.collect()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let labels = SeriesLabels {
        patient_name: "PHANTOM^MÜNZE".to_owned(),
        patient_id: "SECRET-17".to_owned(),
        description: "Ramp".to_owned(),
        body_part: "HEAD".to_owned(),
        window_hu: (40, 400),
    };
    let place = folder.path().join("ct");
    let series = SeriesFolder::create(&place, ExistingFolder::Keep).unwrap();
    series.write_slices(&volume, &labels, &|_| ()).unwrap();
    series.finish().unwrap();
    let found = relief_dicom::discover(&place, Strictness::Strict, &|_| ()).unwrap();
    let entry = found.select(None).unwrap();
    let reference = SeriesReference::of(entry).unwrap();
    let frame_of_reference = entry.frame_of_reference().unwrap().to_owned();
    Made { folder, grid, reference, frame_of_reference }
}

pub(crate) fn at(x: f64, y: f64, z: f64) -> Point<Patient> {
    Point::new(x, y, z)
}

/// An item with an id that its number makes, so that files are the same each time.
pub(crate) fn item(number: u128, name: &str, geometry: Geometry) -> Item {
    let mut item = Item::new(name, "Reader^Anna", Some(geometry)).unwrap();
    item.id = ItemId::from_number(0x0b51_f4c4_95e2_4a4f_9e3b_1c1c_5d8a_7000 + number);
    item.created = "2026-01-31T12:34:56.789Z".parse().unwrap();
    item
}

/// One of each kind that a report holds. Coordinates are short decimals, which 32-bit floats give
/// back.
pub(crate) fn items(frame_of_reference: &str) -> Vec<Item> {
    let curve = |points_mm: Vec<_>, closed, smooth| Geometry::Curve { points_mm, closed, smooth };
    let flat = vec![
        at(-30.5, 18.25, -200.0),
        at(-22.75, 18.25, -200.0),
        at(-22.75, 25.5, -200.0),
        at(-29.0, 27.5, -200.0),
    ];
    let bent = vec![
        at(-30.5, 18.25, -200.0),
        at(-22.75, 18.0, -203.5),
        at(-22.5, 25.5, -199.0),
        at(-29.0, 27.5, -201.0),
    ];
    let mut items = vec![
        item(1, "nasion", Geometry::Point { at_mm: at(-31.25, 20.5, -203.125) }),
        item(2, "Porion links", Geometry::Point { at_mm: at(-24.1, 26.7, -201.3) }),
        item(3, "width", Geometry::Line { ends_mm: [at(-30.0, 18.0, -204.0), at(-27.0, 22.0, -192.0)] }),
        item(
            4,
            "tilt",
            Geometry::Angle {
                points_mm: [at(-30.0, 18.0, -204.0), at(-25.0, 18.0, -204.0), at(-25.0, 21.5, -204.0)],
            },
        ),
        item(5, "flat ring", curve(flat.clone(), true, false)),
        item(6, "bent ring", curve(bent.clone(), true, false)),
        item(7, "path", curve(bent.clone(), false, false)),
        item(8, "smooth ring", curve(flat, true, true)),
        item(9, "smooth path", curve(bent, false, true)),
    ];
    for item in &mut items {
        item.frame_of_reference = Some(FrameOfReference(frame_of_reference.to_owned()));
    }
    items[0].concept = Some(Concept {
        code: "T-11149".to_owned(),
        scheme: "99LAB".to_owned(),
        meaning: "Nasion point".to_owned(),
    });
    items[1].description = "unter dem Jochbogen,\nüber dem Ohr".to_owned();
    items[2].author = "Reader^Börge".to_owned();
    items
}
