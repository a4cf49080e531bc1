//! Slices that may share a volume: a scan, and a second one of the same SeriesInstanceUID that differs
//! in one attribute. Truth: PS3.3 C.7 (patient, study, frame of reference), C.8.2 and C.8.15 (CT images).
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs;
use std::path::Path;

use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use relief_dicom::{Discovery, Error, Strictness, Warning, WarningCode};

use super::made::slice_with;

/// Slices of a scan.
const SLICES: usize = 8;
/// Their distance, mm.
const GAP_MM: f64 = 2.0;

type Texts<'a> = [(Tag, VR, &'a str)];

/// Writes the slices of a scan whose first one is at `z`.
fn write(folder: &Path, scan: usize, z: f64, texts: impl Fn(usize) -> Vec<(Tag, VR, String)>) {
    for k in 0..SLICES {
        let texts = texts(k);
        let texts: Vec<_> = texts.iter().map(|(tag, vr, text)| (*tag, *vr, text.as_str())).collect();
        let slice = slice_with(z + GAP_MM * k as f64, 100 * scan + k, &texts);
        fs::write(folder.join(format!("{scan}-{k:02}.dcm")), slice).unwrap();
    }
}

/// A scan, and a second one at `z` with these texts.
fn two(z: f64, first: &Texts<'_>, second: &Texts<'_>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (scan, z, texts) in [(1, 0.0, first), (2, z, second)] {
        write(folder.path(), scan, z, |_| {
            texts.iter().map(|(tag, vr, text)| (*tag, *vr, (*text).to_owned())).collect()
        });
    }
    folder
}

fn discover(folder: &Path) -> Discovery {
    relief_dicom::discover(folder, Strictness::Lenient, &|_| ()).unwrap()
}

/// Slices of each series.
fn counts(folder: &Path) -> Vec<usize> {
    discover(folder).series.iter().map(|series| series.dims()[2]).collect()
}

fn load(folder: &Path) -> Result<(usize, Vec<Warning>), Error> {
    let found = discover(folder);
    let loaded = relief_dicom::load(found.select(None)?, Strictness::Lenient, &|_| ())?;
    Ok((loaded.volume.grid().dims()[2], loaded.warnings))
}

/// Heights of a second scan: behind the first one, half a slice beside it, and at its positions.
const PLACES_MM: [f64; 3] = [GAP_MM * SLICES as f64, GAP_MM / 2.0, 0.0];

/// Invariant: Slices of different patients, studies or frames of reference never share a volume.
#[test]
fn patients_studies_and_frames_of_reference_never_share_a_volume() {
    for (tag, vr) in [
        (tags::PATIENT_ID, VR::LO),
        (tags::ISSUER_OF_PATIENT_ID, VR::LO),
        (tags::STUDY_INSTANCE_UID, VR::UI),
        (tags::FRAME_OF_REFERENCE_UID, VR::UI),
    ] {
        for z in PLACES_MM {
            for uid in ["", "1.2.3"] {
                let uid = (tags::SERIES_INSTANCE_UID, VR::UI, uid);
                let folder = two(z, &[uid, (tag, vr, "1.2.8")], &[uid, (tag, vr, "1.2.9")]);
                assert_eq!(counts(folder.path()), [SLICES; 2], "{tag} {z} {uid:?}");
                let message = load(folder.path()).unwrap_err().to_string();
                assert!(!message.contains("1.2.8") && !message.contains("1.2.9"), "{message}");
                assert!(message.contains("#1") && message.contains("#2"), "{message}");
            }
        }
    }
    // Where there is no PatientID.
    let id = (tags::PATIENT_ID, VR::LO, "");
    let [first, second] =
        ["One^Patient", "Another^Patient"].map(|name| [id, (tags::PATIENT_NAME, VR::PN, name)]);
    let folder = two(GAP_MM / 2.0, &first, &second);
    assert_eq!(counts(folder.path()), [SLICES; 2]);
    let message = load(folder.path()).unwrap_err().to_string();
    assert!(message.contains("patient 1") && !message.contains("Another"), "{message}");
}

#[test]
fn one_instance_uid_of_two_patients_is_no_copy() {
    let patient = |id| [(tags::PATIENT_ID, VR::LO, id), (tags::SOP_INSTANCE_UID, VR::UI, "1.2.3.4")];
    let folder = two(0.0, &patient("a"), &patient("b"));
    assert_eq!(counts(folder.path()), [SLICES; 2]);
}

/// Invariant: Values of different quantities never share a volume, and a volume names its quantity.
#[test]
fn values_of_other_quantities_never_share_a_volume() {
    let of_type = |name| (tags::RESCALE_TYPE, VR::LO, name);
    for name in ["MGML", "Z_EFF", "ED", "EDW", "PCT", "OD", "US", "HU_MOD", "KARAT"] {
        for z in PLACES_MM {
            assert_eq!(counts(two(z, &[of_type("HU")], &[of_type(name)]).path()), [SLICES; 2], "{name} {z}");
        }
        let scaled = [of_type(name), (tags::RESCALE_SLOPE, VR::DS, "0.1")];
        for (texts, treatment) in [
            (&[of_type(name)][..], "not converted"),
            (&scaled, "rounded to whole numbers, from steps of 0.1"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let texts = texts.iter().map(|(tag, vr, text)| (*tag, *vr, (*text).to_owned()));
            let texts: Vec<_> = texts.collect();
            write(folder.path(), 1, 0.0, |_| texts.clone());
            let found = discover(folder.path());
            let loaded = relief_dicom::load(&found.series[0], Strictness::Lenient, &|_| ()).unwrap();
            let unit = if name == "KARAT" { "US" } else { name };
            assert_eq!((loaded.volume.quantity().unit(), found.series[0].value_type()), (unit, name));
            let warning = &loaded.warnings[0];
            assert_eq!(warning.code, WarningCode::OtherValues, "{name}");
            assert!(
                warning.message.contains(name) && warning.message.contains(treatment),
                "{}",
                warning.message
            );
        }
    }
    // Files without a type have HU.
    assert_eq!(counts(two(PLACES_MM[0], &[], &[of_type("HU")]).path()), [2 * SLICES]);
}

#[test]
fn images_of_other_kinds_do_not_lie_between_each_other() {
    for (tag, vr, first, second) in [
        (tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\AXIAL", "DERIVED\\SECONDARY\\AXIAL\\MIP"),
        (tags::CONVOLUTION_KERNEL, VR::SH, "B30s", "B70s"),
        (tags::KVP, VR::DS, "120", "140"),
        (tags::SLICE_THICKNESS, VR::DS, "2", "5"),
    ] {
        let scans = |z| two(z, &[(tag, vr, first)], &[(tag, vr, second)]);
        for z in [GAP_MM / 2.0, 0.0, GAP_MM * 5.5] {
            assert_eq!(counts(scans(z).path()), [SLICES; 2], "{tag} {z}");
        }
        // One behind the other they are one stack, with a warning.
        let folder = scans(GAP_MM * SLICES as f64);
        let (slices, warnings) = load(folder.path()).unwrap();
        let codes: Vec<WarningCode> = warnings.iter().map(|warning| warning.code).collect();
        assert_eq!((slices, codes), (2 * SLICES, vec![WarningCode::MixedSlices]), "{tag}");
        assert!(warnings[0].message.contains(&format!("8 have {first:?}")), "{}", warnings[0].message);
    }
    // One number in two spellings.
    let folder = two(GAP_MM / 2.0, &[(tags::KVP, VR::DS, "120")], &[(tags::KVP, VR::DS, "120.0")]);
    assert_eq!(counts(folder.path()), [2 * SLICES]);
}

#[test]
fn passes_over_one_region_are_separate() {
    for tag in [tags::ACQUISITION_NUMBER, tags::TEMPORAL_POSITION_IDENTIFIER] {
        let scans = |z| two(z, &[(tag, VR::IS, "1")], &[(tag, VR::IS, "2")]);
        for z in [GAP_MM / 2.0, 0.0, GAP_MM * 3.5] {
            assert_eq!(counts(scans(z).path()), [SLICES; 2], "{tag} {z}");
        }
        assert_eq!(load(scans(GAP_MM * SLICES as f64).path()).unwrap(), (2 * SLICES, vec![]));
    }
}

#[test]
fn rotations_that_meet_are_one_stack() {
    let folder = tempfile::tempdir().unwrap();
    let acquisition = |number: usize| vec![(tags::ACQUISITION_NUMBER, VR::IS, number.to_string())];
    write(folder.path(), 1, 0.0, |k| acquisition(k / 4));
    assert_eq!(load(folder.path()).unwrap(), (SLICES, vec![]));
    // A slice of one rotation at the place of a slice of the other.
    let copy = slice_with(GAP_MM * 3.0, 999, &[(tags::ACQUISITION_NUMBER, VR::IS, "1")]);
    fs::write(folder.path().join("copy.dcm"), copy).unwrap();
    let (slices, warnings) = load(folder.path()).unwrap();
    assert_eq!((slices, warnings.len()), (SLICES, 1));
    assert_eq!(warnings[0].code, WarningCode::DuplicatePosition);
}

#[test]
fn phases_are_separated_by_the_attribute_that_counts_them() {
    for (tag, vr, first, second) in [
        (tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, "1", "2"),
        (tags::ACQUISITION_NUMBER, VR::IS, "1", "2"),
        (tags::TRIGGER_TIME, VR::DS, "0", "400.5"),
        (tags::ACQUISITION_TIME, VR::TM, "120000", "120001"),
        (tags::CONTENT_TIME, VR::TM, "120000", "120001"),
        (tags::SERIES_DESCRIPTION, VR::LO, "Resp 0%", "Resp 50%"),
    ] {
        let folder = two(0.0, &[(tag, vr, first)], &[(tag, vr, second)]);
        assert_eq!(counts(folder.path()), [SLICES; 2], "{tag}");
        let found = discover(folder.path());
        assert!(!found.series[1].summary().contains("Resp"), "{}", found.series[1].summary());
    }
}

#[test]
fn phases_with_a_time_for_each_slice_are_separated_by_their_order() {
    let folder = tempfile::tempdir().unwrap();
    for phase in 0..3 {
        let time = |k: usize| vec![(tags::ACQUISITION_TIME, VR::TM, format!("0900{:02}.5", 10 * phase + k))];
        write(folder.path(), phase, 0.0, time);
    }
    assert_eq!(counts(folder.path()), [SLICES; 3]);
    // Times that do not separate them.
    let folder = tempfile::tempdir().unwrap();
    for phase in 0..3 {
        let time = |k: usize| vec![(tags::ACQUISITION_TIME, VR::TM, format!("0900{:02}", phase + k))];
        write(folder.path(), phase, 0.0, time);
    }
    let message = load(folder.path()).unwrap_err().to_string();
    assert!(message.contains("may be phases"), "{message}");
}

#[test]
fn ten_phases_are_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    for phase in 1..=10 {
        write(folder.path(), phase, 0.0, |_| vec![(tags::ACQUISITION_NUMBER, VR::IS, phase.to_string())]);
    }
    let found = discover(folder.path());
    for (index, series) in found.series.iter().enumerate() {
        let summary = series.summary();
        assert!(summary.ends_with(&format!("AcquisitionNumber (0020,0012) \"{}\"", index + 1)), "{summary}");
        assert!(summary.contains(&format!("phase {} of 10", index + 1)), "{summary}");
        assert_eq!(found.select_phase(None, index + 1).unwrap().uid(), series.uid());
    }
    let error = found.select_phase(None, 11).unwrap_err().to_string();
    assert!(error.starts_with("no series has a phase 11; found:"), "{error}");
    // Passes half a slice apart show other places.
    let passes =
        two(1.0, &[(tags::ACQUISITION_NUMBER, VR::IS, "1")], &[(tags::ACQUISITION_NUMBER, VR::IS, "2")]);
    assert!(discover(passes.path()).series.iter().all(|series| series.phase().is_none()));
}

/// Passes of fewer slices than [`SLICES`] are rotations: one stack, but not in silence.
#[test]
fn rotations_that_overlap_are_one_stack_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    for (number, z) in [("1", 0.0), ("2", 1.0), ("1", 2.0), ("2", 3.0), ("1", 4.0), ("2", 5.0)] {
        let slice = slice_with(z, z as usize, &[(tags::ACQUISITION_NUMBER, VR::IS, number)]);
        fs::write(folder.path().join(format!("{z}.dcm")), slice).unwrap();
    }
    let (slices, warnings) = load(folder.path()).unwrap();
    assert_eq!((slices, warnings.len()), (6, 1), "{warnings:?}");
    assert_eq!(warnings[0].code, WarningCode::MixedSlices);
}

/// Positions of micro-CT are nearer than the rounding of clinical ones.
#[test]
fn slices_of_micro_ct_are_apart() {
    for um in [35.0, 10.0, 1.0] {
        let mm: f64 = um / 1000.0;
        let spacing = format!("{mm}\\{mm}");
        let write = |left_out: Option<usize>| {
            let folder = tempfile::tempdir().unwrap();
            for k in (0..SLICES).filter(|k| Some(*k) != left_out) {
                let slice = slice_with(mm * k as f64, k, &[(tags::PIXEL_SPACING, VR::DS, &spacing)]);
                fs::write(folder.path().join(format!("{k}.dcm")), slice).unwrap();
            }
            load(folder.path()).unwrap()
        };
        assert_eq!(write(None), (SLICES, vec![]), "{um} um");
        let (slices, warnings) = write(Some(3));
        assert_eq!((slices, warnings[0].code), (SLICES, WarningCode::UnevenSpacing), "{um} um");
    }
}
