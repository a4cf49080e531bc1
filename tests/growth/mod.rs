//! Memory does not grow with the number of frames, whatever changes between them.
//!
//! Needs an adapter. With `RELIEF_REQUIRE_ADAPTER=1` a missing one fails; otherwise each test says
//! that it skipped.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]
#![cfg(target_os = "linux")]

use crate::common;

use std::ops::ControlFlow;
use std::process::Command;

use common::software_adapter;
use relief_render::{Mode, RenderError, RenderRequest, Renderer, SceneFile, Surface};
use relief_volume::{Orbit, Phantom, TransferFunction, Volume};

/// Well above what a run without a leak shows (0.2 MiB). A leak of 4 KiB a frame is three times this; one of
/// 2 KiB fits into free memory that the process holds already, and is not found.
const ALLOWED_MIB: f64 = 1.0;

/// Memory of this process that no file backs, MiB: of the heap, and shared, as drivers use it. Pages of
/// programs are left out: up to 1.2 MiB of them are read in during the first thousand frames.
fn resident_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let kib = |name: &str| -> f64 {
        let line = status.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    };
    (kib("RssAnon:") + kib("RssShmem:")) / 1024.0
}

/// A request unlike the others: mode, size, view and transfer function change from frame to frame.
fn request(volume: &Volume, i: u32) -> RenderRequest {
    const MODES: [Mode; 4] = [Mode::Composite, Mode::Mip, Mode::Isosurface, Mode::PathTraced];
    let size = [[64, 48], [48, 32], [97, 61]][i as usize % 3];
    let orbit = Orbit { azimuth_deg: f64::from(i * 7 % 360), ..Orbit::default() };
    let scene = SceneFile::default().with_preset("skin").with_size(size).with_passes(1);
    let mut request = scene.resolve(volume.grid(), &orbit).unwrap().request;
    let unit_mm = 1.0 + f64::from(i) / 1000.0;
    request.transfer = TransferFunction::new(request.transfer.points().to_vec(), unit_mm).unwrap();
    request.mode = MODES[i as usize / 3 % 4];
    if request.mode == Mode::Isosurface {
        request.surfaces = vec![Surface::opaque(300.0, &request.transfer)];
    }
    request
}

/// Every tenth frame is broken off, every fiftieth volume is forgotten.
fn render(renderer: &mut Renderer, volumes: &[Volume], frames: std::ops::Range<u32>) {
    for i in frames {
        let volume = &volumes[i as usize / 12 % volumes.len()];
        let mut goes_on = |_| if i % 10 == 9 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        match renderer.render_watched(volume, &request(volume, i), &mut goes_on) {
            Ok(frame) => assert!(i % 10 != 9 && !frame.color_rgba.is_empty()),
            Err(error) => assert!(i % 10 == 9 && matches!(error, RenderError::Cancelled), "{error}"),
        }
        if i % 50 == 49 {
            renderer.forget(volume.content_hash());
        }
    }
}

/// Invariant: Memory does not grow with the number of frames.
#[test]
fn a_thousand_frames_take_no_more_memory_than_a_few() {
    // In a process of its own: other tests of this program take memory, too.
    const CHILD: &str = "RELIEF_TEST_GROWTH";
    if std::env::var_os(CHILD).is_none() {
        let own = std::env::current_exe().unwrap();
        let name = "growth::a_thousand_frames_take_no_more_memory_than_a_few";
        let output =
            Command::new(own).args(["--exact", name, "--nocapture"]).env(CHILD, "1").output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.contains("1 passed"), "{said}");
        return eprintln!("{}", said.lines().find(|line| line.starts_with("SKIPPED")).unwrap_or_default());
    }
    let Some(gpu) = software_adapter("a_thousand_frames_take_no_more_memory_than_a_few") else { return };
    let mut renderer = Renderer::new(gpu).unwrap();
    let volumes = [Phantom::head(32), Phantom::sphere(32)].map(|phantom| phantom.unwrap().volume);
    // Before measuring, every pipeline is compiled, every buffer has its largest size, and every
    // cache is full.
    render(&mut renderer, &volumes, 0..200);
    let before = resident_mib();
    render(&mut renderer, &volumes, 200..1200);
    let growth = resident_mib() - before;
    eprintln!("{growth:.2} MiB over 1000 frames");
    assert!(growth < ALLOWED_MIB, "{growth:.2} MiB over 1000 frames");
}

/// Invariant: Memory does not grow with the number of frames.
#[test]
fn relief_bench_finds_no_growth_of_memory() {
    let folder = tempfile::tempdir().unwrap();
    let relief = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        let output = command.env("RELIEF_ADAPTER", "cpu").args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let series = folder.path().join("head");
    let series = series.to_str().unwrap();
    relief(&["phantom", "--kind", "head", "--size", "32", "--out", series]);
    let report = relief(&["bench", "--series", series, "--size", "48x32", "--frames", "1000", "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["frames"], 1000);
    let growth = report["rss_growth_mib"].as_f64().unwrap();
    assert!(growth < ALLOWED_MIB, "{growth:.2} MiB over 1000 frames");
}
