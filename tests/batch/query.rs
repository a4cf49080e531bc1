//! Queries: the selection of series by properties that do not identify a patient.

use super::*;
use relief_batch::{Query, SeriesFacts};

fn facts() -> SeriesFacts {
    SeriesFacts {
        modality: "CT".to_owned(),
        format: "dicom",
        dims: [512, 256, 40],
        pixel_mm: [0.7, 0.7],
        thickness_mm: Some(2.5),
    }
}

#[test]
fn conditions_mean_what_they_say() {
    for (text, is_wanted) in [
        ("slices>=40", true),
        ("slices>40", false),
        ("slices=40", true),
        ("slices!=40", false),
        ("modality=ct,slices<=40,columns=512", true),
        ("modality=MR", false),
        ("modality!=MR, rows<256", false),
        ("pixel_mm<0.71, pixel_mm>0.69", true),
        ("thickness_mm<=1.25", false),
        ("format=volume", false),
    ] {
        let query: Query = text.parse().unwrap();
        assert_eq!(query.admit(&facts()).is_ok(), is_wanted, "{text}");
    }
    let unknown = SeriesFacts { thickness_mm: None, ..facts() };
    let refused = "thickness_mm>0".parse::<Query>().unwrap().admit(&unknown).unwrap_err();
    assert_eq!(refused.to_string(), "its files have no thickness_mm");
}

#[test]
fn invalid_conditions_are_refused_with_the_valid_ones() {
    for text in [
        "",
        "slices",
        "slices=>4",
        "slices>many",
        "slices>inf",
        "patient=x",
        "modality>CT",
        "modality=",
        "a=b=c",
    ] {
        let refused = text.parse::<Query>().unwrap_err();
        assert!(refused.to_string().contains("thickness_mm"), "{text}: {refused}");
    }
}

#[test]
fn a_query_chooses_among_the_series_of_a_folder() {
    let archive = Archive::of_phantoms(4); // 24 to 30 slices and more
    let all = ok(&archive.plan(&["--views", "planes"]));
    let some = ok(&archive.plan(&["--views", "planes", "--where", "modality=CT,columns>=26,columns<30"]));
    assert_eq!((&all["series"], &some["series"], &some["unwanted"]), (&4.into(), &2.into(), &2.into()));
    assert_eq!(some["skipped"], serde_json::json!([]), "what is not wanted is no trouble");
    let none = archive.plan(&["--views", "planes", "--where", "slices>1000"]);
    assert_eq!(none.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&none.stderr).contains("which --where does not select"));
}

/// Its voxels are missing; the header is enough for the grid.
#[test]
fn a_query_reads_no_voxels_of_a_volume_file() {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    std::fs::create_dir(archive.path("series")).unwrap();
    let header = "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 10 20 50\n\
                  space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\nendian: little\n\n";
    std::fs::write(archive.path("series/volume.nrrd"), header).unwrap();
    let planned = ok(&archive.plan(&["--views", "planes", "--where", "slices>=40,rows=20,columns<=10"]));
    assert_eq!((&planned["series"], &planned["unwanted"]), (&1.into(), &0.into()), "{planned}");
    let unwanted = archive.plan(&["--views", "planes", "--where", "slices>50"]);
    assert!(
        String::from_utf8_lossy(&unwanted.stderr).contains("slices is 50, which --where does not select")
    );
}
