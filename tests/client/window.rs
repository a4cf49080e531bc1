//! The window under a virtual X server: its screen shows the served frame, byte for byte.
//!
//! Xvfb keeps its screen in a file in the format of xwd, which is read here; so nothing of the
//! client's own takes the picture. Without Xvfb the test says that it skipped.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use relief_display::{DecodedLayer, DisplayProfile, Parallax, ProfileName, synthesize};

use crate::client::real::{Serving, phantom, pixels, relief, text};

struct Xvfb {
    process: Child,
    display: String,
    folder: tempfile::TempDir,
}

impl Xvfb {
    fn start() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let program = std::env::var_os("RELIEF_XVFB").unwrap_or_else(|| "Xvfb".into());
        let screen = ["-screen", "0", "1920x1080x24", "-nolisten", "tcp", "-displayfd", "1", "-fbdir"];
        let spawned = Command::new(program)
            .args(screen)
            .arg(folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut process) = spawned else {
            eprintln!("SKIPPED: the window of relief client (Xvfb is not installed: apt-get install xvfb)");
            return None;
        };
        let mut line = String::new();
        let mut out = std::io::BufReader::new(process.stdout.take().unwrap());
        std::io::BufRead::read_line(&mut out, &mut line).unwrap();
        Some(Self { process, display: format!(":{}", line.trim()), folder })
    }

    /// Red, green, blue of the screen.
    fn screen(&self) -> Vec<u8> {
        read_xwd(&self.folder.path().join("Xvfb_screen0"))
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Pixels of an XWD file of version 7, 32 bits a pixel: the numbers of its header are big-endian.
fn read_xwd(path: &Path) -> Vec<u8> {
    let file = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_be_bytes(file[4 * at..4 * at + 4].try_into().unwrap()) as usize;
    let (header_bytes, width, height) = (word(0), word(4), word(5));
    let (bits, stride, colors) = (word(11), word(12), word(19));
    assert_eq!((word(1), width, height, bits), (7, 1920, 1080, 32));
    let is_little_endian = word(7) == 0;
    let first = header_bytes + 12 * colors;
    let mut rgb = Vec::with_capacity(3 * width * height);
    for row in file[first..].chunks_exact(stride).take(height) {
        for pixel in row[..4 * width].as_chunks::<4>().0 {
            let value =
                if is_little_endian { u32::from_le_bytes(*pixel) } else { u32::from_be_bytes(*pixel) };
            let [_, red, green, blue] = value.to_be_bytes();
            rgb.extend([red, green, blue]);
        }
    }
    rgb
}

struct Client(Child);

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Invariant: The client composes exactly the served PNG, and its window shows it byte for byte;
/// state marks change neither header, depth nor black lines.
#[test]
fn the_screen_shows_the_served_frame_byte_for_byte() {
    let Some(x) = Xvfb::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    let id = serving.ready();
    let query = "preset=bone&azimuth_deg=30&elevation_deg=10&zoom=1.2&frame=tissue";
    let (width, height, served) = pixels(&serving.get(&format!("/v1/volumes/{id}/frame?{query}")));
    assert_eq!((width, height), (1920, 1080));
    let arguments = ["--preset", "bone", "--look", "30,10,1.2", "--fullscreen"];
    let started = relief(&["client", "--server", &serving.url()])
        .args(arguments)
        .env("DISPLAY", &x.display)
        .env_remove("WAYLAND_DISPLAY")
        .stderr(Stdio::inherit())
        .spawn();
    let mut client = Client(started.unwrap());
    let since = Instant::now();
    while x.screen() != served {
        assert!(client.0.try_wait().unwrap().is_none(), "the client ended");
        if since.elapsed() > Duration::from_secs(60) {
            let screen = x.screen();
            let wrong = screen.iter().zip(&served).filter(|(a, b)| a != b).count();
            panic!("{wrong} of {} bytes differ", served.len());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    // Without its server the picture stays, and a mark in the corner of the picture says so: header
    // row and depth are untouched.
    serving.kill();
    let since = Instant::now();
    let marked = loop {
        let screen = x.screen();
        if screen != served {
            break screen;
        }
        assert!(since.elapsed() < Duration::from_secs(60), "no mark of a lost connection");
        std::thread::sleep(Duration::from_millis(100));
    };
    let changed = (0..served.len() / 3).filter(|at| marked[3 * at..3 * at + 3] != served[3 * at..3 * at + 3]);
    let mut count = 0;
    for at in changed {
        let (x, y) = (at % 1920, at / 1920);
        assert!(x < 32 && y > 1000 && y % 2 == 0, "pixel {x},{y}");
        count += 1;
    }
    assert!(count > 0 && count <= 36, "{count} pixels");
    an_old_picture_gives_way_to_text(&x);
    another_series_takes_its_place(&x, &serving.address, folder.path());
}

/// Invariant: Views of two eyes follow the tracked viewer, in the window and in the kiosk.
///
/// The expected picture is made of the server's picture and disparity for eyes whose place is worked
/// out here: as far from the middle as the rays to a point just behind the screen say.
#[test]
fn views_in_the_window_follow_tracked_eyes() {
    let Some(x) = Xvfb::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&phantom(folder.path()), "127.0.0.1:0");
    let id = serving.ready();
    let geometry = folder.path().join("display.json");
    std::fs::write(&geometry, r#"{"rest_mm": [0, 0, 1200], "eye_separation_mm": 60}"#).unwrap();
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let source = format!("opentrack:127.0.0.1:{port}");
    let size = ["--layout", "lines", "--size", "400x300", "--preset", "bone", "--look", "30,10,1.2"];
    let started = relief(&["client", "--server", &serving.url(), "--eyes", &source])
        .args(["--display-geometry", geometry.to_str().unwrap()])
        .args(size)
        .args(["--rest", "synthesised"])
        .env("DISPLAY", &x.display)
        .env_remove("WAYLAND_DISPLAY")
        .spawn();
    let mut client = Client(started.unwrap());
    let query =
        "preset=bone&azimuth_deg=30&elevation_deg=10&zoom=1.2&frame=tissue&size_px=400,300&layout=rgbd";
    let (_, _, rgbd) = pixels(&serving.get(&format!("/v1/volumes/{id}/frame?{query}")));
    let mut layer = DecodedLayer { color: Vec::new(), disparity: Vec::new() };
    for line in rgbd.as_chunks::<3>().0.chunks_exact(800) {
        layer.color.extend(&line[..400]);
        layer.disparity.extend(line[400..].iter().map(|gray| gray[0]));
    }
    let parallax = Parallax::new(&DisplayProfile::named(ProfileName::Philips42), 64, 128, 400);
    let shown = |eyes: [f64; 2]| {
        let views = synthesize([400, 300], &layer, None, &parallax, &eyes).unwrap();
        let rows = |at: usize| &views.pictures()[(at / 400) % 2][at];
        (0..400 * 300).flat_map(|at| *rows(at)).collect::<Vec<u8>>()
    };
    let corner = |screen: &[u8]| {
        screen.chunks_exact(3 * 1920).take(300).flat_map(|row| &row[..3 * 400]).copied().collect::<Vec<u8>>()
    };
    until(&x, |screen| corner(screen) == shown([-0.5, 0.5]));
    // 200 mm to the right and 300 mm closer: x / 65 eye separations as seen from 1200 mm.
    let (closer, right) = (1200.0 - 300.0, [200.0 - 30.0, 200.0 + 30.0]);
    let expected = shown(right.map(|x_mm: f64| x_mm / 65.0 * (1200.0 / closer)));
    assert!(expected != shown([-0.5, 0.5]), "the viewer's place makes a difference");
    let tracker = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let datagram: Vec<u8> =
        [20.0_f64, 0.0, -30.0, 0.0, 0.0, 0.0].iter().flat_map(|n| n.to_le_bytes()).collect();
    let since = Instant::now();
    while corner(&x.screen()) != expected {
        tracker.send_to(&datagram, ("127.0.0.1", port)).unwrap();
        assert!(client.0.try_wait().unwrap().is_none(), "the client ended");
        assert!(since.elapsed() < Duration::from_secs(60), "the views do not follow");
        std::thread::sleep(Duration::from_millis(20));
    }
    // The time is reported at the end.
    assert!(crate::common::child::signal("TERM", client.0.id()));
    let mut errors = client.0.stderr.take().unwrap();
    let mut said = String::new();
    std::io::Read::read_to_string(&mut errors, &mut said).unwrap();
    assert!(said.contains("views followed the eyes ") && said.contains(" ms after they came"), "{said}");
}

/// Invariant: The window shows rendered views of a picture at rest: those of `relief render --views true`, byte by
/// byte.
#[test]
fn views_of_a_picture_at_rest_come_from_the_server() {
    let Some(x) = Xvfb::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let out = folder.path().join("true.png");
    let scene = ["--azimuth-deg", "30", "--elevation-deg", "10", "--zoom", "1.2", "--frame", "tissue"];
    let looks = ["--layout", "lines", "--size", "400x300", "--preset", "bone"];
    let render = |views: &str| {
        let made = relief(&["render", "--series", &series, "--views", views, "--out", out.to_str().unwrap()])
            .args(scene)
            .args(looks)
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", text(&made.stderr));
        pixels(&std::fs::read(&out).unwrap()).2
    };
    let (exact, made) = (render("true"), render("synthesised"));
    assert!(exact != made, "views that are rendered differ");
    let serving = Serving::start(&series, "127.0.0.1:0");
    serving.ready();
    let started = relief(&["client", "--server", &serving.url(), "--view", "desk", "--look", "30,10,1.2"])
        .args(looks)
        .env("DISPLAY", &x.display)
        .env_remove("WAYLAND_DISPLAY")
        .spawn();
    let _client = Client(started.unwrap());
    let corner = |screen: &[u8]| {
        screen.chunks_exact(3 * 1920).take(300).flat_map(|row| &row[..3 * 400]).copied().collect::<Vec<u8>>()
    };
    until(&x, |screen| corner(screen) == exact);
    // It stays, and a movement ends it.
    std::thread::sleep(Duration::from_millis(500));
    assert!(corner(&x.screen()) == exact);
    serving.post("/v1/session/desk/intent", r#"{"intent":"orbit","azimuth_deg":25}"#);
    let moved = until(&x, |screen| corner(screen) != exact);
    assert!(corner(&moved).iter().any(|value| *value > 60));
}

/// Soon afterwards a line of text takes its place: the picture may be of another patient by now.
fn an_old_picture_gives_way_to_text(x: &Xvfb) {
    let shown = until(x, |screen| {
        let [ink, outside] = ink(screen);
        ink > 500 && outside == 0
    });
    if let Some(folder) = std::env::var_os("RELIEF_SHOTS") {
        let file = Path::new(&folder).join("waiting.png");
        image::save_buffer(file, &shown, 1920, 1080, image::ColorType::Rgb8).unwrap();
    }
}

/// The server comes back with another series: its first volume is shown.
fn another_series_takes_its_place(x: &Xvfb, address: &str, folder: &Path) {
    let other = folder.join("other");
    let other = other.to_str().unwrap();
    let made = relief(&["phantom", "--kind", "axes", "--size", "48", "--out", other]).output().unwrap();
    assert!(made.status.success(), "{}", text(&made.stderr));
    let again = Serving::start(other, address);
    let id = again.ready();
    let query = "preset=bone&frame=tissue&azimuth_deg=20&elevation_deg=10";
    let (_, _, served) = pixels(&again.get(&format!("/v1/volumes/{id}/frame?{query}")));
    until(x, |screen| screen == served);
}

/// The screen when `is_good` holds for it.
fn until(x: &Xvfb, is_good: impl Fn(&[u8]) -> bool) -> Vec<u8> {
    const PATIENCE: Duration = Duration::from_secs(60);
    let since = Instant::now();
    loop {
        let screen = x.screen();
        if is_good(&screen) {
            return screen;
        }
        assert!(since.elapsed() < PATIENCE, "not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Numbers of bright pixels in the middle fifth of the rows, and of all that are not black outside.
fn ink(screen: &[u8]) -> [usize; 2] {
    let pixels = screen.as_chunks::<3>().0.iter().enumerate();
    let lit = pixels.filter(|(_, rgb)| **rgb != [0; 3]).map(|(at, _)| at / 1920);
    let (inside, outside): (Vec<_>, Vec<_>) = lit.partition(|row| (432..648).contains(row));
    [inside.len(), outside.len()]
}
