//! A document's folder and the server that runs beside its commands.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::world::{RELIEF, World};

/// Runs commands of one document one after the other.
pub(super) struct Session {
    folder: tempfile::TempDir,
    root: PathBuf,
    server: Option<Server>,
    /// Assignments of shell variables, which hold for later commands.
    variables: Vec<String>,
}

/// A `relief serve` of the document.
struct Server {
    process: Child,
    address: String,
    /// Id of its first volume.
    id: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill(); // gone already where it failed
        let _ = self.process.wait();
    }
}

impl Session {
    pub(super) fn new(world: &World, root: &Path, document: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        if document == "README.md" {
            // It makes its own head first.
            world.put_into(folder.path());
            std::fs::remove_dir_all(folder.path().join("head")).unwrap();
        } else {
            world.put_into(folder.path());
        }
        Self { folder, root: root.to_owned(), server: None, variables: Vec::new() }
    }

    /// Runs a command, and says why it failed.
    pub(super) fn run(&mut self, command: &str) -> Result<(), String> {
        if command.starts_with("relief serve") {
            self.server = None;
            self.server = Some(self.serve(command)?);
            return Ok(());
        }
        let is_variable = command.split_once('=').is_some_and(|(name, _)| {
            !name.is_empty() && name.chars().all(|letter| letter.is_ascii_uppercase())
        });
        let mut command = command.to_owned();
        if command.contains(":8080") && self.server.is_none() {
            self.server = Some(self.serve("relief serve --series head")?);
        }
        if let Some(server) = &self.server {
            for written in ["127.0.0.1:8080", "localhost:8080"] {
                command = command.replace(written, &server.address);
            }
            command = command.replace("/ID/", &format!("/{}/", server.id));
        }
        if is_variable {
            self.variables.push(command);
            return Ok(());
        }
        if command.contains("curl") {
            // An error of the server is the command's.
            command = command.replace("curl ", "curl --fail-with-body --silent --show-error ");
        }
        if command.contains("/desk/") || self.variables.iter().any(|line| line.contains("/desk")) {
            self.open_view()?;
        }
        let script = format!("{}\n{command}", self.variables.join("\n"));
        self.shell(&script)
    }

    fn shell(&self, script: &str) -> Result<(), String> {
        let mut command = Command::new("sh");
        command.arg("-ec").arg(script).current_dir(self.folder.path()).env("RELIEF_ADAPTER", "cpu");
        let path = std::env::var("PATH").unwrap_or_default();
        let programs = Path::new(RELIEF).parent().unwrap().display();
        command.env("PATH", format!("{programs}:{}:{path}", self.root.display()));
        let output = command.output().map_err(|error| error.to_string())?;
        if output.status.success() {
            return Ok(());
        }
        let said = [output.stderr, output.stdout].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        Err(format!("{}: {}", output.status, said.concat().trim()))
    }

    fn serve(&self, written: &str) -> Result<Server, String> {
        let written = written.replace("0.0.0.0:8443", "127.0.0.1:0");
        let listen = if written.contains("--listen") { "" } else { " --listen 127.0.0.1:0" };
        let script = format!("exec {RELIEF}{}{listen}", written.strip_prefix("relief").unwrap());
        let mut command = Command::new("sh");
        command.arg("-c").arg(script).current_dir(self.folder.path()).env("RELIEF_ADAPTER", "cpu");
        let log = std::fs::File::create(self.folder.path().join("serve.log")).unwrap();
        let mut process = command.stdout(Stdio::piped()).stderr(log).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().split_once("://").and_then(|(_, rest)| rest.strip_suffix('/'));
        let address = address.map(str::to_owned);
        let mut server = Server { process, address: String::new(), id: String::new() };
        let said = || std::fs::read_to_string(self.folder.path().join("serve.log")).unwrap_or_default();
        server.address = address.ok_or_else(|| format!("it does not listen: {}", said()))?;
        if line.contains("https") {
            return Ok(server); // callers need a token
        }
        let began = Instant::now();
        while server.id.is_empty() {
            if began.elapsed() > Duration::from_secs(120) {
                return Err(format!("no volume is loaded: {}", said()));
            }
            std::thread::sleep(Duration::from_millis(100));
            let listed =
                Command::new("curl").args(["-s", &format!("http://{}/v1/volumes", server.address)]).output();
            let listed: serde_json::Value =
                serde_json::from_slice(&listed.map_err(|error| error.to_string())?.stdout)
                    .unwrap_or_default();
            // All that were asked for: a document asks for the first one.
            if listed["loading"] == 0 {
                server.id = listed["volumes"][0]["id"].as_str().unwrap_or_default().to_owned();
            }
        }
        Ok(server)
    }

    /// Opens the view `desk`, as a client does that others join.
    fn open_view(&self) -> Result<(), String> {
        let Some(server) = &self.server else { return Err("there is no server".to_owned()) };
        self.shell(&format!(
            "relief client --server http://{} --view desk --headless --save-frame desk-view.png",
            server.address
        ))
    }
}
