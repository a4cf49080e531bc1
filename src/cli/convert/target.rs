//! The destination of the frames: a file, a folder, or a film.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};

use crate::output::write_whole;
use relief_display::{Frame, Pixels, encode_png};
use relief_film::{Ffmpeg, FilmCodec, FilmWriter, FrameRate};

/// The output of a conversion.
pub(super) enum Target {
    /// A PNG file.
    Picture(PathBuf),
    /// A PNG for each picture.
    Folder(PathBuf),
    /// A film, which begins with its first frame.
    Film { path: PathBuf, rate: FrameRate, codec: FilmCodec, film: Option<FilmWriter> },
}

impl Target {
    /// The output at a path, by its ending.
    pub(super) fn new(
        path: &Path,
        is_series: bool,
        rate: FrameRate,
        codec: FilmCodec,
    ) -> anyhow::Result<Self> {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        match (ending.as_deref(), is_series) {
            (Some("mkv" | "mp4"), true) => Ok(Self::Film { path: path.to_owned(), rate, codec, film: None }),
            (Some("mkv" | "mp4"), false) => bail!("one picture makes no film; --out has to end in .png"),
            (Some("png"), false) => Ok(Self::Picture(path.to_owned())),
            (Some("png"), true) => {
                bail!("several pictures do not fit into one .png; name a folder, or a film (.mkv, .mp4)")
            }
            (_, false) => bail!("the ending has to be .png for a single picture"),
            (_, true) => {
                std::fs::create_dir_all(path)?;
                Ok(Self::Folder(path.to_owned()))
            }
        }
    }

    /// Adds the frame of a picture.
    pub(super) fn write(
        &mut self,
        name: &str,
        frame: &Frame,
        ffmpeg: impl FnOnce() -> anyhow::Result<Ffmpeg>,
    ) -> anyhow::Result<()> {
        match self {
            Self::Picture(path) => write_whole(path, &encode_png(frame)?),
            Self::Folder(folder) => write_whole(&folder.join(format!("{name}.png")), &encode_png(frame)?),
            Self::Film { path, rate, codec, film } => {
                let Pixels::Rgb8(rgb) = frame.pixels() else {
                    bail!("a film has 8 bits for each colour; use a layout such as wowvx or rgbd")
                };
                let started = match film.take() {
                    Some(film) => film,
                    None => FilmWriter::start(&ffmpeg()?, path, frame.size_px(), *rate, *codec)?,
                };
                Ok(film.insert(started).write(frame.size_px(), rgb)?)
            }
        }
    }

    /// Completes the output. Whether all frames were decoded again and compared.
    pub(super) fn finish(self) -> anyhow::Result<bool> {
        let Self::Film { film, .. } = self else { return Ok(false) };
        ensure!(film.is_some(), "the film has no frames");
        if let Some(film) = film {
            film.finish()?;
        }
        Ok(true)
    }
}
