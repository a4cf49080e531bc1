//! A client process and a server process, with a phantom whose geometry is known.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use relief_tracking::{Beacon, SensorPath as HandPath, SensorPose, Simulation, recording_line};
use serde_json::Value;

use crate::common::child::{LastLines, signal};

pub(crate) const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

pub(crate) fn relief(arguments: &[&str]) -> Command {
    let mut command = Command::new(RELIEF);
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A sphere of 80 mm and 500 HU around the origin, in voxels of 4 mm.
pub(crate) fn phantom(folder: &Path) -> String {
    let series = folder.join("sphere").to_str().unwrap().to_owned();
    let made = relief(&["phantom", "--kind", "sphere", "--size", "64", "--out", &series]).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    series
}

/// A server, killed when it is dropped.
pub(crate) struct Serving {
    process: Child,
    pub(crate) address: String,
    _errors: LastLines,
}

impl Serving {
    pub(crate) fn start(series: &str, listen: &str) -> Self {
        let mut process = relief(&["serve", "--series", series, "--listen", listen]).spawn().unwrap();
        let mut line = String::new();
        let errors = LastLines::of("relief serve", process.stderr.take().unwrap());
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address =
            line.trim().strip_prefix("listening on http://").and_then(|rest| rest.strip_suffix('/'));
        let address = address.unwrap_or_else(|| panic!("no address in {line:?}")).to_owned();
        Self { process, address, _errors: errors }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    pub(crate) fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Waits until a still frame was sent and no other frame has followed it for two seconds: all
    /// that the client asked for is shown.
    pub(crate) fn until_still(&self) {
        const QUIET: Duration = Duration::from_secs(2);
        let began = Instant::now();
        let (mut seen, mut since) = ([0.0; 2], Instant::now());
        loop {
            let metrics = String::from_utf8(self.get("/metrics")).unwrap();
            let count = |kind: &str| {
                let name = format!("relief_live_frames_total{{kind=\"{kind}\"}} ");
                metrics.lines().find_map(|line| line.strip_prefix(&name)?.parse::<f64>().ok()).unwrap_or(0.0)
            };
            let sent = [count("still"), count("moving")];
            if sent != seen {
                (seen, since) = (sent, Instant::now());
            }
            if seen[0] > 0.0 && since.elapsed() > QUIET {
                return;
            }
            assert!(began.elapsed() < Duration::from_secs(120), "no still frame: {seen:?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The body of an answer.
    pub(crate) fn get(&self, path: &str) -> Vec<u8> {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.address).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer[..end]));
        answer.split_off(end + 4)
    }

    #[cfg(all(feature = "window", target_os = "linux"))]
    /// Posts JSON; the answer has to be 200.
    pub(crate) fn post(&self, path: &str, body: &str) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
        let head = format!("POST {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n", self.address);
        let length = body.len();
        write!(stream, "{head}Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}")
            .unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", text(&answer));
    }

    /// Waits for the series; gives its id.
    pub(crate) fn ready(&self) -> String {
        let since = Instant::now();
        loop {
            let listed: Value = serde_json::from_slice(&self.get("/v1/volumes")).unwrap();
            if let Some(id) = listed["volumes"][0]["id"].as_str() {
                return id.to_owned();
            }
            assert!(since.elapsed() < Duration::from_secs(60), "the series is not loaded");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.process.kill(); // gone already where a test killed it
        let _ = self.process.wait();
    }
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn client(url: &str, arguments: &[&str]) -> Output {
    relief(&["client", "--server", url, "--headless"]).args(arguments).output().unwrap()
}

fn json_of(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", text(&output.stderr)))
}

pub(crate) fn pixels(png: &[u8]) -> (u32, u32, Vec<u8>) {
    let picture = image::load_from_memory(png).unwrap().into_rgb8();
    (picture.width(), picture.height(), picture.into_raw())
}

/// The views that `relief preview` makes of a frame with the --factor of these arguments.
fn previewed(frame: &[u8], layout: &str, arguments: &[&str]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["frame.png", "views.png"].map(|name| folder.path().join(name));
    std::fs::write(&from, frame).unwrap();
    let factor = arguments.iter().position(|name| *name == "--factor").map(|at| arguments[at + 1]);
    let [from, to] = [&from, &to].map(|path| path.to_str().unwrap());
    let factor = factor.map_or(vec![], |factor| vec!["--factor", factor]);
    let made = relief(&[&["preview", from, "--layout", layout, "--out", to][..], &factor].concat()).output();
    let made = made.unwrap();
    assert!(made.status.success(), "{}", text(&made.stderr));
    std::fs::read(to).unwrap()
}

/// Invariant: The client composes exactly the served PNG, and its window shows it byte for byte;
/// state marks change neither header, depth nor black lines.
#[test]
fn the_still_frame_is_the_servers_png_pixel_by_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    let id = serving.ready();
    let listed: Value = serde_json::from_slice(&serving.get("/v1/volumes")).unwrap();
    let narrowest_aspect = listed["volumes"][0]["framing"]["narrowest_aspect"].as_f64().unwrap();
    let file = folder.path().join("frame.png");
    let out = file.to_str().unwrap();
    for (layout, more) in [
        ("wowvx", &[][..]),
        ("rgbd", &["--size", "400x300"]),
        ("wowvx-full-height", &["--factor", "90"]),
        // Views that the client makes of two layers are those that the server makes.
        ("stereo", &["--layers", "2"]),
        ("lenses-9", &["--layers", "2", "--factor", "90"]),
        ("lines", &["--layers", "2", "--adapter", "software"]),
        // Views that the client makes of one layer are those of relief preview.
        ("stereo", &["--size", "400x300"]),
        ("lines", &["--size", "400x300", "--factor", "90"]),
        ("lines", &["--size", "400x300", "--factor", "90", "--adapter", "software"]),
        ("lenses-9", &["--size", "400x300"]),
    ] {
        let arguments =
            ["--preset", "bone", "--look", "30,10,1.2", "--layout", layout, "--save-frame", out, "--json"];
        let output = client(&serving.url(), &[&arguments[..], more].concat());
        assert!(output.status.success(), "{layout}: {}", text(&output.stderr));
        let size = more.iter().position(|name| *name == "--size").map_or("", |_| "&size_px=400,300");
        let factor = more.iter().position(|name| *name == "--factor").map_or("", |_| "&factor=90");
        // A view stands back in a narrow picture; a request's zoom is of the picture's height.
        let is_narrow = layout == "wowvx-full-height";
        let zoom = 1.2 * if is_narrow { (960.0 / 1080.0 / narrowest_aspect).min(1.0) } else { 1.0 };
        let angles = format!("azimuth_deg=30&elevation_deg=10&zoom={zoom}&frame=tissue");
        let frame = |layout| {
            let query = format!("preset=bone&{angles}&layout={layout}{size}{factor}");
            serving.get(&format!("/v1/volumes/{id}/frame?{query}"))
        };
        let has_one_layer = ["stereo", "lines", "lenses-9"].contains(&layout) && !more.contains(&"--layers");
        let served = if has_one_layer { previewed(&frame("rgbd"), layout, more) } else { frame(layout) };
        let composed = std::fs::read(&file).unwrap();
        assert!(pixels(&composed) == pixels(&served), "{layout}: composed and served frame differ");
    }
    for (arguments, reason) in [
        (["--layout", "wowvx", "--layers", "2"], "are for layouts of views"),
        (["--layout", "stereo", "--panel", "none.json"], "--panel is for layouts lenses-N"),
        (["--layout", "wowvx", "--adapter", "cpu"], "are for layouts of views"),
        (["--layout", "stereo", "--adapter", "no-such-card"], "views cannot be made"),
        (["--layout", "stereo", "--view-span", "61"], "allowed: 0 to 60 eye separations"),
        (["--layout", "stereo", "--view-cone", "91"], "allowed: 0 to 90 degrees"),
        (["--layout", "wiggle", "--view-span", "1"], "layout wiggle is an animation"),
    ] {
        let refused = client(&serving.url(), &arguments);
        let errors = text(&refused.stderr);
        assert!(!refused.status.success() && errors.contains(reason), "{errors}");
    }
    let refused = client(&serving.url(), &["--preset", "bonne", "--save-frame", out]);
    let errors = text(&refused.stderr);
    assert!(
        !refused.status.success() && errors.contains("settings.preset is \"bonne\", allowed: bone"),
        "{errors}"
    );
    let checked = relief(&["inspect", out, "--json"]).output().unwrap();
    assert!(checked.status.success(), "{}", text(&checked.stdout));
}

#[test]
fn measuring_reads_every_header_row_and_finds_the_still_frame() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    serving.ready();
    let output = client(&serving.url(), &["--measure", "6", "--preset", "bone", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report = json_of(&output);
    eprintln!("{report:#}");
    // How many frames there are depends on what else the machine does.
    assert!(report["frames"].as_u64().unwrap() > 0, "{report}");
    assert!(report["checked"].as_u64().unwrap() > 0, "{report}");
    assert_eq!(
        (&report["bad_headers"], &report["malformed"]),
        (&Value::from(0), &Value::from(0)),
        "{report}"
    );
    assert!(report["still_ms"].as_f64().is_some(), "{report}");
    for key in
        ["frames_per_s", "overhead_ms_p50", "overhead_ms_p99", "pose_to_frame_ms_p50", "bytes_per_frame"]
    {
        assert!(report[key].as_f64().is_some(), "{key} of {report}");
    }
}

/// A client that runs until it is stopped, and its output.
struct Process {
    process: Child,
    reported: std::io::Lines<BufReader<std::process::ChildStderr>>,
}

impl Process {
    fn start(url: &str, arguments: &[&str]) -> Self {
        let mut process = relief(&["client", "--server", url, "--headless"]).args(arguments).spawn().unwrap();
        let reported = BufReader::new(process.stderr.take().unwrap()).lines();
        Self { process, reported }
    }

    fn until_told(&mut self, word: &str) {
        let found = self.reported.by_ref().map_while(Result::ok).any(|line| line.contains(word));
        assert!(found, "{word:?} is not printed");
    }

    fn stop(mut self) {
        assert!(signal("INT", self.process.id()));
        assert!(self.process.wait().unwrap().success());
    }
}

fn lines_of(record: &Path) -> Vec<Value> {
    let lines = std::fs::read_to_string(record).unwrap();
    assert!(!lines.contains("\"session\""), "the token is nobody's business");
    lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Invariant: Whatever a server sends, the client reports an error or goes on, in bounded memory; a
/// lost session resumes by its token or its view.
#[test]
fn a_server_that_is_killed_and_started_again_gets_its_client_back_with_the_same_view() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let mut serving = Serving::start(&series, "127.0.0.1:0");
    serving.ready();
    let record = folder.path().join("session.jsonl");
    let arguments = ["--preset", "bone", "--look", "40,20,1.3", "--record", record.to_str().unwrap()];
    let mut client = Process::start(&serving.url(), &arguments);
    client.until_told("connected");
    serving.until_still();
    serving.kill();
    client.until_told("trying again");
    let again = Serving::start(&series, &serving.address);
    client.until_told("connected");
    again.ready();
    again.until_still();
    client.stop();
    let lines = lines_of(&record);
    let loss = lines.iter().position(|line| line["state"] == "lost").unwrap();
    let state = |lines: &[Value]| {
        lines
            .iter()
            .rev()
            .find_map(|line| line["received"]["state"].is_object().then(|| line["received"]["state"].clone()))
    };
    let (before, after) = (state(&lines[..loss]).unwrap(), state(&lines).unwrap());
    assert_eq!(before["preset"], after["preset"]);
    for (key, tolerance) in [("orientation_xyzw", 1e-9), ("look_at_mm", 1e-9)] {
        let numbers = |state: &Value| -> Vec<f64> {
            state[key].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
        };
        for (a, b) in numbers(&before).iter().zip(numbers(&after)) {
            assert!((a - b).abs() < tolerance, "{key}: {before} {after}");
        }
    }
    let zoom = |state: &Value| state["zoom"].as_f64().unwrap();
    assert!((zoom(&before) - zoom(&after)).abs() < 1e-9, "{before} {after}");
    let is_still = |line: &Value| line["frame"]["still"] == true;
    assert!(lines[..loss].iter().any(is_still) && lines[loss..].iter().any(is_still));
}

#[test]
fn a_recorded_session_plays_again_and_ends_in_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    serving.ready();
    let record = folder.path().join("session.jsonl");
    let name = record.to_str().unwrap();
    let mut client =
        Process::start(&serving.url(), &["--preset", "bone", "--look", "70,-20,1.5", "--record", name]);
    client.until_told("connected");
    serving.until_still();
    client.stop();
    let output = self::client(&serving.url(), &["--replay", name, "--json"]);
    let outcome = json_of(&output);
    assert!(output.status.success(), "{outcome} {}", text(&output.stderr));
    assert_eq!(outcome["same"], true, "{outcome}");
    assert_eq!((&outcome["messages"], &outcome["dropped"]), (&Value::from(1), &Value::from(0)), "{outcome}");
    // Another preset ends in another picture, which the output reports.
    let altered =
        std::fs::read_to_string(&record).unwrap().replace("\"preset\":\"bone\"", "\"preset\":\"skin\"");
    std::fs::write(&record, altered).unwrap();
    let output = self::client(&serving.url(), &["--replay", name, "--json"]);
    assert_eq!((output.status.code(), &json_of(&output)["same"]), (Some(1), &Value::Bool(false)));
}

#[test]
fn a_session_recorded_as_a_film_has_frames_with_intact_headers() {
    let Some(ffmpeg) = crate::common::ffmpeg::ffmpeg() else {
        eprintln!("SKIPPED: sessions as films (there is no ffmpeg)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    serving.ready();
    let film = folder.path().join("session.mkv");
    let name = film.to_str().unwrap();
    let arguments = ["--preset", "bone", "--look", "70,-20,1.5", "--factor", "90", "--record", name];
    let mut client = Process::start(&serving.url(), &[&arguments[..], &["--ffmpeg", &ffmpeg]].concat());
    client.until_told("connected");
    serving.until_still();
    client.stop();
    let last = folder.path().join("last.png");
    let decode = ["-loglevel", "error", "-i", name, "-update", "1", last.to_str().unwrap()];
    assert!(Command::new(&ffmpeg).args(decode).status().unwrap().success());
    let report = json_of(&relief(&["inspect", last.to_str().unwrap(), "--json"]).output().unwrap());
    assert_eq!(report["problems"].as_array().map(Vec::len), Some(0), "{report}");
    assert_eq!(report["factor"], 90);
    let missing = ["--record", name, "--ffmpeg", "no-such-ffmpeg"];
    let refused = self::client(&serving.url(), &missing);
    assert!(text(&refused.stderr).contains("apt-get install ffmpeg"), "{}", text(&refused.stderr));
}

/// A hand that points, then comes 120 mm closer and 20 mm up, and rests there.
struct Approach {
    from: SensorPose,
}

impl HandPath for Approach {
    fn at(&self, seconds: f64) -> SensorPose {
        let done = ((seconds - 1.0) / 1.5).clamp(0.0, 1.0);
        let eased = done * done * (3.0 - 2.0 * done);
        // The beacon looks along its z axis at the hand, and so does the display: towards the
        // viewer is away from both.
        let way = Vector3::new(10.0, 20.0, 120.0) * eased;
        SensorPose { position: self.from.position + way, orientation: self.from.orientation }
    }
}

fn recording(folder: &Path) -> PathBuf {
    let beacon = Beacon::recommended();
    let target = beacon.centroid();
    let from = SensorPose::looking_at(target + Vector3::z() * 1200.0, target, &Vector3::y(), 0.0).unwrap();
    let mut simulation = Simulation::new(beacon, 7);
    simulation.sensing.noise_px = 0.1;
    let made = simulation.record(&Approach { from }, 4.0);
    let lines: String =
        made.iter().map(|made| recording_line(made.t_ns, &made.report.encode()) + "\n").collect();
    let file = folder.join("hand.jsonl");
    std::fs::write(&file, lines).unwrap();
    file
}

/// Invariant: From the reports of a Wiimote to the frame, the depth of the cursor is correct within
/// 1 mm.
///
/// Reports of a Wiimote become poses in the client (or in the server), a cursor in the view, and a
/// ball in the frame: its depth there is that of a ball around the cursor, seen by the frame's
/// camera, within 1 mm; and the cursor has moved as the hand.
#[test]
fn a_wiimotes_cursor_lies_in_the_frames_depth_where_geometry_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    serving.ready();
    let reports = recording(folder.path());
    for relay in [&[][..], &["--relay-reports"]] {
        let record = folder.path().join("session.jsonl");
        let name = format!("hand-{}", relay.len());
        let arguments = ["--preset", "bone", "--view", &name, "--wiimote", reports.to_str().unwrap()];
        let arguments = [&arguments[..], &["--record", record.to_str().unwrap()], relay].concat();
        let mut client = Process::start(&serving.url(), &arguments);
        client.until_told("connected");
        serving.until_still(); // the hand rests for a second before it moves
        client.stop();
        let lines = lines_of(&record);
        let cursor = lines.iter().rev().find_map(|line| line["received"]["state"]["cursor_mm"].as_array());
        let cursor = cursor.unwrap_or_else(|| panic!("no cursor: {lines:?}"));
        let cursor: Vec<f64> = cursor.iter().map(|c| c.as_f64().unwrap()).collect();
        crate::client::command::check_cursor(&serving, &name, &cursor);
    }
}
