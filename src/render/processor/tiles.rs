//! Rows of pixels, cast packet after packet.
//!
//! A packet is a block of neighbouring pixels, one in each lane: rays that lie close together read
//! the same voxels.

use relief_lanes::{Kernel, Lanes, MOST_LANES, Mask as _, Real as _, Triple};

use super::super::chosen::BLOCK_PX;
use super::super::mode::Mode;
use super::super::region::Region;
use super::history::History;
use super::ray::Rays;
use super::scene::{Hit, Job, Scene};
use super::walk::Walk;

/// Consecutive rows of a picture's region, and where their pixels go.
pub(super) struct Rows<'a> {
    pub(super) job: Job<'a>,
    pub(super) region: Region,
    /// The first row, from the top of the picture.
    pub(super) first: u32,
    pub(super) front: LayerMut<'a>,
    /// The layer behind the first, where the request has one.
    pub(super) back: Option<LayerMut<'a>>,
}

/// Whole rows of a layer of the picture.
pub(super) struct LayerMut<'a> {
    pub(super) color_rgba: &'a mut [[u8; 4]],
    /// View depth in mm; infinite where nothing is hit.
    pub(super) depth_mm: &'a mut [f32],
}

/// The pixels of a packet.
#[derive(Clone, Copy)]
struct Packet {
    /// The first column of the picture, and the first of these rows.
    first: [u32; 2],
    size: [u32; 2],
}

/// Width and height of a packet, pixels: a part of a block, or blocks below one another.
const fn packet(lanes: usize) -> [u32; 2] {
    let (lanes, [width, height]) = (lanes as u32, BLOCK_PX);
    if lanes < width * height { [lanes, 1] } else { [width, lanes / width] }
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) {
        let scene = self.job.scene(lanes);
        let mut history = History::new(lanes);
        let size = packet(L::COUNT);
        let rows = self.rows();
        for row in (0..rows).step_by(size[1] as usize) {
            let Region { first: [left, _], size: [columns, _] } = self.region;
            for column in (left..left + columns).step_by(size[0] as usize) {
                self.cast_packet(&scene, &mut history, Packet { first: [column, row], size });
            }
        }
    }
}

impl Packet {
    /// Column of the picture and one of these rows.
    #[inline(always)]
    fn place(self, lane: usize) -> [u32; 2] {
        let ([column, row], [width, _]) = (self.first, self.size);
        [column + lane as u32 % width, row + lane as u32 / width]
    }
}

impl Rows<'_> {
    fn rows(&self) -> u32 {
        self.front.color_rgba.len() as u32 / self.job.request.size_px[0]
    }

    /// Whether a pixel, by the column of the picture and one of these rows, is to be cast.
    fn is_cast(&self, [column, row]: [u32; 2]) -> bool {
        let is_inside = column < self.region.first[0] + self.region.size[0] && row < self.rows();
        let blocks = self.job.request.blocks.as_ref();
        is_inside && blocks.is_none_or(|blocks| blocks.has([column, self.first + row]))
    }

    #[inline(always)]
    fn cast_packet<L: Lanes>(&mut self, scene: &Scene<'_, L>, history: &mut History<L>, packet: Packet) {
        let lanes = scene.lanes;
        let is_cast = |lane: usize| self.is_cast(packet.place(lane));
        let inside = if (0..L::COUNT).all(is_cast) {
            lanes.first(L::COUNT)
        } else {
            lanes.splat(0.5).lt(lanes.by_lane(|lane| if is_cast(lane) { 1.0 } else { 0.0 }))
        };
        if !inside.any() {
            return;
        }
        let columns = lanes.by_lane(|lane| packet.place(lane)[0].into());
        let first = self.first;
        let rays = scene.view.rays(columns, lanes.by_lane(|lane| (first + packet.place(lane)[1]).into()));
        let walk = scene.bricks.walk(&rays);
        let (hit, back) = scene.cast(&rays, &walk, history, inside);
        self.front.put(scene, packet, &rays, &hit, inside);
        if let (Some(layer), Some(back)) = (&mut self.back, back) {
            layer.put(scene, packet, &rays, &back, inside);
        }
    }
}

impl<L: Lanes> Scene<'_, L> {
    /// The chosen rays, and the layer behind the first where the request has one.
    #[inline(always)]
    fn cast(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        history: &mut History<L>,
        chosen: L::Mask,
    ) -> (Hit<L>, Option<Hit<L>>) {
        let hit = match self.request.mode {
            Mode::Composite | Mode::PathTraced => return self.layers(rays, walk, history, chosen),
            Mode::Slice(blend) => self.lanes.apart(
                #[inline(always)]
                || self.slice(rays, blend, chosen),
            ),
            Mode::Isosurface => self.lanes.apart(
                #[inline(always)]
                || self.isosurface(rays, walk, chosen),
            ),
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Average | Mode::Additive => self.lanes.apart(
                #[inline(always)]
                || self.project(rays, walk, chosen),
            ),
        };
        (hit, None)
    }
}

impl LayerMut<'_> {
    /// Writes the pixels of a packet that are inside the region.
    #[inline(always)]
    fn put<L: Lanes>(
        &mut self,
        scene: &Scene<'_, L>,
        packet: Packet,
        rays: &Rays<L>,
        hit: &Hit<L>,
        inside: L::Mask,
    ) {
        let bytes = bytes(scene, hit);
        let mut depths = [scene.lanes.scalar(0.0); MOST_LANES];
        scene.view.depth(rays, hit.t).store(&mut depths);
        let (hits, inside) = (hit.hits.bits(), inside.bits());
        for lane in (0..L::COUNT).filter(|lane| inside >> lane & 1 == 1) {
            let [column, row] = packet.place(lane);
            let at = (row * scene.request.size_px[0] + column) as usize;
            self.color_rgba[at] = bytes[lane];
            let is_hit = hits >> lane & 1 == 1;
            self.depth_mm[at] = if is_hit { depths[lane].into() as f32 } else { f32::INFINITY };
        }
    }
}

/// Colours over the background as bytes, and the coverage.
#[inline(always)]
fn bytes<L: Lanes>(scene: &Scene<'_, L>, hit: &Hit<L>) -> [[u8; 4]; MOST_LANES] {
    let lanes = scene.lanes;
    let Triple([r, g, b]) = hit.color;
    let behind = lanes.splat(1.0) - hit.opacity;
    let [red, green, blue] = scene.request.background_rgb.map(|channel| lanes.splat(channel) * behind);
    let mut pixels = [[0; 4]; MOST_LANES];
    for (channel, value) in [r + red, g + green, b + blue, hit.opacity].into_iter().enumerate() {
        let value = value.clamped(lanes.splat(0.0), lanes.splat(1.0)) * lanes.splat(255.0);
        let mut stored = [lanes.scalar(0.0); MOST_LANES];
        value.round().store(&mut stored);
        for (pixel, stored) in pixels.iter_mut().zip(stored) {
            pixel[channel] = stored.into() as u8;
        }
    }
    pixels
}
