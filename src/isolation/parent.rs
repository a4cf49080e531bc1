//! The parent: starts a child for a file, waits within limits of time, and checks the answer
//! as it would check the file.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;

use super::job::{
    AnnotationJob, Answer, FoundSeries, Job, ListedSeries, Probe, ReadLimits, Refusal, RemainingRights,
    SeriesAnswer, SeriesChoice,
};
use super::window::Windows;
use super::wire::{receive, send};
use relief_annotation::ContentId;
use relief_base::{Budget, BudgetError};
use relief_exchange::{Format, Imported, ReadContext};
use relief_session::{LoadedVolume, PlacedLabels, most_label_voxels};
use relief_volume::{ContentHasher, Grid, LabelMap, Quantity, Segment, Volume};

/// The subcommand that is the child.
const SUBCOMMAND: &str = "decode-worker";
/// Longest reading.
const PATIENCE: Duration = Duration::from_secs(900);
/// The longest time from the end of a child's socket to the end of the child.
const FAREWELL: Duration = Duration::from_secs(5);
/// The time between two checks of the caller, which may no longer wait for the result.
const TURN: Duration = Duration::from_millis(200);
/// Largest file of annotations, and all of its contents together.
const MOST_ANNOTATION_BYTES: u64 = 1 << 30;

/// Reads files in children of this program.
#[derive(Clone, Debug)]
pub struct IsolatedReader {
    program: PathBuf,
}

/// The content of a file or folder.
#[derive(Clone, Debug, PartialEq)]
pub enum Listing {
    /// A volume in NIfTI or NRRD, on this grid.
    VolumeFile(Grid),
    /// DICOM series, at least one.
    Series(Vec<ListedSeries>),
}

/// Why a file was not read.
#[derive(Debug, thiserror::Error)]
pub enum IsolationError {
    /// The file is damaged, or of another kind.
    #[error("{0}")]
    Refused(String),
    /// The format of a file of annotations is unknown.
    #[error("neither name nor first bytes of the file tell its format")]
    UnknownFormat,
    /// The child was ended: by a limit, or by a fault of a decoder.
    #[error("reading the file failed: {}", ending(.0))]
    Ended(std::process::ExitStatus),
    /// It took too long.
    #[error("reading the file took longer than {} s", PATIENCE.as_secs())]
    TooLong,
    /// Every caller has stopped waiting for the result.
    #[error(transparent)]
    Cancelled(#[from] BudgetError),
    /// The memory of this machine is too small for the result.
    #[error("the machine has too little memory for the file")]
    NoMemory,
    /// The answer of the child is inconsistent.
    #[error("the reader returned invalid data")]
    Invalid,
    /// The child cannot be started, or the file cannot be opened.
    #[error("the reader cannot be started")]
    Start(#[source] Error),
    /// The caller refuses the result.
    #[error("{0}")]
    Unwanted(Box<dyn std::error::Error + Send + Sync>),
}

/// The cause of a child's end, in words.
fn ending(status: &std::process::ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) if signal == SIGXCPU => "it needs too much processor time".to_owned(),
        // An allocation that fails aborts.
        (Some(signal), _) if signal == SIGABRT => "it needs more memory than its limit".to_owned(),
        (Some(signal), _) => format!("the decoder was stopped by signal {signal}"),
        (None, code) => format!("the decoder ended with status {}", code.unwrap_or(-1)),
    }
}

const SIGABRT: i32 = 6;
const SIGXCPU: i32 = 24;

impl IsolatedReader {
    /// A reader by this program.
    ///
    /// # Errors
    /// When the system does not say where the program is.
    pub fn of_this_program() -> std::io::Result<Self> {
        // The very file that runs, even if another one was installed in its place.
        let running = PathBuf::from("/proc/self/exe");
        let program = if running.exists() { running } else { std::env::current_exe()? };
        Ok(Self { program })
    }

    /// A reader by the program at this path.
    #[must_use]
    pub fn of_program(program: PathBuf) -> Self {
        Self { program }
    }

    /// The series of a file or folder by their headers. `hashes_contents` reads all of their files.
    ///
    /// # Errors
    /// When there is no series, or the child does not keep to its limits.
    pub fn list(
        &self,
        path: &Path,
        hashes_contents: bool,
        budget: &Budget,
    ) -> Result<Listing, IsolationError> {
        let job = Job::List { limits: limits(0, budget), hashes_contents };
        match self.start(path, &job, budget)?.receive()? {
            Answer::Listed { series } => Ok(Listing::Series(series)),
            Answer::VolumeFile { grid } => {
                Grid::try_from(&grid).map(Listing::VolumeFile).map_err(|_| IsolationError::Invalid)
            }
            answer => Err(refusal(answer)),
        }
    }

    /// Reads a series of a file or folder, of at most `voxel_bytes`, and the messages of its
    /// warnings. `wanted` decides by its headers before voxels are read.
    ///
    /// # Errors
    /// When there is no such series, it is not wanted, or does not keep to its limits.
    pub fn series(
        &self,
        path: &Path,
        choice: SeriesChoice,
        voxel_bytes: u64,
        budget: &Budget,
        wanted: impl FnOnce(&FoundSeries) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
    ) -> Result<(LoadedVolume, Vec<String>), IsolationError> {
        let mut running = self.start(path, &Job::Series(choice, limits(voxel_bytes, budget)), budget)?;
        match running.receive()? {
            Answer::Found(found) => wanted(&found).map_err(IsolationError::Unwanted)?,
            answer => return Err(refusal(answer)),
        }
        send(&mut running.socket, &()).map_err(|_| running.ended())?;
        let SeriesAnswer { grid, unit, warnings, messages, identity, reference } = match running.receive()? {
            Answer::Series(answer) => *answer,
            answer => return Err(refusal(answer)),
        };
        let grid = Grid::try_from(&grid).map_err(|_| IsolationError::Invalid)?;
        if (grid.voxel_count() as u64).saturating_mul(2) > voxel_bytes {
            return Err(IsolationError::Invalid);
        }
        let mut hasher = ContentHasher::new(&grid);
        let voxels = running.values(grid.voxel_count(), |part| hasher.update(part))?;
        let volume = Volume::hashed(grid, voxels, hasher).map_err(|_| IsolationError::Invalid)?;
        let volume = volume.of_quantity(Quantity::of_rescale_type(&unit));
        let reference = reference.map(Arc::new);
        let loaded = LoadedVolume { volume, warnings, identity, reference, labels: None };
        Ok((loaded, messages))
    }

    /// Reads a label map onto a grid.
    ///
    /// # Errors
    /// When the file is no label map, has nothing in the grid, or does not keep to its limits.
    pub fn labels(&self, path: &Path, grid: &Grid) -> Result<PlacedLabels, IsolationError> {
        let job = Job::Labels { grid: grid.into(), most_voxels: most_label_voxels(grid) };
        let mut running = self.start(path, &job, &Budget::default())?;
        let (found, segments, warnings) = match running.receive()? {
            Answer::Labels { grid, segments, warnings } => (grid, segments, warnings),
            answer => return Err(refusal(answer)),
        };
        if Grid::try_from(&found).ok().as_ref() != Some(grid) {
            return Err(IsolationError::Invalid);
        }
        let labels = running.values::<u16>(grid.voxel_count(), |_| ())?;
        let segments = segments.into_iter().map(Segment::from).collect();
        let map = LabelMap::new(grid.clone(), &labels, segments).map_err(|_| IsolationError::Invalid)?;
        let _ = map.content_hash(); // not when the first request waits
        Ok(PlacedLabels { map: Arc::new(map), warnings })
    }

    /// Reads a file of annotations of `format`, or of the one that its name or content shows.
    ///
    /// # Errors
    /// When its format is unknown, it is damaged, or does not keep to its limits.
    pub fn annotations(
        &self,
        path: &Path,
        file_name: &str,
        format: Option<Format>,
        context: &ReadContext<'_>,
    ) -> Result<Imported, IsolationError> {
        let job = Job::Annotations(Box::new(AnnotationJob {
            format: format.map(|format| format.name().to_owned()),
            file_name: file_name.to_owned(),
            author: context.author.to_owned(),
            set: context.set.to_owned(),
            list: context.list.to_owned(),
            frame_of_reference: context.frame_of_reference.cloned(),
            grid: context.grid.map(Into::into),
            series: context.series.cloned(),
            most_bytes: MOST_ANNOTATION_BYTES,
        }));
        let mut running = self.start(path, &job, &Budget::default())?;
        let (items, described, warnings) = match running.receive()? {
            Answer::Annotations { items, contents, warnings } => (items, contents, warnings),
            answer => return Err(refusal(answer)),
        };
        let mut left = MOST_ANNOTATION_BYTES;
        let mut contents = Vec::new();
        for content in described {
            left = left.checked_sub(content.bytes).ok_or(IsolationError::Invalid)?;
            let bytes = running.values::<u8>(content.bytes as usize, |_| ())?;
            contents.push((ContentId::of(&bytes), content.media_type, bytes));
        }
        Ok(Imported { items, contents, warnings })
    }

    /// The rights that are left to a child on this system, found by trying.
    ///
    /// # Errors
    /// When no child can be started.
    pub fn remaining_rights(&self) -> Result<RemainingRights, IsolationError> {
        let mut running =
            self.start(Path::new("/dev/null"), &Job::Probe(Probe::Rights), &Budget::default())?;
        match running.receive()? {
            Answer::Probed(rights) => Ok(rights),
            answer => Err(refusal(answer)),
        }
    }

    /// The error of a child that allocates without end.
    ///
    /// # Errors
    /// Always: [`IsolationError::Ended`] where the limit holds.
    pub fn exhausted(&self) -> Result<(), IsolationError> {
        let mut running =
            self.start(Path::new("/dev/null"), &Job::Probe(Probe::Memory), &Budget::default())?;
        running.receive().map(drop::<Answer>)
    }

    fn start(&self, path: &Path, job: &Job, budget: &Budget) -> Result<Running, IsolationError> {
        budget.check()?;
        let start = || -> std::io::Result<(Child, UnixStream, Windows)> {
            let ((socket, childs), (windows, childs_windows)) = (UnixStream::pair()?, Windows::new()?);
            socket.set_read_timeout(Some(TURN))?;
            let child = Command::new(&self.program)
                .arg(SUBCOMMAND)
                .env_clear()
                .stdin(File::open(path)?)
                .stdout(OwnedFd::from(childs))
                .stderr(childs_windows)
                .spawn()?;
            Ok((child, socket, windows))
        };
        let (child, socket, windows) = start().map_err(IsolationError::Start)?;
        let (budget, since) = (budget.clone(), Instant::now());
        let mut running = Running { child: Some(child), socket, windows: Arc::new(windows), budget, since };
        send(&mut running.socket, job).map_err(|_| running.ended())?;
        Ok(running)
    }
}

fn limits(voxel_bytes: u64, budget: &Budget) -> ReadLimits {
    ReadLimits { voxel_bytes, kept_bytes: budget.kept_left(), unpacked_bytes: budget.unpacked_left() }
}

/// The error of an answer that is not the expected one.
fn refusal(answer: Answer) -> IsolationError {
    match answer {
        Answer::Refused { kind: Refusal::Content, reason } => IsolationError::Refused(reason),
        Answer::Refused { kind: Refusal::UnknownFormat, .. } => IsolationError::UnknownFormat,
        _ => IsolationError::Invalid,
    }
}

/// A child at work; it is ended when this is dropped.
struct Running {
    /// `None` once it is left to be reaped.
    child: Option<Child>,
    socket: UnixStream,
    windows: Arc<Windows>,
    budget: Budget,
    since: Instant,
}

impl Running {
    fn receive<T: DeserializeOwned>(&mut self) -> Result<T, IsolationError> {
        self.budget.check()?;
        receive(&mut Patient(self)).map_err(|error| self.failure(&error))
    }

    fn values<T: bytemuck::Pod + Send + Sync>(
        &mut self,
        count: usize,
        seen: impl FnMut(&[T]) + Send,
    ) -> Result<Vec<T>, IsolationError> {
        let windows = Arc::clone(&self.windows);
        windows.receive(&mut Patient(self), count, seen).map_err(|error| self.failure(&error))
    }

    /// Why nothing more comes.
    fn failure(&mut self, error: &Error) -> IsolationError {
        if let Err(error) = self.budget.check() {
            return error.into();
        }
        match error.kind() {
            ErrorKind::TimedOut => IsolationError::TooLong,
            ErrorKind::InvalidData => IsolationError::Invalid,
            ErrorKind::OutOfMemory => IsolationError::NoMemory,
            _ => self.ended(),
        }
    }

    /// How the child ended. One that says nothing more and goes on is ended.
    fn ended(&mut self) -> IsolationError {
        let Some(child) = &mut self.child else { return IsolationError::Invalid };
        let since = Instant::now();
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return IsolationError::Ended(status),
                Ok(None) if since.elapsed() < FAREWELL => std::thread::sleep(Duration::from_millis(5)),
                Ok(None) => drop(child.kill()),
                Err(error) => return IsolationError::Start(error),
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        let _ = child.kill();
        // The system takes a while to free the memory of a child, which need not delay the caller.
        let reap = move || drop(child.wait());
        let _ = std::thread::Builder::new().name("relief-reap".to_owned()).spawn(reap);
    }
}

/// Reads from the child, and ends when the caller leaves or it takes too long.
struct Patient<'a>(&'a mut Running);

impl Read for Patient<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            match self.0.socket.read(buffer) {
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    self.0.budget.check().map_err(Error::other)?;
                    if self.0.since.elapsed() > PATIENCE {
                        return Err(ErrorKind::TimedOut.into());
                    }
                }
                read => return read,
            }
        }
    }
}

impl Write for Patient<'_> {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        self.0.socket.write(buffer) // a byte at a time: it never waits
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.socket.flush()
    }
}
