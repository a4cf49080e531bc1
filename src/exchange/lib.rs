//! Annotations in the files of other tools, both ways.
//!
//! [`read`] converts a file's bytes to items, [`write()`] converts items to bytes, and both report
//! losses. They open no files and store nothing (see `store`). `docs/ANNOTATIONS.md` has a table of
//! what each format can represent.
//!
//! Space: patient LPS, mm; formats in RAS are mirrored at the edge. A file is taken whole or
//! refused: an error names its line or JSON path. Memory grows with the file, by a bounded factor,
//! whatever the file claims.

mod cornerstone;
mod deidentify;
mod delimited;
mod error;
mod extra;
mod fcsv;
mod format;
mod loss;
mod merge;
mod meshes;
mod mps;
mod mrk_json;
mod objects;
mod outside;
mod reading;
mod regions;
mod representable;
mod structures;
mod table;
mod written_json;

pub use deidentify::deidentified;
pub use error::ExchangeError;
pub use format::{Format, FormatInfo, UnknownFormat};
pub use loss::LeftOut;
pub use merge::{ExistingItems, Merged};

pub use structures::{
    REGION_TYPE, StoredContent, StructureError, content_of_mesh, content_of_region, mask_of_content,
    mesh_of_content,
};

use relief_annotation::{ContentId, FrameOfReference, Item};
use relief_dicom::{SeriesReference, write_nifti_labels, write_seg_nrrd_layers};
use relief_volume::Grid;

/// Values of items that a file does not contain.
#[derive(Clone, Copy, Debug)]
pub struct ReadContext<'a> {
    /// Who made them, where the file does not say.
    pub author: &'a str,
    /// The set that they come into.
    pub set: &'a str,
    /// The list that they are, where the file does not say: the file's name without its extension.
    pub list: &'a str,
    /// The origin and axes of their coordinates.
    pub frame_of_reference: Option<&'a FrameOfReference>,
    /// The volume that they belong to: points outside of it are warned of.
    pub grid: Option<&'a Grid>,
    /// The DICOM series that they belong to: a report may have places in its images.
    pub series: Option<&'a SeriesReference>,
}

impl ReadContext<'_> {
    /// Voxels that the layers of a label map may have together: sixteen for each of the volume's
    /// where there is one, and at least 16 million.
    fn most_voxels(&self) -> u64 {
        const LEAST: u64 = 1 << 24;
        let of_volume = |grid: &Grid| (grid.voxel_count() as u64).saturating_mul(16).max(LEAST);
        self.grid.map_or(1 << 31, of_volume)
    }
}

/// What items do not say of themselves.
#[derive(Clone, Copy)]
pub struct WriteContext<'a> {
    /// The bytes of a content: regions and meshes are these.
    pub contents: &'a dyn Fn(&ContentId) -> Option<Vec<u8>>,
    /// The voxels that a label map is to have; those of the first region otherwise.
    pub grid: Option<&'a Grid>,
    /// The DICOM series that they belong to: reports and segmentations are about one.
    pub series: Option<&'a SeriesReference>,
}

/// The content of a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The items, valid, with the ids of the file where it has ours.
    pub items: Vec<Item>,
    /// The contents that they refer to: name, media type, bytes.
    pub contents: Vec<(ContentId, String, Vec<u8>)>,
    /// Anomalies and omissions, as sentences.
    pub warnings: Vec<String>,
}

/// A file.
#[derive(Clone, Debug)]
pub struct ExportedFile {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// How many items it has.
    pub items: usize,
    /// The values that it cannot represent.
    pub left_out: Vec<LeftOut>,
}

/// Reads a file.
///
/// # Errors
/// When the bytes are not of the format, or describe items that cannot be: with the line or JSON
/// path.
pub fn read(format: Format, bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    match format {
        Format::MrkJson => mrk_json::read(bytes, context),
        Format::Fcsv => fcsv::read(bytes, context),
        Format::Csv | Format::Tsv => table::read(format, bytes, context),
        Format::Mps => mps::read(bytes, context),
        Format::Cornerstone => cornerstone::read(bytes, context),
        Format::Sr => objects::read_report(bytes, context),
        Format::Seg => objects::read_segmentation(bytes, context),
        Format::SegNrrd | Format::Nifti => regions::read(format, bytes, context),
        Format::Stl | Format::Ply | Format::Obj | Format::Glb => meshes::read(format, bytes, context),
        Format::RtStruct => objects::read_structure_set(bytes, context),
    }
}

/// Makes a file. Items that the format cannot represent are left out and reported.
///
/// # Errors
/// When the format holds none of the items.
pub fn write(
    format: Format,
    items: &[Item],
    context: &WriteContext<'_>,
) -> Result<ExportedFile, ExchangeError> {
    let (mut kept, mut left_out) = loss::kept(format, items)?;
    let mut count = kept.len();
    let bytes = match format {
        Format::MrkJson => mrk_json::write(&kept),
        Format::Fcsv => fcsv::write(&kept),
        Format::Csv | Format::Tsv => table::write(format, &kept),
        Format::Mps => mps::write(&kept),
        Format::Cornerstone => cornerstone::write(&kept),
        Format::Sr => objects::write_report(&kept, context, &mut left_out).map(|(bytes, held)| {
            count = held;
            bytes
        }),
        Format::Seg | Format::SegNrrd | Format::Nifti => {
            let regions::LabelMapParts { maps, items: ids, lost } = regions::join(format, &kept, context)?;
            left_out.extend(lost);
            kept.retain(|item| ids.contains(&item.id));
            count = kept.len();
            match format {
                Format::Seg => objects::write_segmentation(&maps, &kept, context),
                Format::Nifti => {
                    write_nifti_labels(&maps[0]).map_err(|error| regions::failed(format, &error))
                }
                _ => write_seg_nrrd_layers(&maps).map_err(|error| regions::failed(format, &error)),
            }
        }
        Format::Stl | Format::Ply | Format::Obj | Format::Glb => {
            meshes::write(format, &kept, context, &mut left_out)
        }
        Format::RtStruct => {
            let possible = Format::names(Format::can_write);
            return Err(ExchangeError::OneWay { format, action: "written", possible });
        }
    }?;
    Ok(ExportedFile { bytes, items: count, left_out })
}
