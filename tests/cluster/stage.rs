//! The stage of these tests: series, a lone server, a cluster, and requests by hand.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::child::{LastLines, signal};

pub(crate) const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

/// Beyond what any step here may take on a busy machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn has_program(name: &str, variable: &str, usual: &[&str]) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let on_path = std::env::split_paths(&path).any(|folder| folder.join(name).exists());
    on_path || std::env::var_os(variable).is_some() || usual.iter().any(|place| Path::new(place).exists())
}

/// Whether everything for a cluster is available; prints what is missing.
pub(crate) fn can_run(what: &str) -> bool {
    if !has_program("nginx", "RELIEF_NGINX", &["/usr/sbin/nginx"]) {
        eprintln!("SKIPPED: {what} (no nginx; scripts/setup-services gets it)");
        return false;
    }
    if !has_program("initdb", "RELIEF_POSTGRES", &["/usr/lib/postgresql"]) {
        eprintln!("SKIPPED: {what} (no PostgreSQL; scripts/setup-postgres gets it)");
        return false;
    }
    true
}

pub(crate) fn relief(arguments: &[&str]) -> Command {
    let mut command = Command::new(RELIEF);
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").stdin(Stdio::null()).stderr(Stdio::piped());
    command
}

/// A small series of a kind.
pub(crate) fn phantom(folder: &Path, kind: &str) -> PathBuf {
    let series = folder.join(kind);
    let made = relief(&["phantom", "--kind", kind, "--size", "32", "--out"]).arg(&series).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    series
}

/// A process that is stopped when this value is dropped.
pub(crate) struct Process(
    Child,
    #[expect(dead_code, reason = "prints the last lines of its stderr when a test fails")] Option<LastLines>,
);

impl Process {
    /// Starts it, and gives its lines up to the one with its address.
    pub(crate) fn start(command: &mut Command) -> (Self, Vec<String>) {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let errors = child.stderr.take().map(|stderr| LastLines::of("a relief server", stderr));
        let process = Self(child, errors);
        let mut lines: Vec<String> = Vec::new();
        while !lines.last().is_some_and(|line| line.starts_with("listening on ")) {
            let mut line = String::new();
            assert!(output.read_line(&mut line).unwrap() > 0, "it ended after {lines:?}");
            lines.push(line.trim().to_owned());
        }
        (process, lines)
    }

    /// Its exit status after SIGTERM.
    pub(crate) fn stop(mut self) -> Option<i32> {
        signal("TERM", self.0.id());
        self.0.wait().unwrap().code()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.0.try_wait().is_ok_and(|ended| ended.is_none()) {
            signal("TERM", self.0.id());
            let _ = self.0.wait();
        }
    }
}

fn address_in(line: &str) -> String {
    let (_, address) = line.split_once("http://").unwrap_or_else(|| panic!("no address in {line:?}"));
    address.trim_end_matches('/').to_owned()
}

/// A server by itself.
pub(crate) fn lone(series: &[PathBuf]) -> (Process, String) {
    let mut command = relief(&["serve", "--listen", "127.0.0.1:0", "--listen-when-loaded"]);
    for series in series {
        command.arg("--series").arg(series);
    }
    let (process, lines) = Process::start(&mut command);
    (process, address_in(&lines[0]))
}

/// Servers behind nginx.
pub(crate) struct Cluster {
    pub(crate) process: Process,
    /// The address of all.
    pub(crate) address: String,
    /// Process and address of each server.
    pub(crate) servers: Vec<(u32, String)>,
}

impl Cluster {
    pub(crate) fn start(series: &[PathBuf]) -> Self {
        let script = root().join("scripts/serve-cluster");
        let port = free_ports();
        let mut command = Command::new(script);
        command.args(["--listen", &port.to_string()]).args(series);
        command.env("RELIEF_PROGRAM", RELIEF).env("RELIEF_ADAPTER", "cpu").env_remove("RELIEF_ANNOTATIONS");
        let (process, mut lines) = Process::start(command.stdin(Stdio::null()));
        let address = address_in(&lines.pop().unwrap());
        let server = |line: &String| {
            let pid = line.split_once("(process ").unwrap().1.split_once(')').unwrap().0.parse().unwrap();
            (pid, address_in(line))
        };
        let servers = lines.iter().map(server).collect();
        Self { process, address, servers }
    }
}

/// A free port followed by free ports. They lie below the range from which systems assign ports,
/// because an assigned one could be taken before it is used.
pub(crate) fn free_ports() -> u16 {
    const FIRST: u32 = 20_000;
    const RUNS: u32 = 1500;
    static GIVEN: AtomicU32 = AtomicU32::new(0);
    for _ in 0..100 {
        let run = (std::process::id() % RUNS * 17 + GIVEN.fetch_add(1, Ordering::Relaxed)) % RUNS;
        let port = u16::try_from(FIRST + 8 * run).unwrap();
        if (port..port + 8).all(|port| TcpListener::bind(("127.0.0.1", port)).is_ok()) {
            return port;
        }
    }
    panic!("no free ports");
}

/// An answer that came whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim())
        })
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }
}

/// Sends a request on a connection of its own. An answer that does not come whole is an error, as
/// it is for any client.
pub(crate) fn ask(address: &str, line: &str, headers: &str, body: &str) -> std::io::Result<Answer> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let length = if body.is_empty() {
        String::new()
    } else {
        format!("Content-Type: application/json\r\nContent-Length: {}\r\n", body.len())
    };
    write!(stream, "{line} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{length}{headers}\r\n{body}")?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    let broken = || std::io::Error::from(ErrorKind::UnexpectedEof);
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").ok_or_else(broken)?;
    let body = answer.split_off(end + 4);
    let head = String::from_utf8(answer).map_err(|_| broken())?;
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).ok_or_else(broken)?;
    let answer = Answer { status, head, body };
    let length = answer.header("content-length").map(|length| length.parse::<usize>().unwrap());
    if answer.header("transfer-encoding").is_some() {
        return Ok(Answer { body: unchunked(&answer.body).ok_or_else(broken)?, ..answer });
    }
    if length.is_some_and(|length| length != answer.body.len()) {
        return Err(broken());
    }
    Ok(answer)
}

/// A body in chunks (RFC 9112, 7.1), whole or not at all.
fn unchunked(mut bytes: &[u8]) -> Option<Vec<u8>> {
    let mut whole = Vec::new();
    loop {
        let end = bytes.windows(2).position(|two| two == b"\r\n")?;
        let size = usize::from_str_radix(std::str::from_utf8(&bytes[..end]).ok()?, 16).ok()?;
        if size == 0 {
            return Some(whole);
        }
        whole.extend_from_slice(bytes.get(end + 2..end + 2 + size)?);
        bytes = bytes.get(end + 2 + size + 2..)?;
    }
}

pub(crate) fn get(address: &str, path: &str, headers: &str) -> Answer {
    ask(address, &format!("GET {path}"), headers, "").unwrap()
}

/// The volumes of a server, as it lists them.
pub(crate) fn listed(address: &str) -> Value {
    get(address, "/v1/volumes", "").json()
}

/// Ids of the volumes that are served, in their order.
pub(crate) fn volumes(address: &str) -> Vec<String> {
    listed(address)["volumes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|volume| volume["id"].as_str().unwrap().to_owned())
        .collect()
}

/// Waits until something is so.
pub(crate) fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
