//! The series of `relief serve`: where they are, and loading them behind the server.

use std::io::ErrorKind;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use tokio::sync::oneshot;

use super::labels;
use super::source::{self, SeriesOptions};
use relief_batch::{Copies, Location};
use relief_dicom::Strictness;
use relief_render::VolumeLimits;
use relief_server::Server;
use relief_session::LoadedVolume;

/// A place that there is a series in.
#[derive(Clone, Debug)]
pub(super) struct SeriesLocation {
    path: PathBuf,
    labels: Option<PathBuf>,
    /// Of several below a prefix of a bucket: the prefix, which of them it is, and of how many.
    among: Option<(PathBuf, usize, usize)>,
}

/// The locations of series, in the order of the options; those in buckets are listed. A missing
/// location is an error.
pub(super) fn places(
    series: &[PathBuf],
    labels: &[PathBuf],
    copies: &Copies,
) -> anyhow::Result<Vec<SeriesLocation>> {
    for path in series.iter().filter(|path| !Location::is_bucket(path)).chain(labels) {
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
        if !Location::is_bucket(path) {
            places.push(SeriesLocation { path: path.clone(), labels, among: None });
            continue;
        }
        let found = copies.places(path).with_context(|| format!("cannot read {}", path.display()))?;
        if labels.is_some() && found.len() > 1 {
            bail!("--labels are of one series, and {} has {}", path.display(), found.len());
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
    /// The name for messages: below a prefix of a bucket a number, because names there may be those
    /// of patients.
    fn name(&self) -> String {
        match &self.among {
            Some((prefix, number, count)) if *count > 1 => {
                format!("{number} of {count} below {}", prefix.display())
            }
            Some((prefix, ..)) => prefix.display().to_string(),
            None => self.path.display().to_string(),
        }
    }
}

/// Loads all series on a thread of its own. The receiver gets the error that ended it; nothing when
/// all went well.
pub(super) fn load_behind(
    places: Vec<SeriesLocation>,
    copies: Copies,
    options: SeriesOptions,
    limits: VolumeLimits,
    server: Arc<Server>,
) -> anyhow::Result<oneshot::Receiver<anyhow::Error>> {
    let (report, failed) = oneshot::channel();
    std::thread::Builder::new().name("relief-load".into()).spawn(move || {
        let loading = Loading { copies: &copies, options: &options, limits, server: &server };
        // A panic ends the server with its reason; it would be loading for ever otherwise.
        let outcome = std::panic::catch_unwind(AssertUnwindSafe(|| loading.all(&places)));
        let panicked = |_| Err(anyhow::anyhow!("reading a series panicked; see the message above"));
        if let Err(error) = outcome.unwrap_or_else(panicked) {
            let _ = report.send(error);
        }
    })?;
    Ok(failed)
}

struct Loading<'a> {
    copies: &'a Copies,
    options: &'a SeriesOptions,
    limits: VolumeLimits,
    server: &'a Server,
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
            return self.series(place, self.options).map(|()| 1);
        };
        let local = match self.copies.local(&place.path) {
            // Nothing there, or more than copies may have: the others are served all the same.
            Err(error)
                if count > 1 && matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidInput) =>
            {
                return Ok(self.leave_out(place, &error.into()));
            }
            local => local?,
        };
        let found = self.below(local.path());
        let options = match found {
            Ok(options) => options,
            Err(error) if count > 1 => return Ok(self.leave_out(place, &error)),
            Err(error) => return Err(error),
        };
        // One was expected of each place.
        self.server.expect_volumes(options.len() - 1);
        let mut added = 0;
        for options in &options {
            match self.series(place, options) {
                Ok(()) => added += 1,
                Err(error) if count > 1 => added += self.leave_out(place, &error),
                Err(error) => return Err(error),
            }
        }
        Ok(added)
    }

    fn leave_out(&self, place: &SeriesLocation, reason: &anyhow::Error) -> usize {
        eprintln!("warning: cannot serve {}: {reason:#}", place.name());
        self.server.expect_fewer_volumes(1);
        0
    }

    /// The series in a folder or a file, at least one, each by the options that choose it.
    fn below(&self, path: &Path) -> anyhow::Result<Vec<SeriesOptions>> {
        if relief_dicom::is_volume_file(path) || self.options.series_uid.is_some() {
            return Ok(vec![self.options.clone()]);
        }
        let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ())?;
        if found.series.is_empty() {
            found.select(None)?; // says why
        }
        let options = |uid: &str| SeriesOptions { series_uid: Some(uid.to_owned()), ..self.options.clone() };
        Ok(found.series.iter().map(|entry| options(entry.uid())).collect())
    }

    /// Loads a series and its label map, with room made before and a way to read it again.
    fn series(&self, place: &SeriesLocation, options: &SeriesOptions) -> anyhow::Result<()> {
        let local = self.copies.local(&place.path)?;
        let (loaded, _) = source::load_after(local.path(), options, |dims| {
            self.limits.plan(dims)?;
            let bytes = dims.iter().fold(size_of::<i16>() as u64, |bytes, &n| bytes.saturating_mul(n as u64));
            Ok(self.server.make_room(bytes)?)
        })?;
        drop(local); // a copy may go when there is no room for others
        let (copies, path, options) = (self.copies.clone(), place.path.clone(), options.clone());
        let read = move || {
            let local = copies.local(&path).map_err(|_| Unreadable)?;
            Ok(source::load(local.path(), &options).map_err(|_| Unreadable)?.volume)
        };
        let served = served(loaded);
        let labels = place.labels.as_deref();
        let labels = labels.map(|labels| labels::load(labels, served.volume.grid())).transpose()?;
        self.server.add_series(LoadedVolume { labels, ..served }, Arc::new(read))?;
        Ok(())
    }
}

/// A series that was read before and cannot be read again. The cause may name files and patients,
/// so the log does not get it.
#[derive(Debug, thiserror::Error)]
#[error("the files of the series can no longer be read")]
struct Unreadable;

/// A loaded series as the server takes it.
pub(super) fn served(loaded: relief_dicom::Loaded) -> LoadedVolume {
    let relief_dicom::Loaded { volume, warnings, identity, reference, .. } = loaded;
    LoadedVolume { warnings: warnings.len(), volume, identity: Some(identity), reference, labels: None }
}
