//! The child: takes a job, gives its rights away, reads the file, and sends the result.
//!
//! Its standard input is the file or folder; its standard output is a socket to the parent, in both
//! directions; its standard error is the file of the windows.

use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::ExitCode;

use super::job::{
    AnnotationJob, Answer, Job, Probe, Refusal, RemainingRights, WireContent, WireGrid, WireSegment,
};
use super::reply::{FILE, refuse};
use super::sandbox::Held;
use super::series;
use super::window::Windows;
use super::wire::{receive, send};
use relief_exchange::{Format, Imported, ReadContext};
use relief_session::load_labels;
use relief_volume::{Grid, LabelMap};

/// The name of a label map in messages.
const SUBJECT: &str = "the uploaded file";

/// Memory of the program itself: its code, stacks of its threads, and buffers of decoders.
const OWN_BYTES: u64 = 3 << 29;

/// Runs the child: reads one file as the parent says, and ends.
#[must_use]
pub fn serve() -> ExitCode {
    let socket = std::io::stdout().as_fd().try_clone_to_owned().map(UnixStream::from);
    let served = socket.and_then(|mut socket| {
        let windows = Windows::take_stderr()?;
        let job: Job = receive(&mut socket)?;
        let held = enter(&job)?;
        work(&job, held, &mut socket, &windows)
    });
    // The parent sees the end of the socket; output of the child is not read.
    if served.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn enter(job: &Job) -> std::io::Result<Held> {
    let bulk = match job {
        // Voxels, and once more while they are put together.
        Job::Series(_, limits) => limits.voxel_bytes.saturating_mul(2).saturating_add(limits.kept_bytes),
        Job::List { limits, .. } => limits.kept_bytes,
        Job::Labels { most_voxels, .. } => most_voxels.saturating_mul(8),
        Job::Annotations(_) => 4 << 30,
        Job::Probe(_) => 0,
    };
    super::sandbox::enter(std::io::stdin(), bulk.saturating_add(OWN_BYTES)).map_err(std::io::Error::other)
}

fn work(job: &Job, held: Held, socket: &mut (impl Read + Write), windows: &Windows) -> std::io::Result<()> {
    match job {
        Job::List { limits, hashes_contents } => series::list(*limits, *hashes_contents, socket),
        Job::Series(choice, limits) => series::read(choice, *limits, socket, windows),
        Job::Labels { grid, most_voxels } => labels(grid, *most_voxels, socket, windows),
        Job::Annotations(job) => annotations(job, socket, windows),
        Job::Probe(Probe::Rights) => send(socket, &Answer::Probed(remaining_rights(held))),
        Job::Probe(Probe::Memory) => {
            let mut taken: Vec<Vec<u8>> = Vec::new();
            loop {
                taken.push(vec![1; 64 << 20]); // until an allocation fails, which ends the process
            }
        }
    }
}

/// The rights that are left to this process.
fn remaining_rights(held: Held) -> RemainingRights {
    // Nothing listens at this port: a call that passes the filter is refused by the other side.
    let connected = std::net::TcpStream::connect(("127.0.0.1", 9));
    let denied = |error: &std::io::Error| error.kind() == std::io::ErrorKind::PermissionDenied;
    RemainingRights {
        opens_files: std::fs::File::open("/proc/self/status").is_ok(),
        connects: !connected.is_err_and(|error| denied(&error)),
        starts_programs: std::process::Command::new("/proc/self/exe").arg("--version").spawn().is_ok(),
        has_landlock: held.files,
        has_seccomp: held.calls,
    }
}

fn labels(
    grid: &WireGrid,
    most_voxels: u64,
    socket: &mut (impl Read + Write),
    windows: &Windows,
) -> std::io::Result<()> {
    let grid = Grid::try_from(grid).map_err(std::io::Error::other)?;
    match load_labels(Path::new(FILE), most_voxels, &grid) {
        Err(error) => refuse(socket, Refusal::Content, error.about(SUBJECT)),
        Ok(loaded) => {
            let segments = loaded.map.segments().iter().map(WireSegment::from).collect();
            let grid = loaded.map.grid().into();
            send(socket, &Answer::Labels { grid, segments, warnings: loaded.warnings })?;
            windows.send(socket, &labels_of(&loaded.map))
        }
    }
}

/// The label of each voxel.
fn labels_of(map: &LabelMap) -> Vec<u16> {
    let label = |place: usize| place.checked_sub(1).map_or(0, |place| map.segments()[place].label);
    (0..map.grid().voxel_count()).map(|index| label(map.places().at(index))).collect()
}

fn annotations(
    job: &AnnotationJob,
    socket: &mut (impl Read + Write),
    windows: &Windows,
) -> std::io::Result<()> {
    let mut bytes = Vec::new();
    std::fs::File::open(FILE)?.take(job.most_bytes).read_to_end(&mut bytes)?;
    let given = job.format.as_deref().and_then(|name| name.parse::<Format>().ok());
    let Some(format) = given.or_else(|| Format::of(Path::new(&job.file_name), &bytes)) else {
        return refuse(socket, Refusal::UnknownFormat, String::new());
    };
    let grid = job.grid.as_ref().map(Grid::try_from).transpose().map_err(std::io::Error::other)?;
    let context = ReadContext {
        author: &job.author,
        set: &job.set,
        list: &job.list,
        frame_of_reference: job.frame_of_reference.as_ref(),
        grid: grid.as_ref(),
        series: job.series.as_ref(),
    };
    match relief_exchange::read(format, &bytes, &context) {
        Err(error) => refuse(socket, Refusal::Content, error.to_string()),
        Ok(Imported { items, contents, warnings }) => {
            let wire = |(_, media_type, bytes): &(_, String, Vec<u8>)| WireContent {
                media_type: media_type.clone(),
                bytes: bytes.len() as u64,
            };
            let described = contents.iter().map(wire).collect();
            send(socket, &Answer::Annotations { items, contents: described, warnings })?;
            contents.iter().try_for_each(|(_, _, bytes)| windows.send(socket, bytes))
        }
    }
}
