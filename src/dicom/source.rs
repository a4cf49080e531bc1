//! Sources of files: a folder, a file, a DICOMDIR, a zip.
//!
//! A [`FileSource`] is one file that may be DICOM. It is reopened for each use, so that parallel
//! reads share nothing; entries of a zip are unpacked in memory, each up to [`LARGEST_ENTRY`]. This
//! module locates bytes; `part10` interprets them.

use std::fmt;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use zip::ZipArchive;

use super::causes::ContainerError;
use super::dataset::Retention;
use super::error::{Defect, Error};
use super::file_bytes::Bytes;
use super::part10;
use relief_base::Budget;

/// The largest zip entry that is unpacked, in bytes: an enhanced CT of 1000 frames has half as
/// much.
const LARGEST_ENTRY: u64 = 1 << 30;
/// Bytes of a zip entry that are unpacked to read a header.
const HEADER_BYTES: u64 = 1 << 16;
/// The largest zip that is held in memory, in bytes.
const LARGEST_ZIP: u64 = 4 << 30;
/// The most files one path may lead to: far more than any study has, few enough to list.
const MOST_FILES: usize = 200_000;
/// The most folders below a path: links beside each other can double a tree at each level.
const MOST_FOLDERS: usize = 20_000;
/// How deep folders may nest. Links among folders can make a tree of any depth from a few of them.
const DEEPEST_FOLDER: usize = 32;
/// Bytes of a local file header without its name: the least between two entries of a zip.
const LOCAL_HEADER_BYTES: u64 = 30;

type SharedZip = ZipArchive<Cursor<bytes::Bytes>>;

/// One file that may hold a DICOM object.
#[derive(Clone)]
pub(super) enum FileSource {
    Disk { path: PathBuf, label: String },
    Zipped { archive: Arc<SharedZip>, index: usize, label: String },
}

impl FileSource {
    /// The file's bytes; those of a zip entry are unpacked here.
    pub(super) fn bytes(&self, budget: &Budget) -> Result<Bytes, Defect> {
        match self {
            Self::Disk { path, .. } => Ok(Bytes::Disk(path.clone())),
            Self::Zipped { archive, index, .. } => {
                let (bytes, _) = unpack(&mut SharedZip::clone(archive), *index, LARGEST_ENTRY, budget)?;
                Ok(Bytes::Memory(bytes))
            }
        }
    }

    /// The bytes that hold the header of nearly all images: of a zip entry the first
    /// [`HEADER_BYTES`], since its pixels are wanted later or never.
    pub(super) fn beginning(&self, budget: &Budget) -> Result<Bytes, Defect> {
        match self {
            Self::Disk { path, .. } => Ok(Bytes::Disk(path.clone())),
            Self::Zipped { archive, index, .. } => {
                let (bytes, length) = unpack(&mut SharedZip::clone(archive), *index, HEADER_BYTES, budget)?;
                let is_whole = bytes.len() as u64 >= length;
                Ok(if is_whole { Bytes::Memory(bytes) } else { Bytes::Beginning(bytes, length) })
            }
        }
    }

    /// Bytes that [`FileSource::bytes`] keeps in memory: the size of a zip entry, which is a claim
    /// that it is held to.
    pub(super) fn memory_bytes(&self) -> u64 {
        match self {
            Self::Disk { .. } => 0,
            Self::Zipped { archive, index, .. } => {
                let entry = archive.by_index_data(*index);
                entry.map_or(0, |entry| entry.size()).min(LARGEST_ENTRY)
            }
        }
    }
}

/// The name for messages: relative to the folder or zip that was given, so that a message never
/// repeats where the files lie.
impl fmt::Display for FileSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Disk { label, .. } | Self::Zipped { label, .. }) = self;
        f.write_str(label)
    }
}

impl fmt::Debug for FileSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// All files that `path` leads to, in a stable order.
///
/// # Errors
/// When the path cannot be read, or is a zip or DICOMDIR that cannot be used.
pub(super) fn collect(path: &Path, budget: &Budget) -> Result<Vec<FileSource>, Error> {
    let unreadable = |source| Error::Unreadable { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(unreadable)?;
    if metadata.is_dir() {
        return collect_folder(path);
    }
    if !metadata.is_file() {
        return Err(Error::Container { path: path.to_owned(), source: ContainerError::NotAFile });
    }
    let mut magic = Vec::new();
    File::open(path).and_then(|file| file.take(4).read_to_end(&mut magic)).map_err(unreadable)?;
    if magic.starts_with(b"PK") {
        return collect_zip(path);
    }
    let file = FileSource::Disk { path: path.to_owned(), label: "the file".to_owned() };
    match directory_records(&file, budget) {
        Some(references) => collect_references(path, references),
        None => Ok(vec![file]),
    }
}

fn collect_folder(folder: &Path) -> Result<Vec<FileSource>, Error> {
    let mut files = Vec::new();
    let mut folders = 0;
    // Links are followed (archives are often farms of links); walkdir refuses loops.
    let tree = walkdir::WalkDir::new(folder).follow_links(true).max_depth(DEEPEST_FOLDER).sort_by_file_name();
    for entry in tree {
        // An unreadable folder or link inside hides files, but the readable rest may be a whole
        // series. Opening the entry fails later and is reported.
        let path = match entry {
            Ok(entry) if entry.file_type().is_file() => entry.into_path(),
            Ok(entry) => {
                folders += usize::from(entry.file_type().is_dir());
                check_count(folder, folders, MOST_FOLDERS, "folders")?;
                continue;
            }
            Err(error) => match error.path() {
                Some(path) => path.to_owned(),
                None => continue,
            },
        };
        let label = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
        files.push(FileSource::Disk { path, label });
        check_count(folder, files.len(), MOST_FILES, "files")?;
    }
    Ok(files)
}

fn collect_zip(path: &Path) -> Result<Vec<FileSource>, Error> {
    let unreadable = |source| Error::Unreadable { path: path.to_owned(), source };
    let container = |source| Error::Container { path: path.to_owned(), source };
    let length = std::fs::metadata(path).map_err(unreadable)?.len();
    if length > LARGEST_ZIP {
        let (found_mib, most_mib) = (length >> 20, LARGEST_ZIP >> 20);
        return Err(container(ContainerError::LargeZip { found_mib, most_mib }));
    }
    let bytes: bytes::Bytes = std::fs::read(path).map_err(unreadable)?.into();
    let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| container(error.into()))?;
    check_count(path, archive.len(), MOST_FILES, "files")?;
    if let Some(byte) = overlap(&archive) {
        return Err(container(ContainerError::Overlap(byte)));
    }
    let archive = Arc::new(archive);
    let mut files = Vec::new();
    for index in 0..archive.len() {
        // The name only labels messages; nothing is ever written under it.
        let label = archive.name_for_index(index).and_then(Result::ok).unwrap_or_default().into_owned();
        if !label.ends_with('/') {
            files.push(FileSource::Zipped { archive: Arc::clone(&archive), index, label });
        }
    }
    Ok(files)
}

/// Where an entry of a zip begins inside of the one before it. If entries shared compressed bytes, a few
/// kilobytes could stand for terabytes.
fn overlap(archive: &SharedZip) -> Option<u64> {
    let entries = (0..archive.len()).filter_map(|index| archive.by_index_data(index).ok());
    let mut places: Vec<(u64, u64)> =
        entries.map(|entry| (entry.header_start(), entry.compressed_size())).collect();
    places.sort_unstable();
    let end = |(start, size): (u64, u64)| start.saturating_add(LOCAL_HEADER_BYTES).saturating_add(size);
    places.windows(2).find(|pair| end(pair[0]) > pair[1].0).map(|pair| pair[1].0)
}

/// The first bytes of an entry, at most `most`, and its size.
fn unpack(
    archive: &mut SharedZip,
    index: usize,
    most: u64,
    budget: &Budget,
) -> Result<(bytes::Bytes, u64), Defect> {
    let problem = |error: zip::result::ZipError| Defect::from(std::io::Error::from(error));
    let entry = archive.by_index(index).map_err(problem)?;
    let found = entry.size();
    if found > LARGEST_ENTRY {
        return Err(Defect::LargeEntry { found, limit: LARGEST_ENTRY });
    }
    budget.unpack(found.min(most))?;
    // Memory grows with the unpacked bytes; more than the zip's directory states is an error of
    // this reader.
    let mut bytes = Vec::new();
    entry.take(most).read_to_end(&mut bytes)?;
    Ok((bytes.into(), found))
}

/// The file references of a DICOMDIR; `None` when the file is not one.
fn directory_records(file: &FileSource, budget: &Budget) -> Option<Vec<String>> {
    let keep = |tag: Tag| match tag {
        tags::DIRECTORY_RECORD_SEQUENCE => Retention::Items,
        tags::REFERENCED_FILE_ID => Retention::Value,
        _ => Retention::Nothing,
    };
    let object = part10::open(file.bytes(budget).ok()?, budget).ok().filter(part10::Object::is_directory)?;
    let walked = object.walk(keep).ok()?;
    let records = walked.data.items(tags::DIRECTORY_RECORD_SEQUENCE);
    Some(records.iter().filter_map(|record| record.text(tags::REFERENCED_FILE_ID)).collect())
}

fn collect_references(directory: &Path, references: Vec<String>) -> Result<Vec<FileSource>, Error> {
    check_count(directory, references.len(), MOST_FILES, "files")?;
    let folder = directory.parent().unwrap_or(Path::new(""));
    let container = |source| Error::Container { path: directory.to_owned(), source };
    if references.is_empty() {
        return Err(container(ContainerError::NoReferences));
    }
    let mut files = Vec::new();
    for reference in references {
        let relative: PathBuf = reference.split('\\').map(str::trim).collect();
        // A DICOMDIR names files below itself (PS3.10 8.5); anything else would reach outside of
        // the folder.
        if !relative.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(container(ContainerError::OutsideReference(reference)));
        }
        let (path, label) = (find_named(folder, &relative), relative.display().to_string());
        files.push(FileSource::Disk { path, label });
        check_count(folder, files.len(), MOST_FILES, "files")?;
    }
    Ok(files)
}

/// The file as named. Systems that copy discs change case, and put an ending or a version behind
/// names.
fn find_named(folder: &Path, relative: &Path) -> PathBuf {
    let exact = folder.join(relative);
    let lower = folder.join(relative.to_string_lossy().to_lowercase());
    let behind = ["", ".dcm", ".DCM", ";1"];
    let mut names = [&exact, &lower].into_iter().flat_map(|path| {
        behind.map(|behind| {
            let mut name = path.clone().into_os_string();
            name.push(behind);
            PathBuf::from(name)
        })
    });
    names.find(|path| path.exists()).unwrap_or(exact.clone())
}

fn check_count(path: &Path, count: usize, most: usize, what: &'static str) -> Result<(), Error> {
    if count > most {
        return Err(Error::Container {
            path: path.to_owned(),
            source: ContainerError::TooMany { most, what },
        });
    }
    Ok(())
}

/// The bytes that positions in a header refer to: the file's, or its inflated data set.
///
/// # Errors
/// When they cannot be read or unpacked, or the budget is spent.
pub(super) fn open_bytes(source: &FileSource, budget: &Budget) -> Result<Bytes, Defect> {
    part10::open(source.bytes(budget)?, budget).map(|object| object.bytes)
}
