//! DICOM reports and segmentations over HTTP: out of a volume that came as a series, as others read
//! them, and in again.

use axum::body::Body;
use axum::http::{Method, Request};
use relief_dicom::Strictness;
use relief_session::LoadedVolume;
use serde_json::{Value, json};

use crate::server::made;
use crate::server::stage::{Answer, Stage};
use crate::server::tools::{file_of, python};

/// A server with the oblique phantom as a series, whose values rise by 1, 20 and 300 along its axes
/// from -900.
async fn stage() -> (Stage, made::Made) {
    let made = made::series();
    let found = relief_dicom::discover(&made.folder.path().join("ct"), Strictness::Strict, &|_| ()).unwrap();
    let loaded = relief_dicom::load(found.select(None).unwrap(), Strictness::Strict, &|_| ()).unwrap();
    let stage = Stage::annotated().await;
    let id = loaded.volume.content_hash().short();
    stage.server.add_volume(LoadedVolume {
        volume: loaded.volume,
        warnings: Vec::new(),
        identity: Some(loaded.identity),
        reference: loaded.reference,
        labels: None,
    });
    (Stage { id, ..stage }, made)
}

async fn import(stage: &Stage, query: &str, body: &[u8]) -> Answer {
    let request = Request::post(stage.path(&format!("annotations/import?{query}")))
        .header("relief-author", "ben")
        .header("content-type", "application/octet-stream");
    stage.ask(request.body(Body::from(body.to_vec())).unwrap()).await
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

const REPORT: &str = r"
import json, sys, highdicom as hd
from pydicom.sr.codedict import codes
report = hd.sr.srread(sys.argv[1])
groups = report.content.get_planar_roi_measurement_groups(
    graphic_type=hd.sr.GraphicTypeValues3D.POINT, reference_type=codes.DCM.ImageRegion)
print(json.dumps([[group.tracking_identifier, group.roi.value.tolist()[0]] for group in groups]))
";

const SEGMENTATION: &str = r"
import json, sys, highdicom as hd
seg = hd.seg.segread(sys.argv[1])
voxels = seg.get_volume(combine_segments=False).array[..., 0] if hasattr(seg, 'get_volume') else seg.pixel_array
print(json.dumps([seg.get_segment_description(1).segment_label, int((voxels != 0).sum())]))
";

#[tokio::test]
async fn a_report_goes_out_and_comes_in_over_http() {
    let (stage, _series) = stage().await;
    let at = [-31.25, 20.5, -203.125];
    let nasion = json!({ "name": "nasion", "geometry": { "kind": "point", "at_mm": at } });
    let ends = json!([[-30.0, 18.0, -204.0], [-27.0, 22.0, -192.0]]);
    let width = json!({ "name": "width", "geometry": { "kind": "line", "ends_mm": ends } });
    stage.create("anna", json!([nasion, width])).await;
    let file = stage.get(&stage.path("annotations/export?format=sr")).await;
    assert_eq!((file.status.as_u16(), &file.body[128..132]), (200, &b"DICM"[..]));
    assert_eq!(file.header("relief-left-out"), "0");
    let (_folder, path) = file_of("report.dcm", &file.body);
    if let Some(found) = python("a report over HTTP read by highdicom", REPORT, &[&path]) {
        let found: Value = serde_json::from_str(&found).unwrap();
        assert_eq!((found.as_array().unwrap().len(), &found[0][0]), (1, &json!("nasion")), "{found}");
        assert!(numbers(&found[0][1]).iter().zip(at).all(|(a, b)| (a - b).abs() < 1e-4), "{found}");
    }
    let there = import(&stage, "name=report.dcm", &file.body).await;
    assert_eq!(there.status, 200, "{}", there.text());
    assert_eq!(there.json()["there"], json!({ "unchanged": 2, "skipped": 0 }), "{}", there.text());
    let made = import(&stage, "name=report.dcm&set=back&duplicate=true", &file.body).await;
    assert_eq!(made.status, 201, "{}", made.text());
    let events = made.json()["events"].clone();
    let named = |name: &str| {
        let events = events.as_array().unwrap();
        events.iter().find(|event| event["item"]["name"] == name).unwrap()["item"].clone()
    };
    assert_eq!(named("nasion")["set"], "back");
    let back = numbers(&named("nasion")["geometry"]["at_mm"]);
    assert!(back.iter().zip(at).all(|(a, b)| (a - b).abs() < 1e-4), "{events}");
    assert_eq!(named("width")["geometry"]["kind"], "line");
    // A damaged report changes nothing.
    let half = import(&stage, "format=sr", &file.body[..file.body.len() / 2]).await.problem(422);
    assert_eq!(half["type"], "urn:relief:problem:unreadable-annotations");
    let list = stage.annotate(Method::GET, "", "", Value::Null).await.json();
    assert_eq!(list["items"].as_array().unwrap().len(), 4);
}

#[tokio::test]
async fn a_segmentation_goes_out_and_comes_in_over_http() {
    let (stage, series) = stage().await;
    // The third slice from the bottom: 120 voxels of 0.7 x 0.9 x 1.3 mm.
    let seed = series.grid.patient_from_voxel() * relief_base::Point::new(4.0, 5.0, 2.0);
    let wanted = json!({ "seed_mm": seed.xyz.to_array(), "hu": [-300, -71], "name": "slab" });
    let grown = stage.annotate(Method::POST, "/grow", "anna", wanted).await;
    assert_eq!(grown.json()["events"][0]["item"]["geometry"]["voxels"], 120, "{}", grown.text());
    let file = stage.get(&stage.path("annotations/export?format=seg")).await;
    assert_eq!((file.status.as_u16(), &file.body[128..132]), (200, &b"DICM"[..]));
    let (_folder, path) = file_of("segments.dcm", &file.body);
    if let Some(found) = python("a segmentation over HTTP read by highdicom", SEGMENTATION, &[&path]) {
        let found: Value = serde_json::from_str(&found).unwrap();
        assert_eq!(found, json!(["slab", 120]));
    }
    let made = import(&stage, "name=segments.dcm&set=back", &file.body).await;
    assert_eq!(made.status, 201, "{}", made.text());
    let item = made.json()["events"][0]["item"].clone();
    assert_eq!((&item["name"], &item["geometry"]["voxels"]), (&json!("slab"), &json!(120)), "{item}");
    let volume = item["geometry"]["volume_ml"].as_f64().unwrap();
    assert!((volume - 120.0 * 0.7 * 0.9 * 1.3 / 1000.0).abs() < 1e-6, "{volume}");
    let mesh = stage.annotate(Method::POST, "/mesh", "ben", json!({ "region": item["id"] })).await;
    assert_eq!(mesh.status, 201, "{}", mesh.text());
}
