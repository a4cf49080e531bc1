//! The formats of mesh files, and the errors of their readers.

/// A mesh file's format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stanford's polygons; written binary, little-endian. Numbers are f32 within 8 m of the
    /// origin, else f64.
    Ply,
    /// Stereolithography; written binary, f32. Corners at equal places become one when it is read.
    Stl,
    /// Wavefront's text, to a millionth of a millimetre.
    Obj,
    /// Binary glTF 2.0, f32.
    Glb,
}

impl MeshFormat {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Stl, Self::Obj, Self::Glb];

    /// Its name, which is the ending of its files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Obj => "obj",
            Self::Glb => "glb",
        }
    }

    /// The format that a file's ending names, in letters of any case.
    #[must_use]
    pub fn of(path: &std::path::Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| format.name() == ending)
    }

    /// Its media type.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Ply => "model/ply",
            Self::Stl => "model/stl",
            Self::Obj => "model/obj",
            Self::Glb => "model/gltf-binary",
        }
    }
}

/// Why a file is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{format}, {at}: found {found}, expected {expected}")]
pub struct MeshFileError {
    /// The format's name.
    pub format: &'static str,
    /// The place in the file.
    pub at: MeshFilePlace,
    /// The found text or number.
    pub found: String,
    /// The expected content.
    pub expected: String,
}

impl MeshFileError {
    pub(super) fn new(
        format: MeshFormat,
        at: MeshFilePlace,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> Self {
        // Text of a file may be anything: it is shortened to one line.
        let clean = |c: char| if c.is_control() { '?' } else { c };
        let found = found.to_string().chars().map(clean).take(60).collect();
        Self { format: format.name(), at, found, expected: expected.into() }
    }
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MeshFilePlace {
    /// A line of text, from 1.
    Line(usize),
    /// A byte, from 0.
    Byte(usize),
    /// A path in JSON.
    Key(String),
}

impl std::fmt::Display for MeshFilePlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Key(key) => f.write_str(key),
        }
    }
}
