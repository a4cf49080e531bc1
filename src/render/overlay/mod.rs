//! Overlays: landmarks, lines, curves, meshes and instruments, drawn over a rendered picture in the
//! same depth.
//!
//! A pass on the CPU over a rendered frame, the same for every adapter, in f64 and independent of
//! the number of threads, so its bytes are the same everywhere. It casts no rays and has no voxels;
//! it uses only the depth of each pixel.
//!
//! Rules. Fragments of a pixel are sorted by depth. A fragment before the volume's depth is drawn
//! unchanged; a fragment behind it has a share of its opacity (`occluded`) and writes no depth.
//! Where dense overlays before the volume cover half of a pixel or more, the pixel takes the depth
//! of one of them: depths are never blended. Clip planes cut the volume, not the overlays.
//! Instruments (orientation cube, scale bar) are in front of everything.
//!
//! Spaces: items are in patient mm, primitives in view space and pixels (see `lens`); depth is view
//! depth in mm.

mod ball;
mod build;
mod font;
mod glyph_mask;
mod instruments;
mod item;
mod labels;
mod layers;
mod lens;
mod primitive;
mod shape;
mod text;

use parking_lot::Mutex;
use rayon::prelude::*;

use self::layers::{Band, Rank, Scratch};
use self::lens::Lens;
use self::primitive::{Primitive, PrimitiveForm};
use self::shape::pixels;
use super::frame::RenderedFrame;
use super::request::RenderRequest;
use relief_base::OutOfRange;
use relief_volume::Grid;

pub use font::{CAPITAL, lettering};
pub use instruments::length_words;
pub use item::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text};
pub use text::{TextMask, label_height_px, label_stroke_px, text_margin_px, text_mask};

/// Rows of a picture that one thread draws at a time.
const BAND_ROWS: u32 = 16;

/// Least number of primitives in a band for which sorting pays.
const MANY: usize = 512;

/// Most pixels that all primitives of a picture together may have to look at: some seconds of a
/// core.
const MAX_WORK_PX: f64 = (1u64 << 29) as f64;

/// The overlays of one picture, ready to be drawn over it.
#[derive(Debug)]
pub(super) struct Drawing {
    lens: Lens,
    primitives: Vec<Primitive>,
    occluded: f32,
}

/// Draws a request's overlays over the picture that it makes without them, of a volume on `grid`:
/// the bytes are those of the picture with them.
///
/// # Errors
/// When an item is out of range, or drawing would take too long: items too many and too large for
/// the picture.
pub fn draw_overlays(
    frame: &mut RenderedFrame,
    request: &RenderRequest,
    grid: &Grid,
) -> Result<(), OutOfRange> {
    request.overlays.validate()?;
    if let Some(drawing) = Drawing::new(request, grid)? {
        drawing.draw(frame);
    }
    Ok(())
}

impl Drawing {
    /// The overlays of a request for a volume on `grid`; `None` when there are no overlays.
    ///
    /// # Errors
    /// When drawing would take too long: items too many and too large for the picture.
    pub(super) fn new(request: &RenderRequest, grid: &Grid) -> Result<Option<Self>, OutOfRange> {
        let overlays = &request.overlays;
        if overlays.is_empty() {
            return Ok(None);
        }
        let lens = Lens::new(&request.camera, request.size_px);
        let mut primitives = build::primitives(overlays, &lens, grid);
        let [width, height] = request.size_px;
        let mut work_px = 0.0;
        primitives.retain(|primitive| {
            let [left, top, right, bottom] = primitive.bounds();
            let ([a, b], [c, d]) = (pixels(left, right, [0, width]), pixels(top, bottom, [0, height]));
            work_px += primitive.work_px(f64::from(b - a), f64::from(d - c));
            a < b && c < d
        });
        if work_px > MAX_WORK_PX {
            let found = format!("{work_px:.0} pixels of drawing in a picture of this size");
            let allowed = format!("at most {MAX_WORK_PX}: fewer or smaller items");
            return Err(OutOfRange::new("overlays.items", found, allowed));
        }
        Ok(Some(Self { lens, primitives, occluded: overlays.occluded as f32 }))
    }

    /// Draws over a whole picture.
    pub(super) fn draw(&self, frame: &mut RenderedFrame) {
        let balls = self.primitives.iter().filter_map(Primitive::front_of_ball_mm);
        frame.nearest_ball_mm = balls.chain(frame.nearest_ball_mm).reduce(f64::min);
        let [width, height] = frame.size_px;
        let bands = self.bands(height);
        let pixels_of_band = (width * BAND_ROWS) as usize;
        let colors = frame.color_rgba.par_chunks_mut(pixels_of_band);
        let depths = frame.depth_mm.par_chunks_mut(pixels_of_band);
        // Memory of finished bands, for the next ones.
        let spare: Mutex<Vec<Scratch>> = Mutex::default();
        let spare_now = || spare.lock();
        colors.zip(depths).zip(&bands).enumerate().for_each(|(i, ((color_rgba, depth_mm), members))| {
            let mut scratch = spare_now().pop().unwrap_or_default();
            let first = i as u32 * BAND_ROWS;
            let rows = [first, (first + BAND_ROWS).min(height)];
            let mut band = Band::new(rows, width, color_rgba, depth_mm, &mut scratch);
            for &member in members {
                self.primitives[member as usize].draw(&self.lens, &mut band);
            }
            band.resolve(self.occluded);
            spare_now().push(scratch);
        });
    }

    /// The primitives of each band of rows, in their order.
    fn bands(&self, height: u32) -> Vec<Vec<u32>> {
        let mut bands = vec![Vec::new(); height.div_ceil(BAND_ROWS) as usize];
        for (index, primitive) in (0u32..).zip(&self.primitives) {
            let [_, top, _, bottom] = primitive.bounds();
            let [first, end] = pixels(top, bottom, [0, height]);
            let touched = first / BAND_ROWS..end.div_ceil(BAND_ROWS);
            bands[touched.start as usize..touched.end as usize].iter_mut().for_each(|band| band.push(index));
        }
        for band in bands.iter_mut().filter(|band| band.len() >= MANY) {
            self.sort(band);
        }
        bands
    }

    /// The nearest first, so that parts hidden behind them can be skipped. Only for balls and
    /// words, since the depth of others is not known in advance.
    fn sort(&self, members: &mut [u32]) {
        let primitive = |member: &u32| &self.primitives[*member as usize];
        let mut keyed: Vec<(f32, u32)> =
            members.iter().map(|member| (primitive(member).nearest_mm(), *member)).collect();
        let is_mesh = |member: &u32| {
            let Primitive { shape, rank, .. } = primitive(member);
            matches!(shape, PrimitiveForm::Triangle(_)) && *rank == Rank::Scene
        };
        if !members.iter().any(is_mesh) {
            keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
            members.iter_mut().zip(keyed).for_each(|(member, (_, sorted))| *member = sorted);
        }
    }
}
