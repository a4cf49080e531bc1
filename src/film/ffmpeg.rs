//! The installed ffmpeg.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::str::FromStr;
use std::thread::JoinHandle;

use crate::error::FilmError;

/// Longest report of ffmpeg that is read, bytes.
const LONGEST_REPORT: u64 = 64 * 1024;
/// Longest line of it that is shown, characters.
const LONGEST_LINE: usize = 300;

/// Pictures per second of a film, as a ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate {
    /// Pictures.
    pub pictures: u32,
    /// In this number of seconds; never 0.
    pub seconds: u32,
}

impl FrameRate {
    /// A ratio of pictures and seconds; `None` where it is not 0.1 to 1000 a second.
    #[must_use]
    pub fn new(pictures: u32, seconds: u32) -> Option<Self> {
        let rate = f64::from(pictures) / f64::from(seconds);
        (0.1..=1000.0).contains(&rate).then_some(Self { pictures, seconds })
    }

    /// Pictures per second.
    #[must_use]
    pub fn per_second(self) -> f64 {
        f64::from(self.pictures) / f64::from(self.seconds)
    }
}

impl std::fmt::Display for FrameRate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.pictures, self.seconds)
    }
}

impl FromStr for FrameRate {
    type Err = &'static str;

    /// `25`, `29.97` or `30000/1001`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let rate = match text.split_once('/') {
            Some((pictures, seconds)) => pictures.parse().ok().zip(seconds.parse().ok()),
            None => text.parse::<f64>().ok().map(|rate| ((rate * 1000.0).round() as u32, 1000)),
        };
        rate.and_then(|(pictures, seconds)| Self::new(pictures, seconds))
            .ok_or("a rate is 0.1 to 1000 pictures per second, such as 25, 29.97 or 30000/1001")
    }
}

/// The program ffmpeg.
#[derive(Clone, Debug)]
pub struct Ffmpeg {
    program: PathBuf,
}

impl Ffmpeg {
    /// The program of this name or path, which has to run.
    ///
    /// # Errors
    /// When it does not run: how to install it.
    pub fn find(program: &Path) -> Result<Self, FilmError> {
        let mut command = Command::new(program);
        let command =
            command.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        match command.status() {
            Ok(status) if status.success() => Ok(Self { program: program.to_owned() }),
            _ => Err(FilmError::NoFfmpeg { program: program.to_owned() }),
        }
    }

    /// A run of ffmpeg that reads nothing from the terminal and reports errors alone.
    pub(crate) fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(["-hide_banner", "-nostdin", "-loglevel", "error"]);
        command
    }
}

/// Reads the report of a running ffmpeg, so that a full pipe never blocks it.
pub(crate) fn report_of(stderr: Option<ChildStderr>) -> std::io::Result<JoinHandle<String>> {
    std::thread::Builder::new().name("ffmpeg-report".to_owned()).spawn(move || {
        let mut report = Vec::new();
        if let Some(mut stderr) = stderr {
            let _ = stderr.by_ref().take(LONGEST_REPORT).read_to_end(&mut report); // what was read is shown
            let _ = std::io::copy(&mut stderr, &mut std::io::sink()); // the rest is not
        }
        let text = String::from_utf8_lossy(&report);
        let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("no message");
        last.chars().filter(|character| !character.is_control()).take(LONGEST_LINE).collect()
    })
}

/// Waits for a run of ffmpeg.
pub(crate) fn finish(child: &mut Child, report: JoinHandle<String>) -> Result<(), FilmError> {
    let status = child.wait()?;
    let message = report.join().unwrap_or_default();
    if status.success() { Ok(()) } else { Err(FilmError::Ffmpeg { message }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_ratios() {
        let rate = |text: &str| text.parse::<FrameRate>().map(|rate| (rate.pictures, rate.seconds));
        assert_eq!(rate("25"), Ok((25_000, 1000)));
        assert_eq!(rate("30000/1001"), Ok((30_000, 1001)));
        for wrong in ["0", "-3", "1/0", "x", "5000", "NaN", "1/20"] {
            assert!(rate(wrong).is_err(), "{wrong}");
        }
    }
}
