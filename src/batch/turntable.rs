//! Turntables as films: animated PNG by this program, MP4 by ffmpeg where the machine has it.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::str::FromStr;

use image::{DynamicImage, RgbImage};
use relief_dicom::join_captures;
use relief_film::{FilmCodec, FrameRate};

use super::sink::Sink;
use crate::picture::LARGEST_PICTURE;
use crate::picture::open;

/// Time between the pictures of a turntable, ms.
const TURN_MS: u16 = 120;
/// Encoders of ffmpeg that write what browsers and slides play, the best one first; builds lack
/// some.
const ENCODERS: [&[&str]; 3] = [
    &["-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p"],
    &["-c:v", "libopenh264", "-b:v", "8M", "-pix_fmt", "yuv420p"],
    &["-c:v", "mpeg4", "-q:v", "2", "-pix_fmt", "yuv420p"],
];
/// Longest message of ffmpeg that is shown, bytes.
const LONGEST: u64 = 2000;

/// The options of turntables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FilmChoice {
    /// Animated PNG, and MP4 where ffmpeg is.
    #[default]
    Auto,
    /// Only animated PNG.
    Apng,
    /// Both; it is an error if there is no ffmpeg.
    Mp4,
}

/// The settings of turntables, with defaults filled in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FilmWriter {
    /// The program that makes MP4, where it does.
    ffmpeg: Option<PathBuf>,
    /// Whether MP4 was wanted where it could be had, and cannot.
    pub lacks_ffmpeg: bool,
}

/// Why turntables cannot be written as films.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilmError {
    /// A name that no form of turntables has.
    #[error("turntables are auto, apng or mp4")]
    Unknown,
    /// MP4 is required, and ffmpeg does not run.
    #[error(
        "{} does not run, and MP4 needs it: install ffmpeg (Debian, Ubuntu: apt-get install ffmpeg), name it \
         with --ffmpeg, or leave out --turntable mp4 for animated PNG",
        ffmpeg.display()
    )]
    NoFfmpeg {
        /// The program.
        ffmpeg: PathBuf,
    },
}

/// Why ffmpeg made no film.
#[derive(Debug, thiserror::Error)]
enum EncodeError {
    #[error("its pictures cannot be read")]
    Pictures,
    #[error(transparent)]
    Start(#[from] std::io::Error),
    #[error("{message}")]
    Ffmpeg { message: String },
}

impl FromStr for FilmChoice {
    type Err = FilmError;

    fn from_str(name: &str) -> Result<Self, FilmError> {
        match name {
            "auto" => Ok(Self::Auto),
            "apng" => Ok(Self::Apng),
            "mp4" => Ok(Self::Mp4),
            _ => Err(FilmError::Unknown),
        }
    }
}

impl FilmWriter {
    /// Looks for ffmpeg, by its name or path, where it is wanted.
    ///
    /// # Errors
    /// When ffmpeg is required and missing: how to install it.
    pub fn new(film: FilmChoice, ffmpeg: &Path) -> Result<Self, FilmError> {
        if film == FilmChoice::Apng {
            return Ok(Self { ffmpeg: None, lacks_ffmpeg: false });
        }
        let mut command = Command::new(ffmpeg);
        let command =
            command.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let runs = command.status().is_ok_and(|status| status.success());
        match (runs, film) {
            (true, _) => Ok(Self { ffmpeg: Some(ffmpeg.to_owned()), lacks_ffmpeg: false }),
            (false, FilmChoice::Mp4) => Err(FilmError::NoFfmpeg { ffmpeg: ffmpeg.to_owned() }),
            (false, _) => Ok(Self { ffmpeg: None, lacks_ffmpeg: true }),
        }
    }

    /// Writes the display's frames of a turntable as `FILM.frame.mkv`, without loss, if there is
    /// ffmpeg; nothing of fewer than two, of several sizes, or of 16-bit frames.
    ///
    /// # Errors
    /// When the file cannot be written, ffmpeg fails, or the decoded film differs from the frames.
    pub(super) fn write_frames(&self, out: &Sink, film: &str, turns: &[String]) -> std::io::Result<()> {
        let Some(ffmpeg) = self.ffmpeg.as_deref().filter(|_| turns.len() > 1) else { return Ok(()) };
        match frame_film(ffmpeg, out, turns).map_err(std::io::Error::other)? {
            Some(bytes) => out.put(&format!("{film}.frame.mkv"), bytes),
            None => Ok(()),
        }
    }

    /// Writes `FILM.png` and, with ffmpeg, `FILM.mp4` of these outputs of a series;
    /// nothing of fewer than two, or of several sizes.
    ///
    /// # Errors
    /// When a file cannot be written, or ffmpeg fails.
    pub(super) fn write(&self, out: &Sink, film: &str, turns: &[String]) -> std::io::Result<()> {
        if let Some(file) = apng(out, turns) {
            out.put(&format!("{film}.png"), file)?;
            if let Some(ffmpeg) = &self.ffmpeg {
                return out.put(&format!("{film}.mp4"), mp4(ffmpeg, out, turns)?);
            }
        }
        Ok(())
    }
}

/// The captures of a turntable, these outputs of a series, as one DICOM object of several frames;
/// `None` for fewer than two.
///
/// # Errors
/// When a file cannot be read, is missing, or is no capture, and when the object is too large.
pub fn turntable_capture(out: &Sink, turns: &[String]) -> std::io::Result<Option<Vec<u8>>> {
    if turns.len() < 2 {
        return Ok(None);
    }
    let read = |name: &String| -> std::io::Result<Vec<u8>> {
        let missing = || std::io::Error::new(std::io::ErrorKind::NotFound, format!("{name} is missing"));
        out.read(name, LARGEST_PICTURE)?.ok_or_else(missing)
    };
    let captures = turns.iter().map(read).collect::<std::io::Result<Vec<_>>>()?;
    join_captures(&captures, f64::from(TURN_MS)).map(Some).map_err(std::io::Error::other)
}

/// Pictures as an animated PNG: their own compressed pixels one after the other, as they are (PNG,
/// third edition, 11.3.6).
fn apng(out: &Sink, turns: &[String]) -> Option<Vec<u8>> {
    let count = u32::try_from(turns.len()).ok().filter(|count| *count > 1)?;
    let read = |name: &String| out.read(name, LARGEST_PICTURE).ok().flatten();
    let mut file = Animation { bytes: SIGNATURE.to_vec(), sequence: 0 };
    let mut header = Vec::new();
    for name in turns {
        let turn = read(name)?;
        let (_, own) = chunks(&turn).next().filter(|(kind, _)| *kind == *b"IHDR")?;
        if header.is_empty() {
            header = own.to_vec();
            file.chunk(*b"IHDR", &[&header]);
            file.chunk(*b"acTL", &[&count.to_be_bytes(), &[0; 4]]);
        } else if own != header {
            return None;
        }
        file.control(header.get(..8)?);
        for (_, pixels) in chunks(&turn).filter(|(kind, _)| *kind == *b"IDAT") {
            file.pixels(pixels, *name == turns[0]);
        }
    }
    file.chunk(*b"IEND", &[]);
    Some(file.bytes)
}

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The chunks of a PNG up to its end or its first damage: kinds and data.
fn chunks(file: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    let mut rest = file.strip_prefix(SIGNATURE).unwrap_or_default();
    std::iter::from_fn(move || {
        let (length, behind) = rest.split_first_chunk()?;
        let (kind, behind) = behind.split_first_chunk()?;
        let (data, behind) = behind.split_at_checked(u32::from_be_bytes(*length) as usize)?;
        rest = behind.get(4..)?; // its checksum
        Some((*kind, data))
    })
}

/// An animated PNG that grows.
struct Animation {
    bytes: Vec<u8>,
    sequence: u32,
}

impl Animation {
    fn chunk(&mut self, kind: [u8; 4], parts: &[&[u8]]) {
        let length: usize = parts.iter().map(|part| part.len()).sum();
        self.bytes.extend(u32::try_from(length).unwrap_or(u32::MAX).to_be_bytes());
        let from = self.bytes.len();
        self.bytes.extend(kind);
        parts.iter().for_each(|part| self.bytes.extend(*part));
        let mut checksum = flate2::Crc::new();
        checksum.update(&self.bytes[from..]);
        self.bytes.extend(checksum.sum().to_be_bytes());
    }

    fn numbered(&mut self, kind: [u8; 4], parts: &[&[u8]]) {
        let sequence = self.sequence.to_be_bytes();
        self.sequence += 1;
        self.chunk(kind, &[&[&sequence[..]], parts].concat());
    }

    /// How the next picture is shown: whole, for so long, in place of the last.
    fn control(&mut self, size: &[u8]) {
        let [delay, of] = [TURN_MS, 1000].map(u16::to_be_bytes);
        self.numbered(*b"fcTL", &[size, &[0; 8], &delay, &of, &[0, 0]]);
    }

    fn pixels(&mut self, pixels: &[u8], is_first: bool) {
        if is_first { self.chunk(*b"IDAT", &[pixels]) } else { self.numbered(*b"fdAT", &[pixels]) }
    }
}

/// The frames as a film, whose pixels were compared with theirs.
fn frame_film(
    ffmpeg: &Path,
    out: &Sink,
    turns: &[String],
) -> Result<Option<Vec<u8>>, relief_film::FilmError> {
    let ffmpeg = relief_film::Ffmpeg::find(ffmpeg)?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("frames.mkv");
    let rate = FrameRate { pictures: 1000, seconds: TURN_MS.into() };
    let mut film: Option<relief_film::FilmWriter> = None;
    for name in turns {
        let Some(DynamicImage::ImageRgb8(frame)) = open(out, name) else { return Ok(None) };
        let size_px = [frame.width(), frame.height()];
        let started = match film.take() {
            Some(film) => film,
            None => relief_film::FilmWriter::start(&ffmpeg, &path, size_px, rate, FilmCodec::H264)?,
        };
        match film.insert(started).write(size_px, &frame) {
            Err(relief_film::FilmError::Size { .. }) => return Ok(None),
            written => written?,
        }
    }
    if let Some(film) = film {
        film.finish()?;
    }
    Ok(Some(std::fs::read(&path)?))
}

/// The first encoder that this ffmpeg has makes the film.
fn mp4(ffmpeg: &Path, out: &Sink, turns: &[String]) -> std::io::Result<Vec<u8>> {
    let mut refusal = None;
    for encoder in ENCODERS {
        let file = tempfile::Builder::new().prefix("relief-").suffix(".mp4").tempfile()?;
        match encode(ffmpeg, encoder, out, turns, file.path()) {
            Ok(()) => return std::fs::read(file.path()),
            Err(error) => refusal = Some(error),
        }
    }
    let reason = refusal.map(|error| format!(": {error}")).unwrap_or_default();
    Err(std::io::Error::other(format!("ffmpeg cannot encode an MP4{reason}")))
}

fn encode(
    ffmpeg: &Path,
    encoder: &[&str],
    out: &Sink,
    turns: &[String],
    film: &Path,
) -> Result<(), EncodeError> {
    let picture = |name: &String| open(out, name).map(DynamicImage::into_rgb8);
    let first = turns.first().and_then(picture).ok_or(EncodeError::Pictures)?;
    let size = format!("{}x{}", first.width(), first.height());
    let rate = format!("1000/{TURN_MS}");
    let input = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size, "-framerate", &rate, "-i", "pipe:0"];
    // Colours at half the resolution want even sides.
    let output =
        ["-an", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-movflags", "+faststart", "-map_metadata", "-1"];
    let mut child = Command::new(ffmpeg)
        .args(["-hide_banner", "-loglevel", "error", "-y"])
        .args(input)
        .args(output)
        .args(encoder)
        .args(["-f", "mp4"])
        .arg(film)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    let (mut stdin, stderr) = (child.stdin.take(), child.stderr.take());
    let listen = move || {
        let mut said = String::new();
        let _ = stderr.map(|stderr| stderr.take(LONGEST).read_to_string(&mut said));
        said
    };
    let said = std::thread::Builder::new().name("ffmpeg's words".to_owned()).spawn(listen);
    let said = said?;
    let send = |picture: &RgbImage, stdin: &mut Option<std::process::ChildStdin>| {
        stdin.as_mut().is_some_and(|stdin| stdin.write_all(picture).is_ok())
    };
    // A process that does not read pictures has ended; its status has the reason.
    let mut is_taken = send(&first, &mut stdin);
    let mut is_whole = true;
    for name in &turns[1..] {
        if !is_taken || !is_whole {
            break;
        }
        match picture(name) {
            Some(turn) => is_taken = send(&turn, &mut stdin),
            None => is_whole = false,
        }
    }
    drop(stdin);
    let status = child.wait()?;
    let said = said.join().unwrap_or_default();
    if !is_whole {
        return Err(EncodeError::Pictures);
    }
    if status.success() {
        return Ok(());
    }
    Err(EncodeError::Ffmpeg { message: said.lines().last().unwrap_or("no message").to_owned() })
}
