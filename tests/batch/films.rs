//! Turntables as films: MP4 where ffmpeg is, and clear words where it is not.

use super::*;
use crate::common::ffmpeg::ffmpeg;

#[test]
fn an_mp4_has_every_turn_and_opencv_plays_it() {
    let (Some(ffmpeg), Some(python)) = (ffmpeg(), std::env::var_os("RELIEF_PEERS_PYTHON")) else {
        eprintln!("SKIPPED: turntables as MP4 (there is no ffmpeg, or RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    // A head, which looks like itself from no other side.
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
    ok(&relief(&["phantom", "--kind", "head", "--size", "48", "--out", &archive.text("series/head")]));
    let plan =
        ["batch", "plan", "--root", &root, "--out", &out, "--views", "turntable:6", "--preset", "bone"];
    ok(&relief(&[&plan[..], &["--size", "65x49", "--products", "color"]].concat())); // odd sides
    ok(&archive.run(&["--turntable", "mp4", "--ffmpeg", &ffmpeg]));
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let script = "
import cv2, sys, numpy, json
film, nearest, own, others = cv2.VideoCapture(sys.argv[1]), [], [], []
stills = [cv2.imread(f'{sys.argv[2]}/turntable-{turn:03}.color.png').astype(int) for turn in range(6)]
while True:
    there, picture = film.read()
    if not there: break
    size = picture.shape[1::-1]
    apart = [float(numpy.abs(picture[:49, :65] - still).mean()) for still in stills]
    nearest.append(int(numpy.argmin(apart)))
    own.append(apart[nearest[-1]])
    others.append(sorted(apart)[1])
print(json.dumps({'nearest': nearest, 'size': size, 'fps': film.get(cv2.CAP_PROP_FPS), 'worst': max(own), 'others': min(others)}))";
    let film = folder.join("turntable.mp4");
    let played = ok(&Command::new(python).args(["-c", script]).arg(&film).arg(&folder).output().unwrap());
    let (turns, size) = (serde_json::json!([0, 1, 2, 3, 4, 5]), serde_json::json!([66, 50]));
    assert_eq!((&played["nearest"], &played["size"]), (&turns, &size), "{played}");
    assert!((played["fps"].as_f64().unwrap() - 25.0 / 3.0).abs() < 0.01, "{played}");
    let [worst, others] = ["worst", "others"].map(|key| played[key].as_f64().unwrap());
    assert!(worst < 8.0 && 2.0 * worst < others, "each is its own still and no other: {played}");
    assert!(folder.join("turntable.png").exists());
}

#[test]
fn the_frames_of_a_turntable_are_a_film_without_loss() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: frames of turntables as films (there is no ffmpeg)");
        return;
    };
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
    ok(&relief(&["phantom", "--kind", "head", "--size", "32", "--out", &archive.text("series/head")]));
    let plan =
        ["batch", "plan", "--root", &root, "--out", &out, "--views", "turntable:3", "--preset", "bone"];
    ok(&relief(&[&plan[..], &["--products", "frame"]].concat()));
    ok(&archive.run(&["--ffmpeg", &ffmpeg]));
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let decoded = archive.text("turn-%03d.png");
    let mut decode = Command::new(&ffmpeg);
    decode.args(["-loglevel", "error", "-i"]).arg(folder.join("turntable.frame.mkv")).arg(&decoded);
    assert!(decode.status().unwrap().success());
    for turn in 0..3 {
        let pixels = |path: &Path| image::open(path).unwrap().into_rgb8();
        let frame = pixels(&folder.join(format!("turntable-{turn:03}.frame.png")));
        assert!(frame == pixels(&archive.path(&format!("turn-{:03}.png", turn + 1))), "turn {turn} differs");
    }
}

#[test]
fn without_ffmpeg_there_is_the_animated_png_and_a_word() {
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "turntable:2"]));
    let refused = archive.run(&["--turntable", "mp4", "--ffmpeg", "no-such-ffmpeg"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("apt-get install ffmpeg"));
    assert!(!archive.path("out").exists(), "nothing is rendered before");
    let reported = archive.run(&["--ffmpeg", "no-such-ffmpeg"]);
    assert!(String::from_utf8_lossy(&reported.stderr).contains("turntables are animated PNG alone"));
    ok(&reported);
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    assert!(folder.join("turntable.png").exists() && !folder.join("turntable.mp4").exists());
    assert!(archive.run(&["--turntable", "gif"]).status.code() == Some(2));
}
