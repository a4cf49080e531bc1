//! Parts that subcommands share when they write: whole files, JSON, error reports.

use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::OnceLock;

use anyhow::Context;

/// One line per cause, the outermost first.
pub(super) fn report(error: &anyhow::Error) -> String {
    let mut lines = vec![error.to_string()];
    for cause in error.chain().skip(1) {
        let cause = cause.to_string();
        // Libraries often repeat their source in their own message.
        if !lines.iter().any(|line| line.contains(&cause)) {
            lines.push(cause);
        }
    }
    lines.join("\n  because: ")
}

/// Time since then, ms.
pub(super) fn milliseconds(since: std::time::Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Writes a file so that it appears whole or not at all.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    relief_base::write_whole(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// A file that is written bit by bit and appears when it is finished.
pub(super) struct GrowingFile {
    file: std::io::BufWriter<tempfile::NamedTempFile>,
    path: std::path::PathBuf,
}

impl GrowingFile {
    pub(super) fn create(path: &Path) -> anyhow::Result<Self> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = relief_base::shared_temporary().prefix(".relief-").tempfile_in(folder);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { file: std::io::BufWriter::new(file), path: path.to_owned() })
    }

    pub(super) fn line(&mut self, line: &str) -> anyhow::Result<()> {
        writeln!(self.file, "{line}").with_context(|| format!("cannot write {}", self.path.display()))
    }

    pub(super) fn finish(self) -> anyhow::Result<()> {
        let Self { file, path } = self;
        let finish = || -> std::io::Result<()> {
            let file = file.into_inner().map_err(std::io::IntoInnerError::into_error)?;
            file.as_file().sync_all()?;
            file.persist(&path)?;
            Ok(())
        };
        finish().with_context(|| format!("cannot write {}", path.display()))
    }
}

/// `println!` for results: it never panics, see [`print_line`].
macro_rules! say {
    () => { $crate::output::print_line(format_args!("")) };
    ($($line:tt)*) => { $crate::output::print_line(format_args!($($line)*)) };
}
pub(super) use say;

/// Prints a line on stdout. A reader that has gone away has read enough (`relief inspect head |
/// head -1`): the rest is dropped, and the command continues. Other failures are for
/// [`stdout_failure`].
pub(super) fn print_line(line: std::fmt::Arguments<'_>) {
    let written = writeln!(std::io::stdout().lock(), "{line}");
    if let Err(error) = written.and_then(|()| std::io::stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = STDOUT_FAILURE.set(error); // only the first failure is reported
    }
}

static STDOUT_FAILURE: OnceLock<std::io::Error> = OnceLock::new();

/// Why a part of the results is not on stdout, for example because the disk behind it is full.
pub(super) fn stdout_failure() -> Option<&'static std::io::Error> {
    STDOUT_FAILURE.get()
}

/// Prints one JSON object on stdout, indented.
pub(super) fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    say!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_file_has_the_permissions_that_any_new_file_has() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [ours, any] = ["ours.png", "any"].map(|name| folder.path().join(name));
        write_whole(&ours, b"whole").unwrap();
        std::fs::write(&any, b"").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&any));
        assert_eq!(std::fs::read(&ours).unwrap(), b"whole");
    }
}
