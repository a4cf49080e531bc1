//! Fuzz targets: one for each reader of bytes from outside. RELIEF_FUZZ_READER names the reader.
//!
//! Oracles: nothing panics, aborts or exceeds the limits of memory and time that scripts/fuzz sets;
//! beyond that, each reader checks what it was able to read.
#![no_main]

mod annotations;
mod files;
mod messages;
mod pictures;
mod reports;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

/// Name of a reader, and its function on bytes.
type Reader = (&'static str, fn(&[u8]));

/// All readers.
const READERS: [Reader; 32] = [
    ("dicom", files::dicom),
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

static READER: LazyLock<fn(&[u8])> = LazyLock::new(|| {
    let name = std::env::var("RELIEF_FUZZ_READER").unwrap_or_default();
    let found = READERS.iter().find(|(known, _)| *known == name);
    let names = || READERS.map(|(known, _)| known).join(", ");
    found.unwrap_or_else(|| panic!("RELIEF_FUZZ_READER is {name:?}, known: {}", names())).1
});

fuzz_target!(|bytes: &[u8]| READER(bytes));
