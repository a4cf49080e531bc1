//! Servers of a test's own on loopback: NATS with JetStream, and moto, a stand-in for S3.
//!
//! Their programs are those of `scripts/setup-services`, named by `RELIEF_NATS_SERVER` and
//! `RELIEF_MOTO`.

use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The program that a variable names, or `None` after saying aloud that `what` was not tested.
fn program(what: &str, variable: &str) -> Option<String> {
    let found = std::env::var(variable).ok().filter(|path| Path::new(path).exists());
    if found.is_none() {
        eprintln!("SKIPPED: {what} ({variable} is not set, see scripts/setup-services)");
    }
    found
}

/// A NATS server with JetStream that ends with this value.
pub(crate) struct Nats {
    program: String,
    folder: tempfile::TempDir,
    more: Vec<String>,
    port: u16,
    process: Child,
}

impl Nats {
    pub(crate) fn start(what: &str, more: &[&str]) -> Option<Self> {
        let program = program(what, "RELIEF_NATS_SERVER")?;
        let folder = tempfile::tempdir().unwrap();
        let more: Vec<String> = more.iter().map(|argument| (*argument).to_owned()).collect();
        let process = launch(&program, folder.path(), &more, "-1"); // a free port
        let mut nats = Self { program, folder, more, port: 0, process };
        nats.port = nats.find_port();
        Some(nats)
    }

    pub(crate) fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    /// The server says its port in a file.
    fn find_port(&self) -> u16 {
        let file = self.folder.path().join(format!("nats-server_{}.ports", self.process.id()));
        let started = Instant::now();
        loop {
            let ports = std::fs::read(&file).ok();
            let ports = ports.and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
            let url = ports.as_ref().and_then(|ports| ports["nats"][0].as_str());
            if let Some(port) = url.and_then(|url| url.rsplit(':').next()?.parse().ok()) {
                return port;
            }
            assert!(started.elapsed() < Duration::from_secs(60), "nats-server says no port");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// `kill -9`.
    pub(crate) fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Restarts it on the same port, with its data.
    pub(crate) fn restart(&mut self) {
        self.process = launch(&self.program, self.folder.path(), &self.more, &self.port.to_string());
        await_port(self.port);
    }
}

fn launch(program: &str, folder: &Path, more: &[String], port: &str) -> Child {
    let mut server = Command::new(program);
    server.args(["-a", "127.0.0.1", "-p", port, "-js", "-sd"]).arg(folder.join("store"));
    server.arg("--ports_file_dir").arg(folder).args(more);
    server.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

impl Drop for Nats {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A stand-in for S3 with a bucket `views`, which ends with this value.
pub(crate) struct Bucket {
    port: u16,
    process: Child,
}

impl Bucket {
    pub(crate) fn start(what: &str) -> Option<Self> {
        let program = program(what, "RELIEF_MOTO")?;
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let process = Command::new(program)
            .args(["-H", "127.0.0.1", "-p", &port.to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let bucket = Self { port, process };
        await_port(port);
        bucket.python("s3.create_bucket(Bucket='views')", &[]);
        Some(bucket)
    }

    /// The environment that `relief` and others need.
    pub(crate) fn environment(&self) -> [(&'static str, String); 4] {
        [
            ("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", self.port)),
            ("AWS_REGION", "us-east-1".to_owned()),
            ("AWS_ACCESS_KEY_ID", "any".to_owned()),
            ("AWS_SECRET_ACCESS_KEY", "any".to_owned()),
        ]
    }

    /// Runs a line of Python with `s3`, a client of Amazon's own.
    pub(crate) fn python(&self, line: &str, arguments: &[&str]) {
        let moto = std::env::var("RELIEF_MOTO").unwrap();
        let python = Path::new(&moto).with_file_name("python");
        let head =
            "import boto3, os, sys\ns3 = boto3.client('s3', endpoint_url=os.environ['AWS_ENDPOINT_URL'])\n";
        let ran = Command::new(python)
            .args(["-c", &format!("{head}{line}")])
            .args(arguments)
            .envs(self.environment())
            .env("NO_PROXY", "*")
            .output()
            .unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }

    /// All files below a folder as objects, by their names behind the prefix.
    pub(crate) fn upload(&self, folder: &Path, prefix: &str) {
        let line = "
for root, _, names in os.walk(sys.argv[1]):
    for name in names:
        path = os.path.join(root, name)
        s3.upload_file(path, 'views', sys.argv[2] + os.path.relpath(path, sys.argv[1]))";
        self.python(line, &[folder.to_str().unwrap(), prefix]);
    }

    /// All objects into a folder, by their names.
    pub(crate) fn download(&self, folder: &Path) {
        let line = "
for page in s3.get_paginator('list_objects_v2').paginate(Bucket='views'):
    for found in page.get('Contents', []):
        path = os.path.join(sys.argv[1], found['Key'])
        os.makedirs(os.path.dirname(path), exist_ok=True)
        s3.download_file('views', found['Key'], path)";
        std::fs::create_dir_all(folder).unwrap();
        self.python(line, &[folder.to_str().unwrap()]);
    }
}

impl Drop for Bucket {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn await_port(port: u16) {
    let started = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(started.elapsed() < Duration::from_secs(60), "nobody listens on port {port}");
        std::thread::sleep(Duration::from_millis(50));
    }
}
