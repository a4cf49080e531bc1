//! The `relief` command: everything is in [`relief::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    relief::cli::main()
}
