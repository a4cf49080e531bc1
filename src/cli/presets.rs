//! `relief presets`: presets as a list, as JSON and as pictures of a volume; conversion of transfer
//! functions of other programs.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use serde_json::json;

use crate::adapter::AdapterArguments;
use crate::bucket::CopiesArguments;
use crate::output::{print_json, say, write_whole};
use crate::series;
use crate::source::SeriesOptions;
use crate::transfer::{Range, parse_range, read_look};
use relief_display::encode_png;
use relief_render::{RenderedFrame, Subject, preset_json};
use relief_session::encode;
use relief_session::{FileFormat, Product, THUMBNAIL_SIZE_PX, Thumbnail, contact_sheet, thumbnail_scene};
use relief_volume::{PRESETS, PhantomKind, PhantomRecipe, Preset, Volume};

/// List the presets of colours, opacity and light, render a thumbnail of each, or convert those of
/// other programs.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  relief presets                                       names, what they are for, and their colours
  relief presets --json                                all of it, with transfer functions as requests have them
  relief presets --thumbnails pictures --series chest  a PNG of each, and contact-sheet.png
  relief presets convert presets.xml --name CT-Bones   a preset of 3D Slicer, as a request has it"
)]
pub(super) struct PresetsArguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Render a PNG of each preset into this folder, and contact-sheet.png with all of them
    #[arg(long, value_name = "DIR")]
    thumbnails: Option<PathBuf>,
    /// CT series of the thumbnails: a folder, a file, a DICOMDIR or a zip; the procedural head when
    /// left out
    #[arg(long, value_name = "PATH", requires = "thumbnails")]
    series: Option<PathBuf>,
    #[command(flatten)]
    options: SeriesOptions,
    #[command(flatten)]
    copies: CopiesArguments,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    Convert(ConvertArguments),
}

/// Print the look in a file of another program as JSON: a scene, or a part of one
#[derive(Debug, clap::Args)]
struct ConvertArguments {
    /// presets.xml, .vp or .vp.json of 3D Slicer, or a colour map of VTK or ParaView in JSON
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The function, where the file holds several
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Stretch the colours over this range of HU: for maps of 0 to 1
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_range, allow_hyphen_values = true)]
    range_hu: Option<Range>,
}

pub(super) fn run(arguments: &PresetsArguments) -> anyhow::Result<ExitCode> {
    if let Some(Action::Convert(ConvertArguments { file, name, range_hu })) = &arguments.action {
        print_json(&read_look(file, name.as_deref(), *range_hu)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    match &arguments.thumbnails {
        Some(folder) => thumbnails(arguments, folder),
        None if arguments.json => {
            print_json(&json!({ "presets": PRESETS.iter().map(preset_json).collect::<Vec<_>>() }))?;
            Ok(ExitCode::SUCCESS)
        }
        None => {
            list();
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// Cells of a swatch.
const SWATCH: usize = 12;

/// The presets by group, in the order of menus within each.
fn list() {
    let colored = std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let mut groups: Vec<_> = PRESETS.iter().map(|preset| preset.group).collect();
    groups.sort_by_key(|group| PRESETS.iter().position(|preset| preset.group == *group));
    groups.dedup();
    for group in groups {
        say!("{}", group.name());
        for preset in PRESETS.iter().filter(|preset| preset.group == group) {
            let swatch = if colored { swatch(preset) } else { String::new() };
            say!("  {:<18} {swatch}{:<18} {}", preset.name, extent(preset), preset.purpose);
        }
    }
}

/// The values that show.
fn extent(preset: &Preset) -> String {
    match preset.visible_hu() {
        (low, Some(high)) => format!("{low} to {high} HU"),
        (low, None) => format!("above {low} HU"),
    }
}

/// Colours for a terminal: backgrounds in 24 bits, then back to the usual.
fn swatch(preset: &Preset) -> String {
    let cells = preset.swatch(SWATCH).into_iter().map(|[r, g, b]| format!("\x1b[48;2;{r};{g};{b}m "));
    format!("{}\x1b[0m  ", cells.collect::<String>())
}

/// Voxels across of the head that stands in for a series.
const HEAD_SIZE: usize = 160;
const SHEET_COLUMNS: usize = 6;
const SHEET_NAME: &str = "contact-sheet.png";

fn thumbnails(arguments: &PresetsArguments, folder: &Path) -> anyhow::Result<ExitCode> {
    if folder.exists() && !folder.is_dir() {
        bail!("{} is no folder", folder.display());
    }
    let volume = volume(arguments)?;
    let mut renderer = arguments.adapter.open_renderer()?;
    std::fs::create_dir_all(folder)?;
    let mut shown = Vec::with_capacity(PRESETS.len());
    for preset in PRESETS {
        let scene = thumbnail_scene(preset, &Subject::of(&volume, None), THUMBNAIL_SIZE_PX)?;
        let frame: RenderedFrame = renderer.render(&volume, &scene.request)?;
        let png = encode(&frame, &scene.display, Product::Frame, FileFormat::Png)?;
        write_whole(&folder.join(format!("{}.png", preset.name)), &png)?;
        shown.push((preset.name, frame));
    }
    let sheet = folder.join(SHEET_NAME);
    let thumbnails: Vec<_> = shown
        .iter()
        .map(|(name, frame)| Thumbnail { name, size_px: frame.size_px, color_rgba: &frame.color_rgba })
        .collect();
    write_whole(&sheet, &encode_png(&contact_sheet(&thumbnails, SHEET_COLUMNS)?)?)?;
    if arguments.json {
        let files: Vec<_> = PRESETS
            .iter()
            .map(|preset| json!({ "name": preset.name, "file": folder.join(format!("{}.png", preset.name)) }))
            .collect();
        print_json(&json!({ "thumbnails": files, "contact_sheet": sheet, "size_px": THUMBNAIL_SIZE_PX }))?;
    } else {
        let [width, height] = THUMBNAIL_SIZE_PX;
        say!("{}: {} thumbnails of {width}x{height}", folder.display(), shown.len());
        say!("{}: all of them", sheet.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn volume(arguments: &PresetsArguments) -> anyhow::Result<Volume> {
    let SeriesOptions { series_uid, phase, strict, downsample } = &arguments.options;
    match &arguments.series {
        Some(path) => {
            let (copies, options) = (&arguments.copies, &arguments.options);
            Ok(series::load_after(path, copies, options, |_| Ok(()))?.0.volume)
        }
        None if series_uid.is_some() || phase.is_some() || *strict || *downsample > 1 => {
            bail!(
                "--series-uid, --phase, --strict and --downsample are about a series; give one with --series PATH"
            )
        }
        None => Ok(PhantomRecipe::new(PhantomKind::Head).with_size(HEAD_SIZE)?.make().volume),
    }
}
