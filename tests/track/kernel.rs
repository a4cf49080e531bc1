//! Tests that need a Linux kernel with certain devices run on one of their own, in a virtual machine.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::ffi::OsStr;
use std::process::Command;
use std::sync::OnceLock;

pub(super) const WIIMOTE: &str = "track::uhid::the_kernels_virtual_wiimote_is_found_brought_up_and_tracked";

/// Whether the kernel is that of `scripts/with-kernel`. Elsewhere, runs the test of this name there.
pub(super) fn entered(test: &str) -> bool {
    static OUTPUT: OnceLock<String> = OnceLock::new();
    if std::env::var_os("RELIEF_IN_KERNEL").is_some() {
        return true;
    }
    let Some(program) = std::env::var_os("RELIEF_WITH_KERNEL") else {
        eprintln!("SKIPPED: {test} (RELIEF_WITH_KERNEL is not set: scripts/setup-kernel)");
        return false;
    };
    let output = OUTPUT.get_or_init(|| run_all(&program));
    assert!(output.contains("1 passed; 0 failed"), "{output}");
    false
}

fn run_all(program: &OsStr) -> String {
    let mut command = Command::new(program);
    command.arg(std::env::current_exe().unwrap()).arg(WIIMOTE);
    let output = command.args(["--exact", "--test-threads", "1", "--color", "never"]).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    format!("{}{}", text(&output.stdout), text(&output.stderr))
}
