//! `relief render --views`: views rendered by cameras side by side, beside those that a display
//! makes of one picture.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, bail};

use crate::output::milliseconds;
use relief_base::DepthLimits;
use relief_display::{FrameEncoder, Layout, TrueViews, ViewGrid, Views, encode_views, interpolate, psnr_db};
use relief_render::{
    Mode, Refinement, RenderRequest, RenderedFrame, Renderer, Scene, eye_cameras, true_views,
    with_span_of_cone,
};
use relief_volume::{Camera, Volume};

/// The views that are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum ViewChoice {
    /// Made of one picture and its disparity, as a 2D-plus-depth display makes them
    #[default]
    Synthesised,
    /// Rendered, each by a camera of its own
    True,
    /// Every few views rendered, those between made of their two neighbours: nearly true, and faster
    Interpolated,
    /// As interpolated, or made of one picture where there are two views; then a tenth of each view is
    /// rendered, where that changes it most
    Refined,
    /// The rendered ones above the synthesised ones, with the signal-to-noise ratio of each
    Both,
}

/// A file of views and its report.
pub(super) struct ViewFile {
    pub(super) file: Vec<u8>,
    /// Beside the usual report, as JSON.
    pub(super) report: serde_json::Value,
    /// The same in words.
    pub(super) lines: Vec<String>,
}

/// Refuses layouts without true views before rendering.
pub(super) fn check(choice: ViewChoice, keys: Option<u16>, scene: &Scene) -> anyhow::Result<()> {
    if keys.is_some() && !matches!(choice, ViewChoice::Interpolated | ViewChoice::Refined) {
        bail!("--key-views is for --views interpolated and refined");
    }
    let (layout, mode) = (scene.display.layout, scene.request.mode);
    if choice == ViewChoice::Synthesised {
        return Ok(());
    }
    if layout.view_count() == 0 {
        bail!("--views is for layouts of views, such as stereo, views-9 or wiggle; this one is {layout}");
    }
    if matches!(mode, Mode::Slice(_)) {
        bail!("a slice is flat and seen head-on: it has no true views; leave --views out");
    }
    if scene.budget_ms.is_some() {
        bail!("true views are compared at full quality: leave --budget-ms out");
    }
    if choice == ViewChoice::Both {
        both_layout(layout).map(|both| both.check_size(scene.request.size_px)).transpose()?;
    }
    cameras(scene, &scene.request.camera, DepthLimits { near_mm: 1.0, far_mm: 2.0 }).map(|_| ())
}

/// Views between two rendered ones, where --key-views is left out.
const USUAL_STEP: usize = 5;

/// The numbers of the views that are rendered: even, with the first and the last.
fn key_numbers(count: usize, keys: Option<usize>) -> Vec<usize> {
    let keys = keys.unwrap_or(count.div_ceil(USUAL_STEP)).clamp(2.min(count), count);
    let steps = (keys - 1).max(1);
    (0..keys).map(|key| (2 * key * (count - 1) + steps) / (2 * steps)).collect()
}

/// Renders some of the views and interpolates the others; with `refined`, renders parts of these, too.
fn interpolated(
    scene: &Scene,
    middle: &RenderedFrame,
    limits: DepthLimits,
    cameras: &[Camera],
    (refined, keys): (bool, Option<usize>),
    mut render: impl FnMut(&RenderRequest) -> anyhow::Result<RenderedFrame>,
) -> anyhow::Result<ViewFile> {
    let encoder = scene.display.encoder()?;
    let eyes = encoder.eyes();
    // Both eyes of a pair are near to the picture in the middle.
    let from_middle = refined && keys.is_none() && eyes.len() <= 2;
    let numbers = if from_middle { Vec::new() } else { key_numbers(eyes.len(), keys) };
    let seen_by = |camera: Camera| RenderRequest { camera, ..scene.request.clone() };
    let since = Instant::now();
    let key_of = |eye: f64, seen: &RenderedFrame| {
        Ok::<_, anyhow::Error>(encoder.key_view(eye, &seen.picture()?, limits))
    };
    let mut keys = Vec::new();
    if from_middle {
        keys.push(key_of(0.0, middle)?);
    }
    for &number in &numbers {
        keys.push(match eyes[number] {
            0.0 => key_of(0.0, middle)?, // rendered already
            eye => key_of(eye, &render(&seen_by(cameras[number]))?)?,
        });
    }
    let size_px = scene.request.size_px;
    let mut views = interpolate(size_px, &keys, &encoder.parallax(size_px[0]), &eyes)?;
    if refined {
        let mut pictures = views.pictures().to_vec();
        for (number, view) in pictures.iter_mut().enumerate() {
            if !numbers.contains(&number) {
                *view = refine(std::mem::take(view), middle, &seen_by(cameras[number]), &mut render)?;
            }
        }
        views = Views::new(size_px, pictures)?;
    }
    let views_ms = milliseconds(since);
    let words = if refined { "parts of the others" } else { "the others made of them" };
    let rendered = if from_middle { "none".to_owned() } else { numbers.len().to_string() };
    Ok(ViewFile {
        file: encode_views(scene.display.layout, &views, encoder.panel())?,
        report: serde_json::json!({ "eyes": eyes, "rendered": numbers, "views_ms": views_ms }),
        lines: vec![format!("{} views: {rendered} rendered, {words}", eyes.len())],
    })
}

/// Renders the parts of a warped view that are most wrong.
fn refine(
    view: Vec<[u8; 3]>,
    middle: &RenderedFrame,
    request: &RenderRequest,
    render: &mut impl FnMut(&RenderRequest) -> anyhow::Result<RenderedFrame>,
) -> anyhow::Result<Vec<[u8; 3]>> {
    let mut refinement = Refinement::new(view, middle, Refinement::USUAL_SHARE);
    while let Some(blocks) = refinement.next_blocks() {
        let blocks = Arc::new(blocks);
        let cast = render(&RenderRequest { blocks: Some(Arc::clone(&blocks)), ..request.clone() })?;
        refinement.take(&blocks, &cast);
    }
    Ok(refinement.into_view())
}

/// The file with these views of a picture that is rendered already.
pub(super) fn make(
    (choice, keys): (ViewChoice, Option<usize>),
    scene: &Scene,
    frame: &RenderedFrame,
    renderer: &mut Renderer,
    volume: &Volume,
    render: impl Fn(&mut Renderer, &Volume, &RenderRequest) -> anyhow::Result<RenderedFrame>,
) -> anyhow::Result<ViewFile> {
    let limits = frame.limits_for(&scene.display)?;
    let display = with_span_of_cone(&scene.display, &frame.camera, frame.size_px, limits)?;
    let scene = &Scene { display, ..scene.clone() };
    let encoder = scene.display.encoder()?;
    let layout = encoder.layout();
    if choice == ViewChoice::Synthesised {
        return from_one_picture(&encoder, frame, limits);
    }
    let (setup, cameras) = cameras(scene, &frame.camera, limits)?;
    let mut render = |request: &RenderRequest| render(renderer, volume, request);
    if let ViewChoice::Interpolated | ViewChoice::Refined = choice {
        let is_refined = choice == ViewChoice::Refined;
        return interpolated(scene, frame, limits, &cameras, (is_refined, keys), render);
    }
    let (since, mut pictures) = (Instant::now(), Vec::new());
    for camera in cameras {
        let seen = render(&scene.request.seen_by(camera))?;
        pictures.push(seen.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect());
    }
    let views_ms = milliseconds(since);
    let rendered = Views::new(frame.size_px, pictures)?;
    let synthesised = synthesised(&encoder, frame, limits)?;
    let psnr: Vec<f64> =
        rendered.pictures().iter().zip(synthesised.pictures()).map(|(a, b)| psnr_db(a, b)).collect();
    let file = match choice {
        ViewChoice::Both => both(&encoder, &rendered, &synthesised)?,
        _ => encode_views(layout, &rendered, encoder.panel())?,
    };
    let finite: Vec<f64> = psnr.iter().copied().filter(|db| db.is_finite()).collect();
    let mean = (!finite.is_empty()).then(|| finite.iter().sum::<f64>() / finite.len() as f64);
    let in_words: Vec<String> = psnr.iter().map(|db| format!("{db:.1}")).collect();
    let report = serde_json::json!({
        "eyes": scene.display.layout.eyes(scene.display.view_span),
        "converging_mm": setup.converging_mm,
        "baseline_mm": setup.baseline_mm,
        "parallax_difference_px": setup.difference_px,
        "views_ms": views_ms,
        // JSON has no infinity: a view that is equal has none.
        "psnr_db": psnr.iter().map(|db| db.is_finite().then_some(*db)).collect::<Vec<_>>(),
        "psnr_mean_db": mean,
    });
    let lines = vec![
        format!(
            "true views: cameras {:.2} mm apart for an eye separation, converging at {:.1} mm; parallax differs by up to \
             {:.2} px for it",
            setup.baseline_mm, setup.converging_mm, setup.difference_px
        ),
        format!("PSNR of synthesised views, dB: {}", in_words.join(" ")),
        mean.map_or("all views are equal".to_owned(), |mean| {
            format!("mean of those that differ: {mean:.2} dB")
        }),
    ];
    Ok(ViewFile { file, report, lines })
}

/// Views of one picture, as a display makes them.
fn from_one_picture(
    encoder: &FrameEncoder,
    frame: &RenderedFrame,
    limits: DepthLimits,
) -> anyhow::Result<ViewFile> {
    let since = Instant::now();
    let views = synthesised(encoder, frame, limits)?;
    let report = serde_json::json!({ "eyes": encoder.eyes(), "views_ms": milliseconds(since) });
    Ok(ViewFile { file: encode_views(encoder.layout(), &views, encoder.panel())?, report, lines: Vec::new() })
}

fn synthesised(encoder: &FrameEncoder, frame: &RenderedFrame, limits: DepthLimits) -> anyhow::Result<Views> {
    Ok(encoder.views(&frame.picture()?, limits)?)
}

/// The plane of the screen before a scene's camera, and the distance of eyes there.
pub(super) fn screen(scene: &Scene, camera: &Camera, limits: DepthLimits) -> anyhow::Result<TrueViews> {
    Ok(true_views(&scene.display, camera, scene.request.size_px, limits)?)
}

/// The cameras of a scene's views.
fn cameras(scene: &Scene, middle: &Camera, limits: DepthLimits) -> anyhow::Result<(TrueViews, Vec<Camera>)> {
    let setup = screen(scene, middle, limits)?;
    let cameras = eye_cameras(&setup, middle, &scene.display.encoder()?.eyes());
    Ok((setup, cameras.context("leave --fov-deg 0 out")?))
}

/// The quilt of rendered views above synthesised ones; `None` for layouts without a quilt.
fn both_layout(layout: Layout) -> Option<Layout> {
    let columns = u32::try_from(layout.view_count()).ok()?;
    match layout {
        Layout::Stereo | Layout::Views(_) => ViewGrid::new(columns, 2).map(Layout::Views),
        _ => None,
    }
}

/// Rendered views above synthesised ones: each kind in a row from left to right, or in one picture.
fn both(encoder: &FrameEncoder, rendered: &Views, synthesised: &Views) -> anyhow::Result<Vec<u8>> {
    let ([width, height], [above, below]) =
        (rendered.size_px(), [rendered.pictures(), synthesised.pictures()]);
    let (layout, panel) = (encoder.layout(), encoder.panel());
    if let Some(both) = both_layout(layout) {
        // Rows of quilts go upwards.
        let pictures = below.iter().chain(above).cloned().collect();
        return Ok(encode_views(both, &Views::new([width, height], pictures)?, panel)?);
    }
    let pairs = above.iter().zip(below);
    let pictures = pairs.map(|(above, below)| above.iter().chain(below).copied().collect()).collect();
    Ok(encode_views(layout, &Views::new([width, 2 * height], pictures)?, panel)?)
}
