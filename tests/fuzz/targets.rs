//! Fuzz targets: one for each reader of bytes from outside.
//!
//! `scripts/fuzz` runs them under libFuzzer; `tests/hostile/mutated.rs` gives them some mutated
//! files of each format in every run of the tests. Oracles: nothing panics, aborts or exceeds limits
//! of memory and time; beyond that, each reader checks what it was able to read.

#[path = "annotations.rs"]
mod annotations;
#[path = "files.rs"]
mod files;
#[path = "messages.rs"]
mod messages;
#[path = "pictures.rs"]
mod pictures;
#[path = "reports.rs"]
mod reports;

/// Name of a reader, and its function on bytes.
pub(crate) type Reader = (&'static str, fn(&[u8]));

/// All readers.
pub(crate) const READERS: [Reader; 33] = [
    ("dicom", files::dicom),
    ("codecs", files::dicom),
    ("zip", files::zip),
    ("commitment", files::commitment),
    ("nifti", files::nifti),
    ("nrrd", files::nrrd),
    ("labels", files::labels),
    ("seg", annotations::seg),
    ("sr", annotations::sr),
    ("rtstruct", annotations::rtstruct),
    ("mrk-json", annotations::mrk_json),
    ("fcsv", annotations::fcsv),
    ("csv", annotations::csv),
    ("tsv", annotations::tsv),
    ("mps", annotations::mps),
    ("cornerstone", annotations::cornerstone),
    ("seg-nrrd", annotations::seg_nrrd),
    ("nifti-labels", annotations::nifti),
    ("stl", annotations::stl),
    ("ply", annotations::ply),
    ("obj", annotations::obj),
    ("glb", annotations::glb),
    ("template", annotations::template),
    ("png", pictures::png),
    ("exr", pictures::exr),
    ("transfer", pictures::transfer),
    ("scene", pictures::scene),
    ("frame", messages::frame),
    ("views", messages::views),
    ("message", messages::message),
    ("intent", messages::intent),
    ("reports", reports::reports),
    ("recording", reports::recording),
];
