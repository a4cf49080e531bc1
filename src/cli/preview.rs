//! `relief preview`: the views that a display synthesises from a frame file.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};

use crate::against_true::AgainstTrue;
use crate::choices::layouts;
use crate::frame_file::read_bounded;
use crate::output::{print_json, say, write_whole};
use crate::panel::panel_for;
use crate::quilt;
use relief_display::{
    DisplayProfile, DisplaySettings, FrameReport, Layout, Parallax, ProfileName, Views, decode_wiggle,
    encode_views, read_png, synthesize,
};

/// Assumed settings of the display where a header leaves factor or offset to it.
const USUAL_FACTOR: u8 = 64;
const USUAL_OFFSET: u8 = 128;

/// Show the views that a 2D-plus-depth display synthesises from a frame: side by side, as an
/// anaglyph or as a wiggle.
///
/// The frame may have any layout with picture and disparity, and may come from any program. A file
/// of views (stereo, views-N, wiggle) becomes another layout of the same number of views, or of its
/// outermost two.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief preview frame.png --layout wiggle --out wiggle.png
  relief preview frame.png --layout views-9x1 --factor 128 --out strip.png
  relief preview frame.png --layout lenses-9 --panel panel.json --out interlaced.png
  relief preview quilt.png --layout anaglyph --out anaglyph.png
  relief render --series chest --layout views-9x1 --view-span 4 --views true --out true.png
  relief preview frame.png --layout views-9x1 --view-span 4 --against-true true.png --map map.png --out made.png")]
pub(super) struct PreviewArguments {
    /// The frame (PNG)
    #[arg(value_name = "FRAME.png")]
    frame: PathBuf,
    #[arg(long, value_name = "NAME", help = format!("{} [default: wiggle, or the quilt that the name of --out says]", layouts("The layout of the output", |layout| layout.view_count() > 0)))]
    layout: Option<Layout>,
    /// Output file: .png
    #[arg(long, value_name = "FILE", value_parser = parse_png)]
    out: PathBuf,
    /// Depth effect in place of the header's: 64 is 100 %
    #[arg(long, value_name = "0..255")]
    factor: Option<u8>,
    /// Disparity on the screen plane in place of the header's
    #[arg(long, value_name = "0..255")]
    offset: Option<u8>,
    /// The display: philips-20, philips-42 or dimenco-4k; the usual one of the frame's layout where
    /// left out
    #[arg(long, value_name = "NAME", value_parser = parse_profile)]
    profile: Option<ProfileName>,
    /// Eye separations between the outermost views: 1 for two views and 2 for more where left out
    #[arg(long, value_name = "EYES")]
    view_span: Option<f64>,
    /// The panel that views are interlaced for with lenses-N: a JSON file of pitch_px, slant, center,
    /// subpixels and is_reversed, or the calibration of a Looking Glass
    #[arg(long, value_name = "FILE.json")]
    panel: Option<PathBuf>,
    #[command(flatten)]
    against_true: AgainstTrue,
    /// Print the result as one JSON object
    #[arg(long)]
    json: bool,
}

pub(crate) fn parse_png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    if is_png { Ok(path) } else { Err("the file's ending has to be .png".to_owned()) }
}

fn parse_profile(name: &str) -> Result<ProfileName, String> {
    let names = ProfileName::ALL.map(ProfileName::name).join(", ");
    ProfileName::from_name(name).ok_or_else(|| format!("profiles are {names}"))
}

pub(super) fn run(arguments: &PreviewArguments) -> anyhow::Result<ExitCode> {
    let PreviewArguments { frame: path, out, .. } = arguments;
    let layout = &quilt::layout_of(out, arguments.layout)?.unwrap_or(Layout::Wiggle);
    if layout.view_count() == 0 {
        bail!(
            "--layout {layout} is no layout of views; {}",
            layouts("allowed", |layout| layout.view_count() > 0)
        );
    }
    let panel =
        arguments.panel.as_deref().map(|path| panel_for(*layout, path)).transpose()?.unwrap_or_default();
    let file = read_bounded(path).with_context(|| format!("cannot read {}", path.display()))?;
    let (views, factor_and_offset) = views(arguments.view_options(), *layout, &file)
        .with_context(|| format!("cannot preview {}", path.display()))?;
    quilt::check_aspect(out, views.size_px())?;
    let likeness = arguments.against_true.compare(&views)?;
    write_whole(out, &encode_views(*layout, &views, &panel)?)?;
    let [width, height] = views.size_px();
    if arguments.json {
        let [factor, offset] = factor_and_offset.map_or([None; 2], |values| values.map(Some));
        print_json(&serde_json::json!({
            "out": out, "layout": layout, "views": views.pictures().len(), "size_px": [width, height],
            "factor": factor, "offset": offset, "against_true": likeness.map(|likeness| likeness.report()),
        }))?;
    } else {
        say!("{}: {} views of {width}x{height}, layout {layout}", out.display(), views.pictures().len());
        if let Some(likeness) = likeness {
            say!("{}", likeness.words());
        }
        if let Some(hint) = quilt::hint(out, *layout, views.size_px()) {
            say!("{hint}");
        }
        if let Some([factor, offset]) = factor_and_offset {
            say!("factor {factor} ({:.0} %), offset {offset}", f64::from(factor) / 0.64);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// How views are made of a frame. `None` stands for the value in the frame's header, or the default.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ViewOptions {
    pub(crate) factor: Option<u8>,
    pub(crate) offset: Option<u8>,
    pub(crate) profile: Option<ProfileName>,
    /// Eye separations between the outermost views.
    pub(crate) view_span: Option<f64>,
}

impl PreviewArguments {
    fn view_options(&self) -> ViewOptions {
        let Self { factor, offset, profile, view_span, .. } = *self;
        ViewOptions { factor, offset, profile, view_span }
    }
}

/// The views of a frame. Where they were made of disparity, also factor and offset.
pub(crate) fn views(
    options: ViewOptions,
    layout: Layout,
    file: &[u8],
) -> anyhow::Result<(Views, Option<[u8; 2]>)> {
    DisplaySettings { view_span: options.view_span, ..DisplaySettings::default() }.validate()?;
    let (frame, report) = read_png(file)?;
    if report.layout == Layout::Wiggle {
        return Ok((as_many(decode_wiggle(file)?, layout)?, None));
    }
    let decoded = report.layout.decode(&frame).map_err(|problems| {
        let list: Vec<String> =
            problems.iter().map(|problem| format!("{problem}: {}", problem.advice())).collect();
        anyhow::anyhow!("the frame is no whole {} frame: {}", report.layout, list.join("; "))
    })?;
    if let Some(views) = decoded.views {
        return Ok((as_many(views, layout)?, None));
    }
    let size_px = decoded.size_px;
    let Some((front, back)) = decoded.into_layers() else {
        bail!(
            "the picture has no disparity beside it (layout {}): relief inspect prints its content",
            report.layout
        );
    };
    let values = factor_and_offset(options, &report);
    let usual =
        if report.layout == Layout::Wowvx4k { ProfileName::Dimenco4k } else { ProfileName::Philips42 };
    let profile = DisplayProfile::named(options.profile.unwrap_or(usual));
    let parallax = Parallax::new(&profile, values[0], values[1], size_px[0]);
    layout.check_size(size_px)?;
    let eyes = layout.eyes(options.view_span);
    Ok((synthesize(size_px, &front, back.as_ref(), &parallax, &eyes)?, Some(values)))
}

/// Factor and offset: the given ones, else those that the header selects, else the defaults.
fn factor_and_offset(options: ViewOptions, report: &FrameReport) -> [u8; 2] {
    let selected = report.select;
    let factor = report.factor.filter(|_| selected.is_some_and(|select| select.factor));
    let offset = report.offset.filter(|_| selected.is_some_and(|select| select.offset));
    [options.factor.or(factor).unwrap_or(USUAL_FACTOR), options.offset.or(offset).unwrap_or(USUAL_OFFSET)]
}

/// The views for a layout: all where it has as many, or the outermost two. A wiggle takes any
/// number.
fn as_many(views: Views, layout: Layout) -> anyhow::Result<Views> {
    let found = views.pictures().len();
    match (layout, views.pictures()) {
        (Layout::Wiggle, _) => Ok(views),
        _ if layout.view_count() == found => Ok(views),
        (_, [left, .., right]) if layout.view_count() == 2 => {
            Ok(Views::new(views.size_px(), vec![left.clone(), right.clone()])?)
        }
        _ => bail!(
            "the file has {found} views, layout {layout} has {}: views are not made of views",
            layout.view_count()
        ),
    }
}
