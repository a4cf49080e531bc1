//! Files read in a child without rights: the same result as in this process, no rights, and an end
//! that no other process notices.

use std::path::Path;

use relief_base::Budget;
use relief_dicom::Strictness;
use relief_exchange::{Format, ReadContext};
use relief_isolation::{FoundSeries, IsolatedReader, IsolationError, Listing, SeriesChoice};
use relief_session::{load_labels, most_label_voxels};

use super::RELIEF;
use crate::common::any_series;

fn reader() -> IsolatedReader {
    IsolatedReader::of_program(RELIEF.into())
}

fn only() -> SeriesChoice {
    SeriesChoice::only("the uploaded file")
}

/// A phantom head in a folder: the series, `labels.seg.nrrd` and `landmarks.csv`.
fn head(folder: &Path) {
    let made = std::process::Command::new(RELIEF)
        .args(["phantom", "--kind", "head", "--size", "64", "--out"])
        .arg(folder.join("head"))
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
}

/// The files of a folder in a zip.
fn zipped(folder: &Path, zip: &Path) {
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "dcm"));
    paths.sort();
    let files =
        paths.iter().enumerate().map(|(at, path)| (format!("{at}.dcm"), std::fs::read(path).unwrap()));
    std::fs::write(zip, crate::common::hostile::zip_of(files)).unwrap();
}

/// Invariant: A child reads a series, a label map and annotations exactly as the process itself does.
#[test]
fn a_child_reads_what_the_process_reads() {
    let folder = tempfile::tempdir().unwrap();
    head(folder.path());
    let [series, zip] = ["head", "head.zip"].map(|name| folder.path().join(name));
    zipped(&series, &zip);
    let found = relief_dicom::discover(&zip, Strictness::Lenient, &|_| ()).unwrap();
    let own = relief_dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap();
    let (childs, _) = reader().series(&zip, only(), 1 << 30, &Budget::default(), |_| Ok(())).unwrap();
    assert_eq!(childs.volume.content_hash(), own.volume.content_hash());
    assert_eq!(childs.volume.grid(), own.volume.grid());
    assert_eq!(childs.identity.as_ref(), Some(&own.identity));
    let text = |reference: Option<&relief_dicom::SeriesReference>| serde_json::to_string(&reference).unwrap();
    assert_eq!(text(childs.reference.as_deref()), text(own.reference.as_deref()));
    assert!(childs.warnings.iter().eq(own.warnings.iter().map(|warning| &warning.code)));

    let grid = own.volume.grid();
    let labels = series.join("labels.seg.nrrd");
    let map = load_labels(&labels, most_label_voxels(grid), grid).unwrap();
    let isolated = reader().labels(&labels, grid).unwrap();
    assert!(*isolated.map == *map.map && isolated.map.segments() == map.map.segments());

    let context = ReadContext {
        author: "anna",
        set: "default",
        list: "head",
        frame_of_reference: None,
        grid: Some(grid),
        series: own.reference.as_deref(),
    };
    for (file, format) in [("landmarks.csv", None), ("labels.seg.nrrd", Some(Format::SegNrrd))] {
        let path = series.join(file);
        let bytes = std::fs::read(&path).unwrap();
        let here =
            relief_exchange::read(Format::of(Path::new(file), &bytes).unwrap(), &bytes, &context).unwrap();
        let there = reader().annotations(&path, file, format, &context).unwrap();
        let seen = |imported: &relief_exchange::Imported| {
            let items = imported.items.iter().map(|item| (item.name.clone(), item.geometry.clone()));
            (items.collect::<Vec<_>>(), imported.contents.clone(), imported.warnings.clone())
        };
        assert!(!there.items.is_empty(), "{file}");
        assert_eq!(seen(&there), seen(&here), "{file}");
    }
}

/// Invariant: A child lists and reads the series of a folder, and volumes of other formats, as the
/// process itself does.
#[test]
fn a_child_reads_what_a_folder_has() {
    let folder = tempfile::tempdir().unwrap();
    head(folder.path());
    let slab = folder.path().join("slab");
    let phantom = ["phantom", "--kind", "slab", "--size", "24", "--out", slab.to_str().unwrap()];
    assert!(std::process::Command::new(RELIEF).args(phantom).output().unwrap().status.success());
    let found = relief_dicom::discover(folder.path(), Strictness::Lenient, &|_| ()).unwrap();
    let uids: Vec<String> = found.series.iter().map(|entry| entry.uid().to_owned()).collect();
    assert_eq!(uids.len(), 2);
    let budget = Budget::default();
    let Listing::Series(listed) = reader().list(folder.path(), true, &budget).unwrap() else {
        panic!("a folder of slices is no volume file")
    };
    for (listed, entry) in listed.iter().zip(&found.series) {
        assert_eq!((&*listed.uid, &*listed.modality), (entry.uid(), entry.modality()));
        assert_eq!((listed.dims, listed.pixel_mm), (entry.dims(), entry.pixel_spacing_mm()));
        assert_eq!(listed.thickness_mm, entry.thickness_mm());
        assert_eq!(listed.frame_of_reference.as_deref(), entry.frame_of_reference());
        let sha256 = data_encoding::HEXLOWER.encode(&entry.content_sha256().unwrap());
        assert_eq!(listed.sha256.as_deref(), Some(&*sha256));
    }
    assert_eq!(listed.len(), uids.len());
    for (uid, downsample) in uids.into_iter().zip([1u8, 3]) {
        let entry = found.select(Some(&uid)).unwrap();
        let own = relief_dicom::load(entry, Strictness::Lenient, &|_| ()).unwrap();
        let own = own.downsampled(downsample.into()).volume;
        let choice = SeriesChoice { uid: Some(uid), downsample, ..only() };
        let wanted = |series: &FoundSeries| {
            assert_eq!((series.dims, &series.sha256), (own.grid().dims(), &None));
            Ok(())
        };
        let (childs, _) = reader().series(folder.path(), choice, 1 << 30, &budget, wanted).unwrap();
        assert_eq!(childs.volume.content_hash(), own.content_hash());
    }

    let volume = folder.path().join("head/labels.seg.nrrd");
    let own = relief_dicom::read_volume(&volume).unwrap().volume;
    assert_eq!(reader().list(&volume, true, &budget).unwrap(), Listing::VolumeFile(own.grid().clone()));
    let choice = SeriesChoice { takes_volume_files: true, ..only() };
    let (childs, _) = reader().series(&volume, choice, 1 << 30, &budget, |_| Ok(())).unwrap();
    assert_eq!(childs.volume.content_hash(), own.content_hash());
    let refused = reader().series(&volume, only(), 1 << 30, &budget, |_| Ok(())).unwrap_err();
    assert!(refused.to_string().contains("no CT slices"), "{refused}");

    std::fs::create_dir(folder.path().join("JANE^DOE")).unwrap();
    let refused = reader().list(&folder.path().join("JANE^DOE"), true, &budget).unwrap_err().to_string();
    assert!(refused.contains("no CT slices") && !refused.contains("JANE"), "{refused}");
}

/// Invariant: A child reads under limits of the system that are lower than its own.
#[test]
fn a_child_reads_under_lower_limits_of_the_system() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    head(folder.path());
    let [zip, limited] = ["head.zip", "limited"].map(|name| folder.path().join(name));
    zipped(&folder.path().join("head"), &zip);
    // 4 GiB of address space; the child would allow itself 9.
    let script = format!("#!/bin/sh\nulimit -v 4194304\nexec '{RELIEF}' \"$@\"\n");
    std::fs::write(&limited, script).unwrap();
    std::fs::set_permissions(&limited, std::fs::Permissions::from_mode(0o700)).unwrap();
    let read = |reader: IsolatedReader| {
        reader.series(&zip, only(), 4 << 30, &Budget::default(), |_| Ok(())).unwrap().0
    };
    let (limited, own) = (read(IsolatedReader::of_program(limited)), read(reader()));
    assert_eq!(limited.volume.content_hash(), own.volume.content_hash());
}

/// Invariant: A child reads a real series exactly as the process itself does.
#[test]
fn a_child_reads_a_real_series() {
    let Some(data) = any_series("a real series in a child", &["crlm-ct-1004", "catphan504-cbct"]) else {
        return;
    };
    let folder = folder_of_slices(&data);
    let own = tempfile::tempdir().unwrap();
    let zip = own.path().join("real.zip");
    zipped(&folder, &zip);
    let found = relief_dicom::discover(&zip, Strictness::Lenient, &|_| ()).unwrap();
    let own = relief_dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap();
    let (childs, _) = reader().series(&zip, only(), 4 << 30, &Budget::default(), |_| Ok(())).unwrap();
    assert_eq!(childs.volume.content_hash(), own.volume.content_hash());
    assert_eq!(childs.identity.as_ref(), Some(&own.identity));
}

/// The folder of a series' slices.
fn folder_of_slices(data: &Path) -> std::path::PathBuf {
    let files = walkdir::WalkDir::new(data).into_iter().map(Result::unwrap);
    let mut slices = files.filter(|file| file.path().extension().is_some_and(|ending| ending == "dcm"));
    slices.next().expect("a slice").path().parent().unwrap().to_owned()
}

/// Invariant: A child opens no file but its own, connects to nothing and starts no program.
#[test]
fn a_child_has_no_rights() {
    let rights = reader().remaining_rights().unwrap();
    // The kernel's restrictions have to hold; a right may be left only where the kernel lacks the
    // means.
    assert!(!(rights.has_landlock && rights.opens_files), "{rights:?}");
    assert!(!(rights.has_seccomp && (rights.connects || rights.starts_programs)), "{rights:?}");
    if !rights.are_none() {
        eprintln!("UNAVAILABLE: a child without rights (this kernel lacks Landlock or seccomp): {rights:?}");
    }
}

/// Invariant: A child that allocates without end is ended by its limit, and the reader says so.
#[test]
fn a_child_that_allocates_without_end_ends_alone() {
    let error = reader().exhausted().unwrap_err();
    assert!(matches!(error, IsolationError::Ended(_)), "{error:?}");
    assert!(error.to_string().contains("more memory than its limit"), "{error}");
}

/// Invariant: Files that are refused in this process are refused in a child with the same reason, and
/// a cancelled reading ends.
#[test]
fn a_child_refuses_with_the_reason_and_ends_when_the_caller_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.zip");
    std::fs::write(&path, crate::common::hostile::zip_of([("JANE^DOE.txt".to_owned(), vec![b'x'; 4000])]))
        .unwrap();
    let error = reader().series(&path, only(), 1 << 30, &Budget::default(), |_| Ok(())).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, IsolationError::Refused(_)) && !text.contains("JANE"), "{text}");
    assert!(text.contains("no CT slices"), "{text}");

    head(folder.path());
    let zip = folder.path().join("head.zip");
    zipped(&folder.path().join("head"), &zip);
    let unwanted = reader().series(&zip, only(), 1 << 30, &Budget::default(), |found| {
        Err(format!("{:?} is too large for the adapter", found.dims).into())
    });
    assert!(matches!(unwanted, Err(IsolationError::Unwanted(_))));
    let budget = Budget::default();
    budget.cancel();
    let cancelled = reader().series(&zip, only(), 1 << 30, &budget, |_| Ok(()));
    assert!(
        matches!(cancelled, Err(IsolationError::Cancelled(_) | IsolationError::Refused(_))),
        "{cancelled:?}"
    );
}
