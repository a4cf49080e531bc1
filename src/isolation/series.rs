//! The child's reading of a series.

use std::io::{Read, Result, Write};
use std::path::Path;

use super::job::{Answer, FoundSeries, ListedSeries, ReadLimits, Refusal, SeriesAnswer, SeriesChoice};
use super::reply::{FILE, refuse};
use super::window::Windows;
use super::wire::{receive, send};
use data_encoding::HEXLOWER;
use relief_base::Budget;
use relief_dicom::{Discovery, Error, FormatLimits, LoadLimits, Loaded, SeriesEntry, Strictness};

/// The name of a file or folder in messages, while its series are listed.
const SUBJECT: &str = "the series' place";

impl ReadLimits {
    fn budget(self) -> Budget {
        Budget::new(self.kept_bytes, self.unpacked_bytes)
    }
}

impl SeriesChoice {
    fn strictness(&self) -> Strictness {
        if self.is_strict { Strictness::Strict } else { Strictness::Lenient }
    }

    fn reduced(&self, dims: [usize; 3]) -> [usize; 3] {
        dims.map(|side| side.div_ceil(self.downsample.max(1).into()))
    }
}

/// Sends the facts of all series, with hashes of their contents if requested.
pub(crate) fn list(limits: ReadLimits, hashes_contents: bool, socket: &mut impl Write) -> Result<()> {
    if relief_dicom::is_volume_file(Path::new(FILE)) {
        return match relief_dicom::read_grid(Path::new(FILE)) {
            Ok(grid) => send(socket, &Answer::VolumeFile { grid: (&grid).into() }),
            Err(error) => refuse(socket, Refusal::Content, error.about(SUBJECT)),
        };
    }
    let found =
        relief_dicom::discover_within(&limits.budget(), Path::new(FILE), Strictness::Lenient, &|_| ());
    let listed = found.and_then(|found| {
        not_empty(&found)?;
        found.series.iter().map(|entry| listed(entry, hashes_contents)).collect()
    });
    match listed {
        Err(error) => refuse(socket, Refusal::Content, error.without_names(SUBJECT)),
        Ok(series) => send(socket, &Answer::Listed { series }),
    }
}

fn listed(entry: &SeriesEntry, hashes_content: bool) -> std::result::Result<ListedSeries, Error> {
    Ok(ListedSeries {
        uid: entry.uid().to_owned(),
        modality: entry.modality().to_owned(),
        dims: entry.dims(),
        pixel_mm: entry.pixel_spacing_mm(),
        thickness_mm: entry.thickness_mm(),
        frame_of_reference: entry.frame_of_reference().map(str::to_owned),
        sha256: content_hash(entry, hashes_content)?,
    })
}

fn content_hash(entry: &SeriesEntry, is_wanted: bool) -> std::result::Result<Option<String>, Error> {
    is_wanted.then(|| Ok(HEXLOWER.encode(&entry.content_sha256()?))).transpose()
}

/// The error of a place without series.
fn not_empty(found: &Discovery) -> std::result::Result<(), Error> {
    if found.series.is_empty() { found.select(None).map(drop) } else { Ok(()) }
}

/// Sends the dimensions of a series, and its voxels if the parent wants them.
pub(crate) fn read(
    choice: &SeriesChoice,
    limits: ReadLimits,
    socket: &mut (impl Read + Write),
    windows: &Windows,
) -> Result<()> {
    if choice.takes_volume_files && relief_dicom::is_volume_file(Path::new(FILE)) {
        return volume_file(choice, limits, socket, windows);
    }
    let refused = |error: &Error| error.without_names(&choice.subject);
    let found =
        relief_dicom::discover_within(&limits.budget(), Path::new(FILE), choice.strictness(), &|_| ());
    let found = match found {
        Ok(found) => found,
        Err(error) => return refuse(socket, Refusal::Content, refused(&error)),
    };
    let entry = match found.select(choice.uid.as_deref()) {
        Ok(entry) => entry,
        Err(error) => return refuse(socket, Refusal::Content, refused(&error)),
    };
    let sha256 = match content_hash(entry, choice.hashes_content) {
        Ok(sha256) => sha256,
        Err(error) => return refuse(socket, Refusal::Content, refused(&error)),
    };
    send(socket, &Answer::Found(FoundSeries { dims: choice.reduced(entry.dims()), sha256 }))?;
    let () = receive(socket)?; // the parent wants the voxels
    let voxel_limits = LoadLimits { voxel_bytes: limits.voxel_bytes };
    match relief_dicom::load_within(voxel_limits, entry, choice.strictness(), &|_| ()) {
        Err(error) => refuse(socket, Refusal::Content, refused(&error)),
        Ok(mut loaded) => {
            loaded.warnings.extend(found.warnings());
            send_voxels(choice, loaded, socket, windows)
        }
    }
}

fn volume_file(
    choice: &SeriesChoice,
    limits: ReadLimits,
    socket: &mut (impl Read + Write),
    windows: &Windows,
) -> Result<()> {
    let grid = match relief_dicom::read_grid(Path::new(FILE)) {
        Ok(grid) => grid,
        Err(error) => return refuse(socket, Refusal::Content, error.about(&choice.subject)),
    };
    send(socket, &Answer::Found(FoundSeries { dims: choice.reduced(grid.dims()), sha256: None }))?;
    let () = receive(socket)?; // the parent wants the voxels
    let voxel_limits = FormatLimits { voxels: limits.voxel_bytes / size_of::<i16>() as u64 };
    match relief_dicom::read_volume_within(voxel_limits, Path::new(FILE)) {
        Err(error) => refuse(socket, Refusal::Content, error.about(&choice.subject)),
        Ok(read) => send_voxels(choice, Loaded::of_volume(read), socket, windows),
    }
}

fn send_voxels(
    choice: &SeriesChoice,
    loaded: Loaded,
    socket: &mut (impl Read + Write),
    windows: &Windows,
) -> Result<()> {
    let loaded = loaded.downsampled(choice.downsample.into());
    let answer = SeriesAnswer {
        grid: loaded.volume.grid().into(),
        unit: loaded.volume.quantity().unit().to_owned(),
        warnings: loaded.warnings.iter().map(|warning| warning.code).collect(),
        messages: loaded.warnings.into_iter().map(|warning| warning.message).collect(),
        identity: Some(loaded.identity),
        reference: loaded.reference.map(|reference| (*reference).clone()),
    };
    send(socket, &Answer::Series(Box::new(answer)))?;
    windows.send(socket, loaded.volume.voxels_hu())
}
