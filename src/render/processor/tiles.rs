//! Rows of pixels, cast packet after packet.
//!
//! A packet is a block of neighbouring pixels, one in each lane: rays that lie close together read
//! the same voxels.

use relief_lanes::{Kernel, Lanes, Mask as _, Real as _, Triple};

use super::super::region::Region;
use super::super::request::{DepthRule, RenderRequest};
use super::super::skipping::EmptySpaceSkipping;
use super::color::{Colors, Headlight};
use super::composite::{Scene, VISIBLE};
use super::field::Field;
use super::prepared::Prepared;
use super::ray::View;
use super::walk::Bricks;
use relief_volume::Volume;

/// A picture that is to be cast.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) volume: &'a Volume,
    pub(super) request: &'a RenderRequest,
    pub(super) prepared: &'a Prepared,
    pub(super) skipping: EmptySpaceSkipping,
}

/// Consecutive rows of a picture's region, and where their pixels go.
pub(super) struct Rows<'a> {
    pub(super) job: Job<'a>,
    pub(super) region: Region,
    /// The first row, from the top of the picture.
    pub(super) first: u32,
    /// Whole rows of the picture.
    pub(super) color_rgba: &'a mut [[u8; 4]],
    /// The same, view depth in mm; infinite where nothing is hit.
    pub(super) depth_mm: &'a mut [f32],
}

/// Width and height of a packet, pixels.
const fn packet(lanes: usize) -> [u32; 2] {
    if lanes == 8 { [4, 2] } else { [lanes as u32, 1] }
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) {
        let scene = self.job.scene(lanes);
        let [width, height] = packet(L::COUNT);
        let rows = (self.color_rgba.len() / self.job.request.size_px[0] as usize) as u32;
        for row in (0..rows).step_by(height as usize) {
            let Region { first: [left, _], size: [columns, _] } = self.region;
            for column in (left..left + columns).step_by(width as usize) {
                self.cast_packet(&scene, [column, row]);
            }
        }
    }
}

impl<'a> Job<'a> {
    #[inline(always)]
    fn scene<L: Lanes>(self, lanes: L) -> Scene<'a, L> {
        let Self { volume, request, prepared, skipping } = self;
        let skips = skipping == EmptySpaceSkipping::On;
        Scene {
            lanes,
            view: View::new(lanes, request, volume.grid()),
            field: Field::new(lanes, volume),
            bricks: Bricks::new(lanes, &prepared.map, skips),
            colors: Colors::new(lanes, &prepared.tables, &prepared.opacities),
            light: Headlight::new(lanes, &request.shading),
            depth_fraction: lanes.splat(request.depth.fraction().unwrap_or(0.0)),
            is_cut: request.clip.sphere.is_some(),
        }
    }
}

impl Rows<'_> {
    /// Casts the packet whose first pixel is at a column of the picture and a row of these rows.
    #[inline(always)]
    fn cast_packet<L: Lanes>(&mut self, scene: &Scene<'_, L>, [column, row]: [u32; 2]) {
        let lanes = scene.lanes;
        let [width, height] = packet(L::COUNT);
        let picture_width = self.job.request.size_px[0];
        let end = self.region.first[0] + self.region.size[0];
        let rows = self.color_rgba.len() as u32 / picture_width;
        let place = |lane: usize| [column + lane as u32 % width, row + lane as u32 / width];
        let is_inside = |lane: usize| {
            let [column, row] = place(lane);
            column < end && row < rows
        };
        let inside = if column + width <= end && row + height <= rows {
            lanes.first(L::COUNT)
        } else {
            lanes.splat(0.5).lt(lanes.by_lane(|lane| if is_inside(lane) { 1.0 } else { 0.0 }))
        };
        let columns = lanes.by_lane(|lane| place(lane)[0].into());
        let first = self.first;
        let rays = scene.view.rays(columns, lanes.by_lane(|lane| (first + place(lane)[1]).into()));
        let walk = scene.bricks.walk(&rays);
        let sum = scene.composite(&rays, &walk, inside);
        let hits = inside & lanes.splat(VISIBLE).le(sum.opacity);
        let mut depths = [f32::INFINITY; 8];
        if hits.any() {
            let t = match self.job.request.depth {
                DepthRule::FirstHit => scene.first_hit(&rays, sum.first),
                _ => scene.threshold_crossing(&rays, &walk, &sum, hits),
            };
            let mut shown = [lanes.scalar(0.0); 8];
            scene.view.depth(&rays, t).store(&mut shown);
            for (lane, depth) in depths.iter_mut().enumerate().take(L::COUNT) {
                if hits.bits() >> lane & 1 == 1 {
                    *depth = shown[lane].into() as f32;
                }
            }
        }
        let bytes = self.bytes(scene, sum.color, sum.opacity);
        for lane in (0..L::COUNT).filter(|lane| inside.bits() >> lane & 1 == 1) {
            let [column, row] = place(lane);
            let at = (row * picture_width + column) as usize;
            (self.color_rgba[at], self.depth_mm[at]) = (bytes[lane], depths[lane]);
        }
    }

    /// Colours over the background as bytes, and the coverage.
    #[inline(always)]
    fn bytes<L: Lanes>(
        &self,
        scene: &Scene<'_, L>,
        Triple([r, g, b]): Triple<L::Real>,
        opacity: L::Real,
    ) -> [[u8; 4]; 8] {
        let lanes = scene.lanes;
        let behind = lanes.splat(1.0) - opacity;
        let background = self.job.request.background_rgb.map(|channel| lanes.splat(channel) * behind);
        let [red, green, blue] = background;
        let mut pixels = [[0; 4]; 8];
        for (channel, value) in [r + red, g + green, b + blue, opacity].into_iter().enumerate() {
            let value = value.clamped(lanes.splat(0.0), lanes.splat(1.0)) * lanes.splat(255.0);
            let mut stored = [lanes.scalar(0.0); 8];
            (value + lanes.splat(0.5)).floor().store(&mut stored);
            for (pixel, stored) in pixels.iter_mut().zip(stored) {
                pixel[channel] = stored.into() as u8;
            }
        }
        pixels
    }
}
