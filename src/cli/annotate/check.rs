//! `relief annotate check`: whether a log holds together.

use std::process::ExitCode;

use super::super::output::{print_json, say};
use super::log_options::LogArguments;

/// Read the whole log, and say whether it holds together
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Looks at the file itself, at every event (no gaps, each following from those before it), at the
items that follow from the events, and at the SHA-256 of every region's and mesh's content. Exit
status 1 where something is wrong.

Examples:
  relief annotate --db ann.db check")]
pub(super) struct CheckArguments {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &CheckArguments, log: &LogArguments) -> anyhow::Result<ExitCode> {
    let log = log.open_existing()?;
    let found = log.wait(log.store().check())?;
    if arguments.json {
        print_json(&found)?;
    } else {
        say!("all is well: {} events, {} items, {} contents", found.events, found.items, found.contents);
    }
    Ok(ExitCode::SUCCESS)
}
