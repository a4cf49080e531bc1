//! Pictures as films without loss.

use std::collections::hash_map::DefaultHasher;
use std::hash::Hasher;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Stdio};
use std::str::FromStr;
use std::thread::JoinHandle;

use crate::error::FilmError;
use crate::ffmpeg::{Ffmpeg, FrameRate, finish, report_of};
use crate::reader::FilmReader;

/// Codecs that change no pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FilmCodec {
    /// H.264 without loss, in RGB: decoded by most players.
    #[default]
    H264,
    /// FFV1: for archives; only in .mkv.
    Ffv1,
}

impl FilmCodec {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::H264, Self::Ffv1];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::H264 => "h264",
            Self::Ffv1 => "ffv1",
        }
    }

    const fn arguments(self) -> &'static [&'static str] {
        match self {
            Self::H264 => &["-c:v", "libx264rgb", "-qp", "0", "-preset", "veryfast", "-pix_fmt", "rgb24"],
            Self::Ffv1 => &["-c:v", "ffv1", "-level", "3", "-g", "1", "-slicecrc", "1", "-pix_fmt", "gbrp"],
        }
    }
}

impl FromStr for FilmCodec {
    type Err = &'static str;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|codec| codec.name() == name).ok_or("codecs are h264 and ffv1")
    }
}

/// A film that is being encoded. The file appears under its name when the film is finished and
/// has been decoded again.
pub struct FilmWriter {
    ffmpeg: Ffmpeg,
    path: PathBuf,
    folder: tempfile::TempDir,
    size_px: [u32; 2],
    sums: Vec<u64>,
    child: Child,
    pictures: Option<ChildStdin>,
    report: Option<JoinHandle<String>>,
}

/// A film that was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrittenFilm {
    /// Number of pictures.
    pub pictures: u64,
    /// Size of the file, bytes.
    pub bytes: u64,
}

impl std::fmt::Debug for FilmWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FilmWriter")
            .field("path", &self.path)
            .field("size_px", &self.size_px)
            .finish_non_exhaustive()
    }
}

impl FilmWriter {
    /// Begins a film of pictures of one size.
    ///
    /// # Errors
    /// When the name's ending is not `.mkv` or `.mp4` or does not fit the codec, or ffmpeg does not
    /// start.
    pub fn start(
        ffmpeg: &Ffmpeg,
        path: &Path,
        size_px: [u32; 2],
        rate: FrameRate,
        codec: FilmCodec,
    ) -> Result<Self, FilmError> {
        let ending = Self::ending(path)?;
        if codec == FilmCodec::Ffv1 && ending != "mkv" {
            return Err(FilmError::Container { path: path.to_owned() });
        }
        let beside = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !beside.is_dir() {
            return Err(FilmError::NoFolder { path: beside.to_owned() });
        }
        let folder = tempfile::Builder::new().prefix(".relief-film").tempdir_in(beside)?;
        let mut command = ffmpeg.command();
        command.args([
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-s",
            &format!("{}x{}", size_px[0], size_px[1]),
        ]);
        command.args(["-r", &rate.to_string(), "-i", "-"]).args(codec.arguments());
        command.arg(folder.path().join(format!("film.{ending}")));
        command.args(["-fflags", "+bitexact", "-flags:v", "+bitexact"]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
        let report = Some(report_of(child.stderr.take())?);
        let pictures = child.stdin.take();
        let (ffmpeg, path) = (ffmpeg.clone(), path.to_owned());
        Ok(Self { ffmpeg, path, folder, size_px, sums: Vec::new(), child, pictures, report })
    }

    /// The ending of a film's name: `mkv` or `mp4`.
    ///
    /// # Errors
    /// When the file has another ending.
    pub fn ending(path: &Path) -> Result<&'static str, FilmError> {
        let is = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
        let known = ["mkv", "mp4"].into_iter().find(|ending| is(ending));
        known.ok_or_else(|| FilmError::Ending { path: path.to_owned() })
    }

    /// Adds a picture: red, green, blue of every pixel, in rows from the top left.
    ///
    /// # Errors
    /// When it has another size than the film, or ffmpeg fails.
    pub fn write(&mut self, size_px: [u32; 2], rgb: &[u8]) -> Result<(), FilmError> {
        let film_px = self.size_px;
        let expected = 3 * u64::from(film_px[0]) * u64::from(film_px[1]);
        if size_px != film_px || rgb.len() as u64 != expected {
            return Err(FilmError::Size { number: self.sums.len() as u64 + 1, found_px: size_px, film_px });
        }
        self.sums.push(sum(rgb));
        let sent = self.pictures.as_mut().map(|pictures| pictures.write_all(rgb));
        if matches!(sent, Some(Ok(()))) { Ok(()) } else { self.end() }
    }

    /// Ends the film, decodes it again, compares all pictures, and gives the file its name.
    ///
    /// # Errors
    /// When ffmpeg fails, or the decoded pictures differ from those written.
    pub fn finish(mut self) -> Result<WrittenFilm, FilmError> {
        if self.sums.is_empty() {
            return Err(FilmError::Empty);
        }
        self.end()?;
        let written = self.folder.path().join(format!("film.{}", Self::ending(&self.path)?));
        let mut found = 0;
        for picture in FilmReader::open(&self.ffmpeg, &written)? {
            let expected = self.sums.get(found as usize).copied();
            found += 1;
            if expected.is_some_and(|expected| picture.map(|picture| sum(&picture)).ok() != Some(expected)) {
                return Err(FilmError::Changed { number: found });
            }
        }
        let expected = self.sums.len() as u64;
        if found != expected {
            return Err(FilmError::Count { found, expected });
        }
        std::fs::File::open(&written)?.sync_all()?;
        let bytes = std::fs::metadata(&written)?.len();
        std::fs::rename(&written, &self.path)?;
        Ok(WrittenFilm { pictures: found, bytes })
    }

    /// Closes the pipe and waits for ffmpeg.
    fn end(&mut self) -> Result<(), FilmError> {
        drop(self.pictures.take());
        match self.report.take() {
            Some(report) => finish(&mut self.child, report),
            None => Ok(()),
        }
    }
}

impl Drop for FilmWriter {
    fn drop(&mut self) {
        if self.report.is_some() {
            let _ = self.child.kill(); // it may have ended by itself
            let _ = self.child.wait();
        }
    }
}

fn sum(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(bytes);
    hasher.finish()
}
