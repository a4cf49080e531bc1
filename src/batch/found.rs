//! A series that was found: its facts and its annotations.

use super::copies::Local;
use super::error::SkipReason;
use super::log::AnnotationLog;
use super::query::{Query, SeriesFacts};
use super::source::SeriesSource;
use super::views::View;
use relief_annotation::{FrameOfReference, Item};
use relief_dicom::{LoadLimits, SeriesEntry, Strictness};

use relief_volume::Volume;

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
    /// A file of voxels.
    File,
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
            SeriesFormat::File => {
                let grid = relief_dicom::read_grid(self.local.path())?;
                SeriesFacts::of_grid(&grid)
            }
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
        let uid = if let SeriesFormat::Dicom(entry) = &self.kind { entry.frame_of_reference() } else { None };
        let items = match uid {
            Some(uid) => log.items_of(&FrameOfReference::of(Some(uid), "")),
            None if log.has_items_of_volumes() => {
                let loaded = volume.insert(self.load()?);
                log.items_of(&FrameOfReference::of(None, &loaded.content_hash().short()))
            }
            None => Vec::new(),
        };
        if needs_volume && volume.is_none() && !items.is_empty() {
            volume = Some(self.load()?);
        }
        let views = views_of(&items, volume.as_ref());
        Ok((views, items))
    }

    fn load(&self) -> Result<Volume, SkipReason> {
        match &self.kind {
            SeriesFormat::File => Ok(relief_dicom::read_volume(self.local.path())?.volume),
            SeriesFormat::Dicom(entry) => {
                let limits = LoadLimits::default();
                Ok(relief_dicom::load_within(limits, entry, Strictness::Lenient, &|_| ())?.volume)
            }
        }
    }
}
