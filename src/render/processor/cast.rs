//! From a request to a picture: the tables that rays look up are prepared, then rows are cast.

use std::time::{Duration, Instant};

use rayon::prelude::*;
use relief_lanes::{Kernel, Level, OneLane, dispatch};

use super::super::bands::Bands;
use super::super::error::RenderError;
use super::super::frame::{BackLayer, RenderedFrame, Timings};
use super::super::region::Region;
use super::super::request::RenderRequest;
use super::super::skipping::EmptySpaceSkipping;
use super::super::target::background;
use super::super::volume_plan::VolumePlan;
use super::super::watch::Watch;
use super::deal::deal;
use super::illuminate::FillLayer;
use super::light_cells::LightCells;
use super::prepared::{Cache, Looks, PreparedAppearance};
use super::scene::Job;
use super::tiles::{LayerMut, Rows};
use crate::illumination::{Cells, LightQuantity};
use crate::limits::depth_limits;
use relief_volume::{ContentHash, Volume};

/// Rows of pixels that a thread takes at a time: a piece.
const ROWS: u32 = 4;

/// The lanes that cast.
#[derive(Clone, Copy)]
pub(super) enum Width {
    /// Eight or sixteen of 32 bits, by the vector instructions of a level.
    Single(Level),
    /// One of 64 bits.
    Double,
}

/// A volume under a request.
#[derive(Clone, Copy)]
pub(super) struct Order<'a> {
    pub(super) volume: &'a Volume,
    pub(super) request: &'a RenderRequest,
    pub(super) skipping: EmptySpaceSkipping,
    pub(super) plan: &'a VolumePlan,
    pub(super) width: Width,
    pub(super) bands: Bands,
}

/// A layer of a picture.
struct Layer {
    color_rgba: Vec<[u8; 4]>,
    depth_mm: Vec<f32>,
}

/// A picture with some rows cast.
struct Picture {
    front: Layer,
    back: Option<Layer>,
    /// Rows of its region that are cast.
    rows: u32,
    /// Time that they took.
    spent: Duration,
}

/// A picture that was cancelled between two rows. An equal request continues it.
pub(super) struct Unfinished {
    volume: ContentHash,
    request: RenderRequest,
    skipping: EmptySpaceSkipping,
    picture: Picture,
}

impl Unfinished {
    /// Whether it shows a volume.
    pub(super) fn is_of(&self, volume: ContentHash) -> bool {
        self.volume == volume
    }
}

impl Picture {
    fn new(request: &RenderRequest) -> Self {
        let back = request.has_back_layer().then(|| Layer::new(request));
        Self { front: Layer::new(request), back, rows: 0, spent: Duration::ZERO }
    }
}

impl Width {
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Single(level) => dispatch(level, kernel),
            Self::Double => kernel.run(OneLane),
        }
    }
}

impl Layer {
    fn new(request: &RenderRequest) -> Self {
        let pixels = request.size_px.map(|side| side as usize).iter().product();
        Self { color_rgba: vec![background(request); pixels], depth_mm: vec![f32::INFINITY; pixels] }
    }

    /// Some rows as chunks of `chunk` pixels.
    fn chunks(&mut self, pixels: std::ops::Range<usize>, chunk: usize) -> impl Iterator<Item = LayerMut<'_>> {
        let colors = self.color_rgba[pixels.clone()].chunks_mut(chunk);
        let depths = self.depth_mm[pixels].chunks_mut(chunk);
        colors.zip(depths).map(|(color_rgba, depth_mm)| LayerMut { color_rgba, depth_mm })
    }
}

impl Order<'_> {
    /// Casts the picture, without overlays. Continues `unfinished` if that is of an equal request;
    /// leaves the rows of a cancelled picture there.
    ///
    /// # Errors
    /// When `watch` breaks off.
    pub(super) fn cast(
        self,
        cache: &mut Cache,
        unfinished: &mut Option<Unfinished>,
        watch: &mut Watch<'_>,
    ) -> Result<RenderedFrame, RenderError> {
        let Self { volume, request, skipping, plan, .. } = self;
        let start = Instant::now();
        let (_, is_new) = cache.prepare(volume, request, plan);
        let (cells, is_filled) = self.light(cache)?;
        let (prepared, _) = cache.prepare(volume, request, plan);
        let upload_ms = if is_new || is_filled { milliseconds(start) } else { 0.0 };
        let mut picture = self.begin(unfinished);
        let start = Instant::now().checked_sub(picture.spent).unwrap_or_else(Instant::now);
        let region = match skipping {
            EmptySpaceSkipping::Off => Region::whole(request.size_px),
            EmptySpaceSkipping::On => Region::of(request, volume.grid(), &prepared.bricks),
        };
        let Picture { front, back, rows, .. } = &mut picture;
        let PreparedAppearance { looks, map, .. } = prepared;
        let job = Job { volume, request, looks, map, cells: &cells, skipping };
        let width = request.size_px[0] as usize;
        let pace = self.bands.duration.unwrap_or(Duration::MAX);
        let cast = |first_row: u32, rows: u32, watch: &mut Watch<'_>| {
            let pixels = first_row as usize * width..(first_row + rows) as usize * width;
            let chunk = ROWS as usize * width;
            let behind = back.as_mut().map(|layer| layer.chunks(pixels.clone(), chunk));
            let behind = behind.into_iter().flatten().map(Some).chain(std::iter::repeat_with(|| None));
            let firsts = (first_row..).step_by(ROWS as usize);
            let pieces: Vec<Rows<'_>> = front
                .chunks(pixels, chunk)
                .zip(behind)
                .zip(firsts)
                .map(|((front, back), first)| Rows { job, region, first, front, back })
                .collect();
            let (done, outcome) = deal(pieces, |rows| self.width.run(rows), pace, watch);
            (rows.min(done as u32 * ROWS), outcome)
        };
        let outcome = self.bands.each(region, rows, cast, watch);
        if let Err(error) = outcome {
            let picture = Picture { spent: start.elapsed(), ..picture };
            let (volume, request) = (volume.content_hash(), request.clone());
            *unfinished = Some(Unfinished { volume, request, skipping, picture });
            return Err(error);
        }
        let Picture { front, back, .. } = picture;
        Ok(RenderedFrame {
            size_px: request.size_px,
            color_rgba: front.color_rgba,
            depth_mm: front.depth_mm,
            display_mm: None,
            back: back.map(|Layer { color_rgba, depth_mm }| BackLayer { color_rgba, depth_mm }),
            camera: request.camera,
            limits: depth_limits(&request.camera, volume.grid()),
            nearest_ball_mm: None,
            is_partial: request.blocks.is_some(),
            timings: Timings { upload_ms, render_ms: milliseconds(start), ..Timings::default() },
        })
    }

    /// The rows that an equal request left, or none.
    fn begin(self, unfinished: &mut Option<Unfinished>) -> Picture {
        let hash = self.volume.content_hash();
        let is_same = |kept: &mut Unfinished| {
            kept.is_of(hash) && kept.skipping == self.skipping && kept.request == *self.request
        };
        unfinished.take_if(is_same).map_or_else(|| Picture::new(self.request), |kept| kept.picture)
    }

    /// The light in cells that the request looks up; says whether any was computed.
    fn light(self, cache: &mut Cache) -> Result<(LightCells, bool), RenderError> {
        let (mut all, mut is_filled) = (LightCells::default(), false);
        let hash = self.volume.content_hash();
        for quantity in LightQuantity::of(self.request).into_iter().flatten() {
            let known = cache.light(hash, self.request, &quantity);
            let cells = match known {
                Some(cells) => cells,
                None => {
                    is_filled = true;
                    let (prepared, _) = cache.prepare(self.volume, self.request, self.plan);
                    let cells = self.fill(prepared, &quantity)?;
                    cache.put_light(hash, self.request, quantity, cells.clone());
                    cells
                }
            };
            all.shadows = cells.shadows.or(all.shadows);
            all.openness = cells.openness.or(all.openness);
        }
        Ok((all, is_filled))
    }

    fn fill(
        self,
        prepared: &PreparedAppearance,
        quantity: &LightQuantity,
    ) -> Result<LightCells, RenderError> {
        let Self { volume, request, .. } = self;
        let cells = Cells::of(volume.grid());
        let steady = quantity.steady_request(request, volume.grid(), &cells)?;
        let looks = Looks::new(&steady, volume, prepared.map.edge);
        let (map, skipping) = (&prepared.map, self.skipping);
        let dark = LightCells::default();
        let job = Job { volume, request: &steady, looks: &looks, map, cells: &dark, skipping };
        let [nx, ny, _] = cells.dims;
        let mut shares = vec![[1.0; _]; cells.dims.iter().product()];
        shares.par_chunks_mut(nx * ny).enumerate().for_each(|(layer, out)| {
            self.width.run(FillLayer { job, cells, quantity, layer, out });
        });
        Ok(match quantity {
            LightQuantity::Shadows(_) => LightCells { shadows: Some(shares.into()), openness: None },
            LightQuantity::Openness { .. } => {
                let open: Vec<f32> = shares.iter().map(|shares: &[f32; 4]| shares[0]).collect();
                LightCells { shadows: None, openness: Some(open.into()) }
            }
        })
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
