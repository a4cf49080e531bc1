//! A rendered frame of a view and its encodings. The first client that needs an encoding has it
//! made; all share it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::OnceCell;

use super::LiveError;
use crate::engine::Engine;
use crate::volumes::VolumeEntry;
use relief_base::{DepthLimits, ViewDepth};
use relief_display::{DisplaySettings, Frame, Picture};
use relief_live::{
    ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FrameHeader, LiveLayout, ReceivedDepth,
    ReceivedFrame, encode_color, encode_d8, encode_z16,
};
use relief_render::{RenderRequest, RenderedFrame};

/// The newest message of a viewer that a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Echo {
    /// Sequence number of the message.
    pub seq: u64,
    /// Time of the message on the clock of the client, ns.
    pub t_ns: u64,
}

/// An encoding and the time that it took.
#[derive(Debug)]
struct Encoded<T> {
    value: T,
    took: Duration,
}

/// Encodings by format, each made once.
type Cells<K, T> = Mutex<Vec<(K, Arc<OnceCell<Encoded<T>>>)>>;

/// The encodings of a frame.
#[derive(Debug, Default)]
pub(super) struct Encodings {
    colors: Cells<(ColorFormat, u8), EncodedColor>,
    depths: Cells<DepthFormat, EncodedDepth>,
}

/// A rendered frame of a view.
pub struct ViewFrame {
    /// Number of the frame in its view, from 1.
    pub number: u64,
    /// Colour and view depth.
    pub frame: Arc<RenderedFrame>,
    /// Settings of the display.
    pub display: DisplaySettings,
    /// Full width and height of the view; the frame may be smaller.
    pub full_px: [u32; 2],
    /// Revision of the view.
    pub revision: u64,
    /// Whether it has full quality, rendered at rest.
    pub is_still: bool,
    /// Whether the JPEG quality follows the connection.
    pub adapts: bool,
    /// When the newest change that it shows arrived.
    pub arrived: Instant,
    /// Time of rendering.
    pub rendering: Duration,
    /// Time of waiting for the renderer or for a viewer.
    pub waiting: Duration,
    /// The newest message of each viewer that it shows.
    pub shows: Vec<(u64, Echo)>,
    /// The state message for clients.
    pub state: Arc<str>,
    /// View depths of Z = 0 and Z = 1.
    pub limits: DepthLimits,
    /// The request that it was rendered from.
    pub(super) request: RenderRequest,
    pub(super) entry: Arc<VolumeEntry>,
    pub(super) encodings: Encodings,
}

/// The encoded colour and depth of a frame.
#[derive(Debug)]
pub struct EncodedParts {
    color: Arc<OnceCell<Encoded<EncodedColor>>>,
    depth: Arc<OnceCell<Encoded<EncodedDepth>>>,
}

impl EncodedParts {
    /// Colour and depth.
    #[must_use]
    pub fn get(&self) -> Option<(&EncodedColor, &EncodedDepth)> {
        Some((&self.color.get()?.value, &self.depth.get()?.value))
    }

    /// The time of encoding; colour and depth are encoded in parallel.
    #[must_use]
    pub fn took(&self) -> Duration {
        let took = [self.color.get().map(|made| made.took), self.depth.get().map(|made| made.took)];
        took.into_iter().flatten().max().unwrap_or_default()
    }
}

impl ViewFrame {
    /// View depth at a pixel of the full size.
    pub(super) fn depth_at(&self, at: [f64; 2]) -> ViewDepth {
        let [full, size] = [self.full_px, self.frame.size_px].map(|size| size.map(f64::from));
        let inside = at.iter().zip(full).all(|(at, side)| (0.0..side).contains(at));
        if !inside {
            return ViewDepth::MISS;
        }
        let place = |axis: usize| (at[axis] * size[axis] / full[axis]) as u32;
        let last = self.frame.size_px.map(|side| side - 1);
        self.frame.depth_at([place(0).min(last[0]), place(1).min(last[1])])
    }

    /// The header of this frame for a viewer. Formats and lengths are added with the parts.
    #[must_use]
    pub fn header(&self, viewer: u64) -> FrameHeader {
        let side = |side: u32| u16::try_from(side).unwrap_or(u16::MAX);
        let shows = self.shows.iter().find(|(id, _)| *id == viewer).map(|(_, echo)| *echo);
        let Echo { seq, t_ns } = shows.unwrap_or(Echo { seq: 0, t_ns: 0 });
        let limits_mm = [self.limits.near_mm as f32, self.limits.far_mm as f32];
        let header = FrameHeader {
            still: self.is_still,
            back_layer: self.back_layer(),
            color: ColorFormat::Jpeg,
            depth: DepthFormat::None,
            sequence: 0,
            shows_seq: seq,
            shows_t_ns: t_ns,
            total_us: 0,
            render_us: micros(self.rendering),
            wait_us: micros(self.waiting),
            encode_us: 0,
            size_px: self.frame.size_px.map(side),
            full_px: self.full_px.map(side),
            limits_mm,
            display: self.display.header().fields(),
            layout: LiveLayout::of(self.display.layout),
            color_bytes: 0,
            depth_bytes: 0,
            eye_mm: [0.0; 3],
            look_at_mm: [0.0; 3],
            up: [0.0; 3],
            projection: [0.0; 2],
        };
        header.with_camera(&self.frame.camera)
    }

    fn back_layer(&self) -> bool {
        self.frame.has_back_layer() && self.display.layout.needs_background()
    }

    /// Width and rows of the sent picture.
    fn size(&self) -> [usize; 2] {
        let [width, height] = self.frame.size_px.map(|side| side as usize);
        [width, height * if self.back_layer() { 2 } else { 1 }]
    }

    /// Colour and depth in these formats; encodes those that do not exist yet.
    ///
    /// # Errors
    /// When encoding fails.
    pub async fn parts(
        self: &Arc<Self>,
        engine: &Engine,
        color: ColorFormat,
        quality: u8,
        depth: DepthFormat,
    ) -> Result<EncodedParts, LiveError> {
        // Lossless formats have one quality.
        let quality = if color.is_lossless() { 0 } else { quality };
        let parts = EncodedParts {
            color: cell(&self.encodings.colors, (color, quality)),
            depth: cell(&self.encodings.depths, depth),
        };
        let make_color = parts.color.get_or_try_init(|| {
            self.encoded(engine, "encoding colour", move |frame| frame.encode_color(color, quality))
        });
        let make_depth = parts.depth.get_or_try_init(|| {
            self.encoded(engine, "encoding depth", move |frame| frame.encode_depth(depth))
        });
        tokio::try_join!(make_color, make_depth)?;
        Ok(parts)
    }

    async fn encoded<T: Send + 'static>(
        self: &Arc<Self>,
        engine: &Engine,
        what: &'static str,
        encoder: impl FnOnce(&Self) -> Result<T, LiveError> + Send + 'static,
    ) -> Result<Encoded<T>, LiveError> {
        let frame = Arc::clone(self);
        let job = move || {
            let since = Instant::now();
            encoder(&frame).map(|value| Encoded { value, took: since.elapsed() })
        };
        engine.blocking(what, job).await?
    }

    fn encode_color(&self, format: ColorFormat, quality: u8) -> Result<EncodedColor, LiveError> {
        let failed = |error| LiveError::encoding("encoding colour", error);
        let pictures = self.pictures()?;
        let bytes = match &pictures[..] {
            [front] => encode_color(self.size(), front.color(), format, quality),
            both => encode_color(self.size(), &colors(both).collect::<Vec<_>>(), format, quality),
        };
        Ok(EncodedColor { format, bytes: bytes.map_err(failed)? })
    }

    fn encode_depth(&self, format: DepthFormat) -> Result<EncodedDepth, LiveError> {
        let failed = |error| LiveError::encoding("encoding depth", error);
        let bytes = if format == DepthFormat::None {
            Vec::new()
        } else if format.is_z16() {
            let encoder = self.display.encoder()?;
            let z16: Vec<u16> =
                self.pictures()?.iter().flat_map(|p| encoder.scaled16(p, self.limits)).collect();
            encode_z16(self.size(), &z16, format).map_err(failed)?
        } else {
            encode_d8(self.size(), &self.disparity()?, format).map_err(failed)?
        };
        Ok(EncodedDepth { format, bytes })
    }

    /// The picture, and the back layer where the layout has one.
    fn pictures(&self) -> Result<Vec<Picture<'_>>, LiveError> {
        let frame = &self.frame;
        let failed = |error| LiveError::encoding("encoding depth", error);
        let front = frame.picture().map_err(failed)?;
        let back = front.back().filter(|_| self.back_layer());
        Ok(std::iter::once(front).chain(back).collect())
    }

    fn disparity(&self) -> Result<Vec<u8>, LiveError> {
        let encoder = self.display.encoder()?;
        Ok(self.pictures()?.iter().flat_map(|picture| encoder.disparity(picture, self.limits)).collect())
    }

    /// The composed frame of the display, for plain viewers.
    ///
    /// # Errors
    /// When composing fails.
    pub fn composed(&self) -> Result<Frame, LiveError> {
        let color = colors(&self.pictures()?).map(|[r, g, b, _]| [r, g, b]).collect();
        let depth = ReceivedDepth::Disparity(self.disparity()?);
        let received = ReceivedFrame { header: self.header(0), color, depth };
        let curve = self.display.profile()?;
        received.compose(&curve).map_err(|error| LiveError::encoding("composing", error))
    }
}

/// The colours of pictures, one below the other.
fn colors(pictures: &[Picture<'_>]) -> impl Iterator<Item = [u8; 4]> {
    pictures.iter().flat_map(Picture::color).copied()
}

/// The cell of a key; adds one if the key is new.
fn cell<K: PartialEq, T>(made: &Cells<K, T>, key: K) -> Arc<OnceCell<Encoded<T>>> {
    let mut made: MutexGuard<'_, _> = made.lock();
    if let Some((_, cell)) = made.iter().find(|(known, _)| *known == key) {
        return Arc::clone(cell);
    }
    let cell = Arc::new(OnceCell::new());
    made.push((key, Arc::clone(&cell)));
    cell
}

/// Whole microseconds, at most `u32::MAX`.
#[must_use]
pub fn micros(duration: Duration) -> u32 {
    u32::try_from(duration.as_micros()).unwrap_or(u32::MAX)
}
