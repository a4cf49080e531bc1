//! Annotations in the files of other tools, both ways.
//!
//! [`read`] converts a file's bytes to items, [`write()`] converts items to bytes, and both report
//! losses. They open no files and store nothing (see `store`). `docs/ANNOTATIONS.md` has a table of
//! what each format can represent.
//!
//! Space: patient LPS, mm; formats in RAS are mirrored at the edge. A file is taken whole or
//! refused: an error names its line or JSON path. Memory grows with the file, by a bounded factor,
//! whatever the file claims.

mod context;
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

pub use context::{ExportedFile, Imported, ReadContext, WriteContext};
pub use deidentify::deidentified;
pub use error::{ExchangeError, NothingLeft, SyntaxError};
pub use format::{Format, FormatInfo, UnknownFormat};
pub use loss::LeftOut;
pub use merge::{ExistingItems, Merged};
pub use structures::{
    StoredContent, StructureError, content_of_mesh, content_of_region, mask_of_content, mesh_of_content,
};

use relief_annotation::Item;
use relief_dicom::{write_nifti_labels, write_seg_nrrd_layers};

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
        Format::Seg | Format::LabelMap => objects::read_segmentation(format, bytes, context),
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
    let (items, other_phases) = loss::of_phase(items, context.phase);
    let (mut kept, mut left_out) = loss::kept(format, items, other_phases)?;
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
        Format::Seg | Format::LabelMap | Format::SegNrrd | Format::Nifti => {
            let regions::LabelMapParts { maps, items: ids, lost } = regions::join(format, &kept, context)?;
            left_out.extend(lost);
            kept.retain(|item| ids.contains(&item.id));
            count = kept.len();
            match format {
                Format::Seg | Format::LabelMap => objects::write_segmentation(format, &maps, &kept, context),
                Format::Nifti => write_nifti_labels(&maps[0]).map_err(|error| regions::failed(format, error)),
                _ => write_seg_nrrd_layers(&maps).map_err(|error| regions::failed(format, error)),
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
    if !matches!(format, Format::Seg | Format::LabelMap) {
        left_out.extend(loss::of_warnings(context.warnings));
    }
    Ok(ExportedFile { bytes, items: count, left_out })
}
