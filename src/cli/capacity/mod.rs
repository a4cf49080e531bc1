//! `relief bench --capacity`: the number of viewers that this machine carries, and the machines that
//! more viewers would need.

mod print;

use std::process::ExitCode;

use super::adapter::AdapterArguments;
use super::output::{print_json, say};
use super::scene::SceneArguments;
use super::series::SeriesArguments;
use print::CapacityReport;
use relief_render::Subject;
use relief_study::{ViewerHabits, measure_capacity, process_mib};
use relief_volume::{PhantomKind, PhantomRecipe};

/// Options of `relief bench --capacity`.
#[derive(Debug, clap::Args)]
pub(super) struct CapacityArguments {
    /// Measure how many viewers and views per hour this machine carries, of a procedural head where
    /// no --series is given
    #[arg(long)]
    pub(super) capacity: bool,
    /// Frames per second that a viewer is to have while moving the view
    #[arg(long, value_name = "FPS", default_value_t = 20.0, value_parser = positive, requires = "capacity")]
    viewer_fps: f64,
    /// Share of the time in which a viewer moves the view, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, value_parser = share, requires = "capacity")]
    moving_share: f64,
    /// Print the tables of docs/CAPACITY.md
    #[arg(long, requires = "capacity", conflicts_with = "json")]
    pub(super) markdown: bool,
}

/// The inputs of the measurement.
pub(super) struct CapacityRun<'a> {
    /// `None` measures with a procedural head.
    pub(super) series: Option<&'a SeriesArguments>,
    pub(super) scene: &'a SceneArguments,
    pub(super) adapter: &'a AdapterArguments,
    /// Number of still frames.
    pub(super) frames: usize,
    pub(super) json: bool,
}

pub(super) fn run(arguments: &CapacityArguments, order: &CapacityRun<'_>) -> anyhow::Result<ExitCode> {
    let &CapacityArguments { viewer_fps, moving_share, markdown, .. } = arguments;
    let scene_file = order.scene.read()?;
    let renderer = order.adapter.open_renderer()?;
    let base_mib = process_mib("VmRSS:");
    let (volume, labels) = match order.series {
        Some(series) => {
            let (loaded, ()) =
                series.load_after(|dims| Ok(renderer.volume_limits().plan(dims).map(drop)?))?;
            let labels = series.load_labels(loaded.volume.grid())?;
            (loaded.volume, labels)
        }
        None => (PhantomRecipe::new(PhantomKind::Head).make().volume, None),
    };
    let scene = scene_file.resolve_for(&Subject::of(&volume, labels.as_ref()), &order.scene.orbit())?;
    scene.expect_no_annotations()?;
    let measured = measure_capacity(renderer, &volume, &scene, order.frames, base_mib)?;
    let habits = ViewerHabits { viewer_fps, moving_share, ..ViewerHabits::default() };
    let (carried, needed) = (measured.capacity(&habits), measured.needs(&habits));
    let report = CapacityReport { measured, habits, carried, needed };
    if order.json {
        print_json(&report)?;
    } else {
        say!("{}", if markdown { print::markdown(&report) } else { print::text(&report) });
    }
    Ok(ExitCode::SUCCESS)
}

fn positive(text: &str) -> Result<f64, String> {
    let parsed = text.parse::<f64>().ok().filter(|number| (0.1..=1000.0).contains(number));
    parsed.ok_or_else(|| "a rate is 0.1 to 1000 frames per second".to_owned())
}

fn share(text: &str) -> Result<f64, String> {
    let parsed = text.parse::<f64>().ok().filter(|number| (0.001..=1.0).contains(number));
    parsed.ok_or_else(|| "a share is 0.001 to 1".to_owned())
}
