//! Films as pictures.

use std::io::Read;
use std::path::Path;
use std::process::{Child, ChildStdout, Stdio};
use std::thread::JoinHandle;

use image::RgbImage;

use crate::error::FilmError;
use crate::ffmpeg::{Ffmpeg, FrameRate, finish, report_of};

/// Largest side of a picture, pixels.
const MAX_SIDE_PX: u32 = 16384;
/// Options that restrict ffmpeg to the given file. Playlists, which can be named like films, refer to other
/// files and to the network. Therefore only formats that contain their film are read.
const ONE_FILE: [&str; 4] = [
    "-protocol_whitelist",
    "file",
    "-format_whitelist",
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,ogg,flv,asf,mxf,nut,ivf,dv,gif,apng,h264,hevc,m4v,mjpeg,yuv4mpegpipe",
];
/// Longest header of YUV4MPEG2, bytes.
const LONGEST_HEADER: u64 = 1024;

/// A film that is being decoded: an iterator over its pictures, in order.
pub struct FilmReader {
    size_px: [u32; 2],
    rate: FrameRate,
    child: Child,
    pictures: ChildStdout,
    report: Option<JoinHandle<String>>,
}

impl std::fmt::Debug for FilmReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FilmReader")
            .field("size_px", &self.size_px)
            .field("rate", &self.rate)
            .finish_non_exhaustive()
    }
}

impl FilmReader {
    /// Opens the first film in a file.
    ///
    /// # Errors
    /// When the file has no film, its pictures are too large, or ffmpeg does not read it.
    pub fn open(ffmpeg: &Ffmpeg, path: &Path) -> Result<Self, FilmError> {
        let (size_px, rate) = probe(ffmpeg, path)?;
        let mut command = ffmpeg.command();
        command.args(ONE_FILE).arg("-i").arg(path).args(["-map", "0:v:0", "-fps_mode", "passthrough"]);
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]);
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        let report = Some(report_of(child.stderr.take())?);
        let pictures = child.stdout.take().ok_or_else(|| FilmError::NoFilm { path: path.to_owned() })?;
        Ok(Self { size_px, rate, child, pictures, report })
    }

    /// Width and height of its pictures.
    #[must_use]
    pub const fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Pictures per second.
    #[must_use]
    pub const fn rate(&self) -> FrameRate {
        self.rate
    }

    fn read_picture(&mut self) -> Result<Option<RgbImage>, FilmError> {
        let [width, height] = self.size_px;
        let expected = 3 * u64::from(width) * u64::from(height);
        let mut bytes = Vec::new();
        self.pictures.by_ref().take(expected).read_to_end(&mut bytes)?;
        if bytes.len() as u64 == expected {
            return Ok(RgbImage::from_raw(width, height, bytes));
        }
        match self.report.take() {
            Some(report) => finish(&mut self.child, report).map(|()| None),
            None => Ok(None),
        }
    }
}

impl Iterator for FilmReader {
    type Item = Result<RgbImage, FilmError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.report.as_ref()?;
        self.read_picture().transpose()
    }
}

impl Drop for FilmReader {
    fn drop(&mut self) {
        if self.report.is_some() {
            let _ = self.child.kill(); // it may have ended by itself
            let _ = self.child.wait();
        }
    }
}

/// Size and rate of the first film in a file, from the header of its first picture as YUV4MPEG2
/// (the format of mjpegtools: `YUV4MPEG2 W960 H540 F25:1 ...`).
fn probe(ffmpeg: &Ffmpeg, path: &Path) -> Result<([u32; 2], FrameRate), FilmError> {
    let mut command = ffmpeg.command();
    command.args(ONE_FILE).arg("-i").arg(path).args(["-map", "0:v:0", "-frames:v", "1", "-strict", "-1"]);
    command.args(["-f", "yuv4mpegpipe", "-pix_fmt", "yuv444p", "-"]);
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let report = report_of(child.stderr.take())?;
    let mut header = Vec::new();
    if let Some(mut pictures) = child.stdout.take() {
        pictures.by_ref().take(LONGEST_HEADER).read_to_end(&mut header)?;
        std::io::copy(&mut pictures, &mut std::io::sink())?;
    }
    finish(&mut child, report)?;
    let line = header.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let line = String::from_utf8_lossy(line);
    let field = |key: char| line.split(' ').skip(1).find_map(|field| field.strip_prefix(key));
    let side = |key: char| field(key).and_then(|side| side.parse::<u32>().ok()).filter(|side| *side > 0);
    let (width, height) =
        side('W').zip(side('H')).ok_or_else(|| FilmError::NoFilm { path: path.to_owned() })?;
    if width.max(height) > MAX_SIDE_PX {
        return Err(FilmError::TooLarge { width, height, most: MAX_SIDE_PX });
    }
    let rate = field('F').and_then(|rate| rate.replace(':', "/").parse().ok());
    Ok(([width, height], rate.unwrap_or(FrameRate { pictures: 25, seconds: 1 })))
}
