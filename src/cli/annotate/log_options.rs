//! Options that the subcommands share, the log that they open ([`LogArguments`]), and who changes
//! it ([`ByArguments`]).

use anyhow::{Context, bail};
use clap::error::ErrorKind;

use relief_store::{Store, StoreError};

/// The log.
#[derive(Debug, clap::Args)]
pub(super) struct LogArguments {
    /// The log: a file, or postgres://USER:PASSWORD@HOST/DATABASE
    #[arg(long, value_name = "FILE|URL", global = true, env = "RELIEF_ANNOTATIONS", hide_env_values = true)]
    db: Option<String>,
}

/// The author of changes.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct AuthorArguments {
    /// Author of the change; the login name otherwise
    #[arg(long, value_name = "NAME", env = "RELIEF_AUTHOR")]
    author: Option<String>,
}

/// Author and reason of changes.
#[derive(Debug, clap::Args)]
pub(super) struct ByArguments {
    #[command(flatten)]
    pub(super) who: AuthorArguments,
    /// Why, for those who read the log
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub(super) reason: String,
}

/// An open log, and the runtime of its calls.
pub(super) struct Log {
    runtime: tokio::runtime::Runtime,
    store: Store,
}

impl LogArguments {
    /// Opens the log; creates it if it does not exist.
    pub(super) fn open(&self) -> anyhow::Result<Log> {
        self.open_by(&async |place| Store::open(place).await)
    }

    /// Opens an existing log.
    pub(super) fn open_existing(&self) -> anyhow::Result<Log> {
        let place = self.place();
        if !self.is_there() {
            bail!(
                "there is no log {place}; a command that adds to one makes it, such as relief annotate import"
            );
        }
        self.open_by(&async |place| Store::open_existing(place).await)
    }

    /// Whether there is a log, as far as its place says.
    pub(super) fn is_there(&self) -> bool {
        let place = self.place();
        is_url(place) || std::path::Path::new(place).exists()
    }

    fn open_by(&self, open: &impl AsyncFn(&str) -> Result<Store, StoreError>) -> anyhow::Result<Log> {
        let place = self.place();
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        // A URL may have a password: it is not shown.
        let shown = if is_url(place) { "the log of that URL" } else { place };
        let store = runtime.block_on(open(place)).with_context(|| format!("cannot open {shown}"))?;
        Ok(Log { runtime, store })
    }

    /// The place of the log; without one the program ends, as it does for other missing arguments.
    fn place(&self) -> &str {
        let Some(place) = &self.db else {
            let lacking = "which log? Give it with --db FILE, or in RELIEF_ANNOTATIONS\n";
            clap::Error::raw(ErrorKind::MissingRequiredArgument, lacking).exit();
        };
        place
    }
}

impl AuthorArguments {
    /// The author: the argument, or else the login name.
    pub(super) fn name(&self) -> anyhow::Result<String> {
        let named = || ["USER", "LOGNAME", "USERNAME"].iter().find_map(|name| std::env::var(name).ok());
        let author = self.author.clone().or_else(named).or_else(login_name).filter(|name| !name.is_empty());
        author.context("who are you? Give a name with --author, or in RELIEF_AUTHOR")
    }
}

fn is_url(place: &str) -> bool {
    place.contains("://") || place.starts_with("sqlite:")
}

/// The user by the system, if the environment has none, as for services.
fn login_name() -> Option<String> {
    let said = std::process::Command::new("id").arg("-un").output().ok()?;
    said.status.success().then(|| String::from_utf8_lossy(&said.stdout).trim().to_owned())
}

impl Log {
    pub(super) const fn store(&self) -> &Store {
        &self.store
    }

    /// Waits for a call of the store.
    pub(super) fn wait<T>(&self, call: impl Future<Output = Result<T, StoreError>>) -> Result<T, StoreError> {
        self.runtime.block_on(call)
    }
}

impl Drop for Log {
    /// So that the log is one file again, without a journal beside it.
    fn drop(&mut self) {
        self.runtime.block_on(self.store.close());
    }
}
