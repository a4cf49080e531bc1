//! Uploads: a real zip of real DICOM files becomes a volume, within limits.

use std::io::Write;

use axum::body::Body;
use axum::http::Request;
use relief::dicom::write::{Existing, SeriesFolder, SeriesLabels};
use relief::server::{Config, UploadLimits};
use relief::session::QueueConfig;
use relief::volume::{Grid, Volume};

use crate::stage::{Answer, Stage};

/// A zip of a CT series of 8x8x4 voxels, told apart by a value.
fn series_zip(value: i16) -> Vec<u8> {
    let grid = Grid::axis_aligned([8, 8, 4], [2.0, 2.0, 3.0], [0.0; 3]).unwrap();
    let volume = Volume::new(grid, (0..256).map(|i| i + value).collect()).unwrap();
    let place = tempfile::tempdir().unwrap();
    let folder = SeriesFolder::create(&place.path().join("series"), Existing::Keep).unwrap();
    let labels = SeriesLabels {
        patient_name: "SECRET^NAME".to_owned(),
        patient_id: "SECRET-ID".to_owned(),
        description: "SECRET".to_owned(),
        body_part: String::new(),
        window_hu: (40, 400),
    };
    folder.write_slices(&volume, &labels, &|_| ()).unwrap();
    folder.finish().unwrap();
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for slice in std::fs::read_dir(place.path().join("series")).unwrap() {
        let slice = slice.unwrap();
        zip.start_file(slice.file_name().to_string_lossy(), zip::write::SimpleFileOptions::default())
            .unwrap();
        zip.write_all(&std::fs::read(slice.path()).unwrap()).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn stage(limits: Option<UploadLimits>) -> Stage {
    Stage::with(Config { uploads: limits, ..Config::default() }, QueueConfig::default())
}

async fn upload(stage: &Stage, zip: Vec<u8>) -> Answer {
    stage.post("/v1/volumes", "application/zip", zip).await
}

async fn delete(stage: &Stage, path: &str) -> Answer {
    stage.ask(Request::delete(path).body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn a_zip_of_a_series_becomes_a_volume_that_can_be_rendered_and_removed() {
    let stage = stage(Some(UploadLimits::default()));
    let made = upload(&stage, series_zip(0)).await;
    assert_eq!(made.status, 201, "{}", made.text());
    let location = made.header("location").to_owned();
    let described = stage.get(&location).await;
    assert_eq!(described.json()["dims"], serde_json::json!([8, 8, 4]));
    assert_eq!(described.json()["hu_range"], serde_json::json!([0, 255]));
    assert!(!described.text().contains("SECRET") && !made.text().contains("SECRET"));
    assert_eq!(stage.get(&format!("{location}/frame?layout=color&size_px=8,8")).await.status, 200);

    let again = upload(&stage, series_zip(0)).await;
    assert_eq!((again.status.as_u16(), again.header("location")), (200, location.as_str()));
    assert_eq!(stage.get("/v1/volumes").await.json()["volumes"].as_array().unwrap().len(), 2);

    assert_eq!(delete(&stage, &location).await.status, 204);
    stage.get(&location).await.problem(404);
    delete(&stage, &location).await.problem(404);
    delete(&stage, &format!("/v1/volumes/{}", stage.id)).await.problem(403);
}

#[tokio::test]
async fn uploads_are_bounded_in_every_way() {
    let limits = UploadLimits { file_bytes: 1 << 20, volumes: 2, voxel_bytes: 600 };
    let stage = stage(Some(limits));
    let length = (limits.file_bytes + 1).to_string();
    let announced = Request::post("/v1/volumes")
        .header("content-type", "application/zip")
        .header("content-length", length)
        .body(Body::empty())
        .unwrap();
    stage.ask(announced).await.problem(413);
    upload(&stage, vec![0; (1 << 20) + 1]).await.problem(413);
    stage.post("/v1/volumes", "application/json", "{}").await.problem(415);
    let unreadable = upload(&stage, b"PK\x03\x04 not really".to_vec()).await;
    unreadable.problem(422);

    assert_eq!(upload(&stage, series_zip(0)).await.status, 201);
    let full = upload(&stage, series_zip(1)).await.problem(507);
    assert!(full["detail"].as_str().unwrap().contains("88 of 600"), "{full}");
}

#[tokio::test]
async fn the_number_of_uploads_is_bounded() {
    let stage = stage(Some(UploadLimits { volumes: 1, ..UploadLimits::default() }));
    assert_eq!(upload(&stage, series_zip(0)).await.status, 201);
    upload(&stage, series_zip(1)).await.problem(507);
}

#[tokio::test]
async fn uploads_can_be_off() {
    let stage = stage(None);
    assert_eq!(upload(&stage, series_zip(0)).await.problem(403)["type"], "urn:relief:problem:uploads-off");
}
