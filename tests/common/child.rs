//! Helpers for child processes: one measures the peak memory of a child, one prints the last lines of a
//! server's standard error when a test fails.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a failed test prints the last lines of its processes")]

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Sends a signal, such as TERM; returns whether there is such a process. By the shell: small systems
/// have no program `kill`.
pub(crate) fn signal(name: &str, pid: u32) -> bool {
    Command::new("sh").args(["-c", &format!("kill -{name} {pid}")]).status().unwrap().success()
}

/// Collects the last lines of a process' standard error, and prints them when it is dropped by a failing
/// test. End the process first: declare this field after the process.
pub(crate) struct LastLines {
    name: String,
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: JoinHandle<()>,
}

impl LastLines {
    const MOST: usize = 30;

    /// Reads in a thread until the pipe is closed.
    pub(crate) fn of(name: &str, stderr: ChildStderr) -> Self {
        let lines = Arc::new(Mutex::new(VecDeque::new()));
        let kept = Arc::clone(&lines);
        let read = move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                let mut kept = kept.lock();
                kept.push_back(line);
                if kept.len() > Self::MOST {
                    kept.pop_front();
                }
            }
        };
        let reader = std::thread::Builder::new().name("reads-errors".to_owned()).spawn(read).unwrap();
        Self { name: name.to_owned(), lines, reader }
    }
}

impl Drop for LastLines {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        // A grandchild may keep the pipe open, so the wait is limited.
        for _ in 0..20 {
            if self.reader.is_finished() {
                break;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        let lines = self.lines.lock();
        eprintln!("the last {} lines on stderr of {}:", lines.len(), self.name);
        lines.iter().for_each(|line| eprintln!("  {line}"));
    }
}

/// The outcome of a child.
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// Largest resident set, MiB; 0 where the system does not say.
    pub(crate) peak_mib: u64,
}

/// Runs a command to its end. A child that takes more than `most_mib` of memory or two minutes is
/// killed, before it harms the machine.
pub(crate) fn run(command: &mut Command, most_mib: u64) -> Ended {
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let output = reading(child.stdout.take().unwrap());
    let errors = reading(child.stderr.take().unwrap());
    let (began, mut peak_mib) = (Instant::now(), 0);
    let status = loop {
        peak_mib = peak_mib.max(peak_of(&child));
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if peak_mib > most_mib || began.elapsed() > Duration::from_secs(120) {
            child.kill().unwrap();
            let status = child.wait().unwrap();
            panic!("killed at {peak_mib} MiB of {most_mib} after {:?}: {status}", began.elapsed());
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    Ended { status, stdout: output.join().unwrap(), stderr: errors.join().unwrap(), peak_mib }
}

fn reading(mut pipe: impl Read + Send + 'static) -> JoinHandle<String> {
    let reader = move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    std::thread::Builder::new().name("reads-child".to_owned()).spawn(reader).unwrap()
}

/// Largest resident set of a running process so far, MiB; 0 where the system does not say.
pub(crate) fn peak_of(child: &Child) -> u64 {
    let status = Path::new("/proc").join(child.id().to_string()).join("status");
    let Ok(status) = std::fs::read_to_string(status) else { return 0 };
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|peak| peak.trim().trim_end_matches(" kB").parse::<u64>().ok()).map_or(0, |kib| kib >> 10)
}
