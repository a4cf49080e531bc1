//! Loading: decode the slices of a series in parallel into one volume.
//!
//! Every slice is decoded straight into its place, so that beside the volume only the frames being
//! decoded take memory. Slices that cannot be decoded leave a gap, which is then resampled like any
//! other.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::batches;
use super::codec::{self, Frames};
use super::discover::{Strictness, header_warnings};
use super::error::{Defect, Error, Reasons};
use super::file_bytes::Bytes;
use super::formats::ReadVolume;
use super::header::{FileHeader, FrameHeader};
use super::identity::SeriesIdentity;
use super::pixels;
use super::reference::SeriesReference;
use super::resample::RegularGrid;
use super::series::SeriesEntry;
use super::stack::{self, Stack};
use super::warnings::{Warning, WarningCode};
use crate::progress::Progress;
use crate::progress::Stage;
use relief_base::{Budget, Transform};
use relief_volume::{Grid, Quantity, Volume};

/// A loaded series.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The volume in HU and patient LPS, on a regular grid.
    pub volume: Volume,
    /// Anomalies, and how each was handled.
    pub warnings: Vec<Warning>,
    /// The study and series it came from.
    pub identity: SeriesIdentity,
    /// The series' identity for DICOM objects; none where it came from elsewhere, or lacks UIDs.
    pub reference: Option<Arc<SeriesReference>>,
    /// Set at once when resampling drops the stack; else taken from the volume when asked for.
    stack_sha256: OnceLock<[u8; 32]>,
}

impl Loaded {
    /// A volume of another format than DICOM, which is of no study.
    #[must_use]
    pub fn of_volume(read: ReadVolume) -> Self {
        let ReadVolume { volume, warnings } = read;
        let identity = SeriesIdentity::default();
        Self { volume, warnings, identity, reference: None, stack_sha256: OnceLock::new() }
    }

    /// SHA-256 of the HU stack as read: little-endian 16-bit, (z, y, x) order, ascending along row
    /// x column, before any resampling.
    #[must_use]
    pub fn stack_sha256(&self) -> [u8; 32] {
        *self.stack_sha256.get_or_init(|| relief_volume::stack_sha256(self.volume.voxels_hu()))
    }

    /// The series with each block of `factor`³ voxels replaced by its mean; the hash stays that of
    /// the stack as read.
    #[must_use]
    pub fn downsampled(mut self, factor: usize) -> Self {
        if factor > 1 {
            let _ = self.stack_sha256(); // while the voxels are still there
            self.volume = self.volume.downsampled(factor);
        }
        self
    }
}

/// The limits of a volume's memory.
///
/// The sizes of compressed slices are what their headers claim: a file of a few megabytes may well
/// claim, and even hold, gigabytes. So the limit is checked before anything is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadLimits {
    /// Maximum bytes of voxels, two for each, of the stack as read and of the volume on its regular
    /// grid. Both exist while a stack is resampled.
    pub voxel_bytes: u64,
}

impl Default for LoadLimits {
    /// 16 GiB: sixteen thousand slices of 512 x 512.
    fn default() -> Self {
        Self { voxel_bytes: 16 << 30 }
    }
}

impl LoadLimits {
    fn check(self, needed: u64) -> Result<(), Error> {
        let allowed = self.voxel_bytes;
        if needed > allowed { Err(Error::TooLarge { needed, allowed }) } else { Ok(()) }
    }
}

/// Loads a series that [`discover`](super::discover()) has found, within the default
/// [`LoadLimits`].
///
/// # Errors
/// As [`load_within`].
pub fn load(
    entry: &SeriesEntry,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Loaded, Error> {
    load_within(LoadLimits::default(), entry, strictness, progress)
}

/// Loads a series that [`discover`](super::discover()) has found.
///
/// # Errors
/// When the volume is larger than the limits allow, no slice can be decoded, positions are
/// ambiguous or too uneven, or memory is short; under [`Strictness::Strict`] also when a single
/// slice cannot be decoded or lies at another's position.
pub fn load_within(
    limits: LoadLimits,
    entry: &SeriesEntry,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Loaded, Error> {
    let loaded = load_voxels(limits, entry, strictness, progress)?;
    Ok(Loaded { reference: SeriesReference::of(entry).ok().map(Arc::new), ..loaded })
}

/// The volume, without what objects say of the series.
fn load_voxels(
    limits: LoadLimits,
    entry: &SeriesEntry,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Loaded, Error> {
    limits.check(entry.voxel_bytes())?;
    let mut warnings = entry.warnings.clone();
    let (frames, duplicates) = stack::arrange(&entry.frames)?;
    warnings.extend(duplicates);
    refuse(strictness, &warnings)?;
    warnings.extend(header_warnings(&frames));
    let (frames, hu, decoding) = decode(frames, &entry.budget, strictness, progress)?;
    warnings.extend(decoding);
    let stack = Stack::new(&frames);
    let (identity, quantity) = (entry.identity(), Quantity::of_rescale_type(entry.value_type()));
    if stack.len() == 1 {
        let loaded = single(&frames[0], &stack, hu, identity, warnings)?;
        return Ok(Loaded { volume: loaded.volume.of_quantity(quantity), ..loaded });
    }
    let deviation = stack.deviation();
    if deviation.is_none() {
        let grid = grid(&stack, dims(&frames), stack.origin, stack.mean_gap_mm())?;
        return Ok(Loaded {
            volume: Volume::new(grid, hu)?.of_quantity(quantity),
            warnings,
            identity,
            reference: None,
            stack_sha256: OnceLock::new(),
        });
    }
    let [columns, rows, _] = dims(&frames);
    let regular = RegularGrid::over(&stack, [columns, rows])?;
    limits.check(regular.voxel_bytes())?;
    warnings.extend(deviation.warnings(regular.slice_spacing_mm));
    let mut voxels = zeros(regular.dims.iter().product())?;
    regular.resample(&stack, &hu, outside_hu(&frames[0], &hu), &mut voxels);
    let stack_sha256 = OnceLock::from(relief_volume::stack_sha256(&hu));
    drop(hu);
    let grid = grid(&stack, regular.dims, regular.origin(&stack), regular.slice_spacing_mm)?;
    let volume = Volume::new(grid, voxels)?.of_quantity(quantity);
    Ok(Loaded { volume, warnings, identity, reference: None, stack_sha256 })
}

/// Strict reading turns warnings into errors.
fn refuse(strictness: Strictness, warnings: &[Warning]) -> Result<(), Error> {
    if strictness == Strictness::Lenient || warnings.is_empty() {
        return Ok(());
    }
    let reasons = Reasons::plain(warnings.iter().map(|warning| warning.message.clone()));
    Err(Error::Strict { count: warnings.len(), reasons })
}

/// A volume of one slice: its thickness stands in for the spacing that a single slice does not
/// have.
fn single(
    frame: &FrameHeader,
    stack: &Stack,
    hu: Vec<i16>,
    identity: SeriesIdentity,
    mut warnings: Vec<Warning>,
) -> Result<Loaded, Error> {
    let [columns, rows] = frame.spacing_mm;
    let (thickness, origin) = match frame.thickness_mm {
        Some(mm) => (mm, "SliceThickness (0018,0050)"),
        None => ((columns * rows).sqrt(), "the pixel spacing, as no thickness is given"),
    };
    let message = format!("only one slice: it is taken to be {thickness:.4} mm thick, from {origin}");
    warnings.push(Warning::new(WarningCode::SingleSlice, message));
    let grid = grid(stack, dims(std::slice::from_ref(frame)), stack.origin, thickness)?;
    let (volume, stack_sha256) = (Volume::new(grid, hu)?, OnceLock::new());
    Ok(Loaded { volume, warnings, identity, reference: None, stack_sha256 })
}

fn grid(stack: &Stack, dims: [usize; 3], origin: glam::DVec3, slice_spacing_mm: f64) -> Result<Grid, Error> {
    let [x, y, z] = stack.axes;
    let [dx, dy] = stack.spacing_mm;
    Ok(Grid::new(dims, Transform::from_axes(x * dx, y * dy, z * slice_spacing_mm, origin))?)
}

fn dims(frames: &[FrameHeader]) -> [usize; 3] {
    let layout = &frames[0].file.layout;
    [layout.columns as usize, layout.rows as usize, frames.len()]
}

/// HU for places that no slice covers: the series' own padding, else its lowest value, which is air
/// or darker.
fn outside_hu(frame: &FrameHeader, hu: &[i16]) -> i16 {
    let lowest = hu.iter().copied().min().unwrap_or(i16::MIN);
    frame.rescale.padding.map_or(lowest, |padding| frame.rescale.hu(padding).0)
}

/// A zeroed vector. The system hands out zeroed pages as they are touched; asking first turns a
/// failure into an error.
fn zeros(voxels: usize) -> Result<Vec<i16>, Error> {
    Vec::<i16>::new().try_reserve_exact(voxels).map_err(|_| Error::Memory { voxels: voxels as u64 })?;
    Ok(vec![0; voxels])
}

/// A frame to be decoded and its place in the stack.
type Task<'a> = (usize, &'a FrameHeader, &'a mut [i16]);
type Outcome = (usize, Result<u64, Defect>);
type Decoded = (Vec<FrameHeader>, Vec<i16>, Vec<Warning>);

/// Decodes all frames into one stack; those that fail are taken out of it again.
fn decode(
    frames: Vec<FrameHeader>,
    budget: &Budget,
    strictness: Strictness,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Decoded, Error> {
    let slice_len = frames[0].file.layout.frame_pixels();
    let mut hu = zeros(slice_len.checked_mul(frames.len()).ok_or(Error::Memory { voxels: u64::MAX })?)?;
    let tasks = frames.iter().enumerate().zip(hu.chunks_exact_mut(slice_len));
    let files = by_file(tasks.map(|((index, frame), place)| (index, frame, place)));
    let step = Progress::counter(Stage::Slices, frames.len(), progress);
    let memory = |tasks: &Vec<Task<'_>>| tasks[0].1.file.memory_bytes;
    let batches = batches::of(files, memory).into_iter();
    let mut outcomes: Vec<Outcome> = batches
        .flat_map(|files| {
            files.into_par_iter().flat_map(|tasks| decode_file(tasks, budget, &step)).collect::<Vec<_>>()
        })
        .collect();
    outcomes.sort_by_key(|(index, _)| *index);
    let clipped = outcomes.iter().filter_map(|(_, outcome)| outcome.as_ref().ok()).sum();
    let failed: Vec<(usize, Defect)> =
        outcomes.into_iter().filter_map(|(index, outcome)| Some((index, outcome.err()?))).collect();
    if let Some((_, Defect::Budget(error))) =
        failed.iter().find(|(_, defect)| matches!(defect, Defect::Budget(_)))
    {
        return Err((*error).into());
    }
    let mut warnings = failure_warnings(&frames, &failed, strictness)?;
    warnings.extend(clipped_warning(clipped));
    let (frames, hu) = without(frames, hu, &failed, slice_len);
    Ok((frames, hu, warnings))
}

/// Groups tasks by file, in the order of the stack, so that each file is opened and indexed once.
fn by_file<'a>(tasks: impl Iterator<Item = Task<'a>>) -> Vec<Vec<Task<'a>>> {
    let mut files: Vec<Vec<Task<'a>>> = Vec::new();
    let mut places: HashMap<*const FileHeader, usize> = HashMap::new();
    for task in tasks {
        let place = *places.entry(Arc::as_ptr(&task.1.file)).or_insert(files.len());
        match files.get_mut(place) {
            Some(of_file) => of_file.push(task),
            None => files.push(vec![task]),
        }
    }
    files
}

/// Decodes the frames of one file.
fn decode_file(tasks: Vec<Task<'_>>, budget: &Budget, step: &(dyn Fn() + Sync)) -> Vec<Outcome> {
    let file = Arc::clone(&tasks[0].1.file);
    let opened = super::source::open_bytes(&file.source, budget);
    let opened = opened.and_then(|bytes| {
        let frames = if file.syntax.is_native() { None } else { Some(Frames::index(&file, &bytes)?) };
        Ok((bytes, frames))
    });
    let one = |(index, frame, hu): Task<'_>| {
        let outcome = match &opened {
            Ok(_) if budget.check().is_err() => budget.check().map(|()| 0).map_err(Defect::from),
            Ok((bytes, frames)) => decode_frame(frame, bytes, frames.as_ref(), hu),
            Err(defect) => Err(defect.clone()),
        };
        step();
        (index, outcome)
    };
    tasks.into_par_iter().map(one).collect()
}

/// Decodes one frame into its place; returns the number of clipped values.
fn decode_frame(
    frame: &FrameHeader,
    bytes: &Bytes,
    frames: Option<&Frames>,
    hu: &mut [i16],
) -> Result<u64, Defect> {
    let file = &frame.file;
    match frames {
        None => {
            let position = file.pixels.position + u64::from(frame.index) * file.layout.frame_bytes();
            pixels::read_native(bytes, position, file.syntax.encoding, &file.layout, frame.rescale, hu)
        }
        Some(frames) => {
            let data = frames.read(frame.index, bytes)?;
            let samples = codec::decode(data, &file.syntax, &file.layout)?;
            pixels::take_decoded(&samples, &file.layout, frame.rescale, hu)
        }
    }
}

fn failure_warnings(
    frames: &[FrameHeader],
    failed: &[(usize, Defect)],
    strictness: Strictness,
) -> Result<Vec<Warning>, Error> {
    let lines: Vec<(String, String)> =
        failed.iter().map(|(index, defect)| (frames[*index].to_string(), defect.to_string())).collect();
    if lines.len() == frames.len() {
        return Err(Error::NothingDecoded { slices: frames.len(), reasons: Reasons::about(lines) });
    }
    if strictness == Strictness::Strict && !lines.is_empty() {
        return Err(Error::Strict { count: lines.len(), reasons: Reasons::about(lines) });
    }
    let warning = |(frame, reason)| Warning::new(WarningCode::BadFile, format!("{frame}: {reason}"));
    Ok(lines.into_iter().map(warning).collect())
}

fn clipped_warning(clipped: u64) -> Option<Warning> {
    let message = || {
        format!("{clipped} voxels: found values beyond 16 bits after rescaling; clipped to -32768..32767 HU")
    };
    (clipped > 0).then(|| Warning::new(WarningCode::ClippedValues, message()))
}

/// Moves the good slices together.
fn without(
    frames: Vec<FrameHeader>,
    mut hu: Vec<i16>,
    failed: &[(usize, Defect)],
    slice_len: usize,
) -> (Vec<FrameHeader>, Vec<i16>) {
    if failed.is_empty() {
        return (frames, hu);
    }
    let is_good = |index: &usize| failed.binary_search_by_key(index, |(index, _)| *index).is_err();
    let good: Vec<usize> = (0..frames.len()).filter(is_good).collect();
    for (place, &index) in good.iter().enumerate() {
        hu.copy_within(index * slice_len..(index + 1) * slice_len, place * slice_len);
    }
    hu.truncate(good.len() * slice_len);
    (good.into_iter().map(|index| frames[index].clone()).collect(), hu)
}
