//! Tests that need a Linux kernel with certain devices run on one of their own, in a virtual machine.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::process::Command;

/// Whether the kernel is that of `scripts/with-kernel`. Elsewhere, runs the test of this name there.
pub(super) fn entered(test: &str) -> bool {
    if std::env::var_os("RELIEF_IN_KERNEL").is_some() {
        return true;
    }
    let Some(program) = std::env::var_os("RELIEF_WITH_KERNEL") else {
        eprintln!("SKIPPED: {test} (RELIEF_WITH_KERNEL is not set: scripts/setup-kernel)");
        return false;
    };
    let mut command = Command::new(program);
    command.arg(std::env::current_exe().unwrap()).args([test, "--exact", "--nocapture"]);
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    assert!(output.status.success() && said.contains("1 passed"), "{said}");
    false
}
