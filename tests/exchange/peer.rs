//! Other readers and writers: 3D Slicer's own (slicer-core), slicerio, and a validator of JSON
//! schemas.

use std::path::Path;
use std::process::Command;

use super::{CONTEXT, asymmetric, everything, landmark, read, same, write};
use relief_annotation::{Geometry, Item, State, measures};
use relief_exchange::Format;

/// Reads each markup of `ours.mrk.json` with Slicer's own reader, prints its properties, and has
/// Slicer write it; the same with `ours.fcsv` and `ours.csv`.
const SLICER: &str = r"
import json, os, sys, slicer, vtk
folder = sys.argv[1]
scene = slicer.vtkMRMLScene()
vtk.vtkObject.GlobalWarningDisplayOff()
logic = slicer.vtkSlicerMarkupsLogic(); logic.SetMRMLScene(scene)
def described(node):
    points = []
    for i in range(node.GetNumberOfControlPoints()):
        at = [0.0] * 3; node.GetNthControlPointPosition(i, at)
        points.append({'id': node.GetNthControlPointID(i), 'label': node.GetNthControlPointLabel(i),
            'description': node.GetNthControlPointDescription(i), 'ras': at,
            'defined': node.GetNthControlPointPositionStatus(i) == slicer.vtkMRMLMarkupsNode.PositionDefined,
            'locked': bool(node.GetNthControlPointLocked(i)), 'visible': bool(node.GetNthControlPointVisibility(i))})
    reported = {'class': node.GetClassName(), 'name': node.GetName(), 'locked': bool(node.GetLocked()), 'points': points}
    if node.GetDisplayNode():
        reported['visible'] = bool(node.GetDisplayNode().GetVisibility())
        reported['color'] = list(node.GetDisplayNode().GetSelectedColor())
    if node.IsA('vtkMRMLMarkupsPlaneNode'):
        three = lambda: [0.0, 0.0, 0.0]
        x, y, z, center, normal, size = three(), three(), three(), three(), three(), [0.0, 0.0]
        node.GetAxes(x, y, z); node.GetCenter(center); node.GetNormal(normal)
        reported['plane'] = {'x': x, 'normal': normal, 'center': center, 'size': list(node.GetSize())}
    for name in ('length', 'angle'):
        measurement = node.GetMeasurement(name)
        if measurement:
            measurement.SetEnabled(True); node.UpdateAllMeasurements()
            reported[name] = measurement.GetValue()
    return reported
storage = {'Plane': slicer.vtkMRMLMarkupsPlaneJsonStorageNode}
count = len(json.load(open(os.path.join(folder, 'ours.mrk.json')))['markups'])
nodes = []
for index in range(count):
    kind = json.load(open(os.path.join(folder, 'ours.mrk.json')))['markups'][index]['type']
    reader = storage.get(kind, slicer.vtkMRMLMarkupsJsonStorageNode)()
    scene.AddNode(reader)
    node = reader.AddNewMarkupsNodeFromFile(os.path.join(folder, 'ours.mrk.json'), None, index)
    assert node is not None, reader.GetUserMessages().GetAllMessagesAsString()
    nodes.append(described(node))
    reader.SetFileName(os.path.join(folder, f'slicer-{index}.mrk.json'))
    assert reader.WriteData(node) == 1
old = slicer.vtkMRMLMarkupsFiducialNode(); scene.AddNode(old)
reader = slicer.vtkMRMLMarkupsFiducialStorageNode(); scene.AddNode(reader)
reader.SetFileName(os.path.join(folder, 'ours.fcsv'))
assert reader.ReadData(old) == 1
reader.SetFileName(os.path.join(folder, 'slicer.fcsv'))
assert reader.WriteData(old) == 1
table = slicer.vtkMRMLMarkupsFiducialNode(); scene.AddNode(table)
assert logic.ImportControlPointsFromCSV(table, os.path.join(folder, 'ours.csv'))
assert logic.ExportControlPointsToCSV(table, os.path.join(folder, 'slicer-lps.csv'), True)
assert logic.ExportControlPointsToCSV(table, os.path.join(folder, 'slicer-ras.csv'), False)
print(json.dumps({'markups': nodes, 'fcsv': described(old), 'csv': described(table)}))
";

/// The last line that a script prints, as JSON; `None` with a message if the script cannot run.
pub(super) fn reported(
    what: &str,
    script: &str,
    folder: &Path,
    needs_slicer: bool,
) -> Option<serde_json::Value> {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {what} (RELIEF_PEERS_PYTHON is not set)");
        return None;
    };
    let mut command = Command::new(&python);
    if needs_slicer {
        let Ok(slicer) = std::env::var("RELIEF_SLICER") else {
            eprintln!("SKIPPED: {what} (RELIEF_SLICER is not set: 3D Slicer's core is not there)");
            return None;
        };
        command.env("PYTHONPATH", slicer);
    }
    let output = command.arg("-c").arg(script).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().rfind(|line| line.starts_with(['{', '['])).unwrap_or_else(|| panic!("{text}"));
    Some(serde_json::from_str(last).unwrap())
}

fn has(module: &str, what: &str) -> bool {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {what} (RELIEF_PEERS_PYTHON is not set)");
        return false;
    };
    let found =
        Command::new(python).args(["-c", &format!("import {module}")]).output().unwrap().status.success();
    if !found {
        eprintln!("SKIPPED: {what} ({module} is not among the peers)");
    }
    found
}

fn lps(ras: &serde_json::Value) -> [f64; 3] {
    let ras = super::common::numbers(ras);
    [-ras[0], -ras[1], ras[2]]
}

fn near(a: [f64; 3], b: [f64; 3], within: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= within)
}

/// Slicer has the same points, in its own RAS.
fn agrees(item: &Item, point: &serde_json::Value, file: &str) {
    assert_eq!(point["label"], item.name, "{file}");
    assert_eq!(point["defined"], item.geometry.is_some(), "{file}: {point}");
    assert_eq!(
        (&point["locked"], &point["visible"]),
        (&item.locked.into(), &item.visible.into()),
        "{file}: {point}"
    );
    if let Some(at) = item.point() {
        assert!(near(lps(&point["ras"]), at.xyz.to_array(), 1e-9), "{file}: {point}");
    }
}

#[test]
fn slicer_reads_ours_and_we_read_slicer_s() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let items: Vec<Item> = everything();
    let mut points = asymmetric();
    points[2].description = "with, a comma".to_owned();
    points[1].visible = false;
    points[2].locked = true;
    points.push(Item { geometry: None, state: State::Missing, ..landmark("missing", 3, [0.0; 3]) });
    for (format, name, items) in [
        (Format::MrkJson, "ours.mrk.json", &items),
        (Format::Fcsv, "ours.fcsv", &points),
        (Format::Csv, "ours.csv", &points),
    ] {
        std::fs::write(path(name), write(format, items).unwrap().bytes).unwrap();
    }
    let Some(reported) = reported("markups read and written by 3D Slicer", SLICER, folder.path(), true)
    else {
        return;
    };
    for file in ["fcsv", "csv"] {
        let found = reported[file]["points"].as_array().unwrap();
        assert_eq!(found.len(), points.len(), "{file}");
        for (item, point) in points.iter().zip(found) {
            let name = if file == "csv" { item.name.replace('"', "'") } else { item.name.clone() };
            agrees(&Item { name, ..item.clone() }, point, file);
            assert_eq!(point["description"], item.description, "{file}");
        }
    }
    for (name, format) in
        [("slicer.fcsv", Format::Fcsv), ("slicer-lps.csv", Format::Csv), ("slicer-ras.csv", Format::Csv)]
    {
        let back = read(format, std::fs::read(path(name)).unwrap()).unwrap();
        assert_eq!(back.items.len(), points.len(), "{name}");
        for (item, back) in points.iter().zip(&back.items) {
            let own = if format == Format::Csv { item.name.replace('"', "'") } else { item.name.clone() };
            let expected = (own.as_str(), item.description.as_str(), item.state);
            assert_eq!((back.name.as_str(), back.description.as_str(), back.state), expected, "{name}");
            assert_eq!((item.locked, item.visible), (back.locked, back.visible), "{name}");
            assert!(same(item.geometry.as_ref(), back.geometry.as_ref()), "{name}: {item:?} {back:?}");
        }
    }
    let markups = reported["markups"].as_array().unwrap();
    assert_eq!(markups.len(), 7, "points of two lists, and five others");
    for (index, markup) in markups.iter().enumerate() {
        let file = format!("slicer-{index}.mrk.json");
        let back = read(Format::MrkJson, std::fs::read(path(&file)).unwrap()).unwrap();
        check_markup(&items, markup, &back.items);
    }
}

/// Slicer's properties of one of our markups, and the file that Slicer wrote.
fn check_markup(items: &[Item], markup: &serde_json::Value, back: &[Item]) {
    let found = markup["points"].as_array().unwrap();
    if markup["class"] == "vtkMRMLMarkupsFiducialNode" {
        for (point, back) in found.iter().zip(back) {
            let item = items.iter().find(|item| point["id"] == item.id.to_string()).unwrap();
            agrees(item, point, "mrk.json");
            assert_eq!(point["description"], item.description);
            assert_eq!(
                (item.id, &item.name, item.locked, item.visible),
                (back.id, &back.name, back.locked, back.visible)
            );
            assert!(same(item.geometry.as_ref(), back.geometry.as_ref()), "{item:?} {back:?}");
        }
        assert_eq!(found.len(), back.len());
        return;
    }
    let [back] = back else { panic!("{back:?}") };
    let item = items.iter().find(|item| markup["name"] == item.name).unwrap();
    let geometry = item.geometry.as_ref().unwrap();
    assert_eq!(
        (&markup["locked"], &markup["visible"]),
        (&item.locked.into(), &item.visible.into()),
        "{markup}"
    );
    assert_eq!(
        (back.locked, back.visible, &back.description),
        (item.locked, item.visible, &item.description)
    );
    assert!(same(Some(&smooth(geometry)), back.geometry.as_ref()), "{item:?} {back:?}");
    if let Some(rgb) = item.rgb {
        assert_eq!(super::common::numbers(&markup["color"]), rgb);
        assert_eq!(back.rgb, Some(rgb));
    }
    assert_eq!(found.len(), geometry.points().len());
    for (point, at) in found.iter().zip(geometry.points()) {
        assert!(near(lps(&point["ras"]), at.xyz.to_array(), 1e-9), "{markup}");
    }
    match geometry {
        Geometry::Line { .. } | Geometry::Angle { .. } => {
            let own = measures(geometry)[0];
            let slicer_s = markup[own.name].as_f64().unwrap();
            assert!((slicer_s - own.value).abs() < 1e-9, "{slicer_s} for {own:?}");
        }
        Geometry::Plane { center_mm, normal, axis, size_mm } => {
            let plane = &markup["plane"];
            assert!(near(lps(&plane["center"]), center_mm.xyz.to_array(), 1e-9), "{plane}");
            assert!(
                near(lps(&plane["normal"]), *normal, 1e-9) && near(lps(&plane["x"]), *axis, 1e-9),
                "{plane}"
            );
            assert_eq!(super::common::numbers(&plane["size"])[..2], size_mm[..]);
        }
        _ => {}
    }
}

/// Slicer does not write whether a curve is smooth: its own are.
fn smooth(geometry: &Geometry) -> Geometry {
    match geometry.clone() {
        Geometry::Curve { points_mm, closed, .. } => Geometry::Curve { points_mm, closed, smooth: true },
        other => other,
    }
}

#[test]
fn slicerio_reads_our_lists() {
    if !has("slicerio", "a list of points read by slicerio") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut points = asymmetric();
    points[2].name = "chin".to_owned(); // slicerio does not know quotes
    std::fs::write(folder.path().join("ours.fcsv"), write(Format::Fcsv, &points).unwrap().bytes).unwrap();
    let script = "import json, sys, slicerio.markups as m; print(json.dumps(m.read_markups_fcsv(sys.argv[1] + '/ours.fcsv')))";
    let Some(read_there) = reported("a list of points read by slicerio", script, folder.path(), false) else {
        return;
    };
    let markup = &read_there["markups"][0];
    assert_eq!(markup["coordinateSystem"], "LPS");
    for (item, point) in points.iter().zip(markup["controlPoints"].as_array().unwrap()) {
        assert_eq!(point["label"], item.name);
        assert_eq!(super::common::numbers(&point["position"]), item.point().unwrap().xyz.to_array());
    }
    // And what slicerio makes of it is a file that we read.
    let again = relief_exchange::read(Format::MrkJson, read_there.to_string().as_bytes(), &CONTEXT).unwrap();
    assert!(again.items.iter().zip(&points).all(|(a, b)| a.geometry == b.geometry && a.id == b.id));
}

/// Prints the errors of ours, and of the same file with each of several faults.
const VALIDATE: &str = r#"
import copy, json, sys, jsonschema
ours = json.load(open(sys.argv[1] + '/ours.mrk.json'))
schema = json.load(open(sys.argv[1] + '/schema.json'))
def count(change):
    changed = copy.deepcopy(ours); change(changed)
    return len(list(jsonschema.Draft7Validator(schema).iter_errors(changed)))
first = lambda file: file['markups'][0]['controlPoints'][0]
print(json.dumps({'ours': count(lambda file: None), 'bad': [
    count(lambda file: file['markups'][0].update(type='Sphere')),
    count(lambda file: first(file).update(position=[1, 2])),
    count(lambda file: file['markups'][0].update(coordinateSystem='XYZ')),
    count(lambda file: file.pop('@schema')),
    count(lambda file: first(file).update(locked='yes')),
]}))
"#;

#[test]
fn ours_keeps_slicer_s_schema() {
    if !has("jsonschema", "markups checked with a schema") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ours.mrk.json"), write(Format::MrkJson, &everything()).unwrap().bytes)
        .unwrap();
    let schema = match std::env::var("RELIEF_MARKUPS_SCHEMA") {
        Ok(path) => std::fs::read(path).unwrap(),
        Err(_) => {
            eprintln!(
                "UNAVAILABLE: markups checked with 3D Slicer's published schema (RELIEF_MARKUPS_SCHEMA does not name a copy of \
                 markups-schema-v1.0.3.json); they are checked with a short form of it"
            );
            include_bytes!("markups.schema.json").to_vec()
        }
    };
    std::fs::write(folder.path().join("schema.json"), schema).unwrap();
    let Some(counts) = reported("markups checked with a schema", VALIDATE, folder.path(), false) else {
        return;
    };
    assert_eq!(counts["ours"], 0);
    let bad = counts["bad"].as_array().unwrap();
    assert!(
        bad.iter().all(|count| count.as_u64().unwrap() > 0),
        "{bad:?}: a validator that finds nothing shows nothing"
    );
}
