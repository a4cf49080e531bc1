//! Shared by the tests: a PostgreSQL server on loopback, in a folder that goes with it.
//!
//! Needs PostgreSQL's programs: those of `scripts/setup-postgres` (`RELIEF_POSTGRES`), Debian's, or
//! those on the path.
#![allow(dead_code, reason = "each test program uses a part of this")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use relief_store::Store;
use sqlx::{Connection, Executor};

/// A server that ends with this value.
pub(crate) struct Server {
    programs: PathBuf,
    folder: tempfile::TempDir,
    port: u16,
    process: Child,
}

impl Server {
    /// Starts one, or says aloud that `what` was not tested.
    pub(crate) async fn start(what: &str) -> Option<Self> {
        let Some(programs) = programs() else {
            eprintln!("SKIPPED: {what} (no PostgreSQL; scripts/setup-postgres gets it)");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        std::fs::create_dir(&data).unwrap();
        give_away(&[folder.path(), &data]);
        let mut initdb = as_nobody(&programs.join("initdb"));
        let made = initdb.args([
            "--auth=trust",
            "--username=relief",
            "--encoding=UTF8",
            "--no-locale",
            "--no-instructions",
            "-D",
        ]);
        let made = made.arg(&data).env("LC_ALL", "C").output().unwrap();
        if !made.status.success() {
            eprintln!("SKIPPED: {what} (initdb: {})", String::from_utf8_lossy(&made.stderr).trim());
            return None;
        }
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let process = launch(&programs, &data, port);
        let mut server = Self { programs, folder, port, process };
        server.wait().await;
        Some(server)
    }

    /// The address of a database.
    pub(crate) fn url(&self, database: &str) -> String {
        // PostgreSQL takes 63 bytes of a name.
        format!("postgres://relief@127.0.0.1:{}/{}", self.port, &database[..database.len().min(60)])
    }

    /// Waits until it answers. One that has just crashed leaves processes, and while they end no
    /// other one starts.
    async fn wait(&mut self) {
        let patience = Instant::now() + Duration::from_secs(180);
        loop {
            match sqlx::PgConnection::connect(&self.url("postgres")).await {
                Ok(connection) => return connection.close().await.unwrap(),
                Err(error) => assert!(Instant::now() < patience, "PostgreSQL does not answer: {error}"),
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
            if self.process.try_wait().unwrap().is_some() {
                self.process = launch(&self.programs, &self.folder.path().join("data"), self.port);
            }
        }
    }

    pub(crate) async fn admin(&self, database: &str) -> sqlx::PgConnection {
        sqlx::PgConnection::connect(&self.url(database)).await.unwrap()
    }

    /// A log in a database of its own.
    pub(crate) async fn store(&self, name: &str) -> Store {
        self.database(name).await;
        Store::open(&self.url(name)).await.unwrap()
    }

    /// Makes a database.
    pub(crate) async fn database(&self, name: &str) {
        let create = format!("CREATE DATABASE \"{}\"", &name[..name.len().min(60)]);
        self.admin("postgres").await.execute(sqlx::AssertSqlSafe(create)).await.unwrap();
    }

    /// Makes it accept encrypted connections, with a certificate and its key as PEM.
    pub(crate) async fn encrypt(&self, certificate: &str, key: &str) {
        let data = self.folder.path().join("data");
        for (name, text) in [("server.crt", certificate), ("server.key", key)] {
            let path = data.join(name);
            std::fs::write(&path, text).unwrap();
            give_away(&[&path]);
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
            }
        }
        let mut admin = self.admin("postgres").await;
        admin.execute("ALTER SYSTEM SET ssl = on").await.unwrap();
        admin.execute("SELECT pg_reload_conf()").await.unwrap();
        let patience = Instant::now() + Duration::from_secs(60);
        let url = format!("{}?sslmode=require", self.url("postgres"));
        while let Err(error) = sqlx::PgConnection::connect(&url).await {
            assert!(Instant::now() < patience, "PostgreSQL does not encrypt: {error}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// `kill -9` of the server, and a new one with the same data.
    pub(crate) async fn crash(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
        self.wait().await;
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let data = self.folder.path().join("data");
        let stopped = as_nobody(&self.programs.join("pg_ctl"))
            .args(["stop", "-m", "immediate", "-D"])
            .arg(data)
            .output();
        if stopped.is_err() {
            let _ = self.process.kill();
        }
        let _ = self.process.wait();
    }
}

fn launch(programs: &Path, data: &Path, port: u16) -> Child {
    let mut server = as_nobody(&programs.join("postgres"));
    server.arg("-D").arg(data).arg("-p").arg(port.to_string());
    for setting in ["listen_addresses=127.0.0.1", "unix_socket_directories=", "jit=off", "max_connections=60"]
    {
        server.arg("-c").arg(setting);
    }
    server.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Where `initdb` and `postgres` are.
fn programs() -> Option<PathBuf> {
    let named = std::env::var_os("RELIEF_POSTGRES").map(PathBuf::from);
    let debian = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    let debian = debian.map(|version| version.path().join("bin"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path: Vec<_> = std::env::split_paths(&path).collect();
    let mut folders = named.into_iter().chain(debian).chain(path);
    folders.find(|folder| ["initdb", "postgres", "pg_ctl"].iter().all(|name| folder.join(name).exists()))
}

#[cfg(unix)]
fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

#[cfg(not(unix))]
fn is_root() -> bool {
    false
}

/// PostgreSQL refuses to run as root, so it runs as the user `nobody`.
fn as_nobody(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups", "--"]).arg(program);
    command
}

fn give_away(folders: &[&Path]) {
    #[cfg(unix)]
    if is_root() {
        for folder in folders {
            std::os::unix::fs::chown(folder, Some(65534), Some(65534)).unwrap();
        }
    }
    let _ = folders;
}
