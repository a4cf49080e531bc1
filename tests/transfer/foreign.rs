//! Files of other programs: `relief presets convert` and `relief render --transfer`, against VTK's
//! own evaluation where `RELIEF_PEERS_PYTHON` names a Python that has it, and against bytes that
//! are no such files.

use std::path::Path;
use std::process::Command;

use proptest::prelude::*;
use relief_volume::{TransferFunction, TransferImportChoice, TransferImportError, import_transfer};
use serde_json::{Value, json};

use super::{relief, reported};

/// A property as 3D Slicer's presets have them, with a step at 300 HU.
const SLICER_XML: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<MRML>
  <!-- made for this test -->
  <VolumeProperty name="Plain" shade="0" colorTransfer="8 -1000 0 0 0 1000 1 1 1" scalarOpacity="4 0 0 100 1"/>
  <VolumeProperty id="vtkMRMLVolumePropertyNode2" name="Lit &amp; stepped" gradientOpacity="4 0 0.5 255 1" specularPower="30"
    scalarOpacity="10 -1000 0 100 0.25 300 0.25 300 0.75 3000 1" specular="0.3" shade="1" ambient="0.15"
    colorTransfer="12 -1000 0.1 0.2 0.3 300 0.9 0.8 0.7 3000 1 1 1" diffuse="0.85" interpolation="1">
    <Other/>
  </VolumeProperty>
</MRML>
"#;

const SLICER_LINES: &str =
    "1\n1\n0.8\n0.25\n0.3\n12\n6 -500 0 0 0.5 500 1\n4 0 1 255 1\n8 -500 0 0 0 500 1 0.5 0.25\n";

fn slicer_json() -> Value {
    json!({
        "@schema": "volume-property-schema-v1.0.0.json#",
        "volumeProperties": [{
            "effectiveRange": [-200.0, 800.0],
            "components": [{
                "shade": true,
                "lighting": { "ambient": 0.2, "diffuse": 0.7, "specular": 0.1, "specularPower": 8.0 },
                "scalarOpacityUnitDistance": 2.5,
                "rgbTransferFunction": { "type": "colorTransferFunction", "points": [
                    { "x": -200.0, "color": [0.0, 0.2, 0.4], "midpoint": 0.3, "sharpness": 0.0 },
                    { "x": 300.0, "color": [1.0, 0.5, 0.1], "midpoint": 0.5, "sharpness": 0.6 },
                    { "x": 800.0, "color": [0.9, 0.9, 1.0], "midpoint": 0.5, "sharpness": 0.0 } ] },
                "scalarOpacity": { "type": "piecewiseLinearFunction", "points": [
                    { "x": -200.0, "y": 0.0, "midpoint": 0.7, "sharpness": 0.2 },
                    { "x": 100.0, "y": 0.8, "midpoint": 0.5, "sharpness": 1.0 },
                    { "x": 500.0, "y": 0.1, "midpoint": 0.5, "sharpness": 0.0 },
                    { "x": 800.0, "y": 0.6, "midpoint": 0.5, "sharpness": 0.0 } ] },
                "gradientOpacity": { "points": [ { "x": 0.0, "y": 1.0 }, { "x": 255.0, "y": 1.0 } ] }
            }]
        }]
    })
}

fn color_map(space: &str) -> Value {
    json!([{
        "Name": format!("A map in {space}"),
        "ColorSpace": space,
        "RGBPoints": [0.0, 0.231, 0.298, 0.753, 0.4, 0.865, 0.865, 0.865, 0.7, 0.2, 0.7, 0.1, 1.0, 0.706, 0.016, 0.149],
        "Points": [0.0, 0.0, 0.5, 0.0, 0.5, 0.8, 0.3, 0.4, 0.8, 0.2, 0.6, 0.9, 1.0, 1.0, 0.5, 0.0],
        "NanColor": [1.0, 1.0, 0.0]
    }])
}

fn imported(text: &str, name: Option<&str>, range_hu: Option<[f64; 2]>) -> relief_volume::ImportedTransfer {
    import_transfer(text.as_bytes(), &TransferImportChoice { name, range_hu }).unwrap()
}

fn refused(text: &str, name: Option<&str>) -> String {
    import_transfer(text.as_bytes(), &TransferImportChoice { name, range_hu: None }).unwrap_err().to_string()
}

#[test]
fn a_slicer_preset_is_read_with_its_light_and_its_step() {
    let look = imported(SLICER_XML, Some("Lit & stepped"), None);
    let light = look.light.unwrap();
    assert_eq!((light.shares, light.shininess), ([0.15, 0.85, 0.3], 30.0));
    assert_eq!(look.left_out, [""; 0]);
    let gradient = look.transfer.gradient_opacity().unwrap();
    assert_eq!(gradient.points(), [[0.0, 0.5], [255.0, 1.0]]);
    for (hu, opacity) in
        [(-1500.0, 0.0), (-450.0, 0.125), (299.9, 0.25), (300.1, 0.75), (1650.0, 0.875), (4000.0, 1.0)]
    {
        assert!((look.transfer.at(hu)[3] - opacity).abs() < 1e-4, "{hu} HU: {}", look.transfer.at(hu)[3]);
    }
    let color = look.transfer.at(-350.0);
    assert!((color[0] - 0.5).abs() < 1e-12 && (color[2] - 0.5).abs() < 1e-12, "{color:?}");

    let unlit = imported(SLICER_XML, Some("Plain"), None);
    assert_eq!((unlit.light.unwrap().shares, unlit.left_out.len()), ([1.0, 0.0, 0.0], 0));
    assert_eq!(unlit.transfer.points().len(), 4, "a point for each node of either function");
}

#[test]
fn nine_lines_are_read_in_their_order() {
    let look = imported(SLICER_LINES, None, None);
    let light = look.light.unwrap();
    assert_eq!((light.shares, light.shininess), ([0.25, 0.8, 0.3], 12.0));
    for (hu, opacity) in [(-250.0, 0.25), (0.0, 0.5), (250.0, 0.75)] {
        assert!((look.transfer.at(hu)[3] - opacity).abs() < 1e-12);
    }
    assert_eq!(look.transfer.at(0.0)[..3], [0.5, 0.25, 0.125]);
}

#[test]
fn invalid_files_are_refused_with_place_and_reason() {
    let xml = |attributes: &str| format!("<MRML><VolumeProperty name=\"A\" {attributes}/></MRML>");
    let good = r#"colorTransfer="4 0 0 0 0""#;
    for (text, parts) in [
        (String::new(), &["unknown file format"][..]),
        ("hello".to_owned(), &["unknown file format"]),
        ("{}".to_owned(), &["unknown file format"]),
        ("<MRML></MRML>".to_owned(), &["unknown file format"]),
        ("<MRML><VolumeProperty name=\"A\" name=\"B\"/></MRML>".to_owned(), &["XML, byte"]),
        (SLICER_XML.to_owned(), &["contains 2 functions", "Plain, Lit & stepped"]),
        (xml(&format!("{good} scalarOpacity=\"4 0 0 100\"")), &["A: scalarOpacity: values is 3, allowed: 4"]),
        (xml(&format!("{good} scalarOpacity=\"4 0 0 9 1 8\"")), &["values is more, allowed: 4"]),
        (xml(&format!("{good} scalarOpacity=\"3 0 0 9\"")), &["number of values is 3, allowed: a multiple of 2"]),
        (xml(&format!("{good} scalarOpacity=\"99999999999 0\"")), &["number of values is 99999999999"]),
        (xml(&format!("{good} scalarOpacity=\"2 0 1.5\"")), &["point 0: value is 1.5, allowed: 0 to 1"]),
        (xml(&format!("{good} scalarOpacity=\"2 0 nan\"")), &["value is NaN"]),
        (xml(&format!("{good} scalarOpacity=\"2 zero 1\"")), &["scalarOpacity is \"zero\", allowed: numbers"]),
        (xml(good), &["A: scalarOpacity is \"\""]),
        (xml(&format!("{good} scalarOpacity=\"2 0 1\" ambient=\"7\"")), &["A: ambient is 7, allowed: 0 to 1"]),
        (
            xml(&format!("{good} scalarOpacity=\"2 0 1\" scalarOpacityUnitDistance=\"0\"")),
            &["opacity unit is 0 mm"],
        ),
        ("1\n1\n0.9\n0.1".to_owned(), &[".vp: the line of specular is missing"]),
        (r#"{"volumeProperties":[{}]}"#.to_owned(), &["volumeProperties[0].components", "missing"]),
        (
            r#"{"volumeProperties":[{"components":[{"rgbTransferFunction":{"points":[{"x":1,"color":[1,1]}]}}]}]}"#
                .to_owned(),
            &["components[0].rgbTransferFunction.points[0]: color is not 3 number(s)"],
        ),
        (r#"{"Name":"B","RGBPoints":[0,0,0]}"#.to_owned(), &["B: RGBPoints: number of values is 3"]),
        (r#"{"Name":"B","RGBPoints":[0,0,0,0],"ColorSpace":"CMYK"}"#.to_owned(), &["ColorSpace is \"CMYK\""]),
        (r#"[{"Name":"B","IndexedColors":[1,0,0]}]"#.to_owned(), &["B: no RGBPoints"]),
        (r#"{"Name":"B","RGBPoints":[0,0,0,"x"]}"#.to_owned(), &["not a flat list of numbers"]),
    ] {
        let message = refused(&text, None);
        for part in parts {
            assert!(message.contains(part), "{text}: {message:?} lacks {part:?}");
        }
    }
    assert!(refused(SLICER_XML, Some("Other")).contains("no function named \"Other\"; it contains Plain"));
    let flat = import_transfer(
        br#"{"RGBPoints":[5,0,0,0]}"#,
        &TransferImportChoice { name: None, range_hu: Some([0.0, 1.0]) },
    );
    assert!(flat.unwrap_err().to_string().contains("range is 5 to 5"));
    assert!(matches!(
        import_transfer(&vec![b' '; (16 << 20) + 1], &TransferImportChoice::default()),
        Err(TransferImportError::TooLarge)
    ));
    let deep = "[".repeat(100_000);
    assert!(matches!(
        import_transfer(deep.as_bytes(), &TransferImportChoice::default()),
        Err(TransferImportError::Syntax { .. })
    ));
}

/// Every function here as VTK's classes evaluate it: `x r g b a` lines.
const VTK: &str = r"
import json, sys, vtk
for case in json.load(sys.stdin):
    color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    if case['space'] == 'HSV-long':
        color.SetColorSpaceToHSV(); color.HSVWrapOff()
    else:
        getattr(color, 'SetColorSpaceTo' + case['space'])()
    for n in case['color']: color.AddRGBPoint(*n)
    for n in case['opacity']: opacity.AddPoint(*n)
    print(json.dumps([[*color.GetColor(x), opacity.GetValue(x)] for x in case['at']]))
";

/// Values of the functions by VTK; `None` with a message if there is no VTK.
fn by_vtk(test: &str, cases: &Value) -> Option<Vec<Vec<[f64; 4]>>> {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {test} (RELIEF_PEERS_PYTHON is not set)");
        return None;
    };
    let mut input = tempfile::tempfile().unwrap();
    std::io::Write::write_all(&mut input, cases.to_string().as_bytes()).unwrap();
    std::io::Seek::rewind(&mut input).unwrap();
    let output = Command::new(python).arg("-c").arg(VTK).stdin(input).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

/// Places between -250 and 1250 HU that hit no node and no step.
fn places() -> Vec<f64> {
    (0..3000).map(|i| -250.0 + 0.5 * f64::from(i) + 0.171).collect()
}

fn largest_difference(transfer: &TransferFunction, at: &[f64], vtk: &[[f64; 4]]) -> f64 {
    let off = |(hu, vtk): (&f64, &[f64; 4])| {
        transfer.at(*hu).iter().zip(vtk).map(|(own, other)| (own - other).abs()).fold(0.0, f64::max)
    };
    at.iter().zip(vtk).map(off).fold(0.0, f64::max)
}

/// Invariant: Midpoints, sharpness and colour spaces of imported transfer functions equal those of
/// VTK.
#[test]
fn midpoint_sharpness_and_colour_spaces_are_those_of_vtk() {
    let nodes =
        [[-200.0, 0.0, 0.2, 0.4], [300.0, 1.0, 0.5, 0.1], [500.0, 0.1, 0.1, 0.1], [800.0, 0.9, 0.9, 1.0]];
    let bends = [[0.3, 0.0], [0.5, 0.6], [0.8, 0.35], [0.5, 0.0]];
    let levels = [[-200.0, 0.0], [100.0, 0.8], [520.0, 0.1], [900.0, 0.6]];
    let spaces = ["RGB", "HSV", "HSV-long", "Lab", "Diverging", "Step"];
    let mut maps = Vec::new();
    let mut cases = Vec::new();
    for space in spaces {
        // Slicer's points bend their colours, in RGB; maps have other spaces, and bend their
        // opacity.
        let is_rgb = space == "RGB";
        let bend = |i: usize| if is_rgb { bends[i] } else { [0.5, 0.0] };
        let point = |(i, [x, r, g, b]): (usize, [f64; 4])| json!({ "x": x, "color": [r, g, b], "midpoint": bend(i)[0], "sharpness": bend(i)[1] });
        let level = |(i, [x, y]): (usize, [f64; 2])| json!({ "x": x, "y": y, "midpoint": bends[i][1], "sharpness": bends[i][0] });
        let color: Vec<Value> = nodes.into_iter().enumerate().map(point).collect();
        let opacity: Vec<Value> = levels.into_iter().enumerate().map(level).collect();
        let flat = |key: &str, from: &[Value]| -> Vec<Value> {
            let one = |p: &Value| match &p[key] {
                Value::Array(values) => [vec![p["x"].clone()], values.clone()].concat(),
                y => vec![p["x"].clone(), y.clone(), p["midpoint"].clone(), p["sharpness"].clone()],
            };
            from.iter().flat_map(one).collect()
        };
        maps.push(if is_rgb {
            json!({ "volumeProperties": [{ "components": [{
                "rgbTransferFunction": { "points": color }, "scalarOpacity": { "points": opacity } }] }] })
        } else {
            json!({ "RGBPoints": flat("color", &color), "Points": flat("y", &opacity),
                    "ColorSpace": space.trim_end_matches("-long"), "HSVWrap": space != "HSV-long" })
        });
        let node = |p: &Value| {
            let bend = [p["midpoint"].clone(), p["sharpness"].clone()];
            let values = p.get("color").map_or(vec![p["y"].clone()], |c| c.as_array().unwrap().clone());
            Value::from([vec![p["x"].clone()], values, bend.to_vec()].concat())
        };
        let [color, opacity] = [color, opacity].map(|points| points.iter().map(node).collect::<Vec<_>>());
        cases.push(json!({ "space": space, "color": color, "opacity": opacity, "at": places() }));
    }
    let Some(vtk) = by_vtk("midpoint_sharpness_and_colour_spaces_are_those_of_vtk", &cases.into()) else {
        return;
    };
    for ((map, space), vtk) in maps.iter().zip(spaces).zip(&vtk) {
        let look = imported(&map.to_string(), None, None);
        let off = largest_difference(&look.transfer, &places(), vtk);
        println!("{space}: {} points, off by {off:.6} at most", look.transfer.points().len());
        assert!(off < 0.002, "{space} is off by {off}");
    }
}

#[test]
fn a_map_of_0_to_1_is_stretched_over_hu() {
    let map = color_map("Lab").to_string();
    let [own, stretched] = [None, Some([-200.0, 1000.0])].map(|range| imported(&map, None, range).transfer);
    for share in [0.0, 0.2, 0.45, 0.77, 0.93, 1.0] {
        let (a, b) = (own.at(share), stretched.at(-200.0 + 1200.0 * share));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.003), "{share}: {a:?} {b:?}");
    }
    let plain = imported(r#"{"RGBPoints":[-100,0,0,0, 300,1,1,1]}"#, None, None).transfer;
    assert_eq!(plain.at(100.0), [0.5; 4], "a map without opacity rises over its range");
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn convert_prints_what_a_request_takes() {
    let folder = tempfile::tempdir().unwrap();
    let presets = write(folder.path(), "presets.xml", SLICER_XML);
    let printed: Value =
        serde_json::from_str(&reported(&["presets", "convert", &presets, "--name", "Lit & stepped"]))
            .unwrap();
    assert_eq!(
        printed["shading"],
        json!({ "ambient": 0.15, "diffuse": 0.85, "specular": 0.3, "shininess": 30.0 })
    );
    let scene = relief_render::SceneFile::parse(printed.to_string().as_bytes()).unwrap();
    let grid = relief_volume::Grid::axis_aligned([8; 3], [1.0; 3], [0.0; 3]).unwrap();
    let request = scene.resolve(&grid, &relief_volume::Orbit::default()).unwrap().request;
    assert_eq!(request.transfer, imported(SLICER_XML, Some("Lit & stepped"), None).transfer);

    let property = write(folder.path(), "look.vp.json", &slicer_json().to_string());
    let printed: Value = serde_json::from_str(&reported(&["presets", "convert", &property])).unwrap();
    assert_eq!(printed["transfer"]["opacity_unit_mm"], 2.5);
    let map = write(folder.path(), "map.json", &color_map("Diverging").to_string());
    let printed: Value =
        serde_json::from_str(&reported(&["presets", "convert", &map, "--range-hu", "-200,1000"])).unwrap();
    let points = printed["transfer"]["points"].as_array().unwrap();
    assert_eq!((&points[0]["hu"], &points[points.len() - 1]["hu"]), (&json!(-200.0), &json!(1000.0)));
    assert!(printed.get("shading").is_none(), "a colour map says nothing of light");

    let output = relief(&["presets", "convert", &presets]);
    let reported = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{reported}");
    assert!(reported.contains("Plain, Lit & stepped"), "{reported}");
    let half = &printed_gradient(&presets)["points"][0];
    assert_eq!((&half["hu_per_mm"], &half["opacity"]), (&json!(0.0), &json!(0.5)));
    assert_eq!(relief(&["presets", "convert", "no/such/file"]).status.code(), Some(1));
}

fn printed_gradient(presets: &str) -> Value {
    let printed = reported(&["presets", "convert", presets, "--name", "Lit & stepped"]);
    serde_json::from_str::<Value>(&printed).unwrap()["transfer"]["gradient_opacity"].clone()
}

/// The file, its conversion, and a scene with either all give the same picture, which differs from
/// the preset's.
#[test]
fn a_picture_with_the_file_is_one_with_what_it_converts_to() {
    let folder = tempfile::tempdir().unwrap();
    let series = folder.path().join("head");
    reported(&["phantom", "--kind", "head", "--size", "48", "--out", series.to_str().unwrap()]);
    let file = write(folder.path(), "look.vp", SLICER_LINES);
    let converted = write(folder.path(), "converted.json", &reported(&["presets", "convert", &file]));
    let picture = |options: &[&str]| {
        let out = folder.path().join("picture.png");
        let fixed = ["--layout", "color", "--size", "64x48", "--out", out.to_str().unwrap()];
        reported(&[&["render", "--series", series.to_str().unwrap()][..], options, &fixed].concat());
        image::open(out).unwrap().into_rgb8()
    };
    let direct = picture(&["--transfer", &file]);
    assert!(direct.pixels().any(|pixel| pixel.0[0] > 60), "something is shown");
    assert_eq!(direct, picture(&["--transfer", &converted]));
    assert_eq!(direct, picture(&["--scene", &converted]));
    assert_ne!(direct, picture(&["--preset", "bone"]));
    let both =
        relief(&["render", "--series", "x", "--out", "x.png", "--preset", "bone", "--transfer", &file]);
    assert_eq!(both.status.code(), Some(2));
}

fn whole_files() -> [String; 4] {
    [SLICER_XML.to_owned(), SLICER_LINES.to_owned(), slicer_json().to_string(), color_map("HSV").to_string()]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Whatever a byte becomes, the answer is a valid function or an error.
    #[test]
    fn damaged_files_never_panic(which in 0usize..4, at in 0usize..4000, byte: u8, cut in 0usize..4000) {
        let mut bytes = whole_files()[which].clone().into_bytes();
        let length = bytes.len();
        bytes[at % length] = byte;
        if cut % 3 == 0 {
            bytes.truncate(cut % length);
        }
        for name in [None, Some("Plain"), Some("Lit & stepped")] {
            if let Ok(look) = import_transfer(&bytes, &TransferImportChoice { name, range_hu: None }) {
                prop_assert!(look.transfer.points().len() <= TransferFunction::MAX_POINTS);
                prop_assert!(look.transfer.at(100.0).iter().all(|value| (0.0..=1.0).contains(value)));
            }
        }
    }

    #[test]
    fn any_numbers_make_a_function_or_an_error(values in proptest::collection::vec(any::<f64>(), 0..40)) {
        let words: Vec<String> = values.iter().map(|value| format!("{value:e}")).collect();
        let count = values.len();
        let text = format!("1\n1\n1\n0\n0\n1\n{count} {0}\n0\n{count} {0}\n", words.join(" "));
        let _ = import_transfer(text.as_bytes(), &TransferImportChoice::default());
        let map = json!({ "RGBPoints": values, "Points": values, "ColorSpace": "Diverging" }).to_string();
        let _ = import_transfer(map.as_bytes(), &TransferImportChoice::default());
    }
}
