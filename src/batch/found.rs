//! A series that was found: its facts and its annotations.

use super::copies::Local;
use super::error::SkipReason;
use super::isolation::{self, ListedSeries, Listing, SeriesChoice};
use super::log::AnnotationLog;
use super::query::{Query, SeriesFacts};
use super::source::SeriesSource;
use super::views::View;
use data_encoding::HEXLOWER;
use relief_annotation::{FrameOfReference, Item};
use relief_base::Budget;
use relief_dicom::{LoadLimits, SeriesEntry, Strictness};

use relief_volume::{Grid, Volume};

/// A series, not loaded.
pub(super) struct FoundSeries {
    pub(super) source: SeriesSource,
    /// Its files on this machine.
    pub(super) local: Local,
    pub(super) kind: SeriesFormat,
}

/// Its source.
pub(super) enum SeriesFormat {
    /// Slices.
    Dicom(SeriesEntry),
    /// Slices that a child process reads.
    Isolated(ListedSeries),
    /// A file of voxels.
    File,
}

impl SeriesFormat {
    /// The UID of a DICOM series.
    pub(super) fn uid(&self) -> Option<&str> {
        match self {
            Self::Dicom(entry) => Some(entry.uid()),
            Self::Isolated(listed) => Some(&listed.uid),
            Self::File => None,
        }
    }

    /// SHA-256 of the files of a DICOM series, which reads all of them.
    pub(super) fn sha256(&self) -> Result<String, SkipReason> {
        match self {
            Self::Dicom(entry) => Ok(HEXLOWER.encode(&entry.content_sha256()?)),
            Self::Isolated(listed) => listed.sha256.clone().ok_or(SkipReason::NoSeries),
            Self::File => Err(SkipReason::NoSeries),
        }
    }
}

impl FoundSeries {
    /// Whether a query wants it.
    pub(super) fn admit(&self, query: &Query) -> Result<(), SkipReason> {
        if query.is_empty() {
            return Ok(());
        }
        let facts = match &self.kind {
            SeriesFormat::Dicom(entry) => SeriesFacts {
                modality: entry.modality().to_owned(),
                format: "dicom",
                dims: entry.dims(),
                pixel_mm: entry.pixel_spacing_mm(),
                thickness_mm: entry.thickness_mm(),
            },
            SeriesFormat::Isolated(listed) => SeriesFacts {
                modality: listed.modality.clone(),
                format: "dicom",
                dims: listed.dims,
                pixel_mm: listed.pixel_mm,
                thickness_mm: listed.thickness_mm,
            },
            SeriesFormat::File => SeriesFacts::of_grid(&self.grid_of_file()?),
        };
        Ok(query.admit(&facts)?)
    }

    /// Its annotations in the log, and the views that `views_of` makes of them. Loads the volume
    /// only if needed: for the frame of reference of its annotations, or for the normals of
    /// landmarks.
    pub(super) fn annotated<'a>(
        &self,
        log: &'a AnnotationLog,
        needs_volume: bool,
        views_of: impl FnOnce(&[&Item], Option<&Volume>) -> Vec<View>,
    ) -> Result<(Vec<View>, Vec<&'a Item>), SkipReason> {
        let mut volume = None;
        let uid = match &self.kind {
            SeriesFormat::Dicom(entry) => entry.frame_of_reference(),
            SeriesFormat::Isolated(listed) => listed.frame_of_reference.as_deref(),
            SeriesFormat::File => None,
        };
        let mut items = match uid {
            Some(uid) => log.items_of(&FrameOfReference::of(Some(uid), "")),
            None if log.has_items_of_volumes() => {
                let loaded = volume.insert(self.load()?);
                log.items_of(&FrameOfReference::of(None, &loaded.content_hash().short()))
            }
            None => Vec::new(),
        };
        if let SeriesFormat::Dicom(entry) = &self.kind {
            let phase = entry.phase().map(|phase| phase.number);
            items.retain(|item| item.is_in_phase(phase));
        }
        if needs_volume && volume.is_none() && !items.is_empty() {
            volume = Some(self.load()?);
        }
        let views = views_of(&items, volume.as_ref());
        Ok((views, items))
    }

    fn grid_of_file(&self) -> Result<Grid, SkipReason> {
        let Some(reader) = self.local.isolated() else {
            return Ok(relief_dicom::read_grid(self.local.path())?);
        };
        match reader.list(self.local.path(), false, &Budget::default())? {
            Listing::VolumeFile(grid) => Ok(grid),
            Listing::Series(_) => Err(SkipReason::NoSeries),
        }
    }

    fn load(&self) -> Result<Volume, SkipReason> {
        if let Some(reader) = self.local.isolated() {
            let uid = if let SeriesFormat::Isolated(listed) = &self.kind { Some(&*listed.uid) } else { None };
            let choice = SeriesChoice { hashes_content: false, ..isolation::choice(uid) };
            let limits = LoadLimits::default();
            let path = self.local.path();
            let read = reader.series(path, choice, limits.voxel_bytes, &Budget::default(), |_| Ok(()));
            return Ok(read?.0.volume);
        }
        match &self.kind {
            SeriesFormat::Isolated(_) => Err(SkipReason::NoSeries), // only with a reader
            SeriesFormat::File => Ok(relief_dicom::read_volume(self.local.path())?.volume),
            SeriesFormat::Dicom(entry) => {
                let limits = LoadLimits::default();
                Ok(relief_dicom::load_within(limits, entry, Strictness::Lenient, &|_| ())?.volume)
            }
        }
    }
}
