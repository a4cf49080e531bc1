//! The source of reports: a recording, a socket that sends one, or a Wiimote itself through
//! hidraw.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant, SystemTime};

use anyhow::Context;

use crate::output::GrowingFile;
use relief_tracking::{
    AccelerometerCalibration, GyroCalibration, Host, HostOptions, HostState, InputReport, MAX_REPORT_BYTES,
    RecordingReader, Sensitivity, recording_line,
};

/// An event of a source.
pub(crate) enum Event {
    /// A report and its time, ns.
    Report(u64, InputReport),
    /// Calibration data of a remote.
    Calibration(Option<AccelerometerCalibration>, Option<GyroCalibration>),
}

/// How a live source is run.
pub(crate) struct LiveOptions {
    pub(crate) sensitivity: Sensitivity,
    pub(crate) gyroscope: bool,
    pub(crate) full: bool,
    pub(crate) realtime: bool,
    pub(crate) record: Option<PathBuf>,
}

type Recorded = RecordingReader<Box<dyn BufRead + Send>>;

pub(crate) enum Source {
    Recording { reader: Recorded, name: String, pace: Option<Pace> },
    Socket { events: Receiver<Result<(u64, InputReport), String>>, stop: Arc<AtomicBool> },
    Remote(Box<Remote>),
}

/// Keeps a recording at its own speed.
pub(crate) struct Pace {
    start: Instant,
    first_ns: Option<u64>,
}

impl Pace {
    fn wait(&mut self, t_ns: u64) {
        let since = t_ns.saturating_sub(*self.first_ns.get_or_insert(t_ns));
        let due = self.start + Duration::from_nanos(since);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }
}

impl Source {
    pub(crate) fn open(name: &str, options: &LiveOptions) -> anyhow::Result<Self> {
        if let Some(address) = name.strip_prefix("tcp://") {
            return Self::connect(address);
        }
        if name == "hidraw" || name.starts_with("/dev/hidraw") {
            let path = (name != "hidraw").then(|| PathBuf::from(name));
            return Ok(Self::Remote(Box::new(Remote::open(path, options)?)));
        }
        anyhow::ensure!(
            options.record.is_none(),
            "--record is for live sources; {name} is a recording already"
        );
        let input: Box<dyn BufRead + Send> = if name == "-" {
            Box::new(BufReader::new(std::io::stdin()))
        } else {
            let file = std::fs::File::open(name).with_context(|| format!("cannot read {name}"))?;
            Box::new(BufReader::new(file))
        };
        let pace = options.realtime.then(|| Pace { start: Instant::now(), first_ns: None });
        Ok(Self::Recording { reader: RecordingReader::new(input), name: name.to_owned(), pace })
    }

    fn connect(address: &str) -> anyhow::Result<Self> {
        let stream =
            std::net::TcpStream::connect(address).with_context(|| format!("cannot reach {address}"))?;
        let (sender, events) = sync_channel(256);
        let name = address.to_owned();
        let read = move || {
            for item in RecordingReader::new(BufReader::new(stream)) {
                let failed = item.is_err();
                let item = item.map(|timed| (timed.t_ns, timed.report)).map_err(|e| format!("{name}: {e}"));
                if sender.send(item).is_err() || failed {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("reports".to_owned()).spawn(read)?;
        Ok(Self::Socket { events, stop: stop_flag()? })
    }

    /// The next event; `None` at the end of a recording, or when the user stops a live source.
    pub(crate) fn next(&mut self) -> anyhow::Result<Option<Event>> {
        match self {
            Self::Recording { reader, name, pace } => {
                let Some(item) = reader.next() else { return Ok(None) };
                let timed = item.with_context(|| format!("{name} is not a recording"))?;
                if let Some(pace) = pace {
                    pace.wait(timed.t_ns);
                }
                Ok(Some(Event::Report(timed.t_ns, timed.report)))
            }
            Self::Socket { events, stop } => loop {
                if stop.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                match events.recv_timeout(Duration::from_millis(100)) {
                    Ok(Ok((t_ns, report))) => return Ok(Some(Event::Report(t_ns, report))),
                    Ok(Err(message)) => anyhow::bail!(message),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return Ok(None),
                }
            },
            Self::Remote(remote) => remote.next(),
        }
    }

    pub(crate) fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Remote(remote) => remote.record.map_or(Ok(()), GrowingFile::finish),
            _ => Ok(()),
        }
    }
}

/// Set by the first interrupt, so that files can be finished.
fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let wait = move || {
        if runtime.block_on(tokio::signal::ctrl_c()).is_ok() {
            set.store(true, Ordering::Relaxed);
        }
    };
    std::thread::Builder::new().name("stop".to_owned()).spawn(wait)?;
    Ok(flag)
}

/// A Wiimote on a hidraw device: opened, brought up, and looked for again when it goes away.
pub(crate) struct Remote {
    wanted: Option<PathBuf>,
    options: HostOptions,
    open: Option<Open>,
    tried: Instant,
    clock: Clock,
    stop: Arc<AtomicBool>,
    record: Option<GrowingFile>,
}

/// Nanoseconds since 1970, by a clock that does not jump.
#[derive(Clone, Copy)]
struct Clock {
    start: Instant,
    start_ns: u64,
}

impl Clock {
    fn start() -> Self {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self { start: Instant::now(), start_ns: u64::try_from(since_1970.as_nanos()).unwrap_or(0) }
    }

    fn ns(self, at: Instant) -> u64 {
        let since = at.saturating_duration_since(self.start).as_nanos();
        self.start_ns.saturating_add(u64::try_from(since).unwrap_or(u64::MAX))
    }
}

struct Open {
    device: std::fs::File,
    reports: Receiver<(Instant, Vec<u8>)>,
    host: Host,
    reported: bool,
}

const LOOK_AGAIN: Duration = Duration::from_millis(500);

impl Remote {
    fn open(wanted: Option<PathBuf>, options: &LiveOptions) -> anyhow::Result<Self> {
        let path = match &wanted {
            Some(path) => path.clone(),
            None => find_wiimote(Path::new("/sys/class/hidraw")).context(
                "no Wiimote among the hidraw devices; pair it (hold 1 and 2), and see that /dev/hidrawN may be opened",
            )?,
        };
        let record = options.record.as_deref().map(GrowingFile::create).transpose()?;
        let &LiveOptions { sensitivity, full, gyroscope, .. } = options;
        let options = HostOptions { sensitivity, full, gyroscope };
        Ok(Self {
            wanted,
            options,
            open: Some(Open::new(&path, options)?),
            tried: Instant::now(),
            clock: Clock::start(),
            stop: stop_flag()?,
            record,
        })
    }

    fn next(&mut self) -> anyhow::Result<Option<Event>> {
        while !self.stop.load(Ordering::Relaxed) {
            let Some(open) = &mut self.open else {
                self.look_again();
                continue;
            };
            let clock = self.clock;
            if let Some(output) = open.host.poll(clock.ns(Instant::now()))
                && open.device.write_all(&output.encode(false)).is_err()
            {
                self.open = None;
                continue;
            }
            anyhow::ensure!(
                open.host.state() != HostState::Refused,
                "the device refuses what every Wiimote takes; is it one? See --reports /dev/hidrawN"
            );
            if !open.reported && open.host.state() == HostState::Running {
                open.reported = true;
                let accelerometer = open.host.calibrations().and_then(|known| known.accelerometer);
                return Ok(Some(Event::Calibration(accelerometer, open.host.gyroscope())));
            }
            match open.reports.recv_timeout(Duration::from_millis(20)) {
                Ok((at, bytes)) => {
                    // Input that is not a report (from a driver or another program) is skipped.
                    let Ok(report) = InputReport::decode(&bytes) else { continue };
                    let t_ns = clock.ns(at);
                    open.host.take(t_ns, &report);
                    if let Some(record) = &mut self.record {
                        record.line(&recording_line(t_ns, &bytes))?;
                    }
                    return Ok(Some(Event::Report(t_ns, report)));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    tracing::warn!("the Wiimote is gone; looking for it");
                    self.open = None;
                }
            }
        }
        Ok(None)
    }

    fn look_again(&mut self) {
        std::thread::sleep(LOOK_AGAIN.saturating_sub(self.tried.elapsed()));
        self.tried = Instant::now();
        let path = self.wanted.clone().or_else(|| find_wiimote(Path::new("/sys/class/hidraw")));
        self.open = path.and_then(|path| Open::new(&path, self.options).ok());
    }
}

impl Open {
    fn new(path: &Path, options: HostOptions) -> anyhow::Result<Self> {
        let open = || std::fs::File::options().read(true).write(true).open(path);
        let device = open().with_context(|| format!("cannot open {}", path.display()))?;
        let mut reading = device.try_clone()?;
        let (sender, reports) = sync_channel(64);
        let read = move || {
            let mut buffer = [0; 2 * MAX_REPORT_BYTES];
            while let Ok(count) = reading.read(&mut buffer) {
                if count == 0 || sender.send((Instant::now(), buffer[..count].to_vec())).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("hidraw".to_owned()).spawn(read)?;
        Ok(Self { device, reports, host: Host::new(options), reported: false })
    }
}

/// The first Wiimote below a folder like /sys/class/hidraw: vendor 057e, product 0306 or 0330.
fn find_wiimote(class: &Path) -> Option<PathBuf> {
    let mut names: Vec<_> = std::fs::read_dir(class).ok()?.flatten().map(|entry| entry.file_name()).collect();
    names.sort();
    let is_wiimote = |name: &std::ffi::OsString| {
        let uevent = std::fs::read_to_string(class.join(name).join("device/uevent")).unwrap_or_default();
        uevent.lines().filter_map(|line| line.strip_prefix("HID_ID=")).any(|id| {
            let id = id.to_ascii_uppercase();
            let mut parts = id.split(':').skip(1).map(|part| u32::from_str_radix(part, 16).ok());
            parts.next() == Some(Some(0x057e)) && matches!(parts.next(), Some(Some(0x0306 | 0x0330)))
        })
    };
    names.into_iter().find(is_wiimote).map(|name| Path::new("/dev").join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wiimote_is_found_by_vendor_and_product() {
        let class = tempfile::tempdir().unwrap();
        for (name, id) in [("hidraw0", "0003:0000046D:0000C52B"), ("hidraw3", "0005:0000057E:00000306")] {
            let folder = class.path().join(name).join("device");
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("uevent"), format!("DRIVER=x\nHID_ID={id}\n")).unwrap();
        }
        assert_eq!(find_wiimote(class.path()), Some(PathBuf::from("/dev/hidraw3")));
        assert_eq!(find_wiimote(&class.path().join("none")), None);
    }
}
