//! Damaged objects end in a result: never in a panic, an endless loop, or memory that a file only
//! claims.
#![allow(clippy::print_stdout, reason = "a test says what it found, in its helpers too")]

use relief_dicom::ReportReadOptions;

use relief_dicom::{LoadLimits, SegmentationOptions, read_segmentation, write_segmentation};

use super::{made, reports, segmentations};

type Reader = fn(&[u8]) -> bool;

fn read_report(bytes: &[u8]) -> bool {
    relief_dicom::read_report(bytes, &ReportReadOptions { author: "x", series: None }).is_ok()
}

fn read_map(bytes: &[u8]) -> bool {
    read_segmentation(LoadLimits { voxel_bytes: 1 << 20 }, bytes).is_ok()
}

fn read_structures(bytes: &[u8]) -> bool {
    relief_dicom::read_structure_set(bytes).is_ok()
}

/// A report, a segmentation and a structure set, each with its reader.
fn objects() -> [(&'static str, Vec<u8>, Reader); 3] {
    let made = made::series();
    let report = reports::written(&made::items(&made.frame_of_reference), &made).bytes;
    let map = segmentations::map(made.grid.clone());
    let map = write_segmentation(&map, &made.reference, &SegmentationOptions::by("x")).unwrap();
    [
        ("report", report, read_report),
        ("segmentation", map, read_map),
        ("structures", structures(), read_structures),
    ]
}

/// A structure set of two contours in implicit VR, by hand.
fn structures() -> Vec<u8> {
    let element = |group: u16, element: u16, value: &[u8]| {
        let mut value = value.to_vec();
        value.resize(value.len().next_multiple_of(2), b' ');
        let length = u32::try_from(value.len()).unwrap().to_le_bytes();
        [&group.to_le_bytes()[..], &element.to_le_bytes(), &length, &value].concat()
    };
    let item = |value: &[u8]| element(0xFFFE, 0xE000, value);
    let roi = [element(0x3006, 0x0022, b"1"), element(0x3006, 0x0026, b"ring")].concat();
    let contour = |data: &[u8]| {
        item(&[element(0x3006, 0x0042, b"CLOSED_PLANAR"), element(0x3006, 0x0050, data)].concat())
    };
    let contours = [contour(b"0\\0\\1\\4\\0\\1\\4\\3\\1"), contour(b"0\\0\\2\\4\\0\\2\\4\\3\\2")].concat();
    let drawn = [
        element(0x3006, 0x002A, b"255\\0\\9"),
        element(0x3006, 0x0040, &contours),
        element(0x3006, 0x0084, b"1"),
    ];
    [
        element(0x0008, 0x0016, b"1.2.840.10008.5.1.4.1.1.481.3\0"),
        element(0x0008, 0x0060, b"RTSTRUCT"),
        element(0x3006, 0x0020, &item(&roi)),
        element(0x3006, 0x0039, &item(&drawn.concat())),
    ]
    .concat()
}

#[test]
fn every_beginning_of_an_object_ends_in_a_result() {
    for (name, bytes, read) in objects() {
        assert!(read(&bytes), "{name}");
        let good = (0..bytes.len()).filter(|&end| read(&bytes[..end])).count();
        // A report or structure set that ends between two elements at the top is a shorter one.
        assert!(good <= bytes.len() / 10, "{name}: {good} of {} beginnings are read", bytes.len());
        println!("{name}: {} bytes, {good} beginnings are whole", bytes.len());
    }
}

/// Invariant: No bytes from outside cause a panic: DICOM files, frames, requests.
#[test]
fn flipped_bits_never_panic() {
    flip_bits(5_000);
}

#[test]
#[ignore = "takes half a minute: four times as many, in scripts/test --all"]
fn more_flipped_bits_never_panic() {
    flip_bits(20_000);
}

/// Reads each object `times` times, with other bits flipped each time.
fn flip_bits(times: u32) {
    for (name, bytes, read) in objects() {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            usize::try_from(state >> 16).unwrap()
        };
        let mut good = 0;
        for _ in 0..times {
            let mut damaged = bytes.clone();
            for _ in 0..=random() % 4 {
                let at = random() % damaged.len();
                damaged[at] ^= 1 << (random() % 8);
            }
            good += usize::from(read(&damaged));
        }
        println!("{name}: {good} of {times} damaged ones are read");
    }
}

#[test]
fn nesting_and_claims_are_bounded() {
    // Content sequences in each other, a hundred thousand deep, of undefined length.
    let deep = [0x40, 0, 0x30, 0xA7, 0xFF, 0xFF, 0xFF, 0xFF, 0xFE, 0xFF, 0x00, 0xE0, 0xFF, 0xFF, 0xFF, 0xFF]
        .repeat(100_000);
    let start = [0x08, 0, 0x60, 0, 2, 0, 0, 0, b'S', b'R'];
    let bytes = [&start[..], &deep].concat();
    let options = ReportReadOptions { author: "x", series: None };
    let refused = relief_dicom::read_report(&bytes, &options).unwrap_err().to_string();
    assert!(
        refused.contains("nested deeper than 32 levels") && refused.starts_with("(0040,A730)[1]/"),
        "{refused}"
    );
    // Four gigabytes of coordinates that are not there.
    let claim = [&start[..], &[0x70, 0, 0x22, 0, 0xFE, 0xFF, 0xFF, 0xFF, 1, 2]].concat();
    let refused = relief_dicom::read_report(&claim, &options).unwrap_err().to_string();
    assert!(refused.contains("(0070,0022): found 4294967294 bytes, expected at most"), "{refused}");
    let long = vec![0; (1 << 26) + 1];
    assert!(
        relief_dicom::read_report(&long, &options)
            .unwrap_err()
            .to_string()
            .contains("allowed: at most 67108864")
    );
}
