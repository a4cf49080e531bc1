//! `relief manual`: the manual pages and the shell completions of the command line.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap_complete::Shell;

use crate::output::say;

/// Write manual pages and shell completions
///
/// They are made from the texts of --help. The packages have them already.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief manual --out share
  man share/man/man1/relief-render.1
  . share/bash-completion/completions/relief")]
pub(super) struct ManualArguments {
    /// Folder with the layout of /usr/share; created if it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// The folder of completions of `relief` for each shell, below /usr/share.
const COMPLETIONS: [(Shell, &str); 3] = [
    (Shell::Bash, "bash-completion/completions/relief"),
    (Shell::Fish, "fish/vendor_completions.d/relief.fish"),
    (Shell::Zsh, "zsh/vendor-completions/_relief"),
];

/// `commands` is the command line whose pages are written.
pub(super) fn run(arguments: &ManualArguments, commands: clap::Command) -> anyhow::Result<ExitCode> {
    let pages = arguments.out.join("man/man1");
    make_folder(&pages)?;
    let mut completed = commands.clone();
    let mut command = commands.disable_help_subcommand(true);
    command.build();
    let written = write_pages(&command, &pages)?;
    for (shell, place) in COMPLETIONS {
        let path = arguments.out.join(place);
        path.parent().map_or(Ok(()), make_folder)?;
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut completed, "relief", &mut script);
        write(&path, &script)?;
    }
    say!("{written} manual pages and {} completions in {}", COMPLETIONS.len(), arguments.out.display());
    Ok(ExitCode::SUCCESS)
}

/// Writes the page of a command and those of its subcommands; returns their number.
fn write_pages(command: &clap::Command, folder: &Path) -> anyhow::Result<usize> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    page.render(&mut text)?;
    write(&folder.join(page.get_filename()), &text)?;
    let shown = command.get_subcommands().filter(|one| !one.is_hide_set());
    shown.map(|one| write_pages(one, folder)).sum::<anyhow::Result<usize>>().map(|below| below + 1)
}

fn make_folder(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot create the folder {}", path.display()))
}

fn write(path: &Path, content: &[u8]) -> anyhow::Result<()> {
    relief_base::write_whole(path, content).with_context(|| format!("cannot write {}", path.display()))
}
