//! `relief client --record FILM`: the frames of a session as a film without loss.
//!
//! Frames of a session come when they are ready, and a film has a fixed rate. A thread writes the newest
//! frame at that rate, so that the film keeps the time of the session.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use parking_lot::Mutex;

use crate::output::say;
use relief_client::{Composer, Received};
use relief_display::{Frame, Pixels};
use relief_film::{Ffmpeg, FilmCodec, FilmWriter, FrameRate};

/// Pictures per second of recorded films.
const RATE: FrameRate = FrameRate { pictures: 25, seconds: 1 };
/// Most repetitions of one frame before the next is looked for, when the encoder is late.
const MOST_REPEATED: u64 = 5;

/// A film that is being recorded.
pub(crate) struct FilmRecorder {
    newest: Arc<Mutex<Option<Received>>>,
    is_done: Arc<AtomicBool>,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl FilmRecorder {
    /// Whether a path names a film, and not a list of messages.
    pub(crate) fn is_film(path: &Path) -> bool {
        FilmWriter::ending(path).is_ok()
    }

    pub(crate) fn start(
        path: &Path,
        composer: Composer,
        ffmpeg: &Path,
        codec: FilmCodec,
    ) -> anyhow::Result<Self> {
        let ffmpeg = Ffmpeg::find(ffmpeg)?;
        let (newest, is_done) = (Arc::new(Mutex::new(None)), Arc::new(AtomicBool::new(false)));
        let recording = Recording {
            path: path.to_owned(),
            ffmpeg,
            codec,
            composer,
            newest: Arc::clone(&newest),
            is_done: Arc::clone(&is_done),
        };
        let thread = std::thread::Builder::new().name("film".to_owned()).spawn(move || recording.run())?;
        Ok(Self { newest, is_done, thread })
    }

    /// The newest frame of the session.
    pub(crate) fn take(&self, received: &Received) {
        *self.newest.lock() = Some(received.clone());
    }

    /// Ends the film, and checks the written file.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.is_done.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_else(|_| bail!("the recorder of the film stopped"))
    }
}

/// The state of a recording's thread.
struct Recording {
    path: std::path::PathBuf,
    ffmpeg: Ffmpeg,
    codec: FilmCodec,
    composer: Composer,
    newest: Arc<Mutex<Option<Received>>>,
    is_done: Arc<AtomicBool>,
}

impl Recording {
    fn run(self) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        let film = self.record().with_context(|| format!("cannot record {shown}"))?;
        let Some(film) = film else { bail!("cannot record {shown}: no frame came") };
        let written = film.finish().with_context(|| format!("cannot record {shown}"))?;
        say!(
            "{shown}: {} frames at {} a second; all frames and headers are intact",
            written.pictures,
            RATE.per_second()
        );
        Ok(())
    }

    /// Writes frames until the session ends; at least the last one. No film where no frame came.
    fn record(&self) -> anyhow::Result<Option<FilmWriter>> {
        let mut film: Option<(FilmWriter, Instant, u64)> = None;
        let mut frame: Option<Frame> = None;
        loop {
            let is_last = self.is_done.load(Ordering::Relaxed);
            let newest = self.newest.lock().take();
            if let Some(received) = newest {
                frame = Some(self.composed(&received)?);
            }
            if let Some(frame) = &frame {
                let (writer, start, written) = match &mut film {
                    Some(film) => film,
                    None => film.insert((self.begin(frame)?, Instant::now(), 0)),
                };
                let due = (start.elapsed().as_secs_f64() * RATE.per_second()) as u64 + 1;
                let count = due.saturating_sub(*written).min(MOST_REPEATED);
                for _ in 0..count.max(u64::from(is_last && *written == 0)) {
                    writer.write(frame.size_px(), rgb(frame)?)?;
                    *written += 1;
                }
            }
            if is_last {
                return Ok(film.map(|(writer, ..)| writer));
            }
            std::thread::sleep(Duration::from_secs_f64(0.25 / RATE.per_second()));
        }
    }

    fn begin(&self, frame: &Frame) -> anyhow::Result<FilmWriter> {
        Ok(FilmWriter::start(&self.ffmpeg, &self.path, frame.size_px(), RATE, self.codec)?)
    }

    fn composed(&self, received: &Received) -> anyhow::Result<Frame> {
        let composed = self.composer.compose(received)?;
        match composed.header_problem {
            Some(problem) => bail!("the header of a frame is wrong: {problem}"),
            None => Ok(composed.frame),
        }
    }
}

fn rgb(frame: &Frame) -> anyhow::Result<&[u8]> {
    match frame.pixels() {
        Pixels::Rgb8(rgb) => Ok(rgb),
        Pixels::Gray16(_) => bail!("a film has 8 bits for each colour; use a layout such as wowvx or rgbd"),
    }
}
