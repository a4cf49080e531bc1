//! `relief render`: a picture of a series as a file.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::bail;
use indicatif::{ProgressBar, ProgressStyle};

use crate::adapter::AdapterArguments;
use crate::annotated::draw_annotations;
use crate::eye::{EyeArguments, ViewingEye};
use crate::output::{print_json, say, write_whole};
use crate::quilt;
use crate::scene::SceneArguments;
use crate::series::SeriesArguments;
use crate::views;
use relief_annotation::ShownSets;
use relief_display::{DisplaySettings, Layout, USUAL_VIEW_CONE_DEG};
use relief_render::{
    Mode, PictureWarning, Progress, RenderError, RenderRequest, RenderedFrame, Renderer, Scene, SceneFile,
    Subject,
};
use relief_session::encode;
use relief_session::{FileFormat, Product, SpeedBook};
use relief_volume::{Projection, Volume};

/// Render a series to a file: a 2D-plus-depth frame, colour, or depth.
///
/// The extension of --out selects the content: .png is lossless in the chosen layout, .jpg is the
/// colour, .exr has colour and view depth in mm. --depth-out writes the depth: .png as 16-bit grey
/// (nearest brightest), .exr in mm.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief render --series head --preset bone --out head.png
  relief render --series head --preset skin --azimuth-deg 40 --layout color --out side.png
  relief render --series chest --plane axial --offset-mm 40 --layout color --out slice.png
  relief render --series chest --plane coronal --slab-mm 10 --slab-blend mip --layout color --out slab.png
  relief render --series head --preset bone --lights studio --shadows 0.8 --occlusion 0.7 --layout color --out lit.png
  relief render --series abdomen --labels segments.nii.gz --preset soft-tissue --keep-labels liver,spleen --out organs.png
  relief render --series head --mode path-traced --passes 256 --layout color --out light.png
  relief render --series chest --preset skin --budget-ms 100 --layout color --out quick.png
  relief render --series head --preset bone --layout wiggle --out wiggle.png
  relief render --series head --preset bone --size 420x560 --out head_qs5x9a0.75.png
  relief render --series head --preset bone --layout lenses-9 --panel panel.json --size 3840x2160 --out panel.png
  relief render --series head --preset bone --layout views-9 --views both --out compared.png
  relief render --series head --annotations head.db --set anna --layout color --out placed.png
  relief render --series chest --scene scene.json --out frame.png --depth-out depth.exr")]
pub(super) struct RenderArguments {
    #[command(flatten)]
    series: SeriesArguments,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    eye: EyeArguments,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Output file: .png, .jpg or .exr
    #[arg(long, value_name = "FILE", value_parser = parse_picture)]
    out: Output,
    /// File for the depth: .png or .exr
    #[arg(long, value_name = "FILE", value_parser = parse_depth)]
    depth_out: Option<Output>,
    /// Most time for rendering the picture: fewer rays, samples or passes, and enlarged, if it
    /// would take longer. Two very small pictures before it measure how fast this machine is
    #[arg(long, value_name = "MS")]
    budget_ms: Option<f64>,
    /// Draw the annotations of this log over the picture: a file, sqlite:FILE or
    /// postgres://USER@HOST/DATABASE
    #[arg(long, value_name = "PLACE")]
    annotations: Option<String>,
    /// Sets of annotations to draw; all that are not blinded where none is named
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "annotations")]
    set: Vec<String>,
    /// How views are made [default: interpolated if --view-cone, the --panel or the name of a quilt sets
    /// a view cone, else synthesised]
    #[arg(long, value_name = "WHICH")]
    views: Option<views::ViewChoice>,
    /// Number of views that are rendered with --views interpolated or refined: a fifth of them where left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    key_views: Option<u16>,
    /// Print the result as one JSON object
    #[arg(long)]
    json: bool,
}

/// A file to write and how.
#[derive(Clone, Debug)]
struct Output {
    path: PathBuf,
    format: FileFormat,
}

fn parse_picture(text: &str) -> Result<Output, String> {
    parse_output(
        text,
        &[
            ("png", FileFormat::Png),
            ("jpg", FileFormat::Jpeg),
            ("jpeg", FileFormat::Jpeg),
            ("exr", FileFormat::Exr),
        ],
    )
}

fn parse_depth(text: &str) -> Result<Output, String> {
    parse_output(text, &[("png", FileFormat::Png), ("exr", FileFormat::Exr)])
}

fn parse_output(text: &str, formats: &[(&str, FileFormat)]) -> Result<Output, String> {
    let path = PathBuf::from(text);
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
    match formats.iter().find(|(known, _)| *known == ending) {
        Some(&(_, format)) => Ok(Output { path, format }),
        None => {
            let known: Vec<String> = formats.iter().map(|(known, _)| format!(".{known}")).collect();
            Err(format!("the file's ending is {ending:?}, allowed: {}", known.join(", ")))
        }
    }
}

impl RenderArguments {
    /// The scene that the arguments describe, checked before the long work.
    fn scene_file(&self) -> anyhow::Result<SceneFile> {
        let mut file = self.scene.read()?;
        if let Some(ms) = self.budget_ms {
            file = file.with_budget_ms(ms);
        }
        if self.annotations.is_some() && (file.annotations().is_nothing() || !self.set.is_empty()) {
            let shown = ShownSets::of_names(self.set.iter().map(String::as_str)).map_err(anyhow::Error::msg);
            file = file.with_annotations(if self.set.is_empty() { ShownSets::All } else { shown? });
        }
        if self.out.format == FileFormat::Png {
            let mut display = file.display().clone();
            let of_file = Some(display.layout).filter(|layout| *layout != Layout::default());
            let layout = quilt::layout_of(&self.out.path, self.scene.layout().or(of_file))?;
            display.layout = layout.unwrap_or(display.layout);
            file = file.with_display(display);
        }
        Ok(file)
    }

    /// Refuses scenes that the output or the views contradict, before rendering.
    fn check(&self, scene: &Scene) -> anyhow::Result<()> {
        if self.out.format == FileFormat::Png {
            scene.expect_size_of_layout()?;
            quilt::check_aspect(&self.out.path, scene.request.size_px)?;
        } else if self.views.is_some() {
            bail!("--views is for .png files");
        }
        let layout = scene.display.layout;
        if self.scene.has_view_angle() && (layout.view_count() == 0 || self.out.format != FileFormat::Png) {
            bail!(
                "--view-span and --view-cone are for .png files with a layout of views, such as views-9; \
                 this one is {layout}"
            );
        }
        views::check(self.view_choice(scene), self.key_views, scene)
    }

    /// The scene with the usual view cone if the output has the name of a quilt and no cone or span was
    /// given. A parallel projection gets none: it has no eyes.
    fn with_usual_cone(&self, scene: Scene) -> Scene {
        let display = &scene.display;
        let is_given = display.view_span.or(display.view_cone_deg).is_some();
        let is_quilt = self.out.format == FileFormat::Png && quilt::is_named(&self.out.path);
        if !is_quilt || is_given || !has_eyes(&scene) {
            return scene;
        }
        let display = DisplaySettings { view_cone_deg: Some(USUAL_VIEW_CONE_DEG), ..display.clone() };
        scene.with_display(display)
    }

    /// How the views of a scene are made: as --views says. Views of a cone are interpolated by default,
    /// because views made of one picture are poor far from its middle.
    fn view_choice(&self, scene: &Scene) -> views::ViewChoice {
        let is_still = scene.budget_ms.is_none() && !matches!(scene.request.mode, Mode::Slice(_));
        let has_cone = scene.display.view_cone().is_some() && has_eyes(scene);
        let is_wide = has_cone && scene.display.layout.view_count() > 2;
        self.views.unwrap_or(if is_wide && is_still && self.out.format == FileFormat::Png {
            views::ViewChoice::Interpolated
        } else {
            views::ViewChoice::Synthesised
        })
    }
}

/// Whether the scene is seen in perspective: a parallel projection has no eye that could be moved.
fn has_eyes(scene: &Scene) -> bool {
    matches!(scene.request.camera.projection(), Projection::Perspective { .. })
}

pub(super) fn run(arguments: &RenderArguments) -> anyhow::Result<ExitCode> {
    let scene_file = arguments.scene_file()?;
    let RenderArguments { series, adapter, out, depth_out, key_views, json, .. } = arguments;
    check_outputs(out, depth_out.as_ref())?;
    let eye = arguments.eye.read()?;
    let (loaded, mut renderer) = series.load_after(|dims| adapter.open_renderer_for(dims))?;
    let labels = series.load_labels(loaded.volume.grid())?;
    let subject = Subject::of(&loaded.volume, labels.as_ref());
    let scene = scene_file.resolve_for(&subject, &arguments.scene.orbit())?;
    let mut scene = arguments.with_usual_cone(scene);
    if arguments.out.format != FileFormat::Png {
        scene.request.for_views = None; // the other formats have the depth of rays
    }
    draw_annotations(arguments.annotations.as_deref(), &loaded, &mut scene)?;
    arguments.check(&scene)?;
    let choice = arguments.view_choice(&scene);
    if eye.is_some() {
        ViewingEye::check(&scene)?;
    }
    if let Some(ms) = scene.budget_ms {
        scene.request = within_budget(&mut renderer, &loaded.volume, &scene.request, ms)?;
    }
    let mut frame = render(&mut renderer, &loaded.volume, &scene.request)?;
    if let Some(eye) = &eye {
        scene = eye.scene(&scene, &frame)?;
        frame = render(&mut renderer, &loaded.volume, &scene.request)?;
    }
    let range_hu = loaded.volume.range_hu();
    if let Some(warning) = PictureWarning::of(&frame, &scene.display, &scene.request, &subject, range_hu) {
        eprintln!("warning: {warning}");
    }
    let has_views = out.format == FileFormat::Png && scene.display.layout.view_count() > 0;
    let made = match choice {
        views::ViewChoice::Synthesised if !has_views => None,
        _ => Some(views::make(
            (choice, key_views.map(usize::from)),
            &scene,
            &frame,
            &mut renderer,
            &loaded.volume,
            render,
        )?),
    };
    let outputs = [Some((out, Product::Frame)), depth_out.as_ref().map(|out| (out, Product::Depth))];
    for (output, product) in outputs.into_iter().flatten() {
        let bytes = match (&made, product) {
            (Some(made), Product::Frame) => made.file.clone(),
            _ => encode(&frame, &scene.display, product, output.format)?,
        };
        write_whole(&output.path, &bytes)?;
    }
    let depth_out = depth_out.as_ref().map(|out| out.path.as_path());
    let written = Written { out: &out.path, depth_out, views: made.as_ref(), eye: eye.as_ref() };
    report(&renderer, &scene, &frame, &written, *json)
}

/// Renders as the mode wants it.
fn render(
    renderer: &mut Renderer,
    volume: &Volume,
    request: &RenderRequest,
) -> anyhow::Result<RenderedFrame> {
    Ok(match request.mode {
        Mode::PathTraced => render_passes(renderer, volume, request)?,
        _ => renderer.render(volume, request)?,
    })
}

/// The request, reduced as far as a budget wants it by the speed of two very small pictures; the
/// first one only compiles.
fn within_budget(
    renderer: &mut Renderer,
    volume: &Volume,
    request: &RenderRequest,
    budget_ms: f64,
) -> Result<RenderRequest, RenderError> {
    let least = SpeedBook::least(request);
    renderer.render(volume, &least)?;
    let (hash, grid) = (volume.content_hash(), volume.grid());
    // Another seed: cached paths would take no time.
    let mut measured = least;
    measured.path_trace.seed ^= 1;
    let ms = renderer.render(volume, &measured)?.timings.render_ms;
    let mut speeds = SpeedBook::default();
    speeds.record(hash, grid, &measured, measured.path_trace.passes, ms);
    Ok(speeds.plan(hash, grid, request, budget_ms).request)
}

/// Renders pass by pass: a progress bar on a terminal, log lines at times elsewhere.
fn render_passes(
    renderer: &mut Renderer,
    volume: &Volume,
    request: &RenderRequest,
) -> Result<RenderedFrame, RenderError> {
    const BETWEEN_LINES: Duration = Duration::from_secs(10);
    let passes = request.path_trace.passes;
    let style = ProgressStyle::with_template("{msg:20} {bar:40} {pos}/{len} passes, {eta} left");
    let bar =
        ProgressBar::new(passes.into()).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message("tracing paths");
    let mut printed = Instant::now();
    let frame = renderer.render_watched(volume, request, &mut |Progress { passes: done, .. }| {
        bar.set_position(done.into());
        if bar.is_hidden() && printed.elapsed() > BETWEEN_LINES {
            printed = Instant::now();
            tracing::info!("{done} of {passes} passes");
        }
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    frame
}

/// Refuses outputs that could not be written in the end.
fn check_outputs(out: &Output, depth_out: Option<&Output>) -> anyhow::Result<()> {
    if depth_out.is_some_and(|depth| depth.path == out.path) {
        bail!("--out and --depth-out both name {}", out.path.display());
    }
    for Output { path, .. } in [Some(out), depth_out].into_iter().flatten() {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("cannot write {}: there is no folder {}", path.display(), folder.display());
        }
    }
    Ok(())
}

/// The settings chosen for the anatomy, with the reason.
fn chosen(scene: &Scene) -> Option<String> {
    let anatomy = scene.chosen?;
    let is_slice = matches!(scene.request.mode, Mode::Slice(_));
    if let Some(preset) = anatomy.preset().filter(|_| !is_slice) {
        return Some(format!("preset {} for {anatomy}; --preset shows another", preset.name));
    }
    let [center, width] = anatomy.window_hu();
    let unit = anatomy.quantity().unit();
    Some(format!("window {center},{width} {unit} for {anatomy}; --window-hu shows another"))
}

/// The files of a picture.
struct Written<'a> {
    out: &'a Path,
    depth_out: Option<&'a Path>,
    views: Option<&'a views::ViewFile>,
    eye: Option<&'a ViewingEye>,
}

fn report(
    renderer: &Renderer,
    scene: &Scene,
    frame: &RenderedFrame,
    &Written { out, depth_out, views, eye }: &Written<'_>,
    json: bool,
) -> anyhow::Result<ExitCode> {
    let adapter = renderer.adapter();
    let limits = frame.limits_for(&scene.display)?;
    let rays_px = scene.request.reduced_px.unwrap_or(frame.size_px);
    if json {
        let mut made = serde_json::json!({
            "out": out,
            "depth_out": depth_out,
            "size_px": frame.size_px,
            "near_mm": limits.near_mm,
            "far_mm": limits.far_mm,
            "edges": frame.camera.edge_labels(),
            "chosen": chosen(scene),
            "adapter": adapter.name,
            "driver": adapter.driver,
            "left_by_processor": renderer.left_by_processor(),
            "upload_ms": frame.timings.upload_ms,
            "render_ms": frame.timings.render_ms,
            "overlay_ms": frame.timings.overlay_ms,
        });
        if let Some(budget_ms) = scene.budget_ms {
            made["budget_ms"] = budget_ms.into();
            made["rays_px"] = rays_px.to_vec().into();
            made["sample_distance_mm"] = scene.request.sample_distance_mm.into();
            if scene.request.mode == Mode::PathTraced {
                made["passes"] = scene.request.path_trace.passes.into();
            }
        }
        if let Some(views) = views {
            made["views"] = views.report.clone();
        }
        if let Some(eye) = eye {
            made["eye"] = eye.report(scene);
        }
        print_json(&made)?;
    } else {
        if let Some(line) = chosen(scene) {
            say!("{line}");
        }
        let [width, height] = frame.size_px;
        say!("{}: {width}x{height} in {:.0} ms on {adapter}", out.display(), frame.timings.render_ms);
        if let Some(part) = renderer.left_by_processor() {
            say!("{part}: not rendered by the processor's own ray caster, but by this adapter");
        }
        if scene.budget_ms.is_some() {
            let [columns, rows] = rays_px;
            say!("under a budget: {columns}x{rows} rays, samples of {} mm", scene.request.sample_distance_mm);
        }
        for line in views.into_iter().flat_map(|views| &views.lines) {
            say!("{line}");
        }
        if let Some(hint) = quilt::hint(out, scene.display.layout, frame.size_px) {
            say!("{hint}");
        }
        if let Some(path) = depth_out {
            say!("{}: depth", path.display());
        }
    }
    Ok(ExitCode::SUCCESS)
}
