//! Errors of a file name its line or path; no file makes a reader panic or allocate without limit.

use super::{CONTEXT, TEXTS, everything, read, refused, write};
use relief_annotation::FrameOfReference;
use relief_exchange::{Format, ReadContext};

/// A file of one markup with these keys beside its type.
fn markup(kind: &str, keys: &str) -> String {
    format!(r#"{{"@schema": "x/markups-schema-v1.0.3.json#", "markups": [{{"type": "{kind}", {keys}}}]}}"#)
}

fn points(points: &str) -> String {
    markup("Fiducial", &format!(r#""controlPoints": [{points}]"#))
}

#[test]
fn markups_are_refused_with_the_path_of_what_is_wrong() {
    let good = r#"{"id": "1", "label": "a", "position": [1, 2, 3]}"#;
    let with = |from: &str, to: &str| {
        points(&format!("{good}, {}", good.replace("\"1\"", "\"2\"").replace(from, to)))
    };
    assert_eq!(read(Format::MrkJson, with("1", "1")).unwrap().items.len(), 2);
    let cases: [(String, &[&str]); 23] = [
        (String::new(), &["mrk.json: the file", "EOF"]),
        ("[]".to_owned(), &["the file", "expected struct"]),
        (r#"{"markups": []}"#.to_owned(), &["missing field `@schema`"]),
        (good.to_owned(), &["missing field `@schema`"]),
        (points(good).replace("v1.0.3", "v2.0.0"), &["@schema is", "markups-schema-v1.X.Y.json"]),
        (points(good).replace("markups\"", "marks\""), &["missing field `markups`"]),
        (
            points(good).replace("Fiducial", "Sphere"),
            &["markups[0].type", "unknown variant `Sphere`", "ClosedCurve"],
        ),
        (with("[1, 2, 3]", "[1, 2]"), &["markups[0].controlPoints[1].position", "invalid length 2"]),
        (with("[1, 2, 3]", "[1, 2, 3, 4]"), &["markups[0].controlPoints[1].position"]),
        (with("[1, 2, 3]", "[1, 2, 1e999]"), &["markups[0].controlPoints[1].position[2]", "out of range"]),
        (with("[1, 2, 3]", "[1, 2, NaN]"), &["markups: expected value at line 1 column 192"]),
        (
            with("[1, 2, 3]", "[1, 2, 2e6]"),
            &["markups[0].controlPoints[1] (geometry.at_mm) is 2000000", "-1000000"],
        ),
        (
            with("[1, 2, 3]", "null"),
            &["markups[0].controlPoints[1].position is not there", "positionStatus undefined"],
        ),
        (with("[1, 2, 3]", "\"here\""), &["markups[0].controlPoints[1].position", "expected three numbers"]),
        (with("[1, 2, 3]", "\"\""), &["markups[0].controlPoints[1].position is not there"]),
        (
            with("\"label\"", r#""positionStatus": "somewhere", "label""#),
            &["controlPoints[1].positionStatus", "preview"],
        ),
        (
            with("\"label\"", r#""locked": "yes", "label""#),
            &["markups[0].controlPoints[1].locked", "a boolean"],
        ),
        (
            points(&format!("{good}, {good}")),
            &["markups[0].controlPoints[1].id is there twice", "each id once"],
        ),
        (with("\"a\"", "\"a\\nb\""), &["markups[0].controlPoints[1] (name)", "one line"]),
        (
            markup("Fiducial", r#""coordinateSystem": "XYZ""#),
            &["markups[0].coordinateSystem", "`LPS` or `RAS`"],
        ),
        (
            markup("Fiducial", r#""coordinateUnits": "inch""#),
            &["markups[0].coordinateUnits is \"inch\"", "mm or um"],
        ),
        (
            markup(
                "Line",
                r#""controlPoints": [{"position": [1,1,1]}, {"position": [2,1,1]}, {"position": [3,1,1]}]"#,
            ),
            &["markups[0].controlPoints is 3 points", "at most 2 of a Line"],
        ),
        (points(good) + "x", &["trailing characters"]),
    ];
    for (text, parts) in cases {
        let message = refused(Format::MrkJson, &text);
        for part in parts {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
    }
}

#[test]
fn relief_s_own_properties_are_checked_like_any_other() {
    let with =
        |extra: &str| points(&format!(r#"{{"label": "a", "position": [1, 2, 3], "relief": {extra}}}"#));
    for (extra, parts) in [
        (r#"{"rgb": [0, 2, 0]}"#, &["controlPoints[0] (rgb[1]) is 2", "0 to 1"][..]),
        (r#"{"id": "7"}"#, &["controlPoints[0].relief.id", "a UUID"]),
        (r#"{"stat": "missing"}"#, &["controlPoints[0].relief.stat", "unknown field `stat`"]),
        (
            r#"{"concept": {"code": "12345678901234567", "scheme": "DCM", "meaning": "x"}}"#,
            &["(concept.code)"],
        ),
        (r#"{"created": "yesterday"}"#, &["controlPoints[0].relief.created"]),
        (r#"{"author": ""}"#, &["(author) is 0 characters"]),
    ] {
        let message = refused(Format::MrkJson, with(extra));
        for part in parts {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
    }
    // A position overrides the state beside it.
    let contrary = read(Format::MrkJson, with(r#"{"state": "skipped"}"#)).unwrap();
    assert_eq!(contrary.items[0].state, relief_annotation::State::Defined);
}

#[test]
fn unusual_markups_give_warnings() {
    let warned = |text: String| read(Format::MrkJson, text).unwrap().warnings.join("; ");
    let boxes = markup("ROI", r#""center": [1, 2, 3], "size": [4, 5, 6]"#);
    assert_eq!(warned(boxes), "markups[0]: a box (ROI) is left out: Relief has none");
    let preview = points(r#"{"label": "a", "position": [1, 2, 3], "positionStatus": "preview"}"#);
    assert_eq!(warned(preview), "markups[0].controlPoints[0]: a point that was being placed is missing");
    let short =
        markup("Line", r#""controlPoints": [{"position": [1, 1, 1]}, {"positionStatus": "undefined"}]"#);
    assert!(warned(short).contains("fewer points with a position than its type needs"));
    let twice = points(r#"{"label": "a", "position": [1, 2, 3]}, {"label": "a", "position": [1, 2, 3]}"#);
    assert_eq!(warned(twice), "1 names are there more than once in a list");
    let nameless = read(Format::MrkJson, points(r#"{"position": [1, 2, 3]}"#)).unwrap();
    assert_eq!(nameless.items[0].name, "file-1");
    let many = points(&[r#"{"position": [1, 2, 3], "positionStatus": "preview"}"#; 5].join(","));
    assert!(warned(many).starts_with("markups[0].controlPoints[0] and 4 more: a point"));
}

#[test]
fn tables_are_refused_with_the_line_and_column() {
    let fcsv = |row: &str| {
        format!(
            "# Markups fiducial file version = 4.11\n# CoordinateSystem = LPS\n1,1,2,3,0,0,0,1,1,1,0,a,,\n{row}\n"
        )
    };
    for (row, parts) in [
        ("2,1,2", &["line 4, column z is \"\"", "a finite number"][..]),
        ("2,1,two,3", &["line 4, column y is \"two\""]),
        ("2,1,nan,3", &["line 4, column y is \"nan\""]),
        ("2,1,2,inf", &["line 4, column z is \"inf\""]),
        ("2,1,2,3e7", &["line 4 (geometry.at_mm) is 30000000"]),
        ("1,1,2,3", &["line 4, column id is there twice"]),
        ("2,1,2,3,0,0,0,1,yes", &["line 4, column vis is \"yes\"", "0 or 1"]),
        ("2,1,2,3,0,0,0,1,1,1,0,b,,,5", &["line 4, column 15 (position status) is \"5\""]),
        ("2,1,2,3,0,0,0,1,1,1,0,\"b,c", &["line 4 (name) is a text with '\\n'"]),
    ] {
        let message = refused(Format::Fcsv, fcsv(row));
        for part in parts {
            assert!(message.contains(part), "{row}: {message:?} lacks {part:?}");
        }
    }
    let system = fcsv("").replace("= LPS", "= IJK");
    assert!(
        refused(Format::Fcsv, system).contains("line 2, CoordinateSystem is \"IJK\", allowed: LPS, RAS, 0")
    );
    let columns = "# columns = id,x,z,label\n1,2,3,a\n";
    assert!(refused(Format::Fcsv, columns).contains("line 1, columns is without y"));
    for (table, part) in [
        ("", "line 1 is columns , allowed: columns label and l,p,s"),
        ("label,l,p\na,1,2\n", "line 1 is columns label,l,p"),
        ("label,l,p,s,r,a\na,1,2,3,4,5\n", "line 1 is columns of LPS and of RAS"),
        ("label,l,p,s\na,1,2,3\nb,1,,3\n", "line 3, column p is \"\""),
        ("label,l,p,s,defined\na,1,2,3,maybe\n", "line 2, column defined is \"maybe\", allowed: 0 or 1"),
        ("label;l;p;s\na;1,5;2;3\n", "line 2, column l is \"1,5\", allowed: a finite number"),
    ] {
        let message = refused(Format::Csv, table);
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
    for format in TEXTS {
        let latin = [b"label,l,p,s\n".as_slice(), b"\xe9,1,2,3\n"].concat();
        assert!(refused(format, latin).contains("line 2: this is no text in UTF-8"), "{format}");
    }
    let reported = read(Format::Csv, "label,l,p,s,mood\na,1,2,3,good\n").unwrap().warnings;
    assert_eq!(reported, ["the column \"mood\" is left out"]);
}

#[test]
fn point_sets_are_refused_with_the_line() {
    let set = |points: &str| {
        format!(
            "<point_set_file>\n<point_set>\n<time_series>\n{points}\n</time_series></point_set></point_set_file>"
        )
    };
    let point = "<point><id>0</id><x>1</x><y>2</y><z>3</z></point>";
    assert_eq!(read(Format::Mps, set(point)).unwrap().items.len(), 1);
    for (text, parts) in [
        (String::new(), &["line 1", "without </point_set>"][..]),
        ("<html></html>".to_owned(), &["line 1 is <html>", "<point_set_file>"]),
        ("<point_set_file></point_set_file>".to_owned(), &["without </point_set>"]),
        (set(&point.replace("<y>2</y>", "")), &["line 4, <point> is not whole", "id, x, y and z"]),
        (set(&point.replace("<id>0</id>", "")), &["line 4, <point> is not whole"]),
        (set(&point.replace('2', "two")), &["line 4, <y> is \"two\"", "a finite number"]),
        (set(&point.replace('2', "NaN")), &["line 4, <y> is \"NaN\""]),
        (set(&point.replace('2', "2&#48;")), &["line 4", "no plain text"]),
        (set(&point.replace('2', "<![CDATA[2]]>")), &["line 4", "no plain text"]),
        (set(&point.replace("<id>0", "<id>-1")), &["line 4, <id> is \"-1\"", "a whole number"]),
        (set(&format!("{point}\n{point}")), &["line 5, <id> is 0", "each id once"]),
        (set(point).replace("</time_series>", "</time>"), &["line 5"]),
        (
            set(&format!("<Geometry3D><Offset x=\"1\" y=\"b\" z=\"1\"/></Geometry3D>{point}")),
            &["line 4, <Offset>, y"],
        ),
        ("<point_set_file>".to_owned() + &"<a>".repeat(40), &["more than 32 elements within each other"]),
    ] {
        let message = refused(Format::Mps, &text);
        for part in parts {
            assert!(message.contains(part), "{text}: {message:?} lacks {part:?}");
        }
    }
    let steps = set(&format!("{point}</time_series><time_series>{point}"));
    let imported = read(Format::Mps, steps).unwrap();
    assert_eq!(
        (imported.items.len(), imported.warnings[0].contains("later step of time is left out")),
        (1, true)
    );
}

#[test]
fn cornerstone_s_annotations_are_refused_with_the_path() {
    let one = r#"{"annotationUID": "x", "metadata": {"toolName": "Length", "FrameOfReferenceUID": "1.2.3"},
        "data": {"label": "a", "handles": {"points": [[1, 2, 3], [4, 5, 6]]}}}"#;
    let state = format!(r#"{{"1.2.3": {{"Length": [{one}]}}}}"#);
    let listed = format!(r#"{{"annotations": [{one}, {one}]}}"#);
    for (text, count) in
        [(one.to_owned(), 1), (format!("[{one}]"), 1), (state.clone(), 1), (listed.clone(), 2)]
    {
        assert_eq!(read(Format::Cornerstone, text).unwrap().items.len(), count);
    }
    for (text, parts) in [
        (
            format!("[{}]", one.replace("[4, 5, 6]", "[4, 5]")),
            &["[0].data.handles.points[1]", "invalid length 2"][..],
        ),
        (
            format!("[{}]", one.replace(", [4, 5, 6]", "")),
            &["[0].data.handles.points is 1 points", "as many as Length has"],
        ),
        (format!("[{}]", one.replace("toolName", "tool")), &["[0].metadata", "missing field `toolName`"]),
        (
            listed.replacen("[4, 5, 6]", "[4, 5, 1e7]", 1),
            &["annotations[0] (geometry.ends_mm[1]) is 10000000"],
        ),
        (state.replace("[4, 5, 6]", "[4]"), &["....Length[0].data.handles.points[1]"]),
        ("{".to_owned(), &["EOF"]),
        ("7".to_owned(), &["expected a map"]),
    ] {
        let message = refused(Format::Cornerstone, &text);
        assert!(!message.contains("1.2.3"), "{message}: a UID leads to a patient");
        for part in parts {
            assert!(message.contains(part), "{message:?} lacks {part:?}");
        }
    }
    let frame = FrameOfReference("1.2.4".to_owned());
    let context = ReadContext { frame_of_reference: Some(&frame), ..CONTEXT };
    let message =
        relief_exchange::read(Format::Cornerstone, one.as_bytes(), &context).unwrap_err().to_string();
    assert!(
        message.contains("FrameOfReferenceUID is another one than the series'") && !message.contains("1.2.")
    );
    let unknown = read(Format::Cornerstone, one.replace("Length", "Bidirectional")).unwrap();
    assert!(unknown.items.is_empty() && unknown.warnings[0].contains("\"Bidirectional\" is left out"));
    let corners =
        one.replace("Length", "RectangleROI").replace("[4, 5, 6]", "[4, 2, 3], [1, 5, 3], [4, 5, 3]");
    let ring = read(Format::Cornerstone, corners).unwrap().items.remove(0);
    let around: Vec<[f64; 3]> =
        ring.geometry.as_ref().unwrap().points().iter().map(|at| at.xyz.to_array()).collect();
    assert_eq!(around, [[1.0, 2.0, 3.0], [4.0, 2.0, 3.0], [4.0, 5.0, 3.0], [1.0, 5.0, 3.0]]);
}

#[test]
fn every_beginning_of_a_file_is_refused_or_lacks_only_rows() {
    for format in TEXTS {
        let whole = write(format, &everything()).unwrap().bytes;
        let count = read(format, &whole).unwrap().items.len();
        let is_table = matches!(format, Format::Csv | Format::Tsv | Format::Fcsv);
        for cut in 0..whole.len() - 1 {
            match read(format, &whole[..cut]) {
                Ok(part) if is_table => assert!(part.items.len() <= count, "{format}: {cut}"),
                Ok(_) => panic!("{format}: {cut} of {} bytes were taken for a file", whole.len()),
                Err(_) => {}
            }
        }
    }
}

#[test]
fn files_that_are_too_large_are_refused_before_they_cost_anything() {
    let message = refused(Format::Csv, vec![b' '; (64 << 20) + 1]);
    assert!(message.contains("67108865 bytes, allowed: at most 67108864"), "{message}");
    let empty = points(&"{},".repeat(1_000_001));
    assert!(refused(Format::MrkJson, empty).contains("objects, allowed: at most 1000000"));
    let mut rows = "label,l,p,s\n".to_owned();
    rows += &"a,1,2,3\n".repeat(100_001);
    assert!(refused(Format::Csv, rows).contains("100001 items, allowed: at most 100000"));
    // Deep nesting in a key that is not read.
    let deep = points("{}")
        .replace("\"type\"", &format!("\"x\": {}1{}, \"type\"", "[".repeat(100_000), "]".repeat(100_000)));
    let _ = read(Format::MrkJson, deep);
}
