//! One volume of the registry.

use std::sync::Arc;

use super::voxels::{VolumeReader, Voxels};
use relief_annotation::FrameOfReference;
use relief_dicom::{SeriesIdentity, SeriesReference, WarningCode};
use relief_render::{Subject, SubjectContent, framing_of_tissue};
use relief_volume::{Anatomy, ContentHash, Framing, Grid, LabelMap, Occupancy, Volume};

/// A volume as its reader returns it.
#[derive(Clone, Debug)]
pub struct LoadedVolume {
    /// Voxels in HU and their grid in patient mm.
    pub volume: Volume,
    /// Warnings of the reader.
    pub warnings: Vec<WarningCode>,
    /// Study and series UIDs by which DICOMweb requests find the volume; `None` where they are
    /// unknown.
    pub identity: Option<SeriesIdentity>,
    /// Attributes for exported reports and segmentations. They name the patient: for files only.
    pub reference: Option<Arc<SeriesReference>>,
    /// Label map on the grid of the volume.
    pub labels: Option<Arc<LabelMap>>,
}

/// The source of the names of volumes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NameSource {
    /// The body part that the voxels show.
    #[default]
    Anatomy,
    /// The description of the series, which may name the patient; the body part where it is empty.
    Description,
}

/// The origin of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Owner {
    Operator,
    Upload,
}

/// A volume of the registry. Its voxels may be out of memory (see [`crate::Engine::voxels`]).
#[derive(Clone, Debug)]
pub struct VolumeEntry {
    /// First 16 hexadecimal digits of the content hash.
    pub id: String,
    /// Voxel grid in patient mm.
    pub grid: Grid,
    /// Content hash of the voxels and the grid.
    pub hash: ContentHash,
    /// Whether the volume is in memory a second time, without its table.
    pub(super) has_copy: bool,
    /// The distribution of values in the volume without its table. It stays when the voxels are
    /// dropped from memory.
    pub(super) occupancy: Arc<Occupancy>,
    /// The part of a body that the volume shows.
    pub anatomy: Anatomy,
    /// The sphere that live views are fitted to; see [`framing_of_tissue`].
    pub framing: Framing,
    /// Shared with earlier entries of the same volume, which had another label map.
    pub(super) voxels: Arc<Voxels>,
    /// Smallest and largest HU.
    pub range_hu: (i16, i16),
    /// Warnings of the reader.
    pub warnings: Vec<WarningCode>,
    pub(super) owner: Owner,
    pub(super) identity: Option<SeriesIdentity>,
    /// Attributes for exported reports and segmentations. They name the patient: for files only.
    pub reference: Option<Arc<SeriesReference>>,
    /// The description of the series, where the operator wants it to be shown.
    pub(super) description: Option<String>,
    /// Label map on the grid of the volume.
    pub labels: Option<Arc<LabelMap>>,
    /// Whether the operator gave the label map: uploads do not replace it.
    pub(super) has_own_labels: bool,
}

impl VolumeEntry {
    pub(super) fn new(
        loaded: LoadedVolume,
        owner: Owner,
        reader: Option<VolumeReader>,
        names: NameSource,
    ) -> Arc<Self> {
        let LoadedVolume { volume, warnings, identity, reference, labels } = loaded;
        let (grid, hash, range_hu) = (volume.grid().clone(), volume.content_hash(), volume.range_hu());
        let shown = volume.without_table();
        let has_copy = shown.content_hash() != hash;
        let occupancy = Arc::clone(shown.occupancy());
        let framing = framing_of_tissue(&occupancy, &grid);
        let anatomy = shown.anatomy();
        let voxels = Arc::new(Voxels::new(volume, reader));
        let id = hash.short();
        let description = reference.as_deref().map(SeriesReference::description);
        let description = description.filter(|text| names == NameSource::Description && !text.is_empty());
        let description = description.map(str::to_owned);
        let has_own_labels = owner == Owner::Operator && labels.is_some();
        Arc::new(Self {
            id,
            grid,
            hash,
            has_copy,
            occupancy,
            anatomy,
            framing,
            voxels,
            range_hu,
            warnings,
            owner,
            identity,
            reference,
            description,
            labels,
            has_own_labels,
        })
    }

    /// The volume as scenes are resolved for it.
    #[must_use]
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            grid: &self.grid,
            content: self.content(Some(&self.occupancy)),
            labels: self.labels.as_ref(),
        }
    }

    /// The volume for scenes whose camera is replaced: theirs is not fitted.
    #[must_use]
    pub fn subject_without_fit(&self) -> Subject<'_> {
        Subject { content: self.content(None), ..self.subject() }
    }

    fn content<'a>(&'a self, occupancy: Option<&'a Occupancy>) -> SubjectContent<'a> {
        SubjectContent::Known { occupancy, tissue: &self.framing, anatomy: self.anatomy }
    }

    /// Its name for people: the body part and the size. Descriptions of series may name patients;
    /// they take the body part's place where the operator shows them.
    #[must_use]
    pub fn name(&self) -> String {
        let [nx, ny, nz] = self.grid.dims();
        if let Some(description) = &self.description {
            return format!("{description}, {nx} × {ny} × {nz}");
        }
        let mut part = self.anatomy.part.name().to_owned();
        part[..1].make_ascii_uppercase();
        let medium = if self.anatomy.has_contrast { " with contrast medium" } else { "" };
        format!("{part}{medium}, {nx} × {ny} × {nz}")
    }

    /// The frame of reference of annotations in this volume. It may hold a UID, which leads to a
    /// patient: for the store, not for answers.
    #[must_use]
    pub fn frame_of_reference(&self) -> FrameOfReference {
        let of_series = self.identity.as_ref().and_then(SeriesIdentity::frame_of_reference);
        FrameOfReference::of(of_series, &self.id)
    }

    /// Bytes of the voxels.
    #[must_use]
    pub fn voxel_bytes(&self) -> u64 {
        (self.grid.voxel_count() * size_of::<i16>()) as u64
    }

    /// Bytes in memory of the voxels, with and without the table.
    #[must_use]
    pub fn memory_bytes(&self) -> u64 {
        self.voxel_bytes() * if self.has_copy { 2 } else { 1 }
    }

    /// Bytes of the label map in memory; 0 without one.
    #[must_use]
    pub fn label_bytes(&self) -> u64 {
        self.labels.as_deref().map_or(0, LabelMap::bytes)
    }

    /// Whether a client uploaded the volume and may remove it.
    #[must_use]
    pub fn is_upload(&self) -> bool {
        self.owner == Owner::Upload
    }

    pub(super) fn is_of_series(&self, study_uid: &str, series_uid: &str) -> bool {
        self.identity.as_ref().is_some_and(|identity| identity.is(study_uid, series_uid))
    }
}
