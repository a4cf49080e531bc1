//! The ffmpeg that tests use.

use std::process::Command;

/// An ffmpeg of this machine, or the peers'.
pub(crate) fn ffmpeg() -> Option<String> {
    let runs =
        |path: &str| Command::new(path).arg("-version").output().is_ok_and(|output| output.status.success());
    if runs("ffmpeg") {
        return Some("ffmpeg".to_owned());
    }
    let python = std::env::var_os("RELIEF_PEERS_PYTHON")?;
    let found =
        Command::new(python).args(["-c", "import imageio_ffmpeg as f; print(f.get_ffmpeg_exe())"]).output();
    let path = String::from_utf8(found.ok()?.stdout).ok()?.trim().to_owned();
    runs(&path).then_some(path)
}
