//! Rendering, from outside: closed forms, slices, the f64 twin, skipping, refusals.
//!
//! Needs an adapter. With `RELIEF_REQUIRE_ADAPTER=1` a missing one fails; otherwise each test says
//! that it skipped.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tests fail and speak aloud"
)]

mod bands;
mod clip_sphere;
mod closed_forms;
mod depth_rules;
mod faces;
mod for_views;
mod illumination;
mod instruments;
mod isosurfaces;
mod labels;
mod lanes;
mod memory;
mod modes;
mod overlays;
mod pathtrace;
mod pathtrace_peer;
mod picks;
mod pre_integrated;
mod projections;
mod reduced;
mod refusals;
mod scale;
mod skipping;
mod slices;
mod slices_peer;
mod synthesis;
mod twin;
mod views;

use std::sync::OnceLock;

use parking_lot::{Mutex, MutexGuard};
use relief_render::{AdapterChoice, Gpu, Mode, RenderRequest, Renderer, Surface};

/// The one renderer of this test program: software adapters compile pipelines slowly. `None`
/// without an adapter.
fn renderer(test: &str) -> Option<MutexGuard<'static, Renderer>> {
    static RENDERER: OnceLock<Option<Mutex<Renderer>>> = OnceLock::new();
    let shared = RENDERER.get_or_init(|| match Gpu::open(&AdapterChoice::Software) {
        Ok(gpu) => Some(Mutex::new(Renderer::new(gpu).expect("the shaders compile"))),
        Err(error) if std::env::var_os("RELIEF_REQUIRE_ADAPTER").is_some() => {
            panic!("RELIEF_REQUIRE_ADAPTER is set: {error}")
        }
        Err(_) => None,
    });
    if shared.is_none() {
        eprintln!("SKIPPED: {test} (no software graphics adapter)");
    }
    // A test that failed while it held the renderer left nothing half done: every frame starts
    // anew.
    shared.as_ref().map(|shared| shared.lock())
}

/// The request in another mode, with skin and bone where that takes surfaces.
fn in_mode(mode: Mode, request: RenderRequest) -> RenderRequest {
    let surface = |hu, opacity| Surface { opacity, ..Surface::opaque(hu, &request.transfer) };
    let surfaces = match mode {
        Mode::Isosurface => vec![surface(-300.0, 0.4), surface(300.0, 0.8)],
        _ => Vec::new(),
    };
    RenderRequest { mode, surfaces, ..request }
}
