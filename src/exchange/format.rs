//! The formats, their names, and the recognition of a file's format.

use std::path::Path;

use crate::representable::Representable;

/// A format of files that annotations are exchanged in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Format {
    /// 3D Slicer's markups.
    MrkJson,
    /// 3D Slicer's older lists of points.
    Fcsv,
    /// 3D Slicer's table of points, with commas.
    Csv,
    /// The same with tabs.
    Tsv,
    /// MITK's point sets.
    Mps,
    /// Annotations of Cornerstone, as its state manager has them.
    Cornerstone,
    /// DICOM Comprehensive 3D SR.
    Sr,
    /// DICOM Segmentation.
    Seg,
    /// DICOM Label Map Segmentation.
    LabelMap,
    /// 3D Slicer's segmentations.
    SegNrrd,
    /// Label maps of NIfTI.
    Nifti,
    /// DICOM RT Structure Set.
    RtStruct,
    /// Triangles of stereolithography.
    Stl,
    /// Stanford's polygons.
    Ply,
    /// Wavefront's objects.
    Obj,
    /// glTF in one file.
    Glb,
}

/// A name that no format has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown format {found:?}; known formats: {}", Format::names(|_| true))]
pub struct UnknownFormat {
    /// The requested format.
    pub found: String,
}

/// One format.
#[derive(Clone, Copy, Debug)]
pub struct FormatInfo {
    /// The format.
    pub format: Format,
    /// Its name on the command line and in the HTTP interface.
    pub name: &'static str,
    /// A title for menus.
    pub title: &'static str,
    /// Its file name extension.
    pub extension: &'static str,
    /// Its media type in HTTP.
    pub media_type: &'static str,
    /// Whether [`crate::write`] supports it.
    pub is_written: bool,
    /// The values that it can represent; `None` if its writer reports losses itself.
    pub(super) holds: Option<Representable>,
}

impl Format {
    /// All formats: the one table from which the command line, the API description and the pages
    /// take them. `docs/ANNOTATIONS.md` is checked against it.
    pub const TABLE: [FormatInfo; 16] = [
        FormatInfo {
            format: Self::MrkJson,
            name: "mrk.json",
            title: "3D Slicer markups",
            extension: "mrk.json",
            media_type: "application/json",
            is_written: true,
            holds: Some(Representable::EVERYTHING),
        },
        FormatInfo {
            format: Self::Fcsv,
            name: "fcsv",
            title: "3D Slicer fiducials",
            extension: "fcsv",
            media_type: "text/csv",
            is_written: true,
            holds: Some(Representable { quotes: true, ..Representable::TABLE }),
        },
        FormatInfo {
            format: Self::Csv,
            name: "csv",
            title: "table",
            extension: "csv",
            media_type: "text/csv",
            is_written: true,
            holds: Some(Representable::TABLE),
        },
        FormatInfo {
            format: Self::Tsv,
            name: "tsv",
            title: "table with tabs",
            extension: "tsv",
            media_type: "text/tab-separated-values",
            is_written: true,
            holds: Some(Representable::TABLE),
        },
        FormatInfo {
            format: Self::Mps,
            name: "mps",
            title: "MITK points",
            extension: "mps",
            media_type: "application/xml",
            is_written: true,
            holds: Some(Representable::POSITIONS),
        },
        FormatInfo {
            format: Self::Cornerstone,
            name: "cornerstone",
            title: "Cornerstone JSON",
            extension: "json",
            media_type: "application/json",
            is_written: true,
            holds: Some(Representable {
                kinds: &["point", "line", "angle", "curve"],
                undefined: false,
                ..Representable::EVERYTHING
            }),
        },
        FormatInfo {
            format: Self::Sr,
            name: "sr",
            title: "DICOM structured report",
            extension: "dcm",
            media_type: "application/dicom",
            is_written: true,
            holds: None,
        },
        FormatInfo {
            format: Self::Seg,
            name: "seg",
            title: "DICOM segmentation",
            extension: "dcm",
            media_type: "application/dicom",
            is_written: true,
            holds: Some(Representable::REGIONS),
        },
        FormatInfo {
            format: Self::LabelMap,
            name: "labelmap",
            title: "DICOM label map",
            extension: "dcm",
            media_type: "application/dicom",
            is_written: true,
            holds: Some(Representable::REGIONS),
        },
        FormatInfo {
            format: Self::SegNrrd,
            name: "seg.nrrd",
            title: "3D Slicer segmentation",
            extension: "seg.nrrd",
            media_type: "application/octet-stream",
            is_written: true,
            holds: Some(Representable::REGIONS),
        },
        FormatInfo {
            format: Self::Nifti,
            name: "nii.gz",
            title: "NIfTI labels",
            extension: "nii.gz",
            media_type: "application/octet-stream",
            is_written: true,
            holds: Some(Representable::REGIONS),
        },
        FormatInfo {
            format: Self::RtStruct,
            name: "rtstruct",
            title: "DICOM structure set",
            extension: "dcm",
            media_type: "application/dicom",
            is_written: false,
            holds: None,
        },
        FormatInfo {
            format: Self::Stl,
            name: "stl",
            title: "mesh",
            extension: "stl",
            media_type: "model/stl",
            is_written: true,
            holds: Some(Representable { name: false, ..Representable::MESHES }),
        },
        FormatInfo {
            format: Self::Ply,
            name: "ply",
            title: "mesh",
            extension: "ply",
            media_type: "application/octet-stream",
            is_written: true,
            holds: Some(Representable { name: false, ..Representable::MESHES }),
        },
        FormatInfo {
            format: Self::Obj,
            name: "obj",
            title: "mesh",
            extension: "obj",
            media_type: "model/obj",
            is_written: true,
            holds: Some(Representable::MESHES),
        },
        FormatInfo {
            format: Self::Glb,
            name: "glb",
            title: "mesh, glTF",
            extension: "glb",
            media_type: "model/gltf-binary",
            is_written: true,
            holds: Some(Representable::MESHES),
        },
    ];

    /// All formats.
    pub const ALL: [Self; Self::TABLE.len()] = {
        let mut all = [Self::MrkJson; Self::TABLE.len()];
        let mut at = 0;
        while at < all.len() {
            all[at] = Self::TABLE[at].format;
            at += 1;
        }
        all
    };

    /// The format's row of the table.
    #[must_use]
    pub fn info(self) -> &'static FormatInfo {
        const TABLE: &[FormatInfo] = &Format::TABLE;
        TABLE.iter().find(|info| info.format == self).unwrap_or(&TABLE[0]) // every format has its row
    }

    /// Its name on the command line and in the HTTP interface.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.info().name
    }

    /// Its file name extension.
    #[must_use]
    pub fn extension(self) -> &'static str {
        self.info().extension
    }

    /// Its media type in HTTP.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        self.info().media_type
    }

    /// Whether [`crate::write`] supports it.
    #[must_use]
    pub fn can_write(self) -> bool {
        self.info().is_written
    }

    /// Names of the formats that `wanted` picks, for people.
    pub(super) fn names(wanted: impl Fn(Self) -> bool) -> String {
        Self::ALL.into_iter().filter(|format| wanted(*format)).map(Self::name).collect::<Vec<_>>().join(", ")
    }

    /// The format of a file, by its name and the first 16 KiB of its `bytes`. A DICOM object and a
    /// JSON file are recognised by their bytes. `None` where neither decides.
    #[must_use]
    pub fn of(path: &Path, bytes: &[u8]) -> Option<Self> {
        let head = &bytes[..bytes.len().min(1 << 14)];
        if head.get(128..132) == Some(b"DICM") {
            return dicom_kind(head);
        }
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let by_name = |format: Self| name.ends_with(&format!(".{}", format.name()));
        if name.ends_with(".json") {
            let says = |word: &[u8]| head.windows(word.len()).any(|part| part.eq_ignore_ascii_case(word));
            if says(b"markups-schema") {
                return Some(Self::MrkJson);
            }
            if [b"annotationUID".as_slice(), b"toolName", b"FrameOfReferenceUID"].into_iter().any(says) {
                return Some(Self::Cornerstone);
            }
            return by_name(Self::MrkJson).then_some(Self::MrkJson);
        }
        let other_names = [(".nii", Self::Nifti), (".nrrd", Self::SegNrrd)];
        let other = || other_names.into_iter().find(|(end, _)| name.ends_with(end)).map(|(_, format)| format);
        Self::ALL
            .into_iter()
            .find(|format| format.extension() == format.name() && by_name(*format))
            .or_else(other)
    }
}

/// The kind of a DICOM object, by the SOP class in its file meta group.
fn dicom_kind(head: &[u8]) -> Option<Format> {
    let classes = [
        ("1.2.840.10008.5.1.4.1.1.88.", Format::Sr),
        ("1.2.840.10008.5.1.4.1.1.66.4", Format::Seg),
        ("1.2.840.10008.5.1.4.1.1.66.7", Format::LabelMap),
        ("1.2.840.10008.5.1.4.1.1.481.3", Format::RtStruct),
    ];
    let meta = head.get(132..)?;
    let meta = meta.get(..1024).unwrap_or(meta);
    let is_in = |class: &str| meta.windows(class.len()).any(|part| part == class.as_bytes());
    classes.into_iter().find(|(class, _)| is_in(class)).map(|(_, format)| format)
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Format {
    type Err = UnknownFormat;

    fn from_str(text: &str) -> Result<Self, UnknownFormat> {
        let unknown = || UnknownFormat { found: text.chars().take(40).collect() };
        Self::ALL.into_iter().find(|format| format.name() == text).ok_or_else(unknown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_recognised_by_name_and_first_bytes() {
        let of = |name: &str, head: &[u8]| Format::of(Path::new(name), head);
        assert_eq!(of("a/F_1.fcsv", b"# Markups"), Some(Format::Fcsv));
        assert_eq!(of("a.MRK.json", b"{"), Some(Format::MrkJson));
        assert_eq!(of("a.json", br#"{"@schema": "x/Markups-Schema-v1.0.0.json#"#), Some(Format::MrkJson));
        assert_eq!(of("a.json", br#"[{"annotationUID""#), Some(Format::Cornerstone));
        assert_eq!((of("a.json", b"{}"), of("seg", b""), of("csv", b"")), (None, None, None));
        assert_eq!((of("a.nii", b""), of("a.seg.nrrd", b"")), (Some(Format::Nifti), Some(Format::SegNrrd)));
        let object = |class: &str| [[0; 128].as_slice(), b"DICM....", class.as_bytes()].concat();
        assert_eq!(of("any", &object("1.2.840.10008.5.1.4.1.1.88.34")), Some(Format::Sr));
        assert_eq!(of("a.csv", &object("1.2.840.10008.5.1.4.1.1.66.4")), Some(Format::Seg));
        assert_eq!(of("a.csv", &object("1.2.840.10008.5.1.4.1.1.66.7")), Some(Format::LabelMap));
        assert_eq!(of("any", &object("1.2.840.10008.5.1.4.1.1.481.3")), Some(Format::RtStruct));
        assert_eq!(of("any.csv", &object("1.2.840.10008.5.1.4.1.1.2")), None);
    }

    #[test]
    fn every_format_has_a_name_of_its_own() {
        for format in Format::ALL {
            assert_eq!((format.info().format, format.name().parse()), (format, Ok(format)));
        }
        assert!("xml".parse::<Format>().unwrap_err().to_string().contains("mrk.json, fcsv"));
    }
}
