//! The fuzz targets as a program of libFuzzer. RELIEF_FUZZ_READER names the reader.
#![no_main]

mod targets;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use targets::READERS;

static READER: LazyLock<fn(&[u8])> = LazyLock::new(|| {
    let name = std::env::var("RELIEF_FUZZ_READER").unwrap_or_default();
    let found = READERS.iter().find(|(known, _)| *known == name);
    let names = || READERS.map(|(known, _)| known).join(", ");
    found.unwrap_or_else(|| panic!("RELIEF_FUZZ_READER is {name:?}, known: {}", names())).1
});

fuzz_target!(|bytes: &[u8]| READER(bytes));
