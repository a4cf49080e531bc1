//! `relief serve` as users run it: a process that prints its address, loads, answers, and stops on
//! a signal.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![cfg(unix)]

mod faults;
mod hostile;
mod identity;
mod packages;
mod privacy;
#[cfg(feature = "traces")]
mod traces;

use crate::common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

fn relief(arguments: &[&str]) -> Command {
    let mut command = Command::new(RELIEF);
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A running server, killed if a test fails before it stops it.
struct Running {
    process: Child,
    address: String,
}

impl Running {
    fn start(series: &str) -> Self {
        Self::spawn(&mut relief(&["serve", "--series", series, "--listen", "127.0.0.1:0"]))
    }

    fn spawn(command: &mut Command) -> Self {
        let mut process = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().split_once("://").and_then(|(_, rest)| rest.strip_suffix('/'));
        let address = address.unwrap_or_else(|| panic!("no address in {line:?}")).to_owned();
        Self { process, address }
    }

    /// Status line with headers, and the body.
    fn get(&self, path: &str) -> (String, Vec<u8>) {
        self.ask(&format!("GET {path}"), "", &[])
    }

    fn upload(&self, zip: &[u8]) -> (String, Vec<u8>) {
        let headers = format!("Content-Type: application/zip\r\nContent-Length: {}\r\n", zip.len());
        self.ask("POST /v1/volumes", &headers, zip)
    }

    fn ask(&self, line: &str, headers: &str, body: &[u8]) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let host = &self.address;
        write!(stream, "{line} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n").unwrap();
        stream.write_all(body).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("an end of the head");
        let body = answer.split_off(end + 4);
        (String::from_utf8(answer).unwrap(), body)
    }

    fn await_ready(&self) {
        let since = Instant::now();
        while !self.get("/readyz").0.starts_with("HTTP/1.1 200") {
            assert!(since.elapsed() < Duration::from_secs(60), "the series is not loaded");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Sends a signal, and returns the exit status and the standard error.
    fn stop(mut self, signal: &str) -> (Option<i32>, String) {
        assert!(common::child::signal(signal, self.process.id()));
        let mut errors = String::new();
        self.process.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
        (self.process.wait().unwrap().code(), errors)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.process.kill(); // gone already when the test went well
        // A test that reads stderr itself has taken it.
        if std::thread::panicking()
            && let Some(stderr) = self.process.stderr.take()
        {
            drop(common::child::LastLines::of("relief serve", stderr));
        }
    }
}

fn phantom(folder: &Path) -> String {
    let series = folder.join("sphere").to_str().unwrap().to_owned();
    let made = relief(&["phantom", "--kind", "sphere", "--size", "32", "--out", &series]).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    series
}

/// Invariant: The frame over HTTP equals the file of `relief render`, byte for byte.
#[test]
fn serves_the_very_frame_that_render_writes_and_stops_when_told() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let running = Running::start(&series);
    assert!(running.get("/healthz").0.starts_with("HTTP/1.1 200"));
    running.await_ready();
    let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap();
    let (head, frame) = running.get(&format!("/v1/volumes/{id}/frame?preset=bone&azimuth_deg=30"));
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");

    let file = folder.path().join("frame.png");
    let out = file.to_str().unwrap();
    let arguments = ["render", "--series", &series, "--preset", "bone", "--azimuth-deg", "30", "--out", out];
    let rendered = relief(&arguments).output().unwrap();
    assert!(rendered.status.success(), "{}", String::from_utf8_lossy(&rendered.stderr));
    assert!(std::fs::read(&file).unwrap() == frame, "HTTP and the command line give different frames");

    let (status, errors) = running.stop("TERM");
    assert_eq!(status, Some(0), "{errors}");
    assert!(!errors.contains("PHANTOM"), "who was scanned is nobody's business: {errors}");
}

/// Invariant: The log of a request at level `trace` tells its way through queue, frame and
/// encoding, under one id.
#[test]
fn a_traced_request_reads_as_its_story() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let mut command = relief(&["serve", "--series", &series, "--listen", "127.0.0.1:0"]);
    let running = Running::spawn(command.env("RELIEF_LOG", "trace"));
    running.await_ready();
    let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap();
    let path = format!("GET /v1/volumes/{id}/frame?size_px=64,36&layout=color");
    let (head, _) = running.ask(&path, "X-Request-Id: story\r\n", &[]);
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    let (_, log) = running.stop("TERM");
    let story: Vec<&str> = log.lines().filter(|line| line.contains("id=story")).collect();
    let chapters = ["left the queue", "rendered a band", "rendered upload_ms", "finished", "answered"];
    let places = chapters.map(|chapter| story.iter().position(|line| line.contains(chapter)));
    assert!(
        places.iter().all(Option::is_some) && places.is_sorted(),
        "{chapters:?} are at {places:?} of\n{log}"
    );
    assert!(story[places[2].unwrap()].contains("frame{mode=\"composite\" width=64 height=36}"), "{story:?}");
    assert!(!log.contains("wgpu_core"), "libraries are as quiet as ever");
}

/// A zip of files whose names tell who was scanned.
fn named_zip(files: &[Vec<u8>]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (i, bytes) in files.iter().enumerate() {
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("DOE_JANE_19700101/slice{i}.dcm"), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn names_in_an_uploaded_zip_are_not_logged() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let slices =
        std::fs::read_dir(&series).unwrap().map(|slice| std::fs::read(slice.unwrap().path()).unwrap());
    let mut files: Vec<Vec<u8>> = slices.collect();
    let cut = files[0][..files[0].len() / 2].to_vec();
    files.push(cut.clone());
    let running =
        Running::spawn(relief(&["serve", "--listen", "127.0.0.1:0"]).env("RELIEF_LOG", "relief=trace"));
    let (head, described) = running.upload(&named_zip(&files));
    assert!(head.starts_with("HTTP/1.1 201"), "{head}{}", String::from_utf8_lossy(&described));
    let (head, refusal) = running.upload(&named_zip(&[cut]));
    assert!(head.starts_with("HTTP/1.1 422"), "{head}{}", String::from_utf8_lossy(&refusal));
    let (status, errors) = running.stop("TERM");
    assert_eq!(status, Some(0), "{errors}");
    assert!(errors.contains("/v1/volumes"), "requests are logged at this level: {errors}");
    assert!(!errors.contains("DOE"), "{errors}");
}

#[test]
fn stops_at_an_interrupt_while_it_loads() {
    let folder = tempfile::tempdir().unwrap();
    let running = Running::start(&phantom(folder.path()));
    assert_eq!(running.stop("INT").0, Some(0));
}

#[test]
fn a_series_that_cannot_be_served_ends_it_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let missing = relief(&["serve", "--series", "/nowhere", "--listen", "127.0.0.1:0"]).output().unwrap();
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("/nowhere"));

    let empty = folder.path().to_str().unwrap();
    let empty = relief(&["serve", "--series", empty, "--listen", "127.0.0.1:0"]).output().unwrap();
    assert_eq!(empty.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&empty.stderr).contains("no CT slices"));
}

/// The number of a line of the metrics.
fn metric(running: &Running, name: &str) -> u64 {
    let (_, text) = running.get("/metrics");
    let text = String::from_utf8(text).unwrap();
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    value.unwrap_or_else(|| panic!("no {name} in {text}")).parse().unwrap()
}

/// Invariant: Bands change no byte of a picture, and cancelling ends a picture after its current
/// band.
#[test]
fn an_abandoned_long_render_is_cancelled() {
    const SIDE: u64 = 2048;
    let folder = tempfile::tempdir().unwrap();
    let running = Running::start(&phantom(folder.path()));
    running.await_ready();
    let (_, listed) = running.get("/v1/volumes");
    let listed: serde_json::Value = serde_json::from_slice(&listed).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap();
    // Some 10^10 samples, none of which may be left out: minutes.
    let long = format!(
        "/v1/volumes/{id}/frame?mode=mean&layout=color&size_px={SIDE},{SIDE}&sample_distance_mm=0.05"
    );
    let mut leaving = TcpStream::connect(&running.address).unwrap();
    write!(leaving, "GET {long} HTTP/1.1\r\nHost: {}\r\n\r\n", running.address).unwrap();
    while metric(&running, "relief_render_bands_total") < 1 {
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(leaving);
    let (head, _) = running.get(&format!("/v1/volumes/{id}/frame?layout=color&size_px=64,64"));
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    assert_eq!(metric(&running, "relief_render_abandoned_total{when=\"rendering\"}"), 1);
    // All of it would have been a band for each row of tiles; the uppermost miss the volume, and
    // take no time.
    let bands = metric(&running, "relief_render_bands_total");
    assert!(bands < SIDE / 8 / 2, "{bands} bands");
    let (status, _) = running.stop("TERM");
    assert_eq!(status, Some(0));
}

/// Invariant: Volumes stay within the memory limits of host and adapter: the least recently used is
/// evicted, and a volume that cannot fit is refused by its dimensions.
#[test]
fn of_three_series_under_a_budget_for_two_one_is_evicted() {
    if common::software_adapter("graphics memory of a server").is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut arguments: Vec<String> =
        ["serve", "--listen", "127.0.0.1:0", "--gpu-memory", "900kB", "--memory", "140kB"]
            .map(str::to_owned)
            .into();
    for kind in ["sphere", "slab", "ramp"] {
        let series = folder.path().join(kind).to_str().unwrap().to_owned();
        let made = relief(&["phantom", "--kind", kind, "--size", "32", "--out", &series]).output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        arguments.extend(["--series".to_owned(), series]);
    }
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let running = Running::spawn(relief(&arguments).env("RELIEF_ADAPTER", "software"));
    running.await_ready();
    let (_, listed) = running.get("/v1/volumes");
    let listed: serde_json::Value = serde_json::from_slice(&listed).unwrap();
    let ids: Vec<&str> =
        listed["volumes"].as_array().unwrap().iter().map(|v| v["id"].as_str().unwrap()).collect();
    let show = |id: &str, azimuth: u32| {
        let path = format!("/v1/volumes/{id}/frame?layout=color&size_px=32,24&azimuth_deg={azimuth}");
        assert!(running.get(&path).0.starts_with("HTTP/1.1 200"), "{path}");
        assert!(metric(&running, "relief_gpu_memory_bytes") <= 900_000);
        ["relief_gpu_volumes", "relief_gpu_uploads_total", "relief_gpu_evictions_total"]
            .map(|name| metric(&running, name))
    };
    // 32^3 voxels of ten bytes, and an appearance of 98304 bytes, a brick a voxel: 425984 bytes
    // each.
    assert_eq!(show(ids[0], 0), [1, 1, 0]);
    assert_eq!(show(ids[1], 0), [2, 2, 0]);
    assert_eq!(show(ids[2], 0), [2, 3, 1]);
    assert_eq!(show(ids[1], 10), [2, 3, 1], "the second is still there");
    assert_eq!(show(ids[0], 10), [2, 4, 2], "the first had gone, and now the third goes");
    assert_eq!(metric(&running, "relief_gpu_memory_limit_bytes"), 900_000);
    // Of the machine's own memory two volumes may have 65536 bytes each: all but the fourth picture
    // had its series read.
    assert_eq!(metric(&running, "relief_series_reads_total"), 4);
    assert!(metric(&running, "relief_memory_bytes") <= 140_000);
    assert_eq!(running.stop("TERM").0, Some(0));
}

/// Where a landmark is in a picture and how deep, by the camera that the answer names: pixels, mm.
fn projected(found: &serde_json::Value, point: [f64; 3]) -> ([f64; 2], f64, f64) {
    use glam::DVec3;
    let vector = |value: &serde_json::Value| DVec3::from_slice(&common::numbers(value));
    let camera = &found["camera"];
    let (eye, look_at) = (vector(&camera["eye_mm"]), vector(&camera["look_at_mm"]));
    let forward = (look_at - eye).normalize();
    let right = forward.cross(vector(&camera["up"])).normalize();
    let arm = DVec3::from(point) - eye;
    let depth = arm.dot(forward);
    let size = common::numbers(&found["size_px"]);
    let fov = camera["projection"]["perspective"]["vertical_fov_deg"].as_f64().unwrap().to_radians();
    let mm_per_px = 2.0 * depth * (fov / 2.0).tan() / size[1];
    let (x, y) = (arm.dot(right), arm.dot(right.cross(forward)));
    ([size[0] / 2.0 + x / mm_per_px, size[1] / 2.0 - y / mm_per_px], depth, mm_per_px)
}

/// A served sphere with three landmarks of anna's: its path, and each with its place.
struct Annotated {
    running: Running,
    series: String,
    log: String,
    path: String,
    points: [(&'static str, [f64; 3]); 3],
}

impl Annotated {
    fn start(folder: &Path) -> Self {
        let series = phantom(folder);
        let log = folder.join("log.db").to_str().unwrap().to_owned();
        let arguments = ["serve", "--series", &series, "--annotations", &log, "--listen", "127.0.0.1:0"];
        let running = Running::spawn(&mut relief(&arguments));
        running.await_ready();
        let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
        let volume = &listed["volumes"][0];
        let path = format!("/v1/volumes/{}", volume["id"].as_str().unwrap());
        let center = common::numbers(&volume["center_mm"]);
        let radius = volume["radius_mm"].as_f64().unwrap();
        let at = |x: f64, y: f64| [center[0] + x * radius, center[1] + y * radius, center[2]];
        // Beside the sphere, before it, and in its middle, where its surface hides it.
        let points = [("beside", at(0.5, 0.0)), ("before", at(0.1, -0.9)), ("inside", at(0.0, 0.0))];
        let create = |(name, at_mm): (&str, [f64; 3])| {
            serde_json::json!({ "change": "create",
                "item": { "name": name, "set": "anna", "geometry": { "kind": "point", "at_mm": at_mm } } })
        };
        let edit = serde_json::json!({ "changes": points.map(create) }).to_string();
        let length = edit.len();
        let headers =
            format!("Relief-Author: anna\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n");
        let (head, body) = running.ask(&format!("POST {path}/annotations"), &headers, edit.as_bytes());
        assert!(head.starts_with("HTTP/1.1 201"), "{head} {}", String::from_utf8_lossy(&body));
        Self { running, series, log, path, points }
    }

    fn pick(&self, scene: &str, [u, v]: [f64; 2]) -> serde_json::Value {
        let (head, body) = self.running.get(&format!("{}/pick?{scene}&u={u}&v={v}", self.path));
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        serde_json::from_slice(&body).unwrap()
    }

    /// The output of `relief render` for the same series.
    fn render(&self, file: &Path, more: &[&str]) -> Vec<u8> {
        let mut command = relief(&[
            "render",
            "--series",
            &self.series,
            "--preset",
            "bone",
            "--layout",
            "color",
            "--frame",
            "volume",
        ]);
        let rendered = command.arg("--out").arg(file).args(more).output().unwrap();
        assert!(rendered.status.success(), "{}", String::from_utf8_lossy(&rendered.stderr));
        std::fs::read(file).unwrap()
    }
}

/// Invariant: Annotations are drawn at their place and depth, with the same bytes by `relief
/// render`; slices show outlines; labels stand where they can be read.
#[test]
fn annotations_are_drawn_at_their_place_and_depth_in_the_very_frame_that_render_writes() {
    let folder = tempfile::tempdir().unwrap();
    let annotated = Annotated::start(folder.path());
    let Annotated { running, log, path, points, .. } = &annotated;
    let (scene, plain) =
        ("preset=bone&layout=color&frame=volume&annotations=anna", "preset=bone&layout=color&frame=volume");
    let (head, frame) = running.get(&format!("{path}/frame?{scene}"));
    assert!(head.to_lowercase().contains("relief-annotations: drawn=3, left_out=0"), "{head}");
    let picture = image::load_from_memory(&frame).unwrap().to_rgb8();
    for &(name, point) in points {
        let (at, depth_mm, mm_per_px) = projected(&annotated.pick(scene, [1.0, 1.0]), point);
        let found = annotated.pick(scene, at)["depth_mm"].as_f64();
        let bare = annotated.pick(plain, at)["depth_mm"].as_f64();
        let image::Rgb([red, green, _]) = *picture.get_pixel(at[0] as u32, at[1] as u32);
        if name == "inside" {
            assert_eq!(found, bare, "what is hidden writes no depth");
            assert!(bare.unwrap() < depth_mm && red > green, "{red} {green}: dimmed, not gone");
        } else {
            // The front of a ball of six pixels' radius; the pixel is not quite its middle.
            let front = depth_mm - 6.0 * mm_per_px;
            assert!((found.unwrap() - front).abs() < 0.1 * mm_per_px, "{name}: {found:?} for {front}");
            assert!(red > 230 && (70..110).contains(&green), "{name}: {red} {green}");
        }
    }

    let file = folder.path().join("frame.png");
    assert!(annotated.render(&file, &["--annotations", log, "--set", "anna"]) == frame, "the same bytes");
    assert!(annotated.render(&file, &["--annotations", log]) == frame, "all sets are one");
    let bare = running.get(&format!("{path}/frame?{plain}")).1;
    assert!(
        annotated.render(&file, &["--annotations", log, "--set", "ben"]) == bare,
        "nothing of another set"
    );
    let (status, errors) = annotated.running.stop("TERM");
    assert_eq!(status, Some(0), "{errors}");
    assert!(!errors.contains("anna"), "{errors}");
    assert!(!folder.path().join("log.db-wal").exists(), "the log is one file again");
}
