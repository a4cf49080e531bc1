//! A rendered picture of a view, and its encodings: made when the first client asks for one, and shared by all.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::OnceCell;

use crate::blocking::on_blocking_thread;
use crate::problem::Problem;
use crate::state::Server;
use relief_base::{DepthLimits, ViewDepth};
use relief_display::{DisplaySettings, Frame, Picture};
use relief_live::{
    ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FrameHeader, LiveLayout, ReceivedDepth,
    ReceivedFrame, encode_color, encode_d8, encode_z16,
};
use relief_render::RenderedFrame;

/// The newest message of a connection that a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Echo {
    pub(super) seq: u64,
    pub(super) t_ns: u64,
}

/// Something encoded, and how long that took.
struct Encoded<T> {
    value: T,
    took: Duration,
}

/// Encodings by their format, each made once.
type Made<K, T> = Mutex<Vec<(K, Arc<OnceCell<Encoded<T>>>)>>;

/// What was encoded of a picture.
#[derive(Default)]
pub(super) struct Encodings {
    colors: Made<(ColorFormat, u8), EncodedColor>,
    depths: Made<DepthFormat, EncodedDepth>,
}

/// See the module.
pub(super) struct Shot {
    /// Number of the picture in its view, from 1.
    pub(super) number: u64,
    pub(super) frame: Arc<RenderedFrame>,
    pub(super) display: DisplaySettings,
    /// Width and height that the picture stands for.
    pub(super) full_px: [u32; 2],
    /// Revision of the view that it shows.
    pub(super) revision: u64,
    /// Whether it is the best there is of that.
    pub(super) is_still: bool,
    /// Whether the quality of JPEG follows the connection.
    pub(super) adapts: bool,
    /// Arrival of the newest change that it shows.
    pub(super) arrived: Instant,
    pub(super) rendering: Duration,
    pub(super) waiting: Duration,
    /// The newest message of each connection that it shows.
    pub(super) shows: Vec<(u64, Echo)>,
    /// The view as told to clients.
    pub(super) state: Arc<str>,
    pub(super) limits: DepthLimits,
    pub(super) encodings: Encodings,
}

/// A frame's two parts for one client.
pub(super) struct Parts {
    color: Arc<OnceCell<Encoded<EncodedColor>>>,
    depth: Arc<OnceCell<Encoded<EncodedDepth>>>,
}

impl Parts {
    pub(super) fn get(&self) -> Option<(&EncodedColor, &EncodedDepth)> {
        Some((&self.color.get()?.value, &self.depth.get()?.value))
    }

    /// How long encoding took, colour and depth side by side.
    pub(super) fn took(&self) -> Duration {
        let took = [self.color.get().map(|made| made.took), self.depth.get().map(|made| made.took)];
        took.into_iter().flatten().max().unwrap_or_default()
    }
}

impl Shot {
    /// View depth of a picture at a place of its full size.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be inside the picture"
    )]
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

    /// The header of this picture, for a connection; formats and lengths come with the parts.
    pub(super) fn header(&self, slot: u64) -> FrameHeader {
        let side = |side: u32| u16::try_from(side).unwrap_or(u16::MAX);
        let shows = self.shows.iter().find(|(id, _)| *id == slot).map(|(_, echo)| *echo);
        let Echo { seq, t_ns } = shows.unwrap_or(Echo { seq: 0, t_ns: 0 });
        #[expect(clippy::cast_possible_truncation, reason = "the header has single precision")]
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
        self.frame.back.is_some() && self.display.layout.needs_background()
    }

    /// Width and rows of what is sent.
    fn size(&self) -> [usize; 2] {
        let [width, height] = self.frame.size_px.map(|side| side as usize);
        [width, height * if self.back_layer() { 2 } else { 1 }]
    }

    /// Colour and depth in these formats: encoded now, both at once, or known already.
    pub(super) async fn parts(
        self: &Arc<Self>,
        server: &Server,
        (color, quality): (ColorFormat, u8),
        depth: DepthFormat,
    ) -> Result<Parts, Problem> {
        // Of a lossless format there is one quality alone.
        let quality = if color.is_lossless() { 0 } else { quality };
        let parts = Parts {
            color: cell(&self.encodings.colors, (color, quality)),
            depth: cell(&self.encodings.depths, depth),
        };
        let make_color = parts.color.get_or_try_init(|| {
            self.encoded(server, "encoding colour", move |shot| shot.encode_color(color, quality))
        });
        let make_depth = parts
            .depth
            .get_or_try_init(|| self.encoded(server, "encoding depth", move |shot| shot.encode_depth(depth)));
        tokio::try_join!(make_color, make_depth)?;
        Ok(parts)
    }

    async fn encoded<T: Send + 'static>(
        self: &Arc<Self>,
        server: &Server,
        what: &str,
        encoder: impl FnOnce(&Self) -> Result<T, Problem> + Send + 'static,
    ) -> Result<Encoded<T>, Problem> {
        let place = Arc::clone(&server.encoders).acquire_owned().await;
        let place = place.map_err(|closed| Problem::internal(what, closed))?;
        let shot = Arc::clone(self);
        on_blocking_thread(place, what, move || {
            let since = Instant::now();
            encoder(&shot).map(|value| Encoded { value, took: since.elapsed() })
        })
        .await?
    }

    fn encode_color(&self, format: ColorFormat, quality: u8) -> Result<EncodedColor, Problem> {
        let failed = |error| Problem::internal("encoding colour", error);
        let bytes = match &self.frame.back {
            Some(back) if self.back_layer() => {
                let both = [&self.frame.color_rgba[..], &back.color_rgba].concat();
                encode_color(self.size(), &both, format, quality)
            }
            _ => encode_color(self.size(), &self.frame.color_rgba, format, quality),
        };
        Ok(EncodedColor { format, bytes: bytes.map_err(failed)? })
    }

    fn encode_depth(&self, format: DepthFormat) -> Result<EncodedDepth, Problem> {
        let failed = |error| Problem::internal("encoding depth", error);
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

    /// The picture, and what lies behind where the layout has that.
    fn pictures(&self) -> Result<Vec<Picture<'_>>, Problem> {
        let frame = &self.frame;
        let failed = |error| Problem::internal("encoding depth", error);
        let front = Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm).map_err(failed)?;
        let back = frame.back.as_ref().filter(|_| self.back_layer());
        let back = back.map(|back| Picture::new(frame.size_px, &back.color_rgba, &back.depth_mm));
        Ok(std::iter::once(front).chain(back.transpose().map_err(failed)?).collect())
    }

    fn disparity(&self) -> Result<Vec<u8>, Problem> {
        let encoder = self.display.encoder()?;
        Ok(self.pictures()?.iter().flat_map(|picture| encoder.disparity(picture, self.limits)).collect())
    }

    /// The display's frame, for viewers that compose nothing themselves.
    pub(super) fn composed(&self) -> Result<Frame, Problem> {
        let rgb = |color: &[[u8; 4]]| color.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect::<Vec<_>>();
        let mut color = rgb(&self.frame.color_rgba);
        if let Some(back) = self.frame.back.as_ref().filter(|_| self.back_layer()) {
            color.extend(rgb(&back.color_rgba));
        }
        let depth = ReceivedDepth::Disparity(self.disparity()?);
        let received = ReceivedFrame { header: self.header(0), color, depth };
        let curve = self.display.profile()?;
        received.compose(&curve).map_err(|error| Problem::internal("composing", error))
    }
}

/// The cell of a key, made if there is none.
fn cell<K: PartialEq, T>(made: &Made<K, T>, key: K) -> Arc<OnceCell<Encoded<T>>> {
    let mut made: MutexGuard<'_, _> = made.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, cell)) = made.iter().find(|(known, _)| *known == key) {
        return Arc::clone(cell);
    }
    let cell = Arc::new(OnceCell::new());
    made.push((key, Arc::clone(&cell)));
    cell
}

pub(super) fn micros(duration: Duration) -> u32 {
    u32::try_from(duration.as_micros()).unwrap_or(u32::MAX)
}
