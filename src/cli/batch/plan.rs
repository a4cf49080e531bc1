//! `relief batch plan`: series, views and annotations become a manifest of jobs.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde_json::{Map, Value, json};

use crate::batch::copies::BucketSeriesArguments;
use crate::batch::shared::{bar, folder_of};
use crate::output::{GrowingFile, print_json, say};
use relief_annotation::ShownSets;
use relief_batch::plan;
use relief_batch::{AnnotationLog, Product, ProductSet, Query, Request, Root, ViewSet};
use relief_render::{FramingRule, SceneFile};
use relief_volume::Orbit;

/// Write the jobs: one for each view of each series
#[derive(Debug, clap::Args)]
pub(crate) struct PlanArguments {
    /// Folder of series, or s3://BUCKET/PREFIX: each folder, zip, .nii, .nii.gz and .nrrd in it is
    /// looked at
    #[arg(long, value_name = "DIR", required_unless_present = "table", conflicts_with = "table")]
    root: Option<PathBuf>,
    /// Table of series, CSV with a header line: path, and if wanted series_uid, name (what its
    /// outputs are called) and labels
    #[arg(long, value_name = "FILE.csv")]
    table: Option<PathBuf>,
    #[command(flatten)]
    series: BucketSeriesArguments,
    /// Label map of each series: {} stands for the series' path, of a file without its ending, such
    /// as '{}/labels.seg.nrrd' or '{}.labels.nii.gz'; a table may name them in a column labels
    #[arg(long, value_name = "PATTERN", value_parser = parse_pattern)]
    labels: Option<String>,
    /// Series that are wanted, such as modality=CT,slices>=40: modality, format (dicom, volume),
    /// slices, columns, rows, pixel_mm, thickness_mm, with = != < <= > >=
    #[arg(long = "where", value_name = "CONDITIONS")]
    query: Option<Query>,
    /// Views with commas between them: turntable:N, time:N (a turntable through the phases of each
    /// series that has phases), sides (six), planes (axial, coronal, sagittal),
    /// landmarks (one for each point and plane of --annotations, along its normal), cameras (as
    /// annotations were placed), or a file: a JSON array of {"name", "azimuth_deg",
    /// "elevation_deg", "scene"}
    #[arg(long, value_name = "SETS")]
    views: String,
    /// Log of annotations: a file, sqlite:FILE or postgres://USER@HOST/DATABASE
    #[arg(long, value_name = "PLACE")]
    annotations: Option<String>,
    /// Sets of annotations; all that are not blinded where none is named
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "annotations")]
    set: Vec<String>,
    /// Scene that all views share, as JSON
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Preset of colours and light of all views except slices, which have a window [default: one that
    /// suits each series; so has the window]
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Width and height of pictures, where the layout does not say
    #[arg(long, value_name = "WxH", value_parser = crate::scene::parse_size)]
    size: Option<[u32; 2]>,
    /// The part that zoom 1 fits to the picture: what is visible, all tissue, or the bounding sphere
    /// of the volume [default: visible]
    #[arg(long, value_name = "RULE", value_parser = crate::choices::framing_rules())]
    frame: Option<FramingRule>,
    /// 1 fits the whole (see --frame), and shows 160 mm around a landmark; larger is closer
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    zoom: f64,
    /// Outputs of each view: frame (2D plus depth), color, depth (EXR, mm), depth-png (16 bits),
    /// camera (JSON); capture (the colour as a DICOM Secondary Capture); annotated, annotated-frame,
    /// annotated-capture and labels (structures) of --annotations; dataset is
    /// color,depth,depth-png,camera
    #[arg(long, value_name = "PRODUCTS", value_delimiter = ',', default_value = "frame,color")]
    products: Vec<ProductSet>,
    /// The manifest: a job a line. Annotations that are drawn are kept beside it, in a folder of
    /// its name
    #[arg(long, value_name = "JOBS.jsonl")]
    out: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(crate) fn write_plan(arguments: &PlanArguments) -> anyhow::Result<ExitCode> {
    let root = match (&arguments.root, &arguments.table) {
        (Some(folder), _) => Root::Folder(folder.clone()),
        (None, Some(table)) => Root::Table(table.clone()),
        (None, None) => bail!("give --root or --table"),
    };
    let mut products: Vec<Product> = arguments.products.iter().flat_map(|set| set.0.clone()).collect();
    products.sort_unstable();
    products.dedup();
    let orbit = Orbit { zoom: arguments.zoom, ..Orbit::default() };
    orbit.validate()?;
    let views = ViewSet::parse(&arguments.views)?;
    let scene = shared_scene(arguments)?;
    expect_annotations(arguments, &views, &products)?;
    expect_perspective(&views, &products)?;
    if arguments.preset.is_some() && views.are_slices() {
        eprintln!(
            "warning: --preset colours volumes, and all views are slices, whose window suits the body part"
        );
    }
    let annotations = arguments.annotations.as_deref().map(|place| open_log(place, arguments)).transpose()?;
    let query = arguments.query.clone().unwrap_or_default();
    let copies = arguments.series.copies_below(Vec::new())?;
    let labels = arguments.labels.clone();
    let request = Request { root, labels, query, annotations, views, scene, orbit, products, copies };
    let bar = bar("looking for series");
    let planned = plan(&request, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    for (path, reason) in &planned.skipped {
        eprintln!("warning: {}: {reason}", path.display());
    }
    let mut manifest = GrowingFile::create(&arguments.out)?;
    let folder = folder_of(&arguments.out);
    for job in &planned.jobs {
        manifest.line(&serde_json::to_string(&job.clone().relative_to(folder)?)?)?;
    }
    manifest.finish()?;
    if arguments.json {
        let skipped: Vec<_> = planned
            .skipped
            .iter()
            .map(|(path, reason)| json!({ "path": path, "reason": reason.to_string() }))
            .collect();
        print_json(&json!({
            "out": arguments.out, "series": planned.series, "jobs": planned.jobs.len(), "skipped": skipped,
            "unwanted": planned.unwanted,
        }))?;
    } else {
        let (jobs, series) = (planned.jobs.len(), planned.series);
        say!("{}: {jobs} jobs of {series} series", arguments.out.display());
        if planned.unwanted > 0 {
            say!("{} series are not what --where wants", planned.unwanted);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn parse_pattern(text: &str) -> Result<String, String> {
    match text.matches("{}").count() {
        1 => Ok(text.to_owned()),
        _ => Err("a pattern has {} once, for the series' path, such as '{}/labels.seg.nrrd'".to_owned()),
    }
}

fn open_log(place: &str, arguments: &PlanArguments) -> anyhow::Result<AnnotationLog> {
    let names = arguments.set.iter().map(String::as_str);
    let shown = if arguments.set.is_empty() {
        ShownSets::All
    } else {
        ShownSets::of_names(names).map_err(anyhow::Error::msg)?
    };
    Ok(AnnotationLog::open(place, &shown, arguments.out.with_extension("annotations"))?)
}

fn expect_annotations(
    arguments: &PlanArguments,
    views: &ViewSet,
    products: &[Product],
) -> anyhow::Result<()> {
    if arguments.annotations.is_some() {
        return Ok(());
    }
    if views.needs_annotations() {
        bail!(
            "views landmarks and cameras are those of annotations; say which log has them with --annotations PLACE"
        );
    }
    if let Some(product) = products.iter().find(|product| product.needs_annotations()) {
        bail!(
            "product {} has annotations in it; say which log has them with --annotations PLACE",
            product.name()
        );
    }
    Ok(())
}

/// Cameras of parallel views cannot be written.
fn expect_perspective(views: &ViewSet, products: &[Product]) -> anyhow::Result<()> {
    let is_parallel = |scene: &Map<String, Value>| {
        let projection = scene.get("camera").and_then(|camera| camera.get("projection"));
        scene.contains_key("slice") || projection.is_some_and(|file| file.get("orthographic").is_some())
    };
    match views.views.iter().find(|view| is_parallel(&view.scene)) {
        Some(view) if products.contains(&Product::Camera) => {
            bail!(
                "view {} is parallel, and product camera is for perspective views; plan them apart",
                view.name
            )
        }
        _ => Ok(()),
    }
}

/// Keys of the scene that all views share.
fn shared_scene(arguments: &PlanArguments) -> anyhow::Result<Map<String, Value>> {
    let mut scene = Map::new();
    if let Some(path) = &arguments.scene {
        let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = SceneFile::parse(&bytes).with_context(|| format!("{} is not a scene", path.display()))?;
        if file.has_camera() || file.is_slice() {
            bail!("{} has a view of its own; put it into a file for --views", path.display());
        }
        scene = serde_json::from_slice(&bytes)?;
    }
    if let Some(preset) = &arguments.preset {
        scene.insert("transfer".to_owned(), preset.clone().into());
    }
    if let Some(size_px) = arguments.size {
        scene.insert("size_px".to_owned(), size_px.to_vec().into());
    }
    if let Some(rule) = arguments.frame {
        scene.insert("frame".to_owned(), rule.name().into());
    }
    if scene.contains_key("budget_ms") {
        bail!("budget_ms makes pictures depend on the machine; leave it out of a batch");
    }
    if scene.contains_key("annotations") {
        bail!(
            "the scene draws annotations; leave that out, and ask for --products annotated with --annotations PLACE"
        );
    }
    SceneFile::from_value(&Value::Object(scene.clone()))?;
    Ok(scene)
}
