//! The series of `relief serve`: where they are, and loading them behind the server.

use std::cell::RefCell;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use tokio::sync::oneshot;

use crate::labels;
use crate::serve::series::{self, InProcess, SeriesReader};
use crate::source::SeriesOptions;
use relief_batch::{Copies, Local, Location};
use relief_render::VolumeLimits;
use relief_server::Server;
use relief_session::{LoadedVolume, MemoryFull, VolumeReader};

/// A place that there is a series in.
#[derive(Clone, Debug)]
pub(crate) struct SeriesLocation {
    path: PathBuf,
    labels: Option<PathBuf>,
    /// In a bucket, an archive or a folder of received series: the prefix, the number of this place
    /// below it, and the number of all.
    among: Option<(PathBuf, usize, usize)>,
}

/// The locations of series, in the order of the options; those in buckets and archives are
/// listed. A missing
/// location is an error.
pub(crate) fn places(
    series: &[PathBuf],
    labels: &[PathBuf],
    copies: &Copies,
) -> anyhow::Result<Vec<SeriesLocation>> {
    for path in series.iter().filter(|path| !Location::is_remote(path)).chain(labels) {
        // Checked before any series is opened, because loading takes long.
        std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?;
    }
    if labels.len() > series.len() {
        let [labels, series] = [labels, series].map(<[PathBuf]>::len);
        bail!("{labels} --labels for {series} --series; give each label map behind its series");
    }
    let mut places = Vec::new();
    let labels = labels.iter().cloned().map(Some).chain(std::iter::repeat(None));
    for (path, labels) in series.iter().zip(labels) {
        if !Location::is_remote(path) {
            places.push(SeriesLocation { path: path.clone(), labels, among: None });
            continue;
        }
        let found =
            copies.places(path).with_context(|| format!("cannot read {}", Location::public_name(path)))?;
        if labels.is_some() && found.len() > 1 {
            bail!("--labels are of one series, and {} has {}", Location::public_name(path), found.len());
        }
        let count = found.len();
        places.extend(found.into_iter().zip(1..).map(|(found, number)| SeriesLocation {
            path: found,
            labels: labels.clone(),
            among: Some((path.clone(), number, count)),
        }));
    }
    Ok(places)
}

impl SeriesLocation {
    /// A folder of received files: they are read as those of buckets are.
    pub(crate) fn received(folder: &Path) -> Self {
        Self { path: folder.to_owned(), labels: None, among: Some((folder.to_owned(), 1, 1)) }
    }

    /// A series of an archive.
    #[cfg(feature = "archives")]
    pub(crate) fn of_archive(path: PathBuf, archive: &relief_archive::ArchiveAddress) -> Self {
        Self { path, labels: None, among: Some((PathBuf::from(archive.to_string()), 1, 1)) }
    }

    #[cfg(feature = "archives")]
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The name for messages: below a prefix of a bucket and in an archive a number, because names
    /// there may be those of patients.
    fn name(&self) -> String {
        match &self.among {
            Some((prefix, number, count)) if *count > 1 => {
                format!("{number} of {count} below {}", Location::public_name(prefix))
            }
            Some((prefix, ..)) => Location::public_name(prefix),
            None => self.path.display().to_string(),
        }
    }
}

/// How series are loaded.
pub(crate) struct SeriesLoader {
    pub(crate) copies: Copies,
    pub(crate) options: SeriesOptions,
    pub(crate) limits: VolumeLimits,
    /// Reads series from buckets; those of this machine are read in this process.
    pub(crate) of_buckets: Arc<dyn SeriesReader>,
}

/// The folders of series that have arrived since it was asked last.
pub(crate) type Arrivals = Box<dyn Fn() -> Vec<PathBuf> + Send>;

/// The interval of looking for arrivals.
const ARRIVALS: Duration = Duration::from_millis(200);

/// Loads all series on a thread of its own, and then those that arrive. The receiver gets the error
/// that ended it; nothing when all went well.
pub(crate) fn load_behind(
    places: Vec<SeriesLocation>,
    loader: Arc<SeriesLoader>,
    server: Arc<Server>,
    arrivals: Option<Arrivals>,
) -> anyhow::Result<oneshot::Receiver<anyhow::Error>> {
    let (report, failed) = oneshot::channel();
    std::thread::Builder::new().name("relief-load".into()).spawn(move || {
        let loading = Loading { loader: &loader, server: &server, served: RefCell::default() };
        // A panic ends the server with its reason; it would be loading for ever otherwise.
        let outcome = std::panic::catch_unwind(AssertUnwindSafe(|| loading.all(&places)));
        let panicked = |_| Err(anyhow::anyhow!("reading a series panicked; see the message above"));
        if let Err(error) = outcome.unwrap_or_else(panicked) {
            let _ = report.send(error);
            return;
        }
        drop(report);
        while let Some(arrivals) = &arrivals {
            for folder in arrivals() {
                // A panic of one leaves the others.
                let arrived = AssertUnwindSafe(|| loading.arrived(&folder));
                if std::panic::catch_unwind(arrived).is_err() {
                    tracing::error!("reading a received series panicked");
                }
            }
            std::thread::sleep(ARRIVALS);
        }
    })?;
    Ok(failed)
}

impl SeriesLoader {
    pub(crate) fn reader(&self, place: &SeriesLocation) -> Arc<dyn SeriesReader> {
        if place.among.is_some() { Arc::clone(&self.of_buckets) } else { Arc::new(InProcess) }
    }

    /// Reads a series from its local files, after room was made for it. The returned reader reads its
    /// voxels again.
    pub(crate) fn read(
        &self,
        place: &SeriesLocation,
        local: &Local,
        options: &SeriesOptions,
        make_room: &dyn Fn(u64) -> Result<(), MemoryFull>,
    ) -> anyhow::Result<(LoadedVolume, VolumeReader)> {
        let reader = self.reader(place);
        let wanted = |dims: [usize; 3]| {
            self.limits.plan(dims)?;
            let bytes = dims.iter().fold(size_of::<i16>() as u64, |bytes, &n| bytes.saturating_mul(n as u64));
            Ok(make_room(bytes)?)
        };
        let loaded = reader.read(local.path(), options, &wanted)?;
        let (copies, path, options) = (self.copies.clone(), place.path.clone(), options.clone());
        let again = move || {
            let local = copies.local(&path).map_err(|_| Unreadable)?;
            Ok(reader.read(local.path(), &options, &|_| Ok(())).map_err(|_| Unreadable)?.volume)
        };
        Ok((loaded, Arc::new(again)))
    }
}

struct Loading<'a> {
    loader: &'a SeriesLoader,
    server: &'a Server,
    /// Ids of the volumes that were read from each place.
    served: RefCell<HashMap<PathBuf, Vec<String>>>,
}

impl Loading<'_> {
    fn all(&self, places: &[SeriesLocation]) -> anyhow::Result<()> {
        let mut added = 0;
        for place in places {
            added += self.place(place).with_context(|| format!("cannot serve {}", place.name()))?;
        }
        if added == 0 && !places.is_empty() {
            bail!("there is no usable series below --series");
        }
        Ok(())
    }

    /// Adds the series of a location and returns their number. Unusable locations of several in a
    /// bucket are skipped with a warning.
    fn place(&self, place: &SeriesLocation) -> anyhow::Result<usize> {
        let Some((_, _, count)) = place.among else {
            let local = self.loader.copies.local(&place.path)?;
            return match self.series(place, &local, &self.loader.options) {
                Ok(()) => Ok(1),
                Err(error) => self.phases(place, &local, error),
            };
        };
        let local = match self.loader.copies.local(&place.path) {
            // Nothing there, or more than copies may have: the others are served all the same.
            Err(error)
                if count > 1 && matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidInput) =>
            {
                return Ok(self.leave_out(place, &error.into()));
            }
            local => local?,
        };
        let found = self.loader.reader(place).list(local.path(), &self.loader.options);
        let options = match found {
            Ok(options) => options,
            Err(error) if count > 1 => return Ok(self.leave_out(place, &error)),
            Err(error) => return Err(error),
        };
        // One was expected of each place.
        self.server.expect_volumes(options.len() - 1);
        let mut added = 0;
        for options in &options {
            match self.series(place, &local, options) {
                Ok(()) => added += 1,
                Err(error) if count > 1 => added += self.leave_out(place, &error),
                Err(error) => return Err(error),
            }
        }
        Ok(added)
    }

    /// Adds the phases of a series, where it could not be read because it has several.
    fn phases(&self, place: &SeriesLocation, local: &Local, error: anyhow::Error) -> anyhow::Result<usize> {
        let is_several = error
            .chain()
            .any(|cause| matches!(cause.downcast_ref(), Some(relief_dicom::Error::SeveralSeries { .. })));
        if !is_several {
            return Err(error);
        }
        let Some(phases) = series::phases(local.path(), &self.loader.options)? else { return Err(error) };
        self.server.expect_volumes(phases.len() - 1);
        phases.iter().try_for_each(|options| self.series(place, local, options))?;
        Ok(phases.len())
    }

    /// Adds the series of a folder that was received. If it was served before, it has grown, and
    /// the smaller volumes go.
    fn arrived(&self, folder: &Path) {
        let place = SeriesLocation::received(folder);
        let before = self.served.borrow_mut().remove(folder).unwrap_or_default();
        self.server.expect_volumes(1);
        if let Err(error) = self.place(&place) {
            self.leave_out(&place, &error);
            self.served.borrow_mut().entry(folder.to_owned()).or_default().extend(before);
            return;
        }
        let served = self.served.borrow();
        let now = served.get(folder).map(Vec::as_slice).unwrap_or_default();
        before.iter().filter(|id| !now.contains(id)).for_each(|id| self.server.withdraw_series(id));
    }

    fn leave_out(&self, place: &SeriesLocation, reason: &anyhow::Error) -> usize {
        eprintln!("warning: cannot serve {}: {reason:#}", place.name());
        self.server.expect_fewer_volumes(1);
        0
    }

    /// Loads a series and its label map, with room made before and a way to read it again.
    fn series(&self, place: &SeriesLocation, local: &Local, options: &SeriesOptions) -> anyhow::Result<()> {
        let make_room = |bytes| self.server.make_room(bytes);
        let (served, read) = self.loader.read(place, local, options, &make_room)?;
        let labels = place.labels.as_deref();
        let labels = labels.map(|labels| labels::load(labels, served.volume.grid())).transpose()?;
        let entry = self.server.add_series(LoadedVolume { labels, ..served }, read)?;
        self.served.borrow_mut().entry(place.path.clone()).or_default().push(entry.id.clone());
        eprintln!("volume {}: {}; /#volume={0} shows it", entry.id, entry.name());
        Ok(())
    }
}

/// A series that was read before and cannot be read again. The cause may name files and patients,
/// so the log does not get it.
#[derive(Debug, thiserror::Error)]
#[error("the files of the series can no longer be read")]
struct Unreadable;
