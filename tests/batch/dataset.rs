//! Datasets: depth and cameras that agree with closed forms, with OpenCV and with COLMAP's own
//! conventions.

use super::*;

/// Two turns about a ball of 80 mm at the origin.
fn planned() -> Archive {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let out = archive.text("series/ball");
    ok(&relief(&["phantom", "--kind", "sphere", "--size", "128", "--out", &out]));
    let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
    // The surface itself: half of the values of ball and air.
    std::fs::write(archive.path("surface.json"), r#"{ "mode": "isosurface", "iso_hu": -250 }"#).unwrap();
    let scene = archive.text("surface.json");
    let fixed = [
        "batch", "plan", "--root", &root, "--out", &out, "--size", "97x64", "--scene", &scene, "--zoom",
        "1.5",
    ];
    ok(&relief(&[&fixed[..], &["--views", "turntable:3", "--products", "dataset"]].concat()));
    archive
}

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn matrix(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap().iter().map(common::numbers).collect()
}

/// The place of a pixel at a depth, by the matrices as a reader of the files would take them.
fn unprojected(k: &[Vec<f64>], pose: &[Vec<f64>], [column, row]: [f64; 2], depth: f64) -> [f64; 3] {
    let camera = [(column - k[0][2]) / k[0][0] * depth, (row - k[1][2]) / k[1][1] * depth, depth];
    // The inverse of a rigid motion: R transposed times (x - t).
    let moved = [0, 1, 2].map(|axis| camera[axis] - pose[axis][3]);
    [0, 1, 2].map(|axis| (0..3).map(|row| pose[row][axis] * moved[row]).sum())
}

/// Invariant: Depths and cameras of a dataset follow closed forms, and OpenCV and COLMAP project
/// points to the same pixels.
#[test]
fn unprojected_depth_of_every_view_lies_on_the_ball() {
    let archive = planned();
    ok(&archive.run(&[]));
    let lines = std::fs::read_to_string(archive.path("out/dataset.jsonl")).unwrap();
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 3);
    let (mut places, mut sides) = (0, [0usize; 4]);
    for line in &lines {
        let (k, pose) = (matrix(&line["K"]), matrix(&line["camera_from_patient"]));
        let file = |key: &str| archive.path("out").join(line[key].as_str().unwrap());
        let unit = line["depth_png_unit_mm"].as_f64().unwrap();
        let depth = image::open(file("depth_png")).unwrap();
        let image::DynamicImage::ImageLuma16(depth) = depth else { panic!("16-bit grey") };
        let exact = relief_display::decode_exr(&std::fs::read(file("depth_exr")).unwrap()).unwrap();
        assert_eq!((depth.dimensions(), exact.size_px), ((97, 64), [97, 64]));
        for (column, row, value) in depth.enumerate_pixels() {
            let mm = f64::from(exact.depth_mm[(row * 97 + column) as usize]);
            if value.0[0] == 0 {
                assert!(mm.is_infinite(), "0 is where nothing is seen");
                continue;
            }
            let stored = f64::from(value.0[0]) * unit;
            assert!((stored - mm).abs() <= unit / 2.0 + 1e-3, "{stored} for {mm}");
            let at = unprojected(&k, &pose, [f64::from(column), f64::from(row)], stored);
            let radius = at.iter().map(|part| part * part).sum::<f64>().sqrt();
            // Along the surface a little depth is a long way.
            let eye = unprojected(&k, &pose, [0.0, 0.0], 0.0);
            let facing: f64 = (0..3).map(|axis| at[axis] * (eye[axis] - at[axis])).sum::<f64>()
                / radius
                / (0..3).map(|axis| (eye[axis] - at[axis]).powi(2)).sum::<f64>().sqrt();
            if facing > 0.4 {
                assert!((radius - 80.0).abs() < 0.35, "{radius} mm from the centre at {column}, {row}");
                places += 1;
                let quarter = usize::from(at[0] > 0.0) + 2 * usize::from(at[1] > 0.0);
                sides[quarter] += 1;
            }
        }
    }
    assert!(places > 500 && sides.iter().all(|side| *side > 50), "{places} places, {sides:?} around");
}

/// Invariant: Depths and cameras of a dataset follow closed forms, and OpenCV and COLMAP project
/// points to the same pixels.
///
/// Known points through `cv2.projectPoints`, and the model through the rules of COLMAP's own
/// documentation.
#[test]
fn opencv_and_colmap_put_points_where_the_pictures_have_them() {
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: datasets in OpenCV (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let archive = planned();
    ok(&archive.run(&[]));
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/peers/dataset.py");
    let read = Command::new(python).arg(script).arg(archive.path("out")).output().unwrap();
    let reported = ok(&read);
    assert_eq!(reported["views"], 3, "{reported}");
    assert!(reported["points"].as_u64().unwrap() > 100, "{reported}");
    // Places are written in thousandths of a millimetre: less than a thousandth of a pixel.
    for key in ["opencv_px", "colmap_px", "nerf_px"] {
        assert!(reported[key].as_f64().unwrap() < 2e-3, "{key}: {reported}");
    }
    assert!(reported["ball_mm"].as_f64().unwrap() < 0.2, "{reported}");
    if reported["pycolmap"].is_null() {
        eprintln!("SKIPPED: COLMAP's own reader (pycolmap is not installed)");
    } else {
        assert!(reported["pycolmap"].as_f64().unwrap() < 2e-3, "{reported}");
    }
}

#[test]
fn views_without_a_matrix_are_refused_when_they_are_planned() {
    let archive = Archive::of_phantoms(1);
    let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
    let refused = relief(&[
        "batch",
        "plan",
        "--root",
        &root,
        "--out",
        &out,
        "--views",
        "planes",
        "--products",
        "dataset",
    ]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("view axial is parallel"), "{said}");
    let archive = planned();
    let series = archive.jobs()[0]["series"]["name"].as_str().unwrap().to_owned();
    ok(&archive.run(&[]));
    let model = archive.path("out").join(&series).join("sparse/0");
    for file in ["cameras.txt", "images.txt", "points3D.txt"] {
        assert!(std::fs::read_to_string(model.join(file)).unwrap().starts_with("# "), "{file}");
    }
    let transforms = json_of(&archive.path("out").join(series).join("transforms.json"));
    assert_eq!(transforms["frames"].as_array().unwrap().len(), 3);
    assert_eq!(transforms["depth_unit_scale_factor"], 0.1);
}
