//! The `relief` command. Everything is in [`relief_cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    relief_cli::main()
}
