//! LPS and RAS: a file in either is read where it lies, of an asymmetric set of points.

use super::{TEXTS, asymmetric, read, write};
use relief_exchange::Format;

/// The asymmetric points in RAS, as numbers of a file.
const RAS: [[f64; 3]; 3] = [[-1.5, -82.25, 40.125], [-73.0, -4.5, 12.0], [-2.0, -70.5, 3.25]];

fn places(format: Format, text: &str) -> Vec<[f64; 3]> {
    let imported = read(format, text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    imported.items.iter().map(|item| item.point().unwrap().xyz.to_array()).collect()
}

fn lps() -> Vec<[f64; 3]> {
    asymmetric().iter().map(|item| item.point().unwrap().xyz.to_array()).collect()
}

/// Invariant: An annotation file is imported completely or not at all, and LPS and RAS are
/// distinguished in every format.
#[test]
fn markups_say_their_system_or_are_lps() {
    let written = |system: &str, points: [[f64; 3]; 3]| {
        let points = points.map(|xyz| serde_json::json!({"label": "a", "position": xyz}));
        format!(
            r#"{{"@schema": "markups-schema-v1.0.0.json", "markups": [{{"type": "Fiducial", {system} "controlPoints": {}}}]}}"#,
            serde_json::to_string(&points).unwrap()
        )
    };
    let own: [[f64; 3]; 3] = lps().try_into().unwrap();
    assert_eq!(places(Format::MrkJson, &written("", own)), lps());
    assert_eq!(places(Format::MrkJson, &written(r#""coordinateSystem": "LPS","#, own)), lps());
    assert_eq!(places(Format::MrkJson, &written(r#""coordinateSystem": "RAS","#, RAS)), lps());
    let micrometres = own.map(|xyz| xyz.map(|mm| mm * 1000.0));
    let units = r#""coordinateUnits": ["um", "UCUM", "micrometer"],"#;
    assert_eq!(places(Format::MrkJson, &written(units, micrometres)), lps());
}

#[test]
fn old_lists_are_ras_unless_they_say_otherwise() {
    let rows = |points: &[[f64; 3]]| {
        let row = |(n, [x, y, z]): (usize, &[f64; 3])| format!("{n},{x},{y},{z},0,0,0,1,1,1,0,P-{n},,\n");
        points.iter().enumerate().map(row).collect::<String>()
    };
    let columns = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n";
    for (system, points) in [
        ("# CoordinateSystem = 0\n", RAS.to_vec()),
        ("# CoordinateSystem = RAS\n", RAS.to_vec()),
        ("# CoordinateSystem = 1\n", lps()),
        ("# CoordinateSystem = LPS\n", lps()),
        ("", RAS.to_vec()),
    ] {
        let text = format!("# Markups fiducial file version = 4.4\n{system}{columns}{}", rows(&points));
        assert_eq!(places(Format::Fcsv, &text), lps(), "{system}");
        let warned = read(Format::Fcsv, &text).unwrap().warnings;
        assert_eq!(warned.len(), usize::from(system.is_empty()), "{warned:?}");
    }
    // As 3D Slicer 3 wrote it.
    let row = |(n, [x, y, z]): (usize, &[f64; 3])| format!("L{n},{x},{y},{z},1,1\n");
    let oldest: String = RAS.iter().enumerate().map(row).collect();
    assert_eq!(places(Format::Fcsv, &oldest), lps());
    assert_eq!(places(Format::Fcsv, &format!("# columns = label,x,y,z,sel,vis\n{oldest}")), lps());
}

#[test]
fn tables_say_their_system_by_their_columns() {
    let rows = |points: &[[f64; 3]], delimiter: &str| {
        let row = |(n, xyz): (usize, &[f64; 3])| {
            let [x, y, z] = xyz.map(|mm| mm.to_string());
            [format!("F-{n}"), x, y, z, "\n".to_owned()].join(delimiter)
        };
        points.iter().enumerate().map(row).collect::<String>()
    };
    for delimiter in [",", "\t", ";"] {
        let head = |names: &str| format!("{}\n", names.replace(',', delimiter));
        let table = head("label,l,p,s,defined") + &rows(&lps(), delimiter);
        assert_eq!(places(Format::Csv, &table), lps(), "{delimiter:?}");
        let table = head("label,r,a,s,defined") + &rows(&RAS, delimiter);
        assert_eq!(places(Format::Tsv, &table), lps(), "{delimiter:?}");
    }
}

#[test]
fn all_that_is_written_is_lps() {
    for format in TEXTS {
        let text = String::from_utf8(write(format, &asymmetric()).unwrap().bytes).unwrap();
        for number in ["82.25", "40.125", "70.5"] {
            assert!(text.contains(number) && !text.contains(&format!("-{number}")), "{format}: {text}");
        }
    }
}

#[test]
fn a_point_set_lies_where_its_geometry_puts_it() {
    // A quarter turn about z, and a shift.
    let geometry = r#"<Geometry3D><IndexToWorld m_0_0="0" m_0_1="-2" m_0_2="0" m_1_0="2" m_1_1="0" m_1_2="0"
        m_2_0="0" m_2_1="0" m_2_2="1"/><Offset x="10" y="20" z="30"/></Geometry3D>"#;
    let set = |geometry: &str| {
        format!(
            "<point_set_file><point_set><time_series>{geometry}<point><id>0</id><x>1</x><y>5</y><z>7</z></point>\
                 </time_series></point_set></point_set_file>"
        )
    };
    assert_eq!(places(Format::Mps, &set(geometry)), [[0.0, 22.0, 37.0]]);
    assert_eq!(places(Format::Mps, &set("")), [[1.0, 5.0, 7.0]]);
    let oldest = set("").replace("<time_series>", "").replace("</time_series>", "");
    assert_eq!(places(Format::Mps, &oldest), [[1.0, 5.0, 7.0]]);
}
