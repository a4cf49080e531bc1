//! Planning: which series there are, and one job for each view of each.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::copies::{Copies, Local};
use super::error::{PlanError, SkipReason, TableError};
use super::found::{FoundSeries, SeriesFormat};
use super::isolation::Listing;
use super::landmarks::{camera_views, landmark_views};
use super::location::{Location, SERIES_ENDINGS};
use super::log::AnnotationLog;
use super::manifest::Job;
use super::names::is_name;
use super::product::Product;
use super::query::Query;
use super::source::{LabelsSource, PhaseSource, SeriesSource};
use super::views::{View, ViewSet};
use relief_annotation::Item;
use relief_base::{Budget, sha256_of_file};
use relief_dicom::{SeriesIdentity, Strictness};
use relief_display::DepthRange;
use relief_render::{FramingRule, SceneFile, TableRule};
use relief_volume::Orbit;
use relief_volume::Volume;

/// A place to search for series.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Root {
    /// A folder, or a prefix of a bucket: every folder, zip and volume file in it.
    Folder(PathBuf),
    /// A table with a header line and the columns `path` and, optionally, `series_uid`, `name` and
    /// `labels`. Paths are relative to the table, except those in buckets.
    Table(PathBuf),
}

/// The input of a plan.
#[derive(Debug)]
pub struct Request {
    /// The places of the series.
    pub root: Root,
    /// The label map of each, where the table names none: `{}` stands for the series' path, of a
    /// file without its ending.
    pub labels: Option<String>,
    /// The conditions on wanted series.
    pub query: Query,
    /// The log whose annotations are looked at or drawn.
    pub annotations: Option<AnnotationLog>,
    /// The views of each.
    pub views: ViewSet,
    /// Keys of the scene that all views share.
    pub scene: Map<String, Value>,
    /// Angles of views that have none of their own, and zoom and field of view of all.
    pub orbit: Orbit,
    /// The outputs of each view.
    pub products: Vec<Product>,
    /// Copies of series in buckets.
    pub copies: Copies,
}

/// Jobs, and the paths without jobs.
#[derive(Debug)]
pub struct Plan {
    /// All views of a series side by side; series in the order of their paths.
    pub jobs: Vec<Job>,
    /// The number of series that the jobs name; view set `time` names a series with phases once.
    pub series: usize,
    /// The number of series that the query leaves out.
    pub unwanted: usize,
    /// The unusable files: path and reason.
    pub skipped: Skipped,
}

/// Columns of a table.
const COLUMNS: [&str; 4] = ["path", "series_uid", "name", "labels"];

/// One place to look at.
struct Candidate {
    path: PathBuf,
    uid: Option<String>,
    name: Option<String>,
    labels: Option<PathBuf>,
}

/// Finds the series and makes the jobs. Reads every byte of every series, for its hash. `report` is
/// given how many places were looked at, and how many there are.
///
/// # Errors
/// When the root cannot be read or has no series at all; a place without a usable series is among
/// those skipped.
pub fn plan(request: &Request, report: &mut dyn FnMut(usize, usize)) -> Result<Plan, PlanError> {
    let (mut places, root) = match &request.root {
        Root::Folder(folder) => (places_in(folder, &request.copies)?, folder),
        Root::Table(table) => (read_table(table)?, table),
    };
    if let Some(pattern) = &request.labels {
        places.iter_mut().for_each(|place| place.find_labels(pattern));
        // Label maps beside series are files of voxels, too.
        let labels: HashSet<PathBuf> = places.iter().filter_map(|place| place.labels.clone()).collect();
        places.retain(|place| !labels.contains(&place.path));
    }
    let mut planned = Plan { jobs: Vec::new(), series: 0, unwanted: 0, skipped: Vec::new() };
    let (mut known, mut found_any, mut last) = (HashSet::new(), false, None);
    for (done, place) in places.iter().enumerate() {
        report(done, places.len());
        let found = find(place, &request.copies).unwrap_or_else(|reason| {
            planned.skipped.push((place.path.clone(), reason));
            Vec::new()
        });
        let time = time_jobs(&found, request, &known);
        for found in found {
            found_any = true;
            let path = found.source.path.clone();
            if !known.insert(found.source.sha256.clone()) {
                planned.skipped.push((path, SkipReason::Repeated));
                continue;
            }
            if let Err(reason) = found.admit(&request.query) {
                (planned.unwanted, last) = (planned.unwanted + 1, Some(reason));
                continue;
            }
            match jobs_of(&found, request, &mut planned.skipped)? {
                Ok(jobs) => planned.jobs.extend(jobs),
                // A phase has its views in `time`.
                Err(SkipReason::NoPhases) if !time.is_empty() => {}
                Err(reason) => planned.skipped.push((path, reason)),
            }
        }
        planned.jobs.extend(time);
    }
    report(places.len(), places.len());
    planned.series = planned.jobs.iter().map(|job| &job.series.name).collect::<HashSet<_>>().len();
    if !found_any {
        return Err(PlanError::NoSeries { path: root.clone(), skipped: planned.skipped });
    }
    if planned.jobs.is_empty() {
        let last = last.or_else(|| planned.skipped.pop().map(|(_, reason)| reason));
        return Err(PlanError::NoViews { last });
    }
    Ok(planned)
}

/// Paths without jobs, with reasons.
pub type Skipped = Vec<(PathBuf, SkipReason)>;

/// The jobs of a series, or why it has none. The outer error ends the planning.
fn jobs_of(
    found: &FoundSeries,
    request: &Request,
    skipped: &mut Skipped,
) -> Result<Result<Vec<Job>, SkipReason>, PlanError> {
    let mut views = request.views.views.clone();
    let mut kept = None;
    if let Some(log) = &request.annotations {
        let views_of = |items: &[&Item], volume: Option<&Volume>| own_views(items, volume, request);
        let (own, items) = match found.annotated(log, request.views.landmarks, views_of) {
            Ok(annotated) => annotated,
            Err(reason) => return Ok(Err(reason)),
        };
        views.extend(own);
        if request.products.iter().any(|product| product.needs_annotations()) {
            kept = Some(log.keep(&items, &mut |warning| skipped.push((found.source.path.clone(), warning)))?);
        }
    }
    if views.is_empty() {
        let is_time = request.views.is_time();
        return Ok(Err(if is_time { SkipReason::NoPhases } else { SkipReason::NoAnnotations }));
    }
    let job = |view: View| {
        let scene = scene_of(&request.scene, view.scene);
        let orbit = match view.orbit {
            Some([azimuth_deg, elevation_deg]) => Orbit { azimuth_deg, elevation_deg, ..request.orbit },
            None => request.orbit,
        };
        let (scene, products) = (Value::Object(scene), request.products.clone());
        Job::new(found.source.clone(), view.name, view.group, scene, orbit, products, kept.clone())
    };
    Ok(Ok(views.into_iter().map(job).collect()))
}

/// The jobs of view set `time` for the series with phases in one place. Each picture shows the next
/// phase from the next side. All pictures have the framing and the table of the first phase, and the
/// depth range of the volume's box. The jobs of a phase follow each other, so that it is loaded once.
fn time_jobs(found: &[FoundSeries], request: &Request, known: &HashSet<String>) -> Vec<Job> {
    let mut jobs = Vec::new();
    for phases in regions(found) {
        let first = &phases[0].source;
        let is_repeated = known.contains(&first.sha256);
        if request.views.time.is_empty() || is_repeated || phases[0].admit(&request.query).is_err() {
            continue;
        }
        let first_phase = first.uid.clone().map(|uid| PhaseSource { uid, sha256: first.sha256.clone() });
        for (number, phase) in phases.iter().enumerate() {
            let views = request.views.time.iter().skip(number).step_by(phases.len());
            for View { name, group, scene, orbit } in views.cloned() {
                let (own, name_of_series) = (first_phase.clone(), first.name.clone());
                let source = SeriesSource { name: name_of_series, first_phase: own, ..phase.source.clone() };
                let mut scene = scene_of(&request.scene, scene);
                let display = scene.entry("display").or_insert_with(|| Map::new().into());
                if let Some(display) = display.as_object_mut() {
                    display.entry("depth_range").or_insert_with(|| DepthRange::Volume.name().into());
                }
                let [azimuth_deg, elevation_deg] = orbit.unwrap_or_default();
                let orbit = Orbit { azimuth_deg, elevation_deg, ..request.orbit };
                let (scene, products) = (Value::Object(scene), request.products.clone());
                jobs.push(Job::new(source, name, group, scene, orbit, products, None));
            }
        }
    }
    jobs
}

/// The series of a place that are phases of one region, in their order.
fn regions(found: &[FoundSeries]) -> Vec<Vec<&FoundSeries>> {
    let mut regions: Vec<(SeriesIdentity, Vec<(usize, &FoundSeries)>)> = Vec::new();
    for series in found {
        let SeriesFormat::Dicom(entry) = &series.kind else { continue };
        let Some(phase) = entry.phase() else { continue };
        let identity = entry.identity();
        match regions.iter_mut().find(|(known, _)| known.is_of_same_region(&identity)) {
            Some((_, phases)) => phases.push((phase.number, series)),
            None => regions.push((identity, vec![(phase.number, series)])),
        }
    }
    let in_order = |mut phases: Vec<(usize, _)>| {
        phases.sort_by_key(|(number, _)| *number);
        phases.into_iter().map(|(_, series)| series).collect()
    };
    regions.into_iter().map(|(_, phases)| in_order(phases)).collect()
}

/// The scene of a view: the shared keys, and its own in place of theirs. A shared preset colours
/// volumes; a slice without a transfer function of its own has the window of the body part.
fn scene_of(shared: &Map<String, Value>, own: Map<String, Value>) -> Map<String, Value> {
    let mut scene = shared.clone();
    if own.contains_key("slice") && shared.get("transfer").is_some_and(Value::is_string) {
        scene.remove("transfer");
    }
    scene.extend(own);
    write_rules(&mut scene);
    scene
}

/// Writes what decides a picture where a scene says nothing, so that a job's key covers it. A view
/// with a camera of its own, and a slice, are fitted to nothing.
fn write_rules(scene: &mut Map<String, Value>) {
    let file = SceneFile::from_value(&Value::Object(scene.clone()));
    if file.is_ok_and(|file| file.has_camera() || file.is_slice()) {
        scene.remove("frame");
    } else {
        scene.entry("frame").or_insert_with(|| FramingRule::default().name().into());
    }
    scene.entry("table").or_insert_with(|| TableRule::default().name().into());
}

fn own_views(items: &[&Item], volume: Option<&Volume>, request: &Request) -> Vec<View> {
    let mut views = Vec::new();
    if let Some(volume) = volume.filter(|_| request.views.landmarks) {
        views.extend(landmark_views(items, volume, &request.orbit));
    }
    if request.views.cameras {
        views.extend(camera_views(items));
    }
    views
}

/// The entries of a folder, one place each; the folder itself if it contains files of series.
fn places_in(root: &Path, copies: &Copies) -> Result<Vec<Candidate>, PlanError> {
    let unreadable = |source| PlanError::Unreadable { path: root.to_owned(), source };
    let place = |path: PathBuf| Candidate { path, uid: None, name: None, labels: None };
    if Location::is_remote(root) {
        return Ok(copies.places(root).map_err(unreadable)?.into_iter().map(place).collect());
    }
    let (mut places, mut has_loose) = (Vec::new(), false);
    for entry in std::fs::read_dir(root).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let is_zip = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("zip"));
        if path.is_dir() || is_zip || relief_dicom::is_volume_file(&path) {
            places.push(place(path));
        } else {
            has_loose |= path.is_file() && is_dicom(&path);
        }
    }
    if has_loose {
        return Ok(vec![place(root.to_owned())]);
    }
    places.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(places)
}

/// Whether a file has the mark of DICOM files behind its preamble.
fn is_dicom(path: &Path) -> bool {
    let mut head = [0; 132];
    let read = std::fs::File::open(path).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut head));
    read.is_ok() && &head[128..] == b"DICM"
}

fn read_table(table: &Path) -> Result<Vec<Candidate>, PlanError> {
    let wrong = |line, source| PlanError::Table { path: table.to_owned(), line, source };
    let of_csv = |error: csv::Error| {
        let line = error.position().map_or(1, csv::Position::line);
        wrong(line, error.into())
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(table).map_err(of_csv)?;
    let columns = reader.headers().map_err(of_csv)?.clone();
    if let Some(column) = columns.iter().find(|column| !COLUMNS.contains(column)) {
        let source = TableError::UnknownColumn { found: column.to_owned(), allowed: &COLUMNS };
        return Err(wrong(1, source));
    }
    if !columns.iter().any(|column| column == "path") {
        return Err(wrong(1, TableError::NoPathColumn));
    }
    let folder = table.parent().unwrap_or(Path::new("."));
    let (mut places, mut names) = (Vec::new(), BTreeMap::new());
    for (row, line) in reader.records().zip(2..) {
        let row = row.map_err(of_csv)?;
        let cell = |name: &str| {
            let at = columns.iter().position(|column| column == name)?;
            row.get(at).filter(|text| !text.is_empty()).map(str::to_owned)
        };
        let path = cell("path").ok_or_else(|| wrong(line, TableError::NoPath))?;
        let name = cell("name");
        if let Some(name) = &name {
            if let Some(first) = names.insert(name.clone(), line) {
                return Err(wrong(line, TableError::RepeatedName { name: name.clone(), first }));
            }
            if !is_name(name) {
                return Err(wrong(line, TableError::Name(name.clone())));
            }
        }
        let named = |path: String| match PathBuf::from(path) {
            path if Location::is_remote(&path) => path,
            path => folder.join(path),
        };
        places.push(Candidate {
            path: named(path),
            uid: cell("series_uid"),
            name,
            labels: cell("labels").map(named),
        });
    }
    Ok(places)
}

impl Candidate {
    fn find_labels(&mut self, pattern: &str) {
        let path = self.path.to_string_lossy();
        let name = path.to_ascii_lowercase();
        let ending = SERIES_ENDINGS.iter().find(|ending| name.ends_with(**ending));
        let stem = &path[..path.len() - ending.map_or(0, |ending| ending.len())];
        let labels = PathBuf::from(pattern.replace("{}", stem));
        self.labels.get_or_insert(labels);
    }
}

fn find_labels(path: &Path, copies: &Copies) -> Result<LabelsSource, SkipReason> {
    let sha256 = copies.local(path).and_then(|local| sha256_of_file(local.path()));
    let sha256 = sha256.map_err(|source| SkipReason::Labels { path: path.to_owned(), source })?;
    Ok(LabelsSource { path: path.to_owned(), sha256 })
}

/// The series of a place.
fn find(place: &Candidate, copies: &Copies) -> Result<Vec<FoundSeries>, SkipReason> {
    let local: Local = copies.local(&place.path)?;
    let labels = place.labels.as_deref().map(|path| find_labels(path, copies)).transpose()?;
    let source = |uid: Option<String>, sha256: String| {
        let name = place.name.clone().unwrap_or_else(|| format!("series-{}", &sha256[..12]));
        let path = place.path.clone();
        SeriesSource { path, uid, name, sha256, labels: labels.clone(), first_phase: None }
    };
    if relief_dicom::is_volume_file(local.path()) {
        let sha256 = sha256_of_file(local.path())?;
        return Ok(vec![FoundSeries { source: source(None, sha256), local, kind: SeriesFormat::File }]);
    }
    let found = series_at(&local)?;
    let several = found.len() > 1;
    let is_wanted = |kind: &SeriesFormat| place.uid.as_deref().is_none_or(|uid| kind.uid() == Some(uid));
    let wanted: Vec<_> = found.into_iter().filter(is_wanted).collect();
    if wanted.is_empty() {
        return Err(SkipReason::NoSeries);
    }
    if wanted.len() > 1 && place.name.is_some() {
        return Err(SkipReason::SeveralSeries { count: wanted.len() });
    }
    wanted
        .into_iter()
        .map(|kind| {
            let uid = kind.uid().filter(|_| several).map(str::to_owned);
            let source = source(uid, kind.sha256()?);
            Ok(FoundSeries { source, local: local.clone(), kind })
        })
        .collect()
}

/// The DICOM series of a place; those of a bucket are read in a child process.
fn series_at(local: &Local) -> Result<Vec<SeriesFormat>, SkipReason> {
    let Some(reader) = local.isolated() else {
        let found = relief_dicom::discover(local.path(), Strictness::Lenient, &|_| ())?;
        return Ok(found.series.into_iter().map(SeriesFormat::Dicom).collect());
    };
    match reader.list(local.path(), true, &Budget::default())? {
        Listing::Series(series) => Ok(series.into_iter().map(SeriesFormat::Isolated).collect()),
        Listing::VolumeFile(_) => Ok(Vec::new()),
    }
}
