//! An Orthanc of a test's own, on loopback.

use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use crate::cluster::stage::{PATIENCE, ask, free_ports, relief, until};
use crate::common::child::signal;

/// Orthanc with an empty store; ends with this value.
pub(crate) struct Orthanc {
    programs: PathBuf,
    folder: tempfile::TempDir,
    process: Child,
    proxy: Option<Child>,
    /// Of its HTTP services; the next one is that of the DICOM network, then that of the proxy.
    port: u16,
}

/// Orthanc's checks of its callers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// A login.
    Login,
    /// A login over TLS, and a certificate of the client: nginx in front of Orthanc wants it.
    Certificate,
}

impl Orthanc {
    /// `None` after saying aloud that `what` was not tested.
    pub(crate) fn start(what: &str, wanted: Wanted) -> Option<Self> {
        let Some(programs) = std::env::var_os("RELIEF_ORTHANC").map(PathBuf::from) else {
            eprintln!("SKIPPED: {what} (RELIEF_ORTHANC is not set, see scripts/setup-services)");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let port = free_ports();
        let proxy = match wanted {
            Wanted::Login => None,
            Wanted::Certificate => Some(proxy(what, folder.path(), port)?),
        };
        let path = |name: &str| folder.path().join(name);
        let settings = serde_json::json!({
            "StorageDirectory": path("store"), "IndexDirectory": path("store"),
            "HttpPort": port, "DicomPort": port + 1, "DicomAet": "ORTHANC", "RemoteAccessAllowed": false,
            "DicomAlwaysAllowStore": true, "AuthenticationEnabled": true,
            "RegisteredUsers": { "reader": "a secret" },
            "Plugins": [programs.join("dicomweb.so")],
        });
        std::fs::write(path("settings.json"), settings.to_string()).unwrap();
        std::fs::write(path("login"), "reader:a secret\n").unwrap();
        let process = Command::new(programs.join("Orthanc"))
            .arg(path("settings.json"))
            .stdin(Stdio::null())
            .stderr(std::fs::File::create(path("log")).unwrap())
            .spawn()
            .unwrap();
        let mut started = Self { programs, folder, process, proxy, port };
        started.wait();
        Some(started)
    }

    fn wait(&mut self) {
        let started = Instant::now();
        while !self.log().contains("Orthanc has started") {
            assert!(self.process.try_wait().unwrap().is_none(), "Orthanc ended: {}", self.log());
            assert!(started.elapsed() < PATIENCE, "{}", self.log());
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.path("log")).unwrap()
    }

    /// A file in the folder of this Orthanc.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The address of its DICOMweb services, with what follows the root.
    pub(crate) fn address(&self, rest: &str) -> String {
        let (scheme, port) =
            if self.proxy.is_some() { ("https", self.port + 2) } else { ("http", self.port) };
        format!("dicomweb+{scheme}://127.0.0.1:{port}/dicom-web{rest}")
    }

    /// Its address in the DICOM network.
    pub(crate) fn network_address(&self) -> String {
        format!("dicom://ORTHANC@127.0.0.1:{}", self.port + 1)
    }

    /// Sends the files of a folder by the DICOM network, with DCMTK.
    pub(crate) fn store(&self, series: &Path) {
        let sent = Command::new(self.programs.join("storescu"))
            .args(["-aec", "ORTHANC", "127.0.0.1", &(self.port + 1).to_string(), "+sd", "+r", "+sp", "*.dcm"])
            .arg(series)
            .output()
            .unwrap();
        assert!(sent.status.success(), "{}", String::from_utf8_lossy(&sent.stderr));
    }

    /// Its own HTTP interface.
    fn ask(&self, request: &str, body: &str) -> serde_json::Value {
        let login = format!("Authorization: Basic {}\r\n", data_encoding::BASE64.encode(b"reader:a secret"));
        let answer = ask(&format!("127.0.0.1:{}", self.port), request, &login, body).unwrap();
        assert_eq!(answer.status, 200, "{request}: {}", self.log());
        if answer.body.is_empty() { serde_json::Value::Null } else { answer.json() }
    }

    /// Has Orthanc send everything by the DICOM network.
    pub(crate) fn send_all(&self, title: &str, port: u16) {
        let target = serde_json::json!({ "AET": title, "Host": "127.0.0.1", "Port": port }).to_string();
        self.ask("PUT /modalities/target", &target);
        let series = self.ask("GET /series", "").to_string();
        self.ask("POST /modalities/target/store", &series);
    }

    /// Has Orthanc ask whether what it sent is kept; its report.
    pub(crate) fn commit_all(&self) -> serde_json::Value {
        let series = serde_json::json!({ "Resources": self.ask("GET /series", "") }).to_string();
        let begun = self.ask("POST /modalities/target/storage-commitment", &series);
        let report = format!("GET {}", begun["Path"].as_str().unwrap());
        until("a report about storage commitment", || self.ask(&report, "")["Status"] != "Pending");
        self.ask(&report, "")
    }

    /// `relief` that logs in.
    pub(crate) fn relief(&self, arguments: &[&str]) -> Command {
        let mut command = relief(arguments);
        command.env("RELIEF_ARCHIVE_LOGIN_FILE", self.path("login")).env("NO_PROXY", "*");
        if self.proxy.is_some() {
            command.env("RELIEF_ARCHIVE_CA", self.path("certificate.pem"));
            command.env("RELIEF_ARCHIVE_IDENTITY", self.path("server.pem"));
        }
        command
    }
}

/// A certificate for loopback, which server and client share, alone and with its key.
fn certificate(folder: &Path) {
    let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).unwrap();
    let (certificate, key) = (made.cert.pem(), made.signing_key.serialize_pem());
    std::fs::write(folder.join("server.pem"), format!("{certificate}{key}")).unwrap();
    std::fs::write(folder.join("certificate.pem"), certificate).unwrap();
}

/// nginx that passes encrypted requests of clients with the certificate on.
fn proxy(what: &str, folder: &Path, port: u16) -> Option<Child> {
    let named = std::env::var_os("RELIEF_NGINX").map(PathBuf::from);
    let Some(program) =
        named.or_else(|| Some("/usr/sbin/nginx".into()).filter(|path: &PathBuf| path.exists()))
    else {
        eprintln!("SKIPPED: {what} (no nginx; scripts/setup-services gets it)");
        return None;
    };
    certificate(folder);
    let settings = format!(
        "daemon off; pid nginx.pid; error_log nginx.log; events {{}}\n\
         http {{ access_log off; client_body_temp_path a; proxy_temp_path b; fastcgi_temp_path c; uwsgi_temp_path d; \
         scgi_temp_path e; server {{ listen 127.0.0.1:{} ssl; ssl_certificate server.pem; \
         ssl_certificate_key server.pem; ssl_client_certificate certificate.pem; ssl_verify_client on; \
         location / {{ proxy_pass http://127.0.0.1:{port}; }} }} }}\n",
        port + 2,
    );
    std::fs::write(folder.join("nginx.conf"), settings).unwrap();
    let mut command = Command::new(program);
    command.arg("-p").arg(folder).args(["-c", "nginx.conf", "-e", "nginx.log"]);
    let started = command.stdin(Stdio::null()).spawn().unwrap();
    until("nginx listens", || TcpStream::connect(("127.0.0.1", port + 2)).is_ok());
    Some(started)
}

impl Drop for Orthanc {
    fn drop(&mut self) {
        if let Some(proxy) = &mut self.proxy {
            signal("TERM", proxy.id()); // it ends its workers
            let _ = proxy.wait();
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
