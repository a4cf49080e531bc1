//! View set `time`: a turntable through the phases of a series.

use dicom_core::VR;
use dicom_dictionary_std::tags;

use super::*;

#[path = "../dicom/made.rs"]
mod made;

const PHASES: usize = 3;
const SLICES: usize = 8;

/// A series of three phases, whose values rise from phase to phase.
fn moving() -> Archive {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let folder = archive.path("series/DOE^JOHN");
    std::fs::create_dir_all(&folder).unwrap();
    for phase in 0..PHASES {
        for slice in 0..SLICES {
            let [time, intercept] = [phase + 1, 300 * phase].map(|number| number.to_string());
            let texts = [
                (tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, time.as_str()),
                (tags::RESCALE_INTERCEPT, VR::DS, intercept.as_str()),
            ];
            let bytes = made::slice_with(20.0 * slice as f64, 100 * phase + slice, &texts);
            std::fs::write(folder.join(format!("{phase}-{slice}.dcm")), bytes).unwrap();
        }
    }
    archive
}

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Invariant: A film through the phases of a series has one framing: turn for turn the cameras are
/// those of the first phase.
#[test]
fn phases_become_one_film_with_the_cameras_of_the_first() {
    let archive = moving();
    let products = ["--products", "color,camera"];
    let planned = ok(&archive.plan(&[&["--views", "time:6,turntable:6"], &products[..]].concat()));
    assert_eq!(planned["series"], PHASES, "{planned}");
    let jobs = archive.jobs();
    let of_time: Vec<&Value> = jobs.iter().filter(|job| job["group"] == "time").collect();
    assert_eq!(of_time.len(), 6);
    let first = &of_time[0]["series"]["first_phase"]["sha256"];
    for job in &of_time {
        let turn: usize = job["view"].as_str().unwrap().strip_prefix("time-").unwrap().parse().unwrap();
        assert_eq!(job["orbit"]["azimuth_deg"], 60.0 * turn as f64);
        assert_eq!(
            job["series"]["uid"].as_str().unwrap().rsplit('#').next(),
            Some(&*(turn % PHASES + 1).to_string())
        );
        assert_eq!(&job["series"]["first_phase"]["sha256"], first);
    }
    let ran = ok(&archive.run(&["--turntable", "apng"]));
    assert_eq!((&ran["done"], &ran["failed"]), (&24.into(), &serde_json::json!([])), "{ran}");
    let folder = archive.path("out").join(of_time[0]["series"]["name"].as_str().unwrap());
    for turn in 0..6 {
        let camera = |set: &str| json_of(&folder.join(format!("{set}-{turn:03}.camera.json")));
        let (time, turntable) = (camera("time"), camera("turntable"));
        for key in ["K", "camera_from_patient"] {
            assert_eq!(time[key], turntable[key], "turn {turn}");
        }
    }
    let film = std::fs::read(folder.join("time.png")).unwrap();
    let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(film)).unwrap();
    let frames = image::AnimationDecoder::into_frames(decoder.apng().unwrap()).collect_frames().unwrap();
    assert_eq!(frames.len(), 6);
    // The first picture is that of the first phase from the front, the second one is another phase.
    let still = |name: &str| image::open(folder.join(name)).unwrap().into_rgb8();
    assert_eq!(still("time-000.color.png"), still("turntable-000.color.png"));
    assert_ne!(still("time-001.color.png"), still("turntable-001.color.png"));
}

#[test]
fn a_series_without_phases_has_no_film_through_them() {
    let archive = Archive::of_phantoms(1);
    let refused = archive.plan(&["--views", "time:4"]);
    assert_eq!(refused.status.code(), Some(1));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(message.contains("no phases"), "{message}");
    assert_eq!(archive.plan(&["--views", "time:0"]).status.code(), Some(1));
}
