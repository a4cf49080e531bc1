//! `relief annotate grow`, `paint`, `fill` and `mesh`, from outside.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn relief(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relief"))
        .current_dir(folder)
        .env("RELIEF_ANNOTATIONS", "ann.db")
        .env("RELIEF_AUTHOR", "anna")
        .args(arguments)
        .output()
        .unwrap()
}

fn annotate(folder: &Path, arguments: &[&str]) -> Output {
    relief(folder, &[&["annotate"], arguments].concat())
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = annotate(folder, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(folder: &Path, arguments: &[&str], status: i32, text: &str) {
    let output = annotate(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert!(said.contains(text), "{said}");
}

/// A ball of 80 mm, 500 HU, in voxels of 4 mm.
fn sphere() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let made = relief(folder.path(), &["phantom", "--kind", "sphere", "--size", "64", "--out", "ball"]);
    assert!(made.status.success());
    folder
}

/// Invariant: A region that leaks is refused and nothing is stored; a mesh file is valid, or
/// refused with the place of the error.
#[test]
fn a_region_is_grown_and_becomes_a_mesh_and_files() {
    let folder = sphere();
    let folder = folder.path();
    let grow = ["grow", "--series", "ball", "--seed", "0,0,0", "--hu", "-250,900", "--name", "ball"];
    let grown = json(folder, &grow);
    let truth = 4.0 / 3.0 * std::f64::consts::PI * 512.0;
    let volume = grown["item"]["geometry"]["volume_ml"].as_f64().unwrap();
    assert!((volume / truth - 1.0).abs() < 0.02, "{volume} of {truth} ml");
    assert_eq!(grown["result"]["ended"], "complete");
    assert_eq!(grown["item"]["geometry"]["kind"], "region");
    assert_eq!(grown["item"]["placement"]["method"], "computed");
    let limited = [&grow[..], &["--max-ml", "500"]].concat();
    refused(folder, &limited, 1, "the region leaked: it reached");
    refused(
        folder,
        &["grow", "--series", "ball", "--seed", "0,0", "--hu", "0,1", "--name", "x"],
        2,
        "three numbers",
    );
    refused(
        folder,
        &["grow", "--series", "ball", "--seed", "0,0,0", "--hu", "0,9", "--name", "x"],
        1,
        "has 500 HU",
    );

    let mesh = json(folder, &["mesh", "ball", "--smooth", "--triangles", "2000", "--out", "ball.stl"]);
    assert_eq!(mesh["result"]["manifold"], true);
    let geometry = &mesh["item"]["geometry"];
    assert_eq!(geometry["kind"], "mesh");
    let area = geometry["area_mm2"].as_f64().unwrap();
    assert!((area / (4.0 * std::f64::consts::PI * 6400.0) - 1.0).abs() < 0.03, "{area} mm2");
    assert!((geometry["volume_ml"].as_f64().unwrap() / truth - 1.0).abs() < 0.02);
    let stl = std::fs::read(folder.join("ball.stl")).unwrap();
    assert!(String::from_utf8_lossy(&stl[..80]).contains("SPACE=LPS"));
    for name in ["a.ply", "a.obj", "a.glb"] {
        let only = annotate(folder, &["mesh", "ball", "--only-file", "--out", name]);
        assert!(
            only.status.success() && folder.join(name).is_file(),
            "{}",
            String::from_utf8_lossy(&only.stderr)
        );
    }
    refused(folder, &["mesh", "ball", "--out", "a.step"], 1, "cannot tell the format of a.step");
    refused(folder, &["mesh", "bull"], 1, "there is no item \"bull\"");
    let listed = json(folder, &["list"]);
    let kinds: Vec<&str> = listed["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["item"]["geometry"]["kind"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["region", "mesh"], "what was refused made nothing");
    let checked = annotate(folder, &["check"]);
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}

/// Voxels of the phantom (64 of 4 mm along each side, around the origin) that lie in a ball by
/// half, by counting 16³ points in each.
fn half_covered(center: [f64; 3], radius: f64) -> usize {
    let is_in = |voxel: [i32; 3]| {
        let inside = (0..4096).filter(|point| {
            let square = |axis: usize| {
                let part = (point >> (4 * axis)) & 15;
                let at = 4.0 * f64::from(voxel[axis]) - 128.0 + 0.25 * (f64::from(part) + 0.5);
                (at - center[axis]).powi(2)
            };
            (0..3).map(square).sum::<f64>() <= radius * radius
        });
        2 * inside.count() >= 4096
    };
    let near = || 26..38; // all that the ball may touch
    near()
        .flat_map(|i| near().flat_map(move |j| near().map(move |k| [i, j, k])))
        .filter(|voxel| is_in(*voxel))
        .count()
}

#[test]
fn a_region_is_painted_and_painted_over() {
    let folder = sphere();
    let folder = folder.path();
    let paint =
        |extra: &[&str]| json(folder, &[&["paint", "--series", "ball", "--name", "spot"], extra].concat());
    let first = paint(&["--at", "10,0,0", "--radius-mm", "20"]);
    let truth = 4.0 / 3.0 * std::f64::consts::PI * 8.0;
    let volume = first["item"]["geometry"]["volume_ml"].as_f64().unwrap();
    assert!((volume / truth - 1.0).abs() < 0.03, "{volume} of {truth} ml");
    let second = paint(&["--at", "10,0,0", "--radius-mm", "10", "--erase"]);
    assert_eq!(second["item"]["id"], first["item"]["id"]);
    let less = volume - second["item"]["geometry"]["volume_ml"].as_f64().unwrap();
    let voxels = half_covered([10.0, 0.0, 0.0], 10.0);
    assert!(
        (less - voxels as f64 * 0.064).abs() < 1e-9,
        "{less} ml went, {voxels} voxels are half in the ball"
    );
    // Undo restores the first painting.
    assert!(annotate(folder, &["undo"]).status.success());
    let listed = json(folder, &["list"]);
    assert_eq!(listed["items"][0]["item"]["geometry"], first["item"]["geometry"]);
    refused(
        folder,
        &["paint", "--series", "ball", "--name", "spot", "--at", "10,0,0", "--radius-mm", "40", "--erase"],
        1,
        "nothing would be left",
    );
}

#[test]
fn curves_on_levels_are_filled() {
    let folder = sphere();
    let folder = folder.path();
    let ring = |z: f64, radius: f64| {
        let points: Vec<Value> = (0..72)
            .map(|n| f64::from(n) * std::f64::consts::TAU / 72.0)
            .map(|t| serde_json::json!({ "position": [radius * t.cos(), radius * t.sin(), z] }))
            .collect();
        serde_json::json!({
            "@schema": "markups-schema-v1.0.3.json#",
            "markups": [{ "type": "ClosedCurve", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": points }]
        })
    };
    for (name, z) in [("low", -30.0), ("high", 30.0)] {
        let path = folder.join(format!("{name}.mrk.json"));
        std::fs::write(&path, ring(z, 40.0).to_string()).unwrap();
        let imported = annotate(folder, &["import", path.to_str().unwrap(), "--series", "ball"]);
        assert!(imported.status.success(), "{}", String::from_utf8_lossy(&imported.stderr));
    }
    let listed = json(folder, &["list"]);
    let ids: Vec<&str> =
        listed["items"].as_array().unwrap().iter().map(|it| it["item"]["id"].as_str().unwrap()).collect();
    assert_eq!(ids.len(), 2);
    let filled = json(folder, &["fill", ids[0], ids[1], "--series", "ball", "--name", "drum"]);
    let volume = filled["item"]["geometry"]["volume_ml"].as_f64().unwrap();
    let area = std::f64::consts::PI * 1600.0;
    assert!(volume > area * 58.0 / 1000.0 && volume < area * 65.0 / 1000.0, "{volume} ml");
    refused(
        folder,
        &["fill", "drum", "--series", "ball", "--name", "x"],
        1,
        "is a region, expected a closed curve",
    );
}
