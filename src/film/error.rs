//! Why a film was not read or written.

use std::path::PathBuf;

/// A film that failed. Messages of ffmpeg are its last line.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// ffmpeg does not run.
    #[error(
        "{} does not run, and films need it: install ffmpeg (Debian, Ubuntu: apt-get install ffmpeg), or name it with --ffmpeg",
        program.display()
    )]
    NoFfmpeg {
        /// The program.
        program: PathBuf,
    },
    /// ffmpeg reports an error.
    #[error("ffmpeg failed: {message}")]
    Ffmpeg {
        /// The last line of its report.
        message: String,
    },
    /// The file has no film.
    #[error("{} has no film", path.display())]
    NoFilm {
        /// The file.
        path: PathBuf,
    },
    /// The pictures of the film are too large.
    #[error("pictures of {width}x{height} are too large: at most {most} pixels a side")]
    TooLarge {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Largest side, pixels.
        most: u32,
    },
    /// The ending of the file's name is not one of a film.
    #[error("{} has no known ending: films without loss are .mkv or .mp4", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
    },
    /// The folder of the film does not exist.
    #[error("there is no folder {}", path.display())]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// FFV1 does not fit into the container.
    #[error("{} cannot hold FFV1: the ending has to be .mkv", path.display())]
    Container {
        /// The file.
        path: PathBuf,
    },
    /// A picture has another size than the film.
    #[error("picture {number} is {}x{}, the film is {}x{}", found_px[0], found_px[1], film_px[0], film_px[1])]
    Size {
        /// The picture, counted from 1.
        number: u64,
        /// Its width and height.
        found_px: [u32; 2],
        /// Those of the film.
        film_px: [u32; 2],
    },
    /// The written film has no pictures.
    #[error("the film has no pictures")]
    Empty,
    /// The decoded film differs from what was encoded.
    #[error(
        "the codec changed picture {number} of the film: headers in its pixels are lost. Use --codec ffv1, or another build of ffmpeg"
    )]
    Changed {
        /// The first changed picture, counted from 1.
        number: u64,
    },
    /// The decoded film has another number of pictures.
    #[error("the film has {found} pictures, and {expected} were written")]
    Count {
        /// Pictures found.
        found: u64,
        /// Pictures written.
        expected: u64,
    },
    /// A file or a pipe failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}
