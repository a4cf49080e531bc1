//! One volume of the registry.

use std::sync::Arc;

use super::voxels::{VolumeReader, Voxels};
use relief_annotation::FrameOfReference;
use relief_dicom::{Phase, SeriesIdentity, SeriesReference, WarningCode};
use relief_render::{Subject, SubjectContent, framing_of_tissue, name_of, with_hash};
use relief_volume::{Anatomy, ContentHash, Framing, Grid, LabelMap, Occupancy, Table, Volume};

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
    /// The description of the series, which may name the patient, or the body part where it is empty;
    /// and the date of the study.
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
    /// First 16 hexadecimal digits of the content hash; of a phase with the voxels of another one those
    /// of [`ContentHash::of_phase`].
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
    /// The date of the study, where the operator wants it to be shown.
    pub(super) date: Option<String>,
    /// Label map on the grid of the volume.
    pub labels: Option<Arc<LabelMap>>,
    /// Its name and the beginning of its hash, for captions.
    pub(super) caption: String,
    /// The volume whose phases this one is among: the first of them that was read, or itself.
    pub region: ContentHash,
    /// The table of the volume, for later phases of its series.
    pub(super) table: Option<Arc<Table>>,
    /// Whether the operator gave the label map: uploads do not replace it.
    pub(super) has_own_labels: bool,
}

impl VolumeEntry {
    /// The entry of a volume. The other phases of its region, `siblings`, share one framing and one
    /// table on one grid.
    pub(super) fn new(
        loaded: LoadedVolume,
        owner: Owner,
        reader: Option<VolumeReader>,
        names: NameSource,
        siblings: &[Arc<Self>],
    ) -> Arc<Self> {
        let LoadedVolume { volume, warnings, identity, reference, labels } = loaded;
        let sibling = siblings.iter().find(|sibling| sibling.grid == *volume.grid());
        let (volume, reader) = match sibling {
            Some(sibling) => {
                let table = &sibling.table;
                (volume.with_table(table.clone()), reader.map(|reader| reading_on(reader, table.clone())))
            }
            None => (volume, reader),
        };
        let (grid, hash, range_hu) = (volume.grid().clone(), volume.content_hash(), volume.range_hu());
        let shown = volume.without_table();
        let has_copy = shown.content_hash() != hash;
        let (occupancy, framing, anatomy) = match sibling {
            Some(sibling) => (Arc::clone(&sibling.occupancy), sibling.framing.clone(), sibling.anatomy),
            None => {
                let occupancy = Arc::clone(shown.occupancy());
                let framing = framing_of_tissue(&occupancy, &grid);
                (occupancy, framing, shown.anatomy())
            }
        };
        let table = volume.table().cloned();
        let voxels = Arc::new(Voxels::new(volume, reader));
        let id = id_of(hash, identity.as_ref(), siblings);
        let shown_reference = reference.as_deref().filter(|_| names == NameSource::Description);
        let description = shown_reference.map(SeriesReference::description).filter(|text| !text.is_empty());
        let description = description.map(str::to_owned);
        let date = shown_reference.and_then(SeriesReference::study_date);
        let has_own_labels = owner == Owner::Operator && labels.is_some();
        let mut entry = Self {
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
            date,
            labels,
            region: sibling.map_or(hash, |sibling| sibling.region),
            table,
            caption: String::new(),
            has_own_labels,
        };
        entry.caption = with_hash(&entry.name(), hash);
        Arc::new(entry)
    }

    /// The volume as scenes are resolved for it.
    #[must_use]
    pub fn subject(&self) -> Subject<'_> {
        Subject {
            grid: &self.grid,
            content: self.content(Some(&self.occupancy)),
            labels: self.labels.as_ref(),
            name: Some(&self.caption),
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

    /// The name of the preset that suits it; `None` for values that are not HU.
    pub(crate) fn suited_preset(&self) -> Option<String> {
        self.anatomy.preset().map(|preset| preset.name.to_owned())
    }

    /// Which phase of its series it is, where that shows one region several times.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.identity.as_ref().and_then(SeriesIdentity::phase)
    }

    pub(super) fn is_phase_of(&self, identity: &SeriesIdentity) -> bool {
        self.identity.as_ref().is_some_and(|own| own.is_of_same_region(identity))
    }

    /// Whether both are phases of one region, on one grid.
    #[must_use]
    pub fn is_phase_with(&self, other: &Self) -> bool {
        let both = self.identity.as_ref().zip(other.identity.as_ref());
        self.grid == other.grid && both.is_some_and(|(one, other)| one.is_of_same_region(other))
    }

    /// Its name for people: the body part and the size. Descriptions of series may name patients;
    /// they take the body part's place, and the date of the study is added, where the operator shows
    /// them.
    #[must_use]
    pub fn name(&self) -> String {
        let phase = self.phase().map(|phase| format!(", {phase}")).unwrap_or_default();
        let date = self.date.as_ref().map(|date| format!(", {date}")).unwrap_or_default();
        let name = match &self.description {
            Some(description) => {
                let [nx, ny, nz] = self.grid.dims();
                format!("{description}, {nx} × {ny} × {nz}")
            }
            None => name_of(self.anatomy, &self.grid),
        };
        format!("{name}{phase}{date}")
    }

    /// The frame of reference of annotations in this volume. It may hold a UID, which leads to a
    /// patient: for the store, not for answers.
    #[must_use]
    pub fn frame_of_reference(&self) -> FrameOfReference {
        let of_series = self.identity.as_ref().and_then(SeriesIdentity::frame_of_reference);
        FrameOfReference::of(of_series, &self.id)
    }

    /// Whether its voxels are in memory.
    #[must_use]
    pub fn is_in_memory(&self) -> bool {
        self.voxels.lock().is_some()
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

/// The reader of a volume that lies on this table.
fn reading_on(reader: VolumeReader, table: Option<Arc<Table>>) -> VolumeReader {
    Arc::new(move || Ok(reader()?.with_table(table.clone())))
}

/// The id of a volume: phases with equal voxels have different ones.
fn id_of(hash: ContentHash, identity: Option<&SeriesIdentity>, siblings: &[Arc<VolumeEntry>]) -> String {
    let phase = identity.and_then(SeriesIdentity::phase);
    match phase {
        Some(Phase { number, .. })
            if siblings.iter().any(|known| known.hash == hash && known.phase() != phase) =>
        {
            hash.of_phase(number).short()
        }
        _ => hash.short(),
    }
}
