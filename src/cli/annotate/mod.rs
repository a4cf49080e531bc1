//! `relief annotate`: the log of annotations, from a shell.
//!
//! Each subcommand has a file with its arguments and a `run`. This module has the shared options:
//! the log ([`LogArguments`]), author and reason ([`ByArguments`]), and tables.

mod accuracy;
mod check;
mod compare;
mod export;
mod fill;
mod grow;
mod import;
mod list;
mod log;
mod mesh;
mod paint;
mod refine;
mod series;
mod sets;
mod structure;
mod table;
mod template;
mod undo;

use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::CommandFactory;
use clap::error::ErrorKind;

use relief_store::{Store, StoreError};

/// Annotations of volumes: landmarks, lines, regions, meshes, in a log that forgets nothing.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub(super) struct AnnotateArguments {
    #[command(flatten)]
    log: LogArguments,
    #[command(subcommand)]
    action: Action,
}

const AFTER_HELP: &str = "\
The log is a file, made by the first command that writes to it, or a database of a PostgreSQL
server. Every change is an event with an author and a reason. Nothing is ever deleted from it:
what is taken back can be made again.

Examples:
  relief annotate --db ann.db import skull.mrk.json --series head
  relief annotate --db ann.db export --format csv --out skull.csv
  relief annotate --db ann.db list                              what there is, by set and list
  relief annotate --db ann.db list --set anna --json            one object, for programs
  relief annotate --db ann.db log --limit 20                    who changed what, when and why
  relief annotate --db ann.db undo --author anna                take back anna's newest edit
  relief annotate --db ann.db redo --author anna                make it again
  relief annotate --db ann.db sets put anna --reader anna --blinded
  relief annotate --db ann.db template apply skull --set anna   expect the landmarks of a template
  relief annotate --db ann.db compare --sets anna,ben --out report
  relief annotate --db postgres://me@localhost/study check      read all: does it hold together?
  export RELIEF_ANNOTATIONS=ann.db RELIEF_AUTHOR=anna           say both once

Exit status: 0 done, 1 failed (a conflict with another author among them), 2 wrong arguments.";

#[derive(Debug, clap::Subcommand)]
enum Action {
    Import(import::ImportArguments),
    Export(export::ExportArguments),
    List(list::ListArguments),
    Log(log::HistoryArguments),
    Undo(undo::UndoArguments),
    Redo(undo::RedoArguments),
    Sets(sets::SetsArguments),
    Template(template::TemplateArguments),
    Compare(compare::CompareArguments),
    Check(check::CheckArguments),
    Grow(grow::GrowArguments),
    Paint(paint::PaintArguments),
    Refine(refine::RefineArguments),
    Fill(fill::FillArguments),
    Mesh(mesh::MeshArguments),
    Accuracy(accuracy::AccuracyArguments),
}

pub(super) fn run(arguments: &AnnotateArguments) -> anyhow::Result<ExitCode> {
    let log = &arguments.log;
    match &arguments.action {
        Action::Import(arguments) => import::run(arguments, log),
        Action::Export(arguments) => export::run(arguments, log),
        Action::List(arguments) => list::run(arguments, log),
        Action::Log(arguments) => log::run(arguments, log),
        Action::Undo(arguments) => undo::undo(arguments, log),
        Action::Redo(arguments) => undo::redo(arguments, log),
        Action::Sets(arguments) => sets::run(arguments, log),
        Action::Template(arguments) => template::run(arguments, log),
        Action::Compare(arguments) => compare::run(arguments, log),
        Action::Check(arguments) => check::run(arguments, log),
        Action::Grow(arguments) => grow::run(arguments, log),
        Action::Paint(arguments) => paint::run(arguments, log),
        Action::Refine(arguments) => refine::run(arguments, log),
        Action::Fill(arguments) => fill::run(arguments, log),
        Action::Mesh(arguments) => mesh::run(arguments, log),
        Action::Accuracy(arguments) => accuracy::run(arguments),
    }
}

/// Which log.
#[derive(Debug, clap::Args)]
pub(super) struct LogArguments {
    /// The log: a file, or postgres://USER:PASSWORD@HOST/DATABASE
    #[arg(long, value_name = "FILE|URL", global = true, env = "RELIEF_ANNOTATIONS", hide_env_values = true)]
    db: Option<String>,
}

/// Who changes something.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct AuthorArguments {
    /// Who does it; the login name otherwise
    #[arg(long, value_name = "NAME", env = "RELIEF_AUTHOR")]
    author: Option<String>,
}

/// Who changes items, and why.
#[derive(Debug, clap::Args)]
pub(super) struct ByArguments {
    #[command(flatten)]
    pub(super) who: AuthorArguments,
    /// Why, for those who read the log
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub(super) reason: String,
}

/// An open log, and what its calls run on.
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

    /// Where the log is; without that the program ends, as for any other argument that lacks.
    fn place(&self) -> &str {
        let Some(place) = &self.db else {
            let lacking = "which log? Give it with --db FILE, or in RELIEF_ANNOTATIONS";
            super::CommandLine::command().error(ErrorKind::MissingRequiredArgument, lacking).exit();
        };
        place
    }
}

impl AuthorArguments {
    /// Who it is: the argument, or else who is logged in.
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
