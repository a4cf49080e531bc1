//! Options that describe a scene, shared by render and bench.

use std::path::PathBuf;

use anyhow::{Context, bail};

use crate::choices::{depth_rules, framing_rules, layouts, qualities, table_rules};
use crate::light::LightArguments;
use crate::panel::panel_for;
use crate::slice::{SliceArguments, parse_triple};
use crate::transfer::TransferArguments;
use relief_display::{DepthFilter, DepthRange, DisplaySettings, Layout, ScreenPlane};
use relief_render::{
    Classification, CutChoice, CutFaces, DepthRule, FramingRule, Mode, Overlays, Quality, SceneFile,
    TableRule,
};
use relief_volume::{Orbit, PRESETS};

/// A scene file, and options that override it.
#[derive(Debug, clap::Args)]
pub(super) struct SceneArguments {
    /// Scene as JSON: camera, transfer function, size, display; every part may be left out
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Preset of colours and light, such as bone, skin, lung or vessels; `relief presets` lists all
    /// [default: one that suits the body part and contrast medium]
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    preset: Option<String>,
    #[command(flatten)]
    transfer: TransferArguments,
    /// How samples become a colour: composite, mip, minip, mean, average, additive, isosurface,
    /// path-traced (scattered light, see --passes), or slice (see --plane)
    #[arg(long, value_name = "MODE", value_parser = parse_mode)]
    mode: Option<Mode>,
    /// Values that a sample of mode composite stands for: sampled, the one in its middle, or
    /// pre-integrated, all that its path passes: as close at twice the sample distance, and thin
    /// layers are not missed
    #[arg(long, value_name = "NAME", value_parser = parse_classification)]
    classification: Option<Classification>,
    /// How cut faces look, where the volume's edge or a clip opens a body: lit, in the colours of the
    /// preset, or slice, the slice of the volume in grey, as anatomists cut [default: lit]
    #[arg(long, value_name = "NAME", value_parser = parse_cut)]
    cut: Option<CutChoice>,
    /// How closely mode composite is sampled: still, four samples a voxel, or moving, two, which is
    /// faster and leaves faint rings on surfaces [default: still]
    #[arg(long, value_name = "QUALITY", value_parser = qualities())]
    quality: Option<Quality>,
    /// Value of an opaque isosurface, in HU; its colour is the preset's there
    #[arg(long, value_name = "HU", allow_negative_numbers = true)]
    iso_hu: Option<f64>,
    /// Paths through each pixel in mode path-traced; noise falls with the square root
    #[arg(long, value_name = "N")]
    passes: Option<u32>,
    /// Most scatterings of light on its way to the eye in mode path-traced: 1 to 64; shadows
    /// are brighter and softer with more [default: 1]
    #[arg(long, value_name = "N")]
    scatterings: Option<u32>,
    /// Remove the noise of mode path-traced: few passes then look like many
    #[arg(long)]
    denoise: bool,
    #[command(flatten)]
    light: LightArguments,
    /// Drawn over the picture, in its depth: bounding-box, cube, scale-bar, caption
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_overlay)]
    overlay: Vec<String>,
    /// Write the body part, the size and the beginning of the content hash over the picture: the same
    /// as --overlay caption
    #[arg(long)]
    caption: bool,
    /// Segments of --labels to hide, by label or name; 0 is the voxels without a segment
    #[arg(long, value_name = "LABELS", value_delimiter = ',', conflicts_with = "keep_labels")]
    cut_labels: Vec<String>,
    /// The only segments of --labels to show, by label or name
    #[arg(long, value_name = "LABELS", value_delimiter = ',')]
    keep_labels: Vec<String>,
    /// Strength of the segments' tint, 0 to 1 [default: 0.5]
    #[arg(long, value_name = "SHARE")]
    label_tint: Option<f64>,
    /// Depth of a semi-transparent ray [default: views for frames with disparity and for layouts of views,
    /// in mode composite and in a perspective; else two-layer for layouts with a background, threshold
    /// for others]
    #[arg(long, value_name = "RULE", value_parser = depth_rules())]
    depth_rule: Option<DepthRule>,
    #[arg(long, value_name = "NAME", help = layouts("Layout of a .png frame (views-N and views-CxR for other quilts)", |_| true))]
    layout: Option<Layout>,
    /// Eye separations between the outermost views: 1 for two views and 2 for more where left out
    #[arg(long, value_name = "EYES", allow_negative_numbers = true)]
    view_span: Option<f64>,
    /// Angle between the outermost views in degrees, in place of --view-span [default: the view cone of
    /// the --panel; 35 if --out has the name of a quilt]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, conflicts_with = "view_span")]
    view_cone: Option<f64>,
    /// The panel that layouts lenses-N are for: a JSON file of pitch_px, slant, center, subpixels,
    /// is_reversed and view_cone_deg, or the calibration of a Looking Glass
    #[arg(long, value_name = "FILE.json")]
    panel: Option<PathBuf>,
    /// Filter for depth in frames: none, median-3, median-5
    #[arg(long, value_name = "NAME", value_parser = parse_depth_filter)]
    depth_filter: Option<DepthFilter>,
    /// View depths between which disparity is spread: those of the visible surfaces, those of the
    /// volume's bounding sphere, or NEAR,FAR in mm [default: visible]
    #[arg(long, value_name = "visible|volume|NEAR,FAR", value_parser = parse_depth_range)]
    depth_range: Option<DepthRangeOption>,
    /// Point of the patient to put on the plane of the screen, where a display is sharpest: LPS mm,
    /// such as a landmark's; not with --depth-range NEAR,FAR
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple, allow_negative_numbers = true)]
    screen_plane: Option<[f64; 3]>,
    /// Size of the picture (in 2D-plus-depth layouts, of each half); the layout decides when left
    /// out
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Direction of view about the long axis: 0 the front, 90 the patient's left, 180 the back
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    azimuth_deg: f64,
    /// Elevation of the view: 90 is from the head, -90 from the feet
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    elevation_deg: f64,
    /// The part that zoom 1 fits to the picture: what is visible with the preset and clips, all tissue,
    /// or the bounding sphere of the volume [default: visible]
    #[arg(long, value_name = "RULE", value_parser = framing_rules())]
    frame: Option<FramingRule>,
    /// Whether the table, headrest and sheets below the patient are shown [default: remove]
    #[arg(long, value_name = "RULE", value_parser = table_rules())]
    table: Option<TableRule>,
    /// 1 fits the whole (see --frame); larger is closer
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_negative_numbers = true)]
    zoom: f64,
    /// Full vertical field of view at zoom 1; 0 is a parallel projection
    #[arg(long, value_name = "DEG", default_value_t = 22.0, allow_negative_numbers = true)]
    fov_deg: f64,
    /// Show values by a window: centre and width in HU (a slice without one has one that
    /// suits the body part)
    #[arg(long, value_name = "CENTER,WIDTH", value_parser = parse_window, allow_hyphen_values = true, conflicts_with = "preset")]
    window_hu: Option<[f64; 2]>,
    #[command(flatten)]
    slice: SliceArguments,
}

fn parse_preset(name: &str) -> Result<String, String> {
    if PRESETS.iter().any(|preset| preset.name == name) {
        return Ok(name.to_owned());
    }
    let lines: Vec<String> = PRESETS.iter().map(|p| format!("  {:<18} {}", p.name, p.purpose)).collect();
    Err(format!("no preset has this name; there are\n{}", lines.join("\n")))
}

fn parse_mode(name: &str) -> Result<Mode, String> {
    let names = Mode::ALL.map(Mode::name).join(", ");
    Mode::from_name(name).ok_or_else(|| format!("modes are {names}"))
}

fn parse_window(text: &str) -> Result<[f64; 2], String> {
    let parsed =
        text.split_once(',').and_then(|(c, w)| Some([c.trim().parse().ok()?, w.trim().parse().ok()?]));
    parsed.ok_or_else(|| "a window is CENTER,WIDTH in HU, such as 40,400".to_owned())
}

fn parse_classification(name: &str) -> Result<Classification, String> {
    let names = Classification::ALL.map(Classification::name).join(", ");
    Classification::from_name(name).ok_or_else(|| format!("classifications are {names}"))
}

fn parse_cut(name: &str) -> Result<CutChoice, String> {
    CutChoice::from_name(name).ok_or_else(|| format!("cuts are {}", CutFaces::NAMES.join(", ")))
}

fn parse_depth_filter(name: &str) -> Result<DepthFilter, String> {
    let names = DepthFilter::ALL.map(DepthFilter::name).join(", ");
    DepthFilter::from_name(name).ok_or_else(|| format!("depth filters are {names}"))
}

/// `--depth-range`.
#[derive(Clone, Copy, Debug)]
enum DepthRangeOption {
    Of(DepthRange),
    Mm([f64; 2]),
}

fn parse_depth_range(text: &str) -> Result<DepthRangeOption, String> {
    if let Some(range) = DepthRange::ALL.into_iter().find(|range| range.name() == text) {
        return Ok(DepthRangeOption::Of(range));
    }
    let parsed = text
        .split_once(',')
        .and_then(|(near, far)| Some([near.trim().parse().ok()?, far.trim().parse().ok()?]));
    let limits = parsed.filter(|[near, far]: &[f64; 2]| near.is_finite() && far.is_finite() && near < far);
    let limits = limits.map(DepthRangeOption::Mm);
    limits.ok_or_else(|| {
        "it is visible, volume, or NEAR,FAR in mm with NEAR below FAR, such as 500,800".to_owned()
    })
}

fn parse_overlay(name: &str) -> Result<String, String> {
    if Overlays::SWITCHES.iter().any(|(known, _)| *known == name) {
        return Ok(name.to_owned());
    }
    Err(format!("overlays are {}", Overlays::switch_names()))
}

pub(super) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parsed.ok_or_else(|| "a size is WIDTHxHEIGHT in pixels, such as 960x540".to_owned())
}

impl SceneArguments {
    /// The scene file, or an empty scene, with the options applied.
    pub(super) fn read(&self) -> anyhow::Result<SceneFile> {
        let mut scene = match &self.scene {
            Some(path) => {
                let json = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
                SceneFile::parse(&json).with_context(|| format!("{} is not a scene", path.display()))?
            }
            None => SceneFile::default(),
        };
        self.check_view(&scene)?;
        scene = self.frame.map_or(scene.clone(), |rule| scene.with_frame(rule));
        scene = self.table.map_or(scene.clone(), |rule| scene.with_table(rule));
        if let Some(name) = &self.preset {
            scene = scene.with_preset(name);
        }
        if let Some([center_hu, width_hu]) = self.window_hu {
            scene = scene.with_window(center_hu, width_hu);
        }
        scene = self.transfer.apply(scene)?;
        if let Some(mode) = self.mode {
            scene = scene.with_mode(mode);
        }
        if let Some(hu) = self.iso_hu {
            if self.mode.is_some_and(|mode| mode != Mode::Isosurface) {
                bail!("--iso-hu is for --mode isosurface");
            }
            scene = scene.with_iso_hu(hu);
        }
        if let Some(classification) = self.classification {
            scene = scene.with_classification(classification);
        }
        if let Some(cut) = self.cut {
            scene = scene.with_cut(cut);
        }
        if let Some(quality) = self.quality {
            scene = scene.with_quality(quality);
        }
        for name in &self.overlay {
            scene = scene.with_overlay(name)?;
        }
        if self.caption {
            scene = scene.with_overlay("caption")?;
        }
        scene = scene.with_labels(&self.cut_labels, &self.keep_labels, self.label_tint);
        if let Some(rule) = self.depth_rule {
            scene = scene.with_depth_rule(rule);
        }
        scene = self.slice.apply(scene)?;
        if scene.is_slice() && self.orbit() != Orbit::default() {
            bail!("a slice has its own view; leave --azimuth-deg, --elevation-deg, --zoom and --fov-deg out");
        }
        if let Some(passes) = self.passes {
            scene = scene.with_passes(passes);
        }
        if self.scatterings.is_some() || self.denoise {
            scene = scene.with_light(self.scatterings, self.denoise.then_some(true));
        }
        scene = self.light.apply(scene);
        scene = self.with_display_options(scene)?;
        Ok(match self.size {
            Some(size) => scene.with_size(size),
            None => scene,
        })
    }

    fn with_display_options(&self, mut scene: SceneFile) -> anyhow::Result<SceneFile> {
        let mut display = scene.display().clone();
        if let Some(layout) = self.layout {
            display.layout = layout;
            let fixed = display.encoder().ok().and_then(|encoder| encoder.render_size_px());
            if let Some([width, height]) =
                fixed.filter(|fixed| scene.size_px().is_some_and(|size| size != *fixed))
            {
                eprintln!("warning: layout {layout} needs {width}x{height}; the scene's size_px is left out");
                scene = scene.with_size_of_layout();
            }
        }
        display.depth_filter = self.depth_filter.unwrap_or(display.depth_filter);
        if self.view_span.is_some() || self.view_cone.is_some() {
            (display.view_span, display.view_cone_deg) = (self.view_span, self.view_cone);
        }
        if let Some(path) = &self.panel {
            display.panel = Some(panel_for(display.layout, path)?);
        }
        match self.depth_range {
            None => {}
            Some(DepthRangeOption::Of(depth_range)) => {
                display = DisplaySettings { depth_range, near_mm: None, far_mm: None, ..display };
            }
            Some(DepthRangeOption::Mm([near, far])) => {
                display = DisplaySettings { near_mm: Some(near), far_mm: Some(far), ..display };
            }
        }
        if let Some(point) = self.screen_plane {
            display.screen_plane = Some(ScreenPlane::PointMm(point));
        }
        Ok(scene.with_display(display))
    }

    /// Refuses options of the view that a scene file with a camera contradicts.
    fn check_view(&self, scene: &SceneFile) -> anyhow::Result<()> {
        if scene.has_camera() && self.orbit() != Orbit::default() {
            bail!(
                "the scene file has a camera; leave --azimuth-deg, --elevation-deg, --zoom and --fov-deg out"
            );
        }
        if scene.has_camera() && self.frame.is_some() {
            bail!("the scene file has a camera; leave --frame out");
        }
        self.orbit().validate().context("the view is out of range")
    }

    /// Whether --view-span or --view-cone was given.
    pub(super) const fn has_view_angle(&self) -> bool {
        self.view_span.is_some() || self.view_cone.is_some()
    }

    /// The layout that --layout names.
    pub(super) const fn layout(&self) -> Option<Layout> {
        self.layout
    }

    /// The view that applies when the scene file has no camera.
    pub(super) fn orbit(&self) -> Orbit {
        Orbit {
            azimuth_deg: self.azimuth_deg,
            elevation_deg: self.elevation_deg,
            zoom: self.zoom,
            vertical_fov_deg: self.fov_deg,
        }
    }
}
