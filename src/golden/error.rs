//! Why a golden case cannot be read, rendered or shown. A picture that differs is no error but a
//! finding: see `compare`.

use std::path::PathBuf;

use super::limits::MAX_FILE_BYTES;
use relief_base::OutOfRange;
use relief_display::Layout;
use relief_render::{RenderError, SceneError};
use relief_session::EncodingError;
use relief_volume::{PhantomSizeError, UnknownPhantom};

/// Why a case, a golden or an artefact could not be handled.
#[derive(Debug, thiserror::Error)]
pub enum GoldenError {
    /// There is nothing to compare, which must not pass for success.
    #[error("{} contains no golden case; expected <suite>/<case>/case.toml", dir.display())]
    NoCases {
        /// The folder that was searched.
        dir: PathBuf,
    },
    /// A name that is neither a suite's nor a case's.
    #[error("no suite or case is named {name:?}; suites: {suites}")]
    UnknownCase {
        /// The requested name.
        name: String,
        /// The suites that there are.
        suites: String,
    },
    /// A folder whose name is not fit for a command or a page.
    #[error("{}: names of suites and cases have the letters a to z, digits and hyphens", path.display())]
    Name {
        /// The folder.
        path: PathBuf,
    },
    /// A file that nothing compares: probably left over, or misspelt.
    #[error("{}: nothing compares this file; remove it, or add it to `compare` in case.toml", path.display())]
    Stray {
        /// The file.
        path: PathBuf,
    },
    /// A file or folder that cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written or removed.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A golden beyond the limit.
    #[error(
        "{} has {bytes} bytes, allowed: at most {MAX_FILE_BYTES}; make the picture smaller",
        path.display()
    )]
    FileTooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// `case.toml` is not TOML, has an unknown key, or a value of the wrong kind.
    #[error("{}: {source}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's error, with line and column.
        source: Box<toml::de::Error>,
    },
    /// A value of `case.toml` that is out of range.
    #[error("{}: {source}", path.display())]
    Range {
        /// The file.
        path: PathBuf,
        /// The key, its value and the allowed values.
        source: OutOfRange,
    },
    /// The scene.
    #[error("{}: {source}", path.display())]
    Scene {
        /// The file.
        path: PathBuf,
        /// Why.
        source: SceneError,
    },
    /// The series of a case.
    #[error("the series at {}: {source}", path.display())]
    Series {
        /// Its expected place.
        path: PathBuf,
        /// Why it cannot be loaded.
        source: Box<relief_dicom::Error>,
    },
    /// The volume file of a case.
    #[error("the series at {}: {source}", path.display())]
    VolumeFile {
        /// Its expected place.
        path: PathBuf,
        /// Why it cannot be read.
        source: relief_dicom::FormatError,
    },
    /// The phantom's name.
    #[error(transparent)]
    Kind(#[from] UnknownPhantom),
    /// The phantom's size.
    #[error(transparent)]
    Size(#[from] PhantomSizeError),
    /// A golden that is no picture of the kind it should be.
    #[error("{}: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why it cannot be decoded.
        source: PictureError,
    },
    /// A picture that cannot be made into a file.
    #[error("cannot encode a picture: {0}")]
    Picture(#[from] image::ImageError),
    /// The render failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The frame could not be encoded.
    #[error(transparent)]
    Encode(#[from] EncodingError),
    /// A layout that goldens cannot hold.
    #[error("layout {layout} cannot be compared as a frame: {source}")]
    Layout {
        /// The layout.
        layout: Layout,
        /// Why its frame cannot be decoded.
        source: PictureError,
    },
    /// Goldens are made on a software adapter.
    #[error(
        "goldens are blessed on a software adapter, this is {adapter}; set RELIEF_ADAPTER=software, \
         and see `relief doctor` if no adapter is found"
    )]
    Adapter {
        /// The adapter in use.
        adapter: String,
    },
    /// A picture that proves nothing.
    #[error("the picture of {case} {defect}: it is not blessed")]
    Worthless {
        /// The case.
        case: String,
        /// The fault.
        defect: &'static str,
    },
}

/// Why the bytes of a picture are not used.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// It cannot be decoded.
    #[error(transparent)]
    Image(#[from] image::ImageError),
    /// A depth map that cannot be decoded.
    #[error(transparent)]
    Depth(#[from] relief_display::EncodeError),
    /// Another kind of pixels.
    #[error("the picture is {found:?}, expected {expected:?}")]
    ColorType {
        /// Its pixels.
        found: image::ColorType,
        /// The pixels of goldens.
        expected: image::ColorType,
    },
    /// More pixels than any golden has.
    #[error("the picture has {bytes} bytes of pixels, allowed: at most {}", super::limits::MAX_DECODED_BYTES)]
    TooLarge {
        /// Its decoded size.
        bytes: u64,
    },
}
