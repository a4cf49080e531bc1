//! Files that 3D Slicer wrote, with the volumes that they belong to and facts computed by others.

use super::{CONTEXT, common, landmark, read};
use relief_annotation::{Item, State};
use relief_exchange::{Format, ReadContext};

#[test]
fn a_list_of_slicer_5_is_read() {
    let Some(folder) = common::unpacked("a list of points of 3D Slicer", "interop", &["slicer"]) else {
        return;
    };
    let imported = read(Format::Fcsv, std::fs::read(folder.join("slicer/F_1.fcsv")).unwrap()).unwrap();
    assert_eq!((imported.items.len(), imported.warnings.len()), (12, 0));
    let item = |name: &str| imported.items.iter().find(|item| item.name == name).unwrap();
    let second = item("F_1-2");
    assert_eq!(second.description, "Some description");
    assert_eq!((second.visible, second.locked, second.state), (false, false, State::Defined));
    assert_eq!(
        second.point().unwrap().xyz.to_array(),
        [-34.424_668_156_028_36, -55.903_777_304_964_55, -10.2143]
    );
    let other = item("Different name");
    assert_eq!((other.visible, other.locked, other.order), (false, true, 3));
}

#[test]
fn landmarks_of_a_skull_lie_on_it_and_their_mirror_image_gives_a_warning() {
    let Some(folder) = common::unpacked("landmarks of a skull", "interop", &["mouse_ct_atlas"]) else {
        return;
    };
    let facts = common::facts(
        &common::shared_data("facts of files", &["interop.facts.json"]).unwrap(),
        "interop.facts.json",
    );
    let known = facts["mouse_45_LM-skull"]["in_low_res_skull_only.nii.gz"].as_array().unwrap();
    let skull = folder.join("mouse_ct_atlas/low_res_skull_only.nii.gz");
    let grid = relief_dicom::read_volume(&skull).unwrap().volume.grid().clone();
    let context = ReadContext { grid: Some(&grid), ..CONTEXT };
    let markups = std::fs::read(folder.join("mouse_ct_atlas/45_LM-skull.mrk.json")).unwrap();
    let list = std::fs::read(folder.join("mouse_ct_atlas/Skull_LMs.fcsv")).unwrap();
    let [markups_read, list_read] = [(Format::MrkJson, &markups), (Format::Fcsv, &list)]
        .map(|(format, bytes)| relief_exchange::read(format, bytes, &context).unwrap());
    assert_eq!((markups_read.items.len(), list_read.items.len()), (45, 51));
    assert_eq!((&markups_read.warnings, &list_read.warnings), (&vec![], &vec![]), "all points lie inside");
    assert_eq!(known.len(), 45);
    for fact in known {
        let of =
            |items: &[Item]| items.iter().find(|item| item.name == fact["label"]).unwrap().point().unwrap();
        let expected = common::numbers(&fact["position_lps"]);
        for found in [of(&markups_read.items), of(&list_read.items)] {
            assert_eq!(found.xyz.to_array(), expected[..], "{fact}");
            let index = (grid.voxel_from_patient() * found).xyz.to_array();
            let voxel = common::numbers(&fact["voxel_ijk"]);
            assert!(index.iter().zip(&voxel).all(|(a, b)| (a - b).abs() < 0.02), "{index:?} {voxel:?}");
        }
    }
    assert!(markups_read.items.iter().all(|item| item.locked), "the markup itself is locked");
    // The same file under the wrong name of its axes.
    let wrong = String::from_utf8(markups)
        .unwrap()
        .replace(r#""coordinateSystem": "LPS""#, r#""coordinateSystem": "RAS""#);
    let warned = relief_exchange::read(Format::MrkJson, wrong.as_bytes(), &context).unwrap().warnings;
    assert!(
        warned[0].starts_with("45 of 45 points lie outside of the volume; with x and y mirrored"),
        "{warned:?}"
    );
}

#[test]
fn a_list_that_slicer_saved_keeps_its_names_and_locks() {
    let Some(folder) = common::unpacked("markups of 3D Slicer", "interop", &["mouse_ct_atlas"]) else {
        return;
    };
    let skull = folder.join("mouse_ct_atlas/A_J_.nii.gz");
    let grid = relief_dicom::read_volume(&skull).unwrap().volume.grid().clone();
    let bytes = std::fs::read(folder.join("mouse_ct_atlas/A_J_.mrk.json")).unwrap();
    let imported =
        relief_exchange::read(Format::MrkJson, &bytes, &ReadContext { grid: Some(&grid), ..CONTEXT })
            .unwrap();
    assert_eq!((imported.items.len(), imported.warnings.len()), (45, 0), "{:?}", imported.warnings);
    let first = &imported.items[0];
    assert_eq!((first.name.as_str(), first.locked, first.list.as_str()), ("1", true, "file"));
    assert_eq!(first.point().unwrap().xyz.to_array(), [18.4718, 11.5644, 17.3914]);
    assert_eq!(first.rgb, Some([1.0, 0.500_007_629_510_948_3, 0.500_007_629_510_948_3]));
}

#[test]
fn a_table_that_does_not_say_which_way_it_looks_is_refused() {
    let Some(folder) = common::unpacked("a table of points", "interop", &["mouse_ct_atlas"]) else { return };
    let text = std::fs::read_to_string(folder.join("mouse_ct_atlas/low_res_skull_only_LM_LPS.csv")).unwrap();
    let refused = read(Format::Csv, &text).unwrap_err().to_string();
    assert_eq!(
        refused,
        "csv: line 1 is columns x,y,z, allowed: columns label and l,p,s (LPS) or r,a,s (RAS); x,y,z do not say which"
    );
    let named = text.replacen(r#""x","y","z""#, "l,p,s", 1);
    let imported = read(Format::Csv, named).unwrap();
    assert_eq!(imported.items.len(), 51);
    let first = landmark("file-1", 0, [-9.23677, -24.8342, 10.068]);
    assert_eq!((&imported.items[0].name, &imported.items[0].geometry), (&first.name, &first.geometry));
}
