//! Uploads: a real zip of real DICOM files becomes a volume, within limits.

use std::convert::Infallible;
use std::io::Write;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::Request;
use relief_dicom::{ExistingFolder, SeriesFolder, SeriesLabels};
use relief_server::{Config, UploadLimits, VolumeLoader};
use relief_session::{LoadedVolume, QueueConfig};
use relief_volume::{Grid, Volume};

use crate::server::stage::{Answer, Stage, cube};

/// A zip of a CT series of 8x8x4 voxels, identified by a value.
pub(crate) fn series_zip(value: i16) -> Vec<u8> {
    let grid = Grid::axis_aligned([8, 8, 4], [2.0, 2.0, 3.0], [0.0; 3]).unwrap();
    let volume = Volume::new(grid, (0..256).map(|i| i + value).collect()).unwrap();
    let place = tempfile::tempdir().unwrap();
    let folder = SeriesFolder::create(&place.path().join("series"), ExistingFolder::Keep).unwrap();
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

/// Study and Series Instance UID of the first file of a zip, by another reader.
fn uids(zip: &[u8]) -> [String; 2] {
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(zip)).unwrap();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut zip.by_index(0).unwrap(), &mut bytes).unwrap();
    let file = dicom_object::from_reader(bytes.as_slice()).unwrap();
    ["StudyInstanceUID", "SeriesInstanceUID"]
        .map(|name| file.element_by_name(name).unwrap().to_str().unwrap().into_owned())
}

#[tokio::test]
async fn an_upload_answers_for_its_study_and_series() {
    let stage = stage(Some(UploadLimits::default()));
    let zip = series_zip(7);
    let [study, series] = uids(&zip);
    let path = format!("/studies/{study}/series/{series}/renderedmpr?viewport=8,8");
    stage.get(&path).await.problem(404);
    let made = upload(&stage, zip).await;
    assert!(!made.text().contains(&study) && !made.text().contains(&series));
    assert_eq!(stage.get(&path).await.status, 200);
    assert_eq!(delete(&stage, made.header("location")).await.status, 204);
    stage.get(&path).await.problem(404);
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
    let limits =
        UploadLimits { file_bytes: 1 << 20, volumes: 2, voxel_bytes: 600, ..UploadLimits::default() };
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
    let problem = upload(&stage, series_zip(0)).await.problem(403);
    assert_eq!(problem["type"], "urn:relief:problem:uploads-off");
    assert!(problem["detail"].as_str().unwrap().contains("--uploads on"), "{problem}");
}

#[tokio::test]
async fn a_removed_volume_leaves_no_frame_behind() {
    let stage = stage(Some(UploadLimits::default()));
    let frame = |location: &str| format!("{location}/frame?layout=color&size_px=8,8");
    let location = upload(&stage, series_zip(0)).await.header("location").to_owned();
    assert_eq!(stage.get(&frame(&location)).await.status, 200);

    // A frame that is being rendered while its volume is removed goes too.
    stage.gate.close();
    let (app, path) = (stage.app.clone(), format!("{}&zoom=2", frame(&location)));
    let running =
        tokio::spawn(tower::ServiceExt::oneshot(app, Request::get(path).body(Body::empty()).unwrap()));
    stage.gate.held().await;
    assert_eq!(delete(&stage, &location).await.status, 204);
    stage.gate.open();
    assert_eq!(running.await.unwrap().unwrap().status(), 200);

    assert_eq!(upload(&stage, series_zip(0)).await.header("location"), location);
    for zoom in ["", "&zoom=2"] {
        let again = stage.get(&format!("{}{zoom}", frame(&location))).await;
        assert!(!again.header("server-timing").contains("reused"), "{}", again.header("server-timing"));
    }
    assert_eq!(stage.gate.count(), 4);
}

/// A body without end, whose parts each come in time.
struct Trickle(tokio::time::Interval);

impl axum::body::HttpBody for Trickle {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<hyper::body::Frame<Bytes>, Infallible>>> {
        let part = hyper::body::Frame::data(Bytes::from_static(b"PK"));
        self.0.poll_tick(context).map(|_| Some(Ok(part)))
    }
}

#[tokio::test]
async fn an_upload_that_trickles_gives_its_place_away() {
    let limits = UploadLimits { slowest_bytes_per_s: 1 << 20, ..UploadLimits::default() };
    let patience = Duration::from_millis(100);
    let config = Config { uploads: Some(limits), body_timeout: patience, ..Config::default() };
    let stage = Stage::with(config, QueueConfig::default());
    let trickle = stage.post(
        "/v1/volumes",
        "application/zip",
        Body::new(Trickle(tokio::time::interval(Duration::from_millis(20)))),
    );
    let answer = tokio::time::timeout(Duration::from_secs(60), trickle).await.expect("it is given up");
    assert_eq!(answer.problem(408)["type"], "urn:relief:problem:slow-body");
    assert_eq!(upload(&stage, series_zip(0)).await.status, 201, "the place is free again");
}

#[tokio::test]
async fn the_upload_of_a_vanished_client_is_cancelled_and_keeps_its_place_until_then() {
    let (go, gate) = mpsc::sync_channel::<()>(1);
    let (gate, calls) = (Mutex::new(gate), Arc::new(AtomicUsize::new(0)));
    let begun = Arc::clone(&calls);
    let loader: VolumeLoader = Arc::new(move |_, budget| {
        if begun.fetch_add(1, Ordering::SeqCst) == 0 {
            gate.lock().unwrap().recv_timeout(Duration::from_secs(60)).unwrap();
            return Err(budget.check().unwrap_err().into());
        }
        Ok(LoadedVolume {
            volume: cube(),
            warnings: Vec::new(),
            identity: None,
            reference: None,
            labels: None,
        })
    });
    let stage = Stage::loading(Config::default(), QueueConfig::default(), loader);
    let request = Request::post("/v1/volumes").header("content-type", "application/zip");
    let request = request.body(Body::from("PK")).unwrap();
    let vanishing = tokio::spawn(tower::ServiceExt::oneshot(stage.app.clone(), request));
    while calls.load(Ordering::SeqCst) == 0 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    vanishing.abort();
    assert!(vanishing.await.unwrap_err().is_cancelled());
    // The next one waits for its turn.
    let mut next = std::pin::pin!(upload(&stage, b"PK".to_vec()));
    assert!(tokio::time::timeout(Duration::from_millis(300), &mut next).await.is_err());
    assert_eq!(calls.load(Ordering::SeqCst), 1);
    go.send(()).unwrap();
    let again = next.await;
    assert_eq!(again.status, 201, "nothing of the vanished client was added: {}", again.text());
}
