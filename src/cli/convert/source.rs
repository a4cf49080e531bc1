//! The source of the pictures: a file, a folder, or a film.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};

use relief_display::MAX_FRAME_SIDE_PX;
use relief_film::{Ffmpeg, FilmReader, FrameRate};

/// Most memory that the decoder of one picture takes, bytes.
const MAX_PICTURE_BYTES: u64 = 2 << 30;

/// One picture, with the name of its output without ending.
pub(super) struct Named {
    pub(super) name: String,
    pub(super) pixels: RgbImage,
}

/// Pictures in order.
pub(super) enum Pictures {
    /// Files, and whether they came from a folder.
    Files { paths: std::vec::IntoIter<PathBuf>, is_series: bool },
    /// A film, and the number of its next picture.
    Film(FilmReader, u64),
}

impl Pictures {
    /// The pictures at a path; `ffmpeg` finds the program, for a film.
    pub(super) fn open(path: &Path, ffmpeg: impl FnOnce() -> anyhow::Result<Ffmpeg>) -> anyhow::Result<Self> {
        if path.is_dir() {
            let paths = pictures_in(path)?;
            return Ok(Self::Files { paths: paths.into_iter(), is_series: true });
        }
        ensure!(path.is_file(), "there is no such file or folder");
        if is_picture(path)? {
            return Ok(Self::Files { paths: vec![path.to_owned()].into_iter(), is_series: false });
        }
        Ok(Self::Film(FilmReader::open(&ffmpeg()?, path)?, 0))
    }

    pub(super) fn is_film(&self) -> bool {
        matches!(self, Self::Film(..))
    }

    /// Whether there may be several.
    pub(super) fn is_series(&self) -> bool {
        !matches!(self, Self::Files { is_series: false, .. })
    }

    /// Number of pictures, where it is known.
    pub(super) fn total(&self) -> Option<u64> {
        match self {
            Self::Files { paths, .. } => Some(paths.len() as u64),
            Self::Film(..) => None,
        }
    }

    /// Pictures per second of a film.
    pub(super) fn rate(&self) -> Option<FrameRate> {
        match self {
            Self::Files { .. } => None,
            Self::Film(film, _) => Some(film.rate()),
        }
    }
}

impl Iterator for Pictures {
    type Item = anyhow::Result<Named>;

    fn next(&mut self) -> Option<Self::Item> {
        match self {
            Self::Files { paths, .. } => paths.next().map(|path| {
                let pixels =
                    read_picture(&path).with_context(|| format!("cannot read {}", path.display()))?;
                let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                Ok(Named { name, pixels })
            }),
            Self::Film(film, number) => film.next().map(|picture| {
                *number += 1;
                let pixels =
                    picture.with_context(|| format!("cannot decode picture {number} of the film"))?;
                Ok(Named { name: format!("{number:06}"), pixels })
            }),
        }
    }
}

/// PNG and JPEG files of a folder, by name. Two files of one name with different endings would
/// write one output.
fn pictures_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let is_picture = path.extension().and_then(|ending| ending.to_str()).is_some_and(|ending| {
            ["png", "jpg", "jpeg"].iter().any(|known| ending.eq_ignore_ascii_case(known))
        });
        if is_picture && path.is_file() {
            paths.push(path);
        }
    }
    ensure!(!paths.is_empty(), "the folder has no .png, .jpg or .jpeg files");
    paths.sort();
    if let Some(pair) = paths.windows(2).find(|pair| pair[0].file_stem() == pair[1].file_stem()) {
        bail!("{} and {} have one output; rename one of them", pair[0].display(), pair[1].display());
    }
    Ok(paths)
}

/// By its signature: PNG or JPEG.
fn is_picture(path: &Path) -> anyhow::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(8).read_to_end(&mut start)?;
    Ok(start == b"\x89PNG\r\n\x1a\n" || start.starts_with(b"\xff\xd8\xff"))
}

/// A picture as viewers show it: turned as its EXIF orientation says.
fn read_picture(path: &Path) -> anyhow::Result<RgbImage> {
    let mut reader = ImageReader::new(BufReader::new(File::open(path)?)).with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_FRAME_SIDE_PX);
    limits.max_image_height = Some(MAX_FRAME_SIDE_PX);
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let mut decoder = reader.into_decoder()?;
    let bytes = decoder.total_bytes();
    ensure!(bytes <= MAX_PICTURE_BYTES, "the picture has {bytes} bytes, allowed: {MAX_PICTURE_BYTES}");
    let orientation = decoder.orientation()?;
    let mut picture = DynamicImage::from_decoder(decoder)?;
    picture.apply_orientation(orientation);
    Ok(picture.to_rgb8())
}
