//! `relief convert`: plain pictures and films as 2D-plus-depth frames, with estimated depth.

mod depth;
mod source;
mod target;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::choices::layouts;
use crate::output::{print_json, say};
use depth::Estimator;
use relief_display::{ContentType, DepthFilter, DisplaySettings, FrameEncoder, Layout};
use relief_film::{Ffmpeg, FilmCodec, FrameRate};
use source::Pictures;
use target::Target;

/// Convert plain pictures or a film to 2D-plus-depth frames, with depth that a network estimates.
///
/// SOURCE is a picture (PNG, JPEG), a folder of pictures, or a film that ffmpeg reads. --out is a
/// picture (.png), a folder, or a film without loss (.mkv, .mp4), whose headers Relief checks after
/// encoding. The built-in network was trained on renders of volumes; for photographs use --model.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief convert render.png --estimate-depth --out frame.png
  relief convert pictures --estimate-depth --layout rgbd --out frames
  relief convert surgery.mp4 --estimate-depth --out surgery-3d.mkv
  relief convert photo.jpg --model depth_anything_v2_vits.onnx --out photo-3d.png
  relief convert pictures --estimate-depth --fps 25 --codec ffv1 --out film.mkv

Depth has no unit: the nearest surface is at the near limit of the display, the background at the far one.")]
pub(super) struct ConvertArguments {
    /// A picture, a folder of pictures, or a film
    #[arg(value_name = "PICTURE|FOLDER|FILM")]
    source: PathBuf,
    /// Output: a .png, a folder, or a film (.mkv, .mp4)
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Estimate the depth by the built-in network
    #[arg(long, required_unless_present = "model")]
    estimate_depth: bool,
    /// Estimate the depth by this network: ONNX in the layout of MiDaS or Depth Anything, or of
    /// scripts/depth-network
    #[arg(long, value_name = "FILE.onnx")]
    model: Option<PathBuf>,
    #[arg(long, value_name = "NAME", default_value = "wowvx", help = layouts("Layout of the frames", |layout| layout != Layout::Color))]
    layout: Layout,
    /// Depth effect of the header, 0 to 255: 64 is 100 %
    #[arg(long, value_name = "0..255", default_value_t = 64)]
    factor: u8,
    /// Disparity on the plane of the screen, 0 to 255
    #[arg(long, value_name = "0..255", default_value_t = 128)]
    offset: u8,
    /// Filter for depth in frames: none, median-3, median-5
    #[arg(long, value_name = "NAME", default_value = "none", value_parser = depth_filter)]
    depth_filter: DepthFilter,
    /// Pictures per second of a film from a folder
    #[arg(long, value_name = "RATE", default_value = "25")]
    fps: FrameRate,
    /// Codec of a film: h264, without loss in RGB, or ffv1, for archives in .mkv
    #[arg(long, value_name = "NAME", default_value = "h264")]
    codec: FilmCodec,
    /// The ffmpeg to use
    #[arg(long, value_name = "PATH", env = "RELIEF_FFMPEG", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Print the result as one JSON object
    #[arg(long)]
    json: bool,
}

fn depth_filter(name: &str) -> Result<DepthFilter, String> {
    let all = DepthFilter::ALL;
    let names = all.map(DepthFilter::name).join(", ");
    all.into_iter().find(|filter| filter.name() == name).ok_or_else(|| format!("filters are {names}"))
}

pub(super) fn run(arguments: &ConvertArguments) -> anyhow::Result<ExitCode> {
    let ConvertArguments { source, out, .. } = arguments;
    let pictures = Pictures::open(source, || Ok(Ffmpeg::find(&arguments.ffmpeg)?))
        .with_context(|| format!("cannot read {}", source.display()))?;
    let rate = pictures.rate().unwrap_or(arguments.fps);
    let encoder = encoder(arguments, pictures.is_film())?;
    let is_series = pictures.is_series();
    let mut estimator = Estimator::new(arguments.model.as_deref(), is_series && pictures.is_film())?;
    let mut target = Target::new(out, is_series, rate, arguments.codec)
        .with_context(|| format!("cannot write {}", out.display()))?;
    let bar = progress(pictures.total());
    let mut converted = 0_u64;
    for picture in pictures {
        let picture = picture?;
        let frame = estimator
            .frame(&encoder, &picture.pixels)
            .with_context(|| format!("cannot convert {}", picture.name))?;
        let find = || Ok(Ffmpeg::find(&arguments.ffmpeg)?);
        target
            .write(&picture.name, &frame, find)
            .with_context(|| format!("cannot write {}", out.display()))?;
        converted += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    if converted == 0 {
        bail!("{} has no pictures", source.display());
    }
    let checked = target.finish().with_context(|| format!("cannot write {}", out.display()))?;
    if arguments.json {
        print_json(&serde_json::json!({
            "out": out, "frames": converted, "layout": arguments.layout, "median_ms": estimator.median_ms(),
            "checked": checked,
        }))?;
    } else {
        let frames = if converted == 1 { "frame" } else { "frames" };
        say!(
            "{}: {converted} {frames}, layout {}, {:.0} ms each",
            out.display(),
            arguments.layout,
            estimator.median_ms()
        );
        if checked {
            say!("decoded again: all frames and headers are intact");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The encoder of the frames. The header names their content.
fn encoder(arguments: &ConvertArguments, is_film: bool) -> anyhow::Result<FrameEncoder> {
    let layout = arguments.layout;
    if layout == Layout::Color {
        bail!("--layout color has no depth; use a layout such as wowvx or rgbd");
    }
    if layout.needs_background() {
        bail!(
            "--layout {layout} needs a background layer, and only the front is estimated; use wowvx or rgbd"
        );
    }
    let display = DisplaySettings {
        layout,
        factor: arguments.factor,
        offset: arguments.offset,
        depth_filter: arguments.depth_filter,
        content: if is_film { ContentType::Movie } else { ContentType::Still },
        ..DisplaySettings::default()
    };
    Ok(display.encoder()?)
}

fn progress(count: Option<u64>) -> ProgressBar {
    let bar = match count {
        Some(1) => return ProgressBar::hidden(),
        Some(count) => ProgressBar::new(count),
        None => ProgressBar::new_spinner(),
    };
    bar.set_draw_target(ProgressDrawTarget::stderr());
    let template = if count.is_some() {
        "{bar:30} {pos}/{len} pictures, {eta} left"
    } else {
        "{spinner} {pos} pictures"
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}
