//! Transfer functions from outside: the commands and their results.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

mod foreign;
mod presets;

use std::process::{Command, Output};

/// Runs `relief` with these arguments on the processor.
fn relief(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").env_remove("RELIEF_LOG");
    command.output().unwrap()
}

/// The output of a command that succeeds.
fn reported(arguments: &[&str]) -> String {
    let output = relief(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}
