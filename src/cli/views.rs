//! `relief render --views`: views rendered by cameras side by side, beside those that a display
//! makes of one picture.

use std::time::Instant;

use anyhow::{Context, bail};

use crate::output::milliseconds;
use relief_base::DepthLimits;
use relief_display::{
    FrameEncoder, Layout, Picture, TrueViews, ViewGrid, Views, encode_views, interpolate, psnr_db,
};
use relief_render::{Mode, RenderRequest, RenderedFrame, Renderer, Scene};
use relief_volume::{Camera, Volume};

/// Which views are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum ViewChoice {
    /// Made of one picture and its disparity, as a 2D-plus-depth display makes them
    #[default]
    Synthesised,
    /// Rendered, each by a camera of its own
    True,
    /// Every few views rendered, those between made of their two neighbours: nearly true, and faster
    Interpolated,
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
    if keys.is_some() && choice != ViewChoice::Interpolated {
        bail!("--key-views is for --views interpolated");
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

/// Views of which only some are rendered.
fn interpolated(
    scene: &Scene,
    middle: &RenderedFrame,
    limits: DepthLimits,
    cameras: Vec<Camera>,
    keys: Option<usize>,
    mut render: impl FnMut(Camera) -> anyhow::Result<RenderedFrame>,
) -> anyhow::Result<ViewFile> {
    let encoder = scene.display.encoder()?;
    let eyes = encoder.eyes();
    let numbers = key_numbers(eyes.len(), keys);
    let mut cameras: Vec<Option<Camera>> = cameras.into_iter().map(Some).collect();
    let (since, mut rendered) = (Instant::now(), Vec::new());
    for &number in &numbers {
        let Some(camera) = cameras[number].take() else { continue };
        let other; // the picture in the middle is there already
        let seen = if eyes[number] == 0.0 {
            middle
        } else {
            other = render(camera)?;
            &other
        };
        let picture = Picture::new(seen.size_px, &seen.color_rgba, &seen.depth_mm)?;
        rendered.push(encoder.key_view(eyes[number], &picture, limits));
    }
    let size_px = scene.request.size_px;
    let views = interpolate(size_px, &rendered, &encoder.parallax(size_px[0]), &eyes)?;
    Ok(ViewFile {
        file: encode_views(scene.display.layout, &views, encoder.panel())?,
        report: serde_json::json!({ "eyes": eyes, "rendered": numbers, "views_ms": milliseconds(since) }),
        lines: vec![format!("{} views, {} of them rendered", eyes.len(), rendered.len())],
    })
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
    let encoder = scene.display.encoder()?;
    let layout = encoder.layout();
    let limits = frame.limits_for(&scene.display)?;
    if choice == ViewChoice::Synthesised {
        return from_one_picture(&encoder, frame, limits);
    }
    let (setup, cameras) = cameras(scene, &frame.camera, limits)?;
    let mut seen_by =
        |camera: Camera| render(renderer, volume, &RenderRequest { camera, ..scene.request.clone() });
    if choice == ViewChoice::Interpolated {
        return interpolated(scene, frame, limits, cameras, keys, seen_by);
    }
    let (since, mut pictures) = (Instant::now(), Vec::new());
    for camera in cameras {
        let seen = seen_by(camera)?;
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
    let mut picture = Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm)?;
    if let Some(back) = &frame.back {
        picture = picture.with_back(&back.color_rgba, &back.depth_mm)?;
    }
    Ok(encoder.views(&picture, limits)?)
}

/// Where the plane of the screen lies before a scene's camera, and how far apart eyes are there.
pub(super) fn screen(scene: &Scene, camera: &Camera, limits: DepthLimits) -> anyhow::Result<TrueViews> {
    let size_px = scene.request.size_px;
    let [half_width, _] = camera.half_extent(size_px);
    let parallax = scene.display.encoder()?.parallax(size_px[0]);
    let setup = parallax.true_views(limits, half_width, size_px[0]);
    setup.context("the plane of the screen is behind the camera: set near_mm and far_mm, or another offset")
}

/// The cameras of a scene's views.
fn cameras(scene: &Scene, middle: &Camera, limits: DepthLimits) -> anyhow::Result<(TrueViews, Vec<Camera>)> {
    let setup = screen(scene, middle, limits)?;
    let cameras = scene.display.encoder()?.eyes().into_iter().map(|eye| {
        middle.seen_from_beside(eye * setup.baseline_mm, setup.converging_mm).context(
            "true views need a perspective: a parallel projection has no eye to be moved (leave --fov-deg 0 out)",
        )
    });
    Ok((setup, cameras.collect::<anyhow::Result<_>>()?))
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
