//! Arguments, errors and exit statuses of `relief client`, and the cursor in its frames.

use std::io::Write;
use std::process::Output;

use relief_client::Event;
use relief_live::{Accept, Hello, ReceivedDepth, ReceivedFrame};

use crate::client::real::{Serving, relief, text};
use crate::client::stand_in::Running;

fn client(arguments: &[&str]) -> Output {
    relief(&["client"]).args(arguments).output().unwrap()
}

#[test]
fn invalid_arguments_are_refused_with_the_allowed_values() {
    let server = ["--server", "http://127.0.0.1:1", "--headless"];
    for (more, status, expected) in [
        (&["--look", "1"][..], 2, "AZIMUTH,ELEVATION"),
        (&["--view", "a b"], 2, "letters, digits"),
        (&["--rest", "true"], 2, if cfg!(feature = "window") { "--headless" } else { "--features window" }),
        (&["--measure", "0"], 2, "0.1 to 3600 s"),
        (&["--layout", "depth16"], 1, "no picture with disparity"),
        (&["--role", "watcher", "--preset", "bone"], 1, "a watcher sees what presenters show"),
        (&["--role", "watcher", "--wiimote", "hidraw"], 1, "a watcher moves nothing"),
        (&["--wiimote", "nowhere.jsonl"], 1, "cannot read nowhere.jsonl"),
        (&["--replay", "nowhere.jsonl"], 1, "cannot read nowhere.jsonl"),
        (&["--measure", "1"], 1, "cannot reach http://127.0.0.1:1"),
        (&["--save-frame", "x.png"], 1, "cannot reach http://127.0.0.1:1"),
    ] {
        let output = client(&[&server[..], more].concat());
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{more:?}: {errors}");
        assert!(errors.contains(expected), "{more:?}: {errors}");
    }
    let output = client(&["--server", "ftp://127.0.0.1:1", "--headless"]);
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("https://HOST:PORT"));
    let output = client(&[&server[..], &["--ca", "nowhere.pem"]].concat());
    assert!(output.status.code() == Some(1) && text(&output.stderr).contains("--ca is for https://"));
}

#[test]
fn a_file_that_is_no_session_is_named_with_its_line() {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    for (content, expected) in [
        ("", "empty"),
        ("{}\n", "no session of this version"),
        ("{\"relief_session\":1,\"hello\":{\"type\":\"hello\",\"x\":1}}\n", "line 1: hello.x"),
    ] {
        file.as_file().set_len(0).unwrap();
        file.write_all(content.as_bytes()).unwrap();
        let path = file.path().to_str().unwrap();
        let output = client(&["--server", "http://127.0.0.1:1", "--headless", "--replay", path]);
        let errors = text(&output.stderr);
        assert!(output.status.code() == Some(1) && errors.contains(expected), "{content:?}: {errors}");
        std::io::Seek::rewind(&mut file).unwrap();
    }
}

#[test]
fn failed_connections_are_logged_once() {
    let mut waiting = relief(&["client", "--server", "http://127.0.0.1:1", "--headless"]).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_secs(3)); // half a dozen attempts
    waiting.kill().unwrap();
    let reported = text(&waiting.wait_with_output().unwrap().stderr);
    let lines: Vec<_> = reported.lines().collect();
    assert_eq!(lines.len(), 2, "{reported}");
    assert!(lines[0].contains("--save-frame") && lines[1].contains("cannot reach"), "{reported}");
}

#[cfg(all(feature = "window", target_os = "linux"))]
#[test]
fn a_missing_display_gives_an_error_without_source_paths() {
    let mut command = relief(&["client", "--server", "http://127.0.0.1:1"]);
    let output = command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    let errors = text(&output.stderr);
    assert!(!output.status.success() && errors.contains("DISPLAY is not set"), "{errors}");
    let output = command.env("DISPLAY", ":4711").output().unwrap();
    let errors = text(&output.stderr);
    assert!(!output.status.success() && errors.contains("no window can be opened"), "{errors}");
    assert!(!errors.contains(".rs"), "{errors}");
    let output = command.args(["--rest", "synthesised"]).output().unwrap();
    assert!(text(&output.stderr).contains("--rest is for layouts of views"), "{}", text(&output.stderr));
}

/// Looks at a view with 16-bit Z, and compares the depth where the cursor is with a ball around it.
pub(crate) fn check_cursor(serving: &Serving, view: &str, cursor: &[f64]) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let received = runtime.block_on(async {
        let accept = Accept { color: vec!["rgb-zstd".to_owned()], depth: vec!["z16-zstd".to_owned()] };
        let hello = Hello { view: Some(view.to_owned()), accept, ..Hello::default() };
        let server = serving.url().parse().unwrap();
        let mut client = Running::start(relief_client::Options {
            server,
            access: relief_client::Access::default(),
            hello,
            wait: false,
        });
        let still = client
            .until(|event| match event {
                Event::Frame(received) => {
                    let header = received.header;
                    header.still.then(|| received.clone())
                }
                _ => None,
            })
            .await;
        client.handle.stop();
        client.ended().await.unwrap();
        still
    });
    let frame = ReceivedFrame::decode(&received.bytes).unwrap();
    let header = frame.header;
    assert!(header.lossless() && header.full_size());
    let ReceivedDepth::Scaled16(z16) = &frame.depth else { panic!("no 16-bit depth") };
    let camera = header.camera().unwrap();
    let at = relief_base::Point::new(cursor[0], cursor[1], cursor[2]);
    let seen = (camera.view_from_patient() * at).xyz;
    let [width, height] = header.size_px.map(f64::from);
    let half_height = match camera.projection() {
        relief_volume::Projection::Perspective { vertical_fov } => (vertical_fov / 2.0).tan() * -seen.z,
        relief_volume::Projection::Orthographic { height_mm } => height_mm / 2.0,
    };
    let mm_per_px = 2.0 * half_height / height;
    let (u, v) = (width / 2.0 + seen.x / mm_per_px, height / 2.0 - seen.y / mm_per_px);
    let pixel = v as usize * usize::from(header.size_px[0]) + u as usize;
    let [near, far] = header.limits_mm.map(f64::from);
    let depth = near + (1.0 - f64::from(z16[pixel]) / 65535.0) * (far - near);
    // The ball has a fixed size in pixels of the picture.
    let radius_mm = (height / 90.0).clamp(2.0, 64.0) * mm_per_px;
    let ball = -seen.z - radius_mm;
    // The phantom's sphere, hit by the ray through that pixel: the nearer of the two is seen.
    let eye = camera.eye().xyz;
    let direction = (at.xyz - eye).normalize();
    let (b, c) = (eye.dot(direction), eye.length_squared() - 80.0 * 80.0);
    let along = -b - (b * b - c).max(0.0).sqrt();
    let forward = (camera.look_at().xyz - eye).normalize();
    let sphere = if b * b > c { along * direction.dot(forward) } else { f64::INFINITY };
    eprintln!(
        "{view}: cursor {cursor:?} at {u:.1},{v:.1}: depth {depth:.2}, ball {ball:.2}, sphere {sphere:.2} mm"
    );
    assert!(ball < sphere - 5.0, "the cursor is before the sphere: the hand came closer by 120 mm");
    assert!((depth - ball).abs() < 1.0, "depth {depth}, geometry {ball}");
    // The hand's way, in view axes: right is x, up is y, towards the viewer is z; tracking knows it
    // to some mm.
    let look_at = (camera.view_from_patient() * camera.look_at()).xyz;
    let way = seen - look_at;
    let expected = glam::DVec3::new(10.0, 20.0, 120.0);
    assert!((way - expected).length() < 12.0, "the cursor went {way}, the hand {expected}");
}
