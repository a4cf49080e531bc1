//! Loading: the series of each group of jobs, one ahead of the renderer, with all that can be done
//! before rays are cast.

use std::borrow::Borrow;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use super::copies::Copies;
use super::error::{FailureKind, SeriesError};
use super::gate::MemoryBudget;
use super::manifest::Job;
use super::run_state::RunState;
use super::source::{BudgetedVolume, LastLook, SeriesSource};
use relief_render::{
    Preparation, PreparedVolume, Scene, SceneError, SceneFile, Subject, SubjectContent, name_of, with_hash,
};

/// The time for which a permanent failure of a series holds: it may be mended while a worker runs.
const BROKEN_FOR: Duration = Duration::from_secs(10);

/// A series, its volume as the renderer needs it, and its jobs with their scenes.
pub(super) struct LoadedSeries<'a, J> {
    pub(super) loaded: Arc<BudgetedVolume<'a>>,
    /// `None` where the renderer has the volume, or will refuse it.
    pub(super) prepared: Option<PreparedVolume>,
    pub(super) jobs: Vec<(J, Result<Scene, SeriesError>)>,
}

/// A series, or the jobs that cannot be done without it.
pub(super) type Series<'a, J> = Result<LoadedSeries<'a, J>, (Vec<J>, SeriesError)>;

/// The inputs of loading.
pub(super) struct Loading<'a, 'r> {
    pub(super) copies: &'r Copies,
    pub(super) gate: &'a MemoryBudget,
    /// For the renderer.
    pub(super) preparation: Preparation,
    pub(super) shared: &'r RunState<'r>,
    /// Of phases.
    pub(super) last_look: LastLook,
}

/// The series that was loaded last, or its error.
struct Last<'a> {
    source: SeriesSource,
    series: Result<Arc<BudgetedVolume<'a>>, SeriesError>,
    at: Instant,
}

impl Last<'_> {
    /// Whether the result holds for another job. A series that cannot be read is not read again for
    /// each of its views, for a while.
    fn holds_for(&self, wanted: &SeriesSource) -> bool {
        let holds = match &self.series {
            Ok(_) => true,
            Err(error) => error.kind == FailureKind::Permanent && self.at.elapsed() < BROKEN_FOR,
        };
        holds && self.source == *wanted
    }
}

/// Loads the series of each group, until the receiver ends. What rendering would do first is done
/// here, while another series is rendered: scenes are resolved, and the volume is prepared.
pub(super) fn load_all<'a, J: Borrow<Job>>(
    groups: impl Iterator<Item = Vec<J>>,
    loading: &Loading<'a, '_>,
    loaded: &SyncSender<Series<'a, J>>,
) {
    let mut last: Option<Last<'a>> = None;
    for group in groups {
        let Some(wanted) = group.first().map(|job| &job.borrow().series) else { continue };
        let mut prepared = None;
        if !last.as_ref().is_some_and(|last| last.holds_for(wanted)) {
            // The bytes of the last series are released first: the next one may need them.
            drop(last.take());
        }
        let Last { series, .. } = last.get_or_insert_with(|| {
            let series = loading.load(wanted, &group).map(|(loaded, volume)| {
                prepared = volume;
                Arc::new(loaded)
            });
            Last { source: wanted.clone(), series, at: Instant::now() }
        });
        let series = match series {
            Ok(series) => Ok(with_scenes(series, prepared, group)),
            Err(error) => Err((group, error.clone())),
        };
        if loaded.send(series).is_err() {
            return; // the renderer has ended
        }
    }
}

impl<'a> Loading<'a, '_> {
    /// A series, and its volume as the first of these jobs shows it.
    fn load<J: Borrow<Job>>(
        &self,
        wanted: &SeriesSource,
        jobs: &[J],
    ) -> Result<(BudgetedVolume<'a>, Option<PreparedVolume>), SeriesError> {
        let started = Instant::now();
        let loaded = wanted.load(self.gate, self.copies, &self.last_look).map(|mut loaded| {
            // The renderer needs the hash.
            let _ = loaded.volume.content_hash();
            let scene = jobs.iter().find_map(|job| scene_of(&loaded, job.borrow()).ok());
            let prepared = scene.and_then(|scene| self.preparation.of(&loaded.volume, &scene.request));
            loaded.count_copy();
            (loaded, prepared)
        });
        self.shared.change(|summary| {
            summary.loaded += usize::from(loaded.is_ok());
            summary.seconds.loading += started.elapsed().as_secs_f64();
        });
        loaded
    }
}

/// A series with the scenes of jobs on it.
fn with_scenes<'a, J: Borrow<Job>>(
    loaded: &Arc<BudgetedVolume<'a>>,
    prepared: Option<PreparedVolume>,
    jobs: Vec<J>,
) -> LoadedSeries<'a, J> {
    let with_scene = |job: J| {
        let scene = scene_of(loaded, job.borrow());
        (job, scene)
    };
    LoadedSeries { loaded: Arc::clone(loaded), prepared, jobs: jobs.into_iter().map(with_scene).collect() }
}

/// The scene of a job on its series.
fn scene_of(loaded: &BudgetedVolume<'_>, job: &Job) -> Result<Scene, SeriesError> {
    let permanent = |error: SceneError| SeriesError::permanent(&error);
    let mut subject = Subject::of(&loaded.volume, loaded.labels.as_ref());
    let name;
    if let Some(look) = &loaded.look {
        let (occupancy, tissue) = (Some(&*look.occupancy), &look.tissue);
        subject.content = SubjectContent::Known { occupancy, tissue, anatomy: look.anatomy };
        name = with_hash(&name_of(look.anatomy, subject.grid), loaded.volume.content_hash());
        subject.name = Some(&name);
    }
    let file = SceneFile::from_value(&job.scene).map_err(permanent)?;
    let mut scene = file.resolve_for(&subject, &job.orbit).map_err(permanent)?;
    scene.expect_no_annotations().map_err(permanent)?;
    if job.products.iter().any(|product| product.is_frame()) {
        scene.expect_size_of_layout().map_err(permanent)?;
    }
    let request = &mut scene.request;
    if !job.products.iter().any(|product| product.is_frame()) {
        request.for_views = None;
    }
    // Overlays are hidden by depth.
    request.needs_depth =
        !request.overlays.is_empty() || job.products.iter().any(|product| product.needs_depth());
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::sync_channel;

    use crate::{CopiesOptions, Product, Sink};
    use relief_volume::Orbit;

    #[test]
    fn a_series_that_is_broken_for_good_is_not_read_again_for_each_of_its_views() {
        let folder = tempfile::tempdir().unwrap();
        let source = |name: &str| {
            let (path, name) = (folder.path().join(name), name.to_owned());
            SeriesSource { path, uid: None, name, sha256: "0".repeat(64), labels: None, first_phase: None }
        };
        let job = |series: &str, view: &str| {
            let (scene, orbit) = (serde_json::json!({}), Orbit::default());
            let (view, group) = (view.to_owned(), String::new());
            vec![Job::new(source(series), view, group, scene, orbit, vec![Product::Color], None)]
        };
        // Reading it again would give another error, because the folder exists by then.
        let mut groups = vec![job("b", "one"), job("a", "two"), job("a", "one")];
        let path = folder.path().join("a");
        let groups = std::iter::from_fn(|| {
            let group = groups.pop()?;
            if group[0].view == "two" {
                std::fs::create_dir(&path).unwrap();
            }
            Some(group)
        });
        let copies = Copies::new(CopiesOptions::default());
        let (sink, gate) = (Sink::Folder(folder.path().join("out")), MemoryBudget::new(1 << 20));
        let shared = RunState::new(&sink, &|_| ());
        let preparation = relief_render::Renderer::on_processor().preparation();
        let loading = Loading {
            copies: &copies,
            gate: &gate,
            preparation,
            shared: &shared,
            last_look: LastLook::default(),
        };
        let (send, series) = sync_channel(3);
        load_all(groups, &loading, &send);
        drop(send);
        let reasons: Vec<SeriesError> = series.iter().filter_map(|series| Some(series.err()?.1)).collect();
        assert_eq!(reasons[0], reasons[1]);
        assert_eq!(reasons.len(), 3);
        let again = source("a").load(&gate, &copies, &LastLook::default()).unwrap_err();
        assert!(again.kind == FailureKind::Permanent && again != reasons[0], "{again:?}");
    }
}
