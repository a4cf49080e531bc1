//! `relief annotate template` and `compare` as a user runs them: a log with several readers' sets.

use std::path::Path;
use std::process::{Command, Output};

use relief_annotation::{Change, Edit, Geometry, Item, State};
use relief_base::Point;
use relief_store::Store;
use serde_json::Value;

use crate::readers::normal::Normal;

const NAMES: [&str; 6] = ["nasion", "sella", "basion", "menton", "gonion \"left\"", "<b>gonion</b> & right"];

fn relief(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.env_remove("RELIEF_LOG").env_remove("RELIEF_ANNOTATIONS").env("RELIEF_AUTHOR", "anna");
    command.arg("annotate").arg("--db").arg(folder.join("ann.db")).args(arguments).output().unwrap()
}

fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = relief(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn fails(folder: &Path, arguments: &[&str]) -> String {
    let output = relief(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_str(&succeeds(folder, arguments)).unwrap()
}

/// Puts items into a log, past the command line.
fn store(folder: &Path, items: Vec<Item>) {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    runtime.block_on(async {
        let store = Store::open(folder.join("ann.db").to_str().unwrap()).await.unwrap();
        let changes = items.into_iter().map(|item| Change::Create { item: Box::new(item) }).collect();
        let edit = Edit { author: "anna".to_owned(), reason: String::new(), changes };
        store.apply(&edit).await.unwrap();
        store.close().await;
    });
}

fn landmark(set: &str, name: &str, [x, y, z]: [f64; 3]) -> Item {
    let geometry = Geometry::Point { at_mm: Point::new(x, y, z) };
    Item { set: set.to_owned(), ..Item::new(name, "anna", Some(geometry)).unwrap() }
}

fn place(at: usize) -> [f64; 3] {
    let at = at as f64;
    [10.0 * at - 30.0, 7.0 * (at * 1.3).sin() * 5.0, 60.0 - 4.0 * at * at]
}

/// A truth, two readers of two repeats each, of whom one is 1 mm off to the left and skips a
/// landmark, and a line each.
fn study(folder: &Path) {
    let mut normal = Normal::new(9);
    let mut items: Vec<Item> =
        NAMES.iter().enumerate().map(|(at, name)| landmark("truth", name, place(at))).collect();
    for (set, bias) in [("anna.1", 0.0), ("anna.2", 0.0), ("ben.1", 1.0), ("ben.2", 1.0)] {
        for (at, name) in NAMES.iter().enumerate() {
            let [l, p, s] = place(at).map(|mm| mm + 0.1 * normal.next());
            items.push(landmark(set, name, [l + bias, p, s]));
        }
        let ends_mm = [Point::new(0.0, 0.0, 0.0), Point::new(100.0 + bias, 0.0, 0.0)];
        let line = Item::new("width", "anna", Some(Geometry::Line { ends_mm })).unwrap();
        items.push(Item { set: set.to_owned(), ..line });
    }
    let skipped = items.iter_mut().find(|item| item.set == "ben.1" && item.name == "menton").unwrap();
    (skipped.state, skipped.geometry) = (State::Skipped, None);
    store(folder, items);
}

/// Invariant: Applying a template twice adds nothing the second time.
#[test]
fn a_template_is_kept_applied_and_followed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let write = |name: &str, text: &str| {
        std::fs::write(folder.join(name), text).unwrap();
        folder.join(name).to_str().unwrap().to_owned()
    };
    let good = write(
        "skull.json",
        r#"{"name":"skull","items":[{"name":"nasion"},{"name":"width","kind":"line"},{"name":"menton"}]}"#,
    );
    assert_eq!(succeeds(folder, &["template", "add", &good]), "skull: 3 items\n");
    let bad = write("bad.json", r#"{"name":"bad","items":[{"name":"nasion"},{"name":"x","kind":"lin"}]}"#);
    let refused = fails(folder, &["template", "add", &bad]);
    assert!(refused.contains("items[1].kind") && refused.contains("bad.json is no template"), "{refused}");
    let listed = json(folder, &["template", "list", "--json"]);
    assert_eq!(listed["templates"].as_array().unwrap().len(), 1, "a bad template changes nothing: {listed}");
    assert_eq!(json(folder, &["template", "show", "cephalometry"])["items"][0]["name"], "Nasion");
    let shown = json(folder, &["template", "show", "skull"]);
    assert_eq!(shown["items"][1]["kind"], "line");
    assert!(fails(folder, &["template", "show", "knee"]).contains("knee"));

    // 3D Slicer's way: points that have no place yet.
    let slicer = r#"{"@schema": "https://example.org/markups-schema-v1.0.3.json#", "markups": [{"type": "Fiducial", "controlPoints": [
        {"label": "porion left", "positionStatus": "undefined"},
        {"label": "porion right", "description": "the mirror image", "positionStatus": "undefined"}]}]}"#;
    let slicer = write("ears.mrk.json", slicer);
    assert_eq!(succeeds(folder, &["template", "add", &slicer]), "ears: 2 items\n");
    let shown = json(folder, &["template", "show", "ears"]);
    assert_eq!((&shown["name"], &shown["items"][1]["name"]), (&"ears".into(), &"porion right".into()));
    assert_eq!(shown["items"][1]["description"], "the mirror image");

    let applied = json(folder, &["template", "apply", "skull", "--set", "ben", "--json"]);
    assert_eq!(applied["added"], serde_json::json!(["nasion", "width", "menton"]));
    let again = json(folder, &["template", "apply", "skull", "--set", "ben", "--json"]);
    assert_eq!(again["added"], serde_json::json!([]));
    store(folder, vec![landmark("anna", "menton", [1.0; 3])]);
    let some = json(folder, &["template", "apply", "skull", "--set", "anna", "--json"]);
    assert_eq!(some["added"], serde_json::json!(["nasion", "width"]));
    let status = json(folder, &["template", "status", "skull", "--json"]);
    let complete: Vec<_> = status["sets"].as_array().unwrap().iter().map(|set| &set["complete"]).collect();
    assert_eq!(
        (&complete[0]["defined"], &complete[0]["missing"], &complete[0]["next"]),
        (&1.into(), &2.into(), &"nasion".into())
    );
    assert_eq!((&complete[1]["defined"], &complete[1]["missing"]), (&0.into(), &3.into()));
    let items = json(folder, &["list", "--set", "ben", "--json"]);
    let names: Vec<_> =
        items["items"].as_array().unwrap().iter().map(|found| found["item"]["name"].clone()).collect();
    assert_eq!(names, ["nasion", "width", "menton"], "in the template's order");
    // One application is one edit: undone at once.
    succeeds(folder, &["undo", "--author", "anna"]);
    assert_eq!(
        json(folder, &["template", "status", "skull", "--set", "anna", "--json"])["sets"][0]["complete"]["defined"],
        1
    );
}

#[test]
fn readers_are_compared_with_the_truth_in_tables_and_on_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    study(folder);
    let out = folder.join("report");
    let sets = "anna.1,anna.2,ben.1,ben.2";
    let arguments = [
        "compare",
        "--sets",
        sets,
        "--repeats",
        ".",
        "--truth",
        "truth",
        "--out",
        out.to_str().unwrap(),
        "--json",
    ];
    let found = json(folder, &arguments);
    assert_eq!(found["readings"][3]["reader"], "ben");
    let bias = found["errors"][2]["errors"]["bias_mm"][0].as_f64().unwrap();
    assert!((bias - 1.0).abs() < 0.2, "{bias}");
    assert_eq!(found["errors"][2]["errors"]["count"], 5);
    let skipped = &found["missing"][0];
    assert_eq!(
        (&skipped["set"], &skipped["name"], &skipped["why"]),
        (&"ben.1".into(), &"menton".into(), &"skipped".into())
    );
    let intra = found["agreements"].as_array().unwrap().iter().filter(|a| a["relation"] == "intra").count();
    assert_eq!(intra, 2 * 4, "L, P, S and length of two readers");

    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for part in
        ["<svg", "between readers", "within ben", "&lt;b&gt;gonion&lt;/b&gt; &amp; right", "skipped", "width"]
    {
        assert!(page.contains(part), "{part} is not on the page");
    }
    for part in ["<script", "http:", "https:", "NaN", "inf", "<b>gonion", "src="] {
        assert!(!page.contains(part), "{part} is on the page");
    }
    let rows = |name: &str| -> Vec<csv::StringRecord> {
        let mut reader = csv::Reader::from_path(out.join(name)).unwrap();
        reader.records().collect::<Result<_, _>>().unwrap()
    };
    // 6 landmarks of 4 sets less the skipped one; a set each, all, and each landmark; 4 quantities
    // between and within two.
    let counts = ["landmarks.csv", "errors.csv", "icc.csv", "measures.csv", "missing.csv"]
        .map(|name| rows(name).len());
    assert_eq!(counts, [23, 4 + 1 + 6, 4 * 3, 4, 2]);
    assert_eq!(rows("bland-altman.csv").len(), 3 * (4 + 1 + 2) + 4 + 1 + 2);
    assert!(rows("landmarks.csv").iter().any(|row| &row[2] == NAMES[4]), "quotes are kept");
    let table = succeeds(folder, &["compare", "--sets", "anna.1,ben.1"]);
    for part in ["the mean of the readers", "between readers", "anna.1 - ben.1", "skipped"] {
        assert!(table.contains(part), "{part} is not in\n{table}");
    }
}

#[test]
fn sets_without_common_items_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(fails(folder, &["compare", "--sets", "a,b"]).contains("there is no log"));
    store(
        folder,
        vec![landmark("a", "x", [0.0; 3]), landmark("b", "y", [0.0; 3]), landmark("c", "x", [1.0; 3])],
    );
    assert!(fails(folder, &["compare", "--sets", "a"]).contains("needed: at least 2, or 1 and a truth"));
    assert!(fails(folder, &["compare", "--sets", "a,nobody"]).contains("the set nobody has no items"));
    assert!(fails(folder, &["compare", "--sets", "a,b"]).contains("share no item"));
    // One landmark: an error, and words in the place of correlation and limits.
    let one = succeeds(folder, &["compare", "--sets", "a,c"]);
    assert!(
        one.contains("1 targets were placed by all readers")
            && one.contains("1 targets were placed by both readers"),
        "{one}"
    );
    assert!(!one.contains("NaN"), "{one}");
}

/// Correlations and limits of the same data by pingouin, or by numpy without it.
#[test]
fn figures_are_those_of_a_python_peer() {
    let test = "figures_are_those_of_a_python_peer";
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON").filter(|name| !name.is_empty()) else {
        eprintln!("SKIPPED: {test} (RELIEF_PEERS_PYTHON names no Python)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    study(folder);
    let out = folder.join("report");
    let arguments = ["--sets", "anna.1,anna.2,ben.1,ben.2", "--repeats", ".", "--truth", "truth", "--out"];
    succeeds(folder, &[&["compare"], &arguments[..], &[out.to_str().unwrap()]].concat());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/peers/readers.py");
    let compared = Command::new(python).arg(script).arg(&out).output().unwrap();
    let error = String::from_utf8_lossy(&compared.stderr);
    if compared.status.code() == Some(3) {
        eprintln!("SKIPPED: {test} ({})", error.trim());
        return;
    }
    assert!(compared.status.success(), "{error}");
    let report: Value = serde_json::from_slice(&compared.stdout).unwrap();
    assert_eq!((&report["icc"], &report["limits"]), (&12.into(), &28.into()), "{report}");
    for figure in ["icc_difference", "limits_difference", "error_difference"] {
        assert!(report[figure].as_f64().unwrap() < 1e-9, "{report}");
    }
    match report["interval_difference"].as_f64() {
        // pingouin rounds its intervals to two digits.
        Some(difference) => assert!(difference <= 0.005 + 1e-9, "{report}"),
        None => eprintln!("SKIPPED: {test}: confidence intervals (that Python has no pingouin)"),
    }
}
