//! Films: in from any codec, out without loss, with intact headers, and without flicker.

use super::*;

/// Frames of a short film.
const FEW: usize = 3;

/// A still film with the noise of a lossy codec in it.
fn plain_film(ffmpeg: &str, folder: &Path, frames: usize) -> PathBuf {
    for number in 0..frames {
        saved(folder, &format!("{number:02}.png"), &picture([320, 180], 90));
    }
    let film = folder.join("plain.mp4");
    let pictures = folder.join("%02d.png");
    let arguments =
        ["-loglevel", "error", "-framerate", "12", "-i", text(&pictures), "-c:v", "mpeg4", "-q:v", "6"];
    assert!(Command::new(ffmpeg).args(arguments).arg(&film).status().unwrap().success());
    film
}

#[test]
fn frames_of_a_film_decode_with_their_headers() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: films of frames (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = plain_film(&ffmpeg, folder.path(), FEW);
    for (codec, name) in [("h264", "out.mkv"), ("h264", "out.mp4"), ("ffv1", "archive.mkv")] {
        let out = folder.path().join(name);
        let options = ["--codec", codec, "--ffmpeg", &ffmpeg, "--json"];
        let convert = ["convert", text(&film), "--estimate-depth", "--out", text(&out)];
        let report: serde_json::Value =
            serde_json::from_str(&ok(&relief(&[&convert[..], &options].concat()))).unwrap();
        assert_eq!((&report["frames"], &report["checked"]), (&FEW.into(), &true.into()), "{report}");
        let inspected_film = ok(&relief(&["inspect", text(&out), "--ffmpeg", &ffmpeg, "--json"]));
        let film: serde_json::Value = serde_json::from_str(&inspected_film).unwrap();
        assert_eq!((&film["frames"], &film["layout"]), (&FEW.into(), &"wowvx".into()), "{film}");
        assert_eq!((&film["bad"], &film["different"]), (&0.into(), &0.into()), "{film}");
        let decoded = folder.path().join(format!("{codec}-{name}.%02d.png"));
        let decode = ["-loglevel", "error", "-i", text(&out), text(&decoded)];
        assert!(Command::new(&ffmpeg).args(decode).status().unwrap().success());
        for number in 1..=FEW {
            let report = inspected(&folder.path().join(format!("{codec}-{name}.{number:02}.png")));
            assert_eq!(report["problems"].as_array().map(Vec::len), Some(0), "{codec} {number}: {report}");
            assert_eq!(report["content"], "movie");
        }
    }
}

/// Invariant: A playlist with the name of a film is refused: only the named file is read.
#[test]
fn a_playlist_by_the_name_of_a_film_is_refused() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: playlists by the name of a film (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = plain_film(&ffmpeg, folder.path(), FEW);
    let segment = folder.path().join("segment.ts");
    let copy = ["-loglevel", "error", "-i", text(&film), "-c:v", "mpeg2video", text(&segment)];
    assert!(Command::new(&ffmpeg).args(copy).status().unwrap().success());
    let path = |of: &Path| text(of).to_owned();
    for (name, playlist) in [
        (
            "hls.mp4",
            format!("#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n", path(&segment)),
        ),
        ("concat.mp4", format!("ffconcat version 1.0\nfile {}\n", path(&film))),
    ] {
        let link = saved_text(folder.path(), name, &playlist);
        let out = folder.path().join("out.mkv");
        let convert = ["convert", text(&link), "--estimate-depth", "--ffmpeg", &ffmpeg, "--out", text(&out)];
        let refused = relief(&convert);
        assert!(
            !refused.status.success() && !out.exists(),
            "{name}: {}",
            String::from_utf8_lossy(&refused.stdout)
        );
    }
    // The files in the playlists are films.
    let out = folder.path().join("whole.mkv");
    ok(&relief(&["convert", text(&segment), "--estimate-depth", "--ffmpeg", &ffmpeg, "--out", text(&out)]));
}

fn saved_text(folder: &Path, name: &str, content: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

#[test]
fn a_film_whose_codec_destroyed_the_headers_is_reported_frame_by_frame() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: films with destroyed headers (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (film, out) = (plain_film(&ffmpeg, folder.path(), FEW), folder.path().join("out.mkv"));
    let convert = ["convert", text(&film), "--estimate-depth", "--ffmpeg", &ffmpeg, "--out", text(&out)];
    ok(&relief(&convert));
    let lossy = folder.path().join("lossy.mp4");
    let encode =
        ["-loglevel", "error", "-i", text(&out), "-c:v", "mpeg4", "-q:v", "8", "-pix_fmt", "yuv420p"];
    assert!(Command::new(&ffmpeg).args(encode).arg(&lossy).status().unwrap().success());
    let inspected = relief(&["inspect", text(&lossy), "--ffmpeg", &ffmpeg]);
    let report = String::from_utf8(inspected.stdout.clone()).unwrap();
    assert_eq!(inspected.status.code(), Some(1), "{report}");
    assert!(report.contains("problems  3 frames") && report.contains("frame 3: "), "{report}");
    let cut = folder.path().join("cut.mkv");
    std::fs::write(&cut, &std::fs::read(&out).unwrap()[..100]).unwrap();
    let refused = relief(&["inspect", text(&cut), "--ffmpeg", &ffmpeg]);
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("cannot inspect"));
}

#[test]
fn a_folder_and_a_film_go_into_each_other() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: folders as films (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = plain_film(&ffmpeg, folder.path(), FEW);
    let frames = folder.path().join("frames");
    let convert = ["convert", text(&film), "--estimate-depth", "--layout", "rgbd", "--ffmpeg", &ffmpeg];
    ok(&relief(&[&convert[..], &["--out", text(&frames)]].concat()));
    assert_eq!(std::fs::read_dir(&frames).unwrap().count(), FEW);
    let back = folder.path().join("back.mkv");
    let convert = ["convert", text(&frames), "--estimate-depth", "--layout", "rgbd", "--ffmpeg", &ffmpeg];
    ok(&relief(&[&convert[..], &["--fps", "12", "--out", text(&back)]].concat()));
    assert!(back.metadata().unwrap().len() > 0);
    let left = std::fs::read_dir(folder.path()).unwrap().filter_map(Result::ok);
    assert!(
        left.into_iter().all(|entry| !entry.file_name().to_string_lossy().starts_with('.')),
        "temporary files stay"
    );
    let wrong = folder.path().join("archive.mp4");
    let codec = ["--codec", "ffv1", "--out", text(&wrong)];
    assert!(refusal(&[&convert[..], &codec].concat()).contains("cannot hold FFV1"));
}

#[test]
fn a_still_film_flickers_less_than_its_pictures_one_by_one() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: flicker of films (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = plain_film(&ffmpeg, folder.path(), 8);
    let noisy = folder.path().join("noisy");
    std::fs::create_dir(&noisy).unwrap();
    let noise = ["-loglevel", "error", "-i", text(&film), "-vf", "noise=alls=12:allf=t"];
    let noisy_film = folder.path().join("noisy.mkv");
    assert!(
        Command::new(&ffmpeg).args(noise).args(["-c:v", "ffv1"]).arg(&noisy_film).status().unwrap().success()
    );
    let decode = ["-loglevel", "error", "-i", text(&noisy_film)];
    assert!(Command::new(&ffmpeg).args(decode).arg(noisy.join("%02d.png")).status().unwrap().success());
    let flicker = |source: &Path, name: &str| {
        let out = folder.path().join(name);
        let convert =
            ["convert", text(source), "--estimate-depth", "--layout", "depth16", "--ffmpeg", &ffmpeg];
        ok(&relief(&[&convert[..], &["--out", text(&out)]].concat()));
        let mut paths: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        let depths: Vec<_> = paths.iter().map(|path| image::open(path).unwrap().into_luma16()).collect();
        let difference = |pair: &[image::ImageBuffer<image::Luma<u16>, Vec<u16>>]| -> f64 {
            pair[0].pixels().zip(pair[1].pixels()).map(|(a, b)| f64::from(a.0[0].abs_diff(b.0[0]))).sum()
        };
        depths.windows(2).skip(2).map(difference).sum::<f64>()
    };
    let (steady, single) = (flicker(&noisy_film, "steady"), flicker(&noisy, "single"));
    assert!(steady < 0.5 * single, "{steady} of {single}");
}

#[test]
fn a_film_is_turned_as_its_container_says() {
    let Some(ffmpeg) = ffmpeg() else {
        eprintln!("SKIPPED: films that are turned (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = plain_film(&ffmpeg, folder.path(), 1);
    let (turned, out) = (folder.path().join("turned.mp4"), folder.path().join("frames"));
    let copy = ["-loglevel", "error", "-display_rotation", "90", "-i", text(&film), "-c", "copy"];
    assert!(Command::new(&ffmpeg).args(copy).arg(&turned).status().unwrap().success());
    let convert = ["convert", text(&turned), "--estimate-depth", "--layout", "rgbd", "--ffmpeg", &ffmpeg];
    ok(&relief(&[&convert[..], &["--out", text(&out)]].concat()));
    let frame = std::fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    assert_eq!(image::open(frame).unwrap().into_rgb8().dimensions(), (2 * 180, 320));
}

#[test]
fn without_ffmpeg_the_error_says_how_to_install_it() {
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.mp4");
    std::fs::write(&film, b"no film").unwrap();
    let out = folder.path().join("out.mkv");
    let said = refusal(&[
        "convert",
        text(&film),
        "--estimate-depth",
        "--ffmpeg",
        "no-such-ffmpeg",
        "--out",
        text(&out),
    ]);
    assert!(said.contains("apt-get install ffmpeg"), "{said}");
}
