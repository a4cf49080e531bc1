//! A body, objects on and beside it, and the table below: the truth of each voxel is known.

use super::*;
use crate::Grid;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Part {
    Air,
    Lung,
    Body,
    Arm,
    Ear,
    Finger,
    Marker,
    Foam,
    Shell,
    Rail,
    Tube,
}

impl Part {
    fn hu(self) -> i16 {
        match self {
            Self::Air => -1000,
            Self::Lung => -850,
            Self::Foam => -920,
            Self::Body | Self::Arm | Self::Ear | Self::Finger => 40,
            Self::Marker => 2000,
            Self::Shell => 150,
            Self::Rail => 900,
            Self::Tube => 100,
        }
    }

    fn is_patient(self) -> bool {
        matches!(self, Self::Body | Self::Arm | Self::Ear | Self::Finger | Self::Lung | Self::Marker)
    }
}

/// Voxels of 1 x 1 x 2 mm, 360 x 300 x 80 of them; y points to the back.
const DIMS: [usize; 3] = [360, 300, 80];

/// The part at a voxel, where the skin is at `gap_mm` above the upper shell of the couch.
fn part([i, j, k]: [usize; 3], gap_mm: f64) -> Part {
    let [x, y, z] = [i as f64 - 180.0, j as f64 - 120.0, k as f64 * 2.0];
    let ellipse = |cx: f64, cy: f64, a: f64, b: f64| ((x - cx) / a).hypot((y - cy) / b) <= 1.0;
    let couch_y = 80.0 + gap_mm + x * x / 800.0;
    if ellipse(45.0, 0.0, 35.0, 50.0) || ellipse(-45.0, 0.0, 35.0, 50.0) {
        Part::Lung
    } else if ellipse(0.0, 0.0, 110.0, 80.0) {
        Part::Body
    } else if ellipse(150.0, 20.0, 22.0, 25.0) {
        Part::Arm
    } else if (-118.0..-108.0).contains(&x) && (-22.0..-18.0).contains(&y) && (60.0..110.0).contains(&z) {
        Part::Ear // a flap of 4 mm
    } else if (x + 150.0).hypot(y + 20.0) <= 7.0 && (20.0..100.0).contains(&z) {
        Part::Finger // of a hand beyond the picture
    } else if (x - 20.0).hypot(y + 84.0).hypot(z - 80.0) <= 3.0 {
        Part::Marker
    } else if (y - couch_y).abs() < 1.5 || (y - couch_y - 40.0).abs() < 1.5 {
        Part::Shell
    } else if y > couch_y && y < couch_y + 40.0 {
        if (x.abs() - 140.0).hypot(y - couch_y - 20.0) <= 4.0 { Part::Rail } else { Part::Foam }
    } else if (x - 60.0).hypot(y + 95.0) <= 3.0 {
        Part::Tube
    } else {
        Part::Air
    }
}

fn scan(gap_mm: f64) -> Volume {
    let grid = Grid::axis_aligned(DIMS, [1.0, 1.0, 2.0], [0.0; 3]).unwrap();
    let place = |index: usize| [index % DIMS[0], index / DIMS[0] % DIMS[1], index / (DIMS[0] * DIMS[1])];
    Volume::new(grid.clone(), (0..grid.voxel_count()).map(|index| part(place(index), gap_mm).hu()).collect())
        .unwrap()
}

/// The number of voxels of each part, and of those that the table takes.
fn taken(gap_mm: f64) -> std::collections::BTreeMap<Part, [usize; 2]> {
    let volume = scan(gap_mm);
    let table = Table::find(&volume).expect("there is a table");
    let mut counts = std::collections::BTreeMap::new();
    for index in 0..volume.voxels_hu().len() {
        let at = [index % DIMS[0], index / DIMS[0] % DIMS[1], index / (DIMS[0] * DIMS[1])];
        let [all, taken] = counts.entry(part(at, gap_mm)).or_insert([0; 2]);
        *all += 1;
        *taken += usize::from(table.contains(at));
    }
    counts
}

#[test]
fn the_table_goes_and_no_voxel_of_the_patient_does() {
    // On a mattress, near, and with the skin on the shell.
    for (gap_mm, least_shell) in [(12.0, 1.0), (4.0, 0.98), (0.0, 0.91)] {
        let counts = taken(gap_mm);
        for (part, [all, taken]) in &counts {
            assert!(!part.is_patient() || *taken == 0, "{gap_mm}: {taken} of {all} voxels of {part:?}");
        }
        let share = |part: Part| counts[&part][1] as f64 / counts[&part][0] as f64;
        for part in [Part::Rail, Part::Tube] {
            assert_eq!(share(part), 1.0, "{gap_mm}: {part:?}");
        }
        assert!(share(Part::Shell) >= least_shell, "{gap_mm}: {}", share(Part::Shell));
    }
}

#[test]
fn removed_voxels_are_air_and_the_others_as_they_were() {
    let volume = scan(4.0);
    let (table, shown) = (Table::find(&volume).unwrap(), volume.without_table());
    for (index, (before, after)) in volume.voxels_hu().iter().zip(shown.voxels_hu()).enumerate() {
        let at = [index % DIMS[0], index / DIMS[0] % DIMS[1], index / (DIMS[0] * DIMS[1])];
        assert_eq!(*after, if table.contains(at) { -1000 } else { *before }, "{at:?}");
    }
    assert_ne!(shown.content_hash(), volume.content_hash());
    assert_eq!(shown.content_hash(), volume.content_hash().without_table());
    assert_eq!(shown.without_table().content_hash(), shown.content_hash(), "there is no table any more");
}

/// Invariant: Phantoms have no table: nothing of them is removed.
#[test]
fn phantoms_stay_whole() {
    for kind in crate::PhantomKind::ALL {
        let phantom = crate::PhantomRecipe::new(kind).with_size(96).unwrap().make();
        assert!(Table::find(&phantom.volume).is_none(), "{kind:?}");
        assert_eq!(phantom.volume.without_table().content_hash(), phantom.volume.content_hash());
    }
}
