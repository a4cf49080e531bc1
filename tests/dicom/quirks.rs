//! Odd files, one by one and together: each behaves as the table in `../shared/data/README.md`
//! says.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use common::{facts, numbers, shared_data, unpacked};
use relief_dicom::{Discovery, Error, Loaded, Strictness, WarningCode};

fn discover(path: &Path) -> Discovery {
    relief_dicom::discover(path, Strictness::Lenient, &|_| ()).unwrap()
}

fn load(path: &Path) -> Result<Loaded, Error> {
    let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ())?;
    relief_dicom::load(found.select(None)?, Strictness::Lenient, &|_| ())
}

fn quirks(what: &str) -> Option<PathBuf> {
    shared_data(what, &["quirks"]).map(|data| data.join("quirks"))
}

fn codes(loaded: &Loaded) -> Vec<WarningCode> {
    loaded.warnings.iter().map(|warning| warning.code).collect()
}

#[test]
fn odd_ct_slices_load_with_the_hu_of_other_readers() {
    let Some(data) = shared_data("odd CT slices", &["quirks.facts.json"]) else { return };
    let facts = facts(&data, "quirks.facts.json");
    for file in ["CT_small.dcm", "J2K_pixelrep_mismatch.dcm", "explicit_VR-UN.dcm", "bad_sequence.dcm"] {
        let loaded = load(&data.join("quirks").join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        let fact = facts.as_array().unwrap().iter().find(|fact| fact["file"] == file).unwrap();
        let [low, high, mean] = numbers(&fact["hu"])[..] else { panic!("{fact}") };
        assert_eq!(loaded.volume.range_hu(), (low as i16, high as i16), "{file}");
        let hu = loaded.volume.voxels_hu();
        let found = hu.iter().map(|&hu| f64::from(hu)).sum::<f64>() / hu.len() as f64;
        assert!((found - mean).abs() < 1e-3, "{file}: mean {found} HU, not {mean}");
        assert_eq!(codes(&loaded), [WarningCode::SingleSlice], "{file}");
    }
}

#[test]
fn files_that_are_no_ct_slices_are_skipped_with_a_reason() {
    for (file, reason) in [
        ("no_meta_group_length.dcm", "not CT"),
        ("meta_missing_tsyntax.dcm", "not CT"),
        ("ExplVR_BigEnd.dcm", "not CT"),
        ("ExplVR_BigEndNoMeta.dcm", "not CT: RTPLAN"),
        ("ExplVR_LitEndNoMeta.dcm", "not CT: RTPLAN"),
        ("image_dfl.dcm", "not CT"),
        ("MR_truncated.dcm", "not CT: MR"),
        ("MR_small_padded.dcm", "not CT: MR"),
        ("MR_small_bigendian.dcm", "not CT: MR"),
        ("JPEG2000-embedded-sequence-delimiter.dcm", "not CT"),
        ("UN_sequence.dcm", "not CT"),
        ("badVR.dcm", "not CT: RTDOSE"),
        ("empty_charset_LEI.dcm", "not CT"),
        ("nested_priv_SQ.dcm", "not CT"),
        ("emri_small_RLE.dcm", "not CT: MR"),
        ("emri_small_jpeg_2k_lossless_too_short.dcm", "not CT: MR"),
        ("liver.dcm", "not CT: SEG"),
        ("liver_nonbyte_aligned.dcm", "not CT: SEG"),
        ("SC_rgb.dcm", "not CT"),
        ("SC_rgb_small_odd.dcm", "not CT"),
        ("MR2_J2KI.dcm", "not CT: MR"),
        ("dx_image_MONOCHROME1.dcm", "not CT: DX"),
        ("RG3_J2KI_MONOCHROME1.dcm", "not CT: CR"),
        ("rtdose.dcm", "not CT: RTDOSE"),
        ("rtstruct.dcm", "not CT: RTSTRUCT"),
        ("test-SR.dcm", "not CT: SR"),
        ("jpeg_lossless_sel1_localizer.dcm", "localizer"),
    ] {
        let Some(data) = shared_data("a file that is no CT slice", &[&format!("quirks/{file}")]) else {
            continue;
        };
        let found = discover(&data.join("quirks").join(file));
        assert!(found.series.is_empty(), "{file} is a series");
        assert_eq!(found.skipped.len(), 1, "{file}");
        assert!(found.skipped[0].reason.contains(reason), "{file}: {}", found.skipped[0].reason);
        // Sound objects of another kind are no defects, so that strict reading accepts them beside
        // a series.
        assert!(found.skipped[0].defect.is_none(), "{file}: {}", found.skipped[0].reason);
        let error = found.select(None).unwrap_err().to_string();
        assert!(error.contains(file), "{error}");
    }
}

#[test]
fn a_file_shifted_by_one_byte_is_not_dicom() {
    let Some(quirks) = quirks("a file without meta information") else { return };
    let found = discover(&quirks.join("no_meta.dcm"));
    assert!(found.skipped[0].defect.is_some());
    assert!(found.skipped[0].reason.contains("found bytes 20 08 00 05"), "{}", found.skipped[0].reason);
}

#[test]
fn a_slice_without_meta_information_is_read_by_a_guess() {
    let Some(quirks) = quirks("a slice without meta information") else { return };
    // The purpose of `no_meta.dcm`: only the data set.
    let bytes = fs::read(quirks.join("no_meta.dcm")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bare.dcm"), &bytes[1..]).unwrap();
    let loaded = load(folder.path()).unwrap();
    assert_eq!(codes(&loaded), [WarningCode::GuessedEncoding, WarningCode::SingleSlice]);
    let whole = load(&quirks.join("CT_small.dcm")).unwrap();
    assert_eq!(loaded.volume.voxels_hu(), whole.volume.voxels_hu());
}

#[test]
fn enhanced_ct_is_placed_by_its_functional_groups() {
    let Some(data) = shared_data("enhanced CT", &["enhanced_ct.facts.json"]) else { return };
    let expected = &facts(&data, "enhanced_ct.facts.json")["quirks/eCT_Supplemental.dcm"]["frames_facts"];
    let loaded = load(&data.join("quirks/eCT_Supplemental.dcm")).unwrap();
    // Its RescaleType is US, "unspecified".
    assert_eq!(codes(&loaded), [WarningCode::OtherValues]);
    let grid = loaded.volume.grid();
    let spacing = [0.388_672, 0.388_672, 10.0];
    assert!(grid.spacing_mm().iter().zip(spacing).all(|(found, mm)| (found - mm).abs() < 1e-6));
    let [x, y, z] = grid.axis_directions();
    assert_eq!((x, y, z), (-glam::DVec3::X, glam::DVec3::Y, -glam::DVec3::Z)); // rows run to the right
    for frame in expected.as_array().unwrap() {
        let [px, py, pz] = numbers(&frame["ipp"])[..] else { panic!("{frame}") };
        let index = (grid.voxel_from_patient() * relief_base::Point::new(px, py, pz)).xyz;
        assert!(index.distance(index.round()) < 1e-6 && index.x.abs() + index.y.abs() < 1e-6, "{index}");
        let slice = &loaded.volume.voxels_hu()[index.z.round() as usize * 512 * 512..][..512 * 512];
        let [low, high, mean] = numbers(&frame["hu_min_max_mean"])[..] else { panic!("{frame}") };
        let range = [slice.iter().min().unwrap(), slice.iter().max().unwrap()].map(|&hu| f64::from(hu));
        assert_eq!(range, [low, high]);
        let found = slice.iter().map(|&hu| f64::from(hu)).sum::<f64>() / slice.len() as f64;
        assert!((found - mean).abs() < 1e-3, "mean {found} HU, not {mean}");
    }
}

#[test]
fn a_folder_of_everything_lists_its_series_and_asks_which() {
    let Some(quirks) = quirks("a mixed folder") else { return };
    let found = discover(&quirks);
    let sizes: BTreeSet<[usize; 3]> = found.series.iter().map(relief_dicom::SeriesEntry::dims).collect();
    let expected = [[512, 512, 1], [128, 128, 1], [512, 512, 2], [16, 16, 4]];
    assert_eq!(sizes, expected.into_iter().collect());
    let error = found.select(None).unwrap_err();
    let Error::SeveralSeries { count, .. } = &error else { panic!("{error}") };
    assert_eq!(*count, found.series.len());
    let message = error.to_string();
    for series in &found.series {
        assert!(message.contains(series.uid()), "{message}");
        assert_eq!(found.select(Some(series.uid())).unwrap().uid(), series.uid());
    }
    assert!(matches!(found.select(Some("1.2.3")), Err(Error::UnknownSeries { .. })));
    // Only one of these files is damaged.
    let defective: Vec<&str> = found.defective().map(|skipped| skipped.file.as_str()).collect();
    assert!(defective.len() == 1 && defective[0].ends_with("no_meta.dcm"), "{defective:?}");
}

#[test]
fn scouts_and_dose_pages_stay_out_of_the_axial_volume() {
    let Some(phantom) = unpacked("a phantom study", "phantom-skull-5mm", &[]) else { return };
    let Some(extras) = unpacked("a phantom study", "phantom-study-extras", &[]) else { return };
    let study = tempfile::tempdir().unwrap();
    for (name, folder) in [("S2010", &phantom), ("extras", &extras)] {
        link_all(folder, &study.path().join(name));
    }
    let found = discover(study.path());
    assert_eq!(found.series.len(), 1);
    assert_eq!(found.series[0].dims(), [512, 512, 28]);
    let alone = load(&phantom).unwrap();
    let together = relief_dicom::load(&found.series[0], Strictness::Lenient, &|_| ()).unwrap();
    assert_eq!(together.volume.content_hash(), alone.volume.content_hash());
}

/// Makes `to` a folder like `from`, with links to its files.
fn link_all(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            link_all(&from, &to);
        } else {
            fs::hard_link(&from, &to).or_else(|_| fs::copy(&from, &to).map(|_| ())).unwrap();
        }
    }
}

#[test]
fn a_series_with_one_odd_gap_is_resampled_and_says_how_far_off() {
    let Some(quirks) = quirks("a series with a gap") else { return };
    let loaded = load(&quirks.join("dicomdirtests/77654033_CT2")).unwrap();
    // Positions -99.48, 103.02, 104.27, 105.52 mm: an even grid of 4 has 103.02 at -31.147 mm.
    assert_eq!(codes(&loaded), [WarningCode::UnevenSpacing]);
    assert!(loaded.warnings[0].message.contains("134.167 mm"), "{}", loaded.warnings[0].message);
    assert_eq!(loaded.volume.grid().dims(), [16, 16, 165]);
    assert!((loaded.volume.grid().spacing_mm()[2] - 1.25).abs() < 1e-6);
}

#[test]
fn a_dicomdir_leads_to_the_files_it_names() {
    let Some(quirks) = quirks("DICOMDIR") else { return };
    // Systems that copy discs put an ending or a version behind names.
    for behind in ["", ".dcm", ".DCM", ";1"] {
        let disc = tempfile::tempdir().unwrap();
        // The disc has its folders in lower case, as some systems copy them.
        let folder = disc.path().join("77654033/ct2");
        fs::create_dir_all(&folder).unwrap();
        fs::copy(quirks.join("DICOMDIR"), disc.path().join("DICOMDIR")).unwrap();
        for slice in fs::read_dir(quirks.join("dicomdirtests/77654033_CT2")).unwrap().map(Result::unwrap) {
            let mut name = slice.file_name();
            name.push(behind);
            fs::copy(slice.path(), folder.join(name)).unwrap();
        }
        fs::copy(quirks.join("CT_small.dcm"), disc.path().join("not-in-the-directory.dcm")).unwrap();
        let found = discover(&disc.path().join("DICOMDIR"));
        assert_eq!(found.series.len(), 1, "{behind}");
        assert_eq!(found.series[0].dims(), [16, 16, 4], "{behind}");
        // The other files it names were left behind.
        assert!(
            found.skipped.iter().all(|skipped| skipped.reason.contains("cannot be read")),
            "{:?}",
            found.skipped
        );
        assert!(found.skipped.iter().any(|skipped| skipped.file.ends_with("98892001/CT2N/6293")));
    }
}

#[test]
fn a_dicomdir_that_points_outside_is_refused() {
    let Some(quirks) = quirks("DICOMDIR") else { return };
    let mut bytes = fs::read(quirks.join("DICOMDIR")).unwrap();
    let at = bytes.windows(12).position(|window| window == b"77654033\\CT2").unwrap();
    bytes[at..at + 8].copy_from_slice(b"..\\..\\..");
    let disc = tempfile::tempdir().unwrap();
    fs::write(disc.path().join("DICOMDIR"), bytes).unwrap();
    let error =
        relief_dicom::discover(&disc.path().join("DICOMDIR"), Strictness::Lenient, &|_| ()).unwrap_err();
    assert!(error.to_string().contains("ReferencedFileID (0004,1500)"), "{error}");
}

#[test]
fn a_zip_is_read_as_the_folder_it_holds() {
    let Some(quirks) = quirks("zip") else { return };
    let folder = quirks.join("dicomdirtests");
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("study.zip");
    let mut zip = zip::ZipWriter::new(fs::File::create(&path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    zip.add_directory("deep", options).unwrap();
    for slice in fs::read_dir(folder.join("77654033_CT2")).unwrap().map(Result::unwrap) {
        zip.start_file(format!("deep/er/{}", slice.file_name().display()), options).unwrap();
        std::io::Write::write_all(&mut zip, &fs::read(slice.path()).unwrap()).unwrap();
    }
    zip.start_file("README.txt", options).unwrap();
    std::io::Write::write_all(&mut zip, b"no image").unwrap();
    zip.finish().unwrap();
    let (zipped, plain) = (load(&path).unwrap(), load(&folder).unwrap());
    assert_eq!(zipped.volume.content_hash(), plain.volume.content_hash());
    let skipped = discover(&path).skipped;
    assert!(skipped.len() == 1 && skipped[0].file == "README.txt", "{skipped:?}");
}
