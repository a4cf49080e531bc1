//! Label maps over HTTP: uploaded, listed, in queries, in picks; and refusals.

use relief_dicom::write_seg_nrrd;
use relief_server::Config;
use relief_session::QueueConfig;
use relief_volume::{LabelMap, Segment};

use crate::server::stage::{Stage, cube};

const BYTES: &str = "application/octet-stream";

/// The cube's lower half is "low", the upper one has no name.
fn halves() -> Vec<u8> {
    let labels: Vec<u16> = (0..64).map(|at| if at < 32 { 3 } else { 40 }).collect();
    let described = vec![Segment::new(3, Some("low"), Some([1.0, 0.5, 0.0]))];
    write_seg_nrrd(&LabelMap::new(cube().grid().clone(), &labels, described).unwrap()).unwrap()
}

#[tokio::test]
async fn a_label_map_becomes_the_segments_of_its_volume() {
    let stage = Stage::new();
    let described = format!("/v1/volumes/{}", stage.id);
    assert!(stage.get(&described).await.json()["segments"].is_null());
    let before = stage.get(&stage.path("frame?layout=color")).await.header("etag").to_owned();
    let answer = stage.post(&stage.path("labels"), BYTES, halves()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let segments = stage.get(&described).await.json()["segments"].clone();
    assert_eq!(answer.json()["segments"], segments);
    assert_eq!(segments[0]["name"], "low");
    assert_eq!((&segments[0]["label"], &segments[1]["label"]), (&3.into(), &40.into()));
    assert_eq!((&segments[0]["voxels"], &segments[0]["volume_ml"]), (&32.into(), &32.0.into()));
    assert_eq!(segments[0]["rgb"], serde_json::json!([1.0, 0.5, 0.0]));
    assert!(segments[1]["name"].is_null() && segments[1]["rgb"][0].is_number());
    // Each another picture: none may be taken for another.
    let mut tags = vec![before];
    for query in [
        "layout=color",
        "layout=color&cut_labels=low",
        "layout=color&keep_labels=low,40",
        "layout=color&label_tint=1",
    ] {
        let answer = stage.get(&stage.path(&format!("frame?{query}"))).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        tags.push(answer.header("etag").to_owned());
    }
    let distinct: std::collections::BTreeSet<_> = tags.iter().collect();
    assert_eq!(distinct.len(), tags.len(), "{tags:?}");
    let body = r#"{"clip": {"labels": {"cut": ["low"]}}, "display": {"layout": "color"}}"#;
    let by_body = stage.post(&stage.path("frame"), "application/json", body).await;
    assert_eq!(by_body.header("etag"), tags[2], "the same by query and by body");
}

/// Invariant: Uploaded label maps count towards the memory for voxels, and one that does not fit is refused.
#[tokio::test]
async fn label_maps_are_charged_to_the_memory_for_voxels() {
    // The cube has 64 voxels of two bytes, its label map one byte for each.
    for (bytes, status) in [(128 + 63, 507), (128 + 64, 200)] {
        let config = Config { memory_bytes: bytes, ..Config::default() };
        let stage = Stage::with(config, QueueConfig::default());
        let answer = stage.post(&stage.path("labels"), BYTES, halves()).await;
        assert_eq!(answer.status, status, "{}", answer.text());
        if status == 507 {
            assert_eq!(answer.json()["code"], "memory-full");
            continue;
        }
        // Another map takes the place of the first one.
        let again = stage.post(&stage.path("labels"), BYTES, halves()).await;
        assert_eq!(again.status, 200, "{}", again.text());
    }
}

#[tokio::test]
async fn a_pick_names_the_segment_that_it_hits() {
    let stage = Stage::new();
    let query = stage.path("pick?u=32&v=32&size_px=64,64&layout=color");
    assert!(stage.get(&query).await.json()["segment"].is_null());
    stage.post(&stage.path("labels"), BYTES, halves()).await;
    let mut named = 0;
    for v in [20, 28, 36, 44] {
        let found =
            stage.get(&stage.path(&format!("pick?u=32&v={v}&size_px=64,64&layout=color"))).await.json();
        let z = found["patient_mm"][2].as_f64();
        let Some(z) = z.filter(|z| z.abs() < 20.0) else { continue };
        let inside = (0..2).all(|i| found["patient_mm"][i].as_f64().unwrap().abs() < 20.0);
        let expected = if inside { Some(if z < 0.0 { 3 } else { 40 }) } else { None };
        assert_eq!(found["segment"]["label"].as_u64(), expected, "{found}");
        named += usize::from(inside);
    }
    println!("{named} picks inside of the cube");
}

#[tokio::test]
async fn labels_that_are_wrong_are_refused_by_name_and_without_a_path() {
    let stage = Stage::new();
    let problem = stage.get(&stage.path("frame?cut_labels=low")).await.problem(422);
    assert_eq!(problem["allowed"], "nothing beside a volume without a label map");
    let problem = stage.post(&stage.path("labels"), BYTES, "no labels at all").await.problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("neither NIfTI nor NRRD"), "{problem}");
    assert!(!problem["detail"].as_str().unwrap().contains("relief-upload"), "{problem}");
    stage.post(&stage.path("labels"), "application/zip", halves()).await.problem(415);
    stage.post("/v1/volumes/0123456789abcdef/labels", BYTES, halves()).await.problem(404);
    stage.post(&stage.path("labels"), BYTES, halves()).await;
    let problem = stage.get(&stage.path("frame?cut_labels=low,high")).await.problem(422);
    assert_eq!(problem["path"], "cut_labels");
    assert!(problem["allowed"].as_str().unwrap().contains("one of low"), "{problem}");
    let problem = stage.get(&stage.path("frame?label_tint=2")).await.problem(422);
    assert_eq!((&problem["path"], &problem["allowed"]), (&"label_tint".into(), &"0 to 1".into()));
    stage.get(&stage.path("frame?cut_labels=3&keep_labels=3")).await.problem(422);
    let problem = stage.get(&stage.path("frame?mode=mean&cut_labels=3")).await.problem(422);
    assert!(problem["allowed"].as_str().unwrap().contains("composite, mip, minip, slice"), "{problem}");
    let closed = Stage::with(Config { uploads: None, ..Config::default() }, QueueConfig::default());
    closed.post(&closed.path("labels"), BYTES, halves()).await.problem(403);
}
