//! The formats, their names, and the recognition of a file's format.

use std::path::Path;

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

impl Format {
    /// All of them.
    pub const ALL: [Self; 15] = [
        Self::MrkJson,
        Self::Fcsv,
        Self::Csv,
        Self::Tsv,
        Self::Mps,
        Self::Cornerstone,
        Self::Sr,
        Self::Seg,
        Self::SegNrrd,
        Self::Nifti,
        Self::RtStruct,
        Self::Stl,
        Self::Ply,
        Self::Obj,
        Self::Glb,
    ];

    /// Its name on the command line and in the HTTP interface.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::MrkJson => "mrk.json",
            Self::Fcsv => "fcsv",
            Self::Csv => "csv",
            Self::Tsv => "tsv",
            Self::Mps => "mps",
            Self::Cornerstone => "cornerstone",
            Self::Sr => "sr",
            Self::Seg => "seg",
            Self::SegNrrd => "seg.nrrd",
            Self::Nifti => "nii.gz",
            Self::RtStruct => "rtstruct",
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Glb => "glb",
        }
    }

    /// Its file name extensions.
    #[must_use]
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Cornerstone => "json",
            Self::Sr | Self::Seg | Self::RtStruct => "dcm",
            _ => self.name(),
        }
    }

    /// What HTTP calls its content.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::MrkJson | Self::Cornerstone => "application/json",
            Self::Fcsv | Self::Csv => "text/csv",
            Self::Tsv => "text/tab-separated-values",
            Self::Mps => "application/xml",
            Self::Sr | Self::Seg | Self::RtStruct => "application/dicom",
            Self::SegNrrd | Self::Nifti | Self::Ply => "application/octet-stream",
            Self::Stl => "model/stl",
            Self::Obj => "model/obj",
            Self::Glb => "model/gltf-binary",
        }
    }

    /// Names of the formats that `wanted` picks, for people.
    pub(super) fn names(wanted: impl Fn(Self) -> bool) -> String {
        Self::ALL.into_iter().filter(|format| wanted(*format)).map(Self::name).collect::<Vec<_>>().join(", ")
    }

    /// The format of a file, by its name and its first bytes (a kilobyte or more). A DICOM object
    /// and a JSON file are recognised by their bytes. `None` where neither decides.
    #[must_use]
    pub fn of(path: &Path, head: &[u8]) -> Option<Self> {
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
    fn files_are_told_by_name_and_beginning() {
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
        assert_eq!(of("any", &object("1.2.840.10008.5.1.4.1.1.481.3")), Some(Format::RtStruct));
        assert_eq!(of("any.csv", &object("1.2.840.10008.5.1.4.1.1.2")), None);
    }

    #[test]
    fn every_format_has_a_name_of_its_own() {
        for format in Format::ALL {
            assert_eq!(format.name().parse(), Ok(format));
        }
        assert!("xml".parse::<Format>().unwrap_err().to_string().contains("mrk.json, fcsv"));
    }
}
