//! `relief annotate`: the log of annotations, from a shell.
//!
//! Each subcommand has a file with its arguments and a `run`; `log_options` has the options that
//! they share.

mod accuracy;
mod check;
mod compare;
mod export;
mod fill;
mod grow;
mod import;
mod list;
mod log;
mod log_options;
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

use log_options::LogArguments;

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
