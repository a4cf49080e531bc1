//! A stand-in for an archive, whose answers a test writes.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// A server that gives every request, by its path, to a function that writes the answer.
pub(crate) struct StandIn {
    port: u16,
    paths: Arc<Mutex<Vec<String>>>,
}

impl StandIn {
    /// Serves until the test program ends; each connection has one answer.
    pub(crate) fn start(
        answer: impl Fn(&str, &mut TcpStream) -> std::io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let (answer, paths) = (Arc::new(answer), Arc::<Mutex<Vec<String>>>::default());
        let asked = Arc::clone(&paths);
        let serving = move || {
            for mut stream in listener.incoming().flatten() {
                let (answer, asked) = (Arc::clone(&answer), Arc::clone(&asked));
                spawn(move || {
                    let Some(path) = requested(&stream) else { return };
                    asked.lock().unwrap().push(path.clone());
                    // A client that leaves is what some tests are about.
                    let _ = answer(&path, &mut stream);
                });
            }
        };
        spawn(serving);
        Self { port, paths }
    }

    /// The address of its services, with what follows the root.
    pub(crate) fn address(&self, rest: &str) -> String {
        format!("dicomweb+http://127.0.0.1:{}/rs{rest}", self.port)
    }

    /// The paths of all requests.
    pub(crate) fn requests(&self) -> Vec<String> {
        self.paths.lock().unwrap().clone()
    }
}

fn spawn(work: impl FnOnce() + Send + 'static) {
    std::thread::Builder::new().name("stand-in".to_owned()).spawn(work).unwrap();
}

/// The path of a request, without its query; its body is read.
fn requested(stream: &TcpStream) -> Option<String> {
    let mut reader = BufReader::new(stream);
    let mut lines = reader.by_ref().lines();
    let first = lines.next()?.ok()?;
    let mut length = 0;
    loop {
        let line = lines.next()?.ok()?.to_ascii_lowercase();
        if line.is_empty() {
            break;
        }
        if let Some(value) = line.strip_prefix("content-length:") {
            length = value.trim().parse().ok()?;
        }
    }
    std::io::copy(&mut reader.take(length), &mut std::io::sink()).ok()?;
    Some(first.split(' ').nth(1)?.split('?').next()?.to_owned())
}

/// Writes a whole answer.
pub(crate) fn reply(stream: &mut TcpStream, status: &str, kind: &str, body: &[u8]) -> std::io::Result<()> {
    write_head(stream, status, kind, body.len())?;
    stream.write_all(body)
}

/// Writes the head of an answer that says how long its body is.
pub(crate) fn write_head(
    stream: &mut TcpStream,
    status: &str,
    kind: &str,
    bytes: usize,
) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {bytes}\r\nConnection: close\r\n\r\n"
    )
}
