//! The part of a picture in which rays can hit anything: beside it the background shows, and no ray
//! is cast.
//!
//! Spaces: pixels, rows from the top. The region is computed from a box around the possibly visible
//! voxels, in patient mm, and is never too small: the picture is the same without it.

use super::appearance::VisibleBricks;
use super::cut::CutFaces;
use super::mode::Mode;
use super::pipelines::WORKGROUP_SIDE;
use super::request::RenderRequest;
use relief_base::{Patient, Point};
use relief_volume::{Camera, Grid};

/// Pixels beyond the outermost that a box touches: far more than rays of 32 bits are off.
const MARGIN_PX: f64 = 2.0;

/// A rectangle of pixels; its first column and row are a tile's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Region {
    /// Column and row.
    pub(super) first: [u32; 2],
    /// Columns and rows, at least one of each.
    pub(super) size: [u32; 2],
}

impl Region {
    /// The whole picture.
    pub(super) fn whole(size_px: [u32; 2]) -> Self {
        Self { first: [0; 2], size: size_px }
    }

    /// The rows above the last row of tiles.
    pub(super) fn rows_above_last_tiles(self) -> u32 {
        (self.size[1] - 1) / WORKGROUP_SIDE * WORKGROUP_SIDE
    }

    /// The part of a picture that shows anything of a volume: its visible bricks, or all of it in
    /// modes that blend the invisible in.
    pub(super) fn of(request: &RenderRequest, grid: &Grid, bricks: &VisibleBricks) -> Self {
        let corners = match request.mode {
            // Faces show values that the transfer function hides.
            _ if matches!(request.cut, CutFaces::Slice { .. }) => Some(grid.corners()),
            Mode::Composite | Mode::Isosurface => bricks.corners(grid),
            _ => Some(grid.corners()),
        };
        match corners {
            Some(corners) => Self::of_corners(&corners, &request.camera, request.size_px),
            // Nothing shows: a tile is enough.
            None => Self::between([0; 2], [1; 2], request.size_px),
        }
    }

    /// The region of the picture in which a box with these corners can be visible.
    fn of_corners(corners: &[Point<Patient>; 8], camera: &Camera, size_px: [u32; 2]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in corners {
            // A box that the eye is in or beside may be seen anywhere.
            let seen =
                camera.project(*corner, size_px).filter(|(_, _, depth)| *depth > 1e-3 * camera.distance_mm());
            let Some((u, v, _)) = seen else { return Self::whole(size_px) };
            (low, high) = ([low[0].min(u), low[1].min(v)], [high[0].max(u), high[1].max(v)]);
        }
        let pixel = |position: f64, axis: usize| position.clamp(0.0, f64::from(size_px[axis]));
        let bound =
            |[u, v]: [f64; 2], margin: f64| [pixel(u + margin, 0), pixel(v + margin, 1)].map(|at| at as u32);
        Self::between(bound(low, -MARGIN_PX), bound(high, MARGIN_PX + 1.0), size_px)
    }

    /// The tiles from one pixel up to and without another, one at least.
    fn between(low: [u32; 2], end: [u32; 2], size_px: [u32; 2]) -> Self {
        let along = |axis: usize| {
            let first = low[axis].min(size_px[axis].saturating_sub(1)) / WORKGROUP_SIDE * WORKGROUP_SIDE;
            (first, end[axis].min(size_px[axis]).saturating_sub(first).max(1))
        };
        let ((left, width), (top, height)) = (along(0), along(1));
        Self { first: [left, top], size: [width, height] }
    }

    /// Whole pictures of `size_px` one after the other, from buffers of which only this region was
    /// written: `empty` beside it.
    pub(super) fn spread<T: bytemuck::Pod>(
        self,
        written: &[T],
        size_px: [u32; 2],
        empty: T,
        pixel: impl Fn(T) -> T,
    ) -> Vec<T> {
        let [width, height] = size_px.map(|side| side as usize);
        let ([left, top], [columns, rows]) =
            (self.first.map(|at| at as usize), self.size.map(|side| side as usize));
        let mut whole = Vec::with_capacity(written.len());
        for picture in written.chunks_exact((width * height).max(1)) {
            whole.resize(whole.len() + top * width, empty);
            for row in picture.chunks_exact(width).skip(top).take(rows) {
                whole.resize(whole.len() + left, empty);
                whole.extend(row[left..left + columns].iter().map(|&value| pixel(value)));
                whole.resize(whole.len() + width - left - columns, empty);
            }
            whole.resize(whole.len() + (height - top - rows) * width, empty);
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Vector;
    use relief_volume::Projection;

    const SIZE_PX: [u32; 2] = [960, 540];

    /// A metre before the origin, looking along +y, x to the right.
    fn camera(projection: Projection) -> Camera {
        Camera::new(
            Point::new(0.0, -1000.0, 0.0),
            Point::new(0.0, 0.0, 0.0),
            Vector::new(0.0, 0.0, 1.0),
            projection,
        )
        .unwrap()
    }

    fn cube(center: [f64; 3], half: f64) -> [Point<Patient>; 8] {
        std::array::from_fn(|i| {
            let at = |axis: usize| center[axis] + if i >> axis & 1 == 0 { -half } else { half };
            Point::new(at(0), at(1), at(2))
        })
    }

    #[test]
    fn a_cube_is_seen_in_the_tiles_that_its_faces_reach() {
        let camera = camera(Projection::Orthographic { height_mm: 540.0 });
        // A pixel a millimetre, the origin in the picture's middle: columns 429.75 to 530.25 and
        // rows 219.75 to 320.25.
        let found = Region::of_corners(&cube([0.0; 3], 50.25), &camera, SIZE_PX);
        assert_eq!(found, Region { first: [424, 216], size: [533 - 424, 323 - 216] });
        // Half out of the picture at its left, and at its top.
        let found = Region::of_corners(&cube([-480.0, 0.0, 270.0], 50.25), &camera, SIZE_PX);
        assert_eq!(found, Region { first: [0, 0], size: [53, 53] });
        // Beside it: one row or column of tiles is left.
        let found = Region::of_corners(&cube([600.0, 0.0, 0.0], 50.0), &camera, SIZE_PX);
        assert_eq!((found.first[0], found.size[0]), (952, 8));
        assert!(found.first[0] + found.size[0] <= 960 && found.first[1] + found.size[1] <= 540);
    }

    #[test]
    fn a_box_about_the_eye_may_be_seen_anywhere() {
        let camera = camera(Projection::Perspective { vertical_fov: 0.4 });
        for center in [[0.0, -1000.0, 0.0], [30.0, -1010.0, 0.0]] {
            assert_eq!(Region::of_corners(&cube(center, 50.0), &camera, SIZE_PX), Region::whole(SIZE_PX));
        }
        // The nearer face counts: 50 mm at 950.
        let found = Region::of_corners(&cube([0.0; 3], 50.0), &camera, SIZE_PX);
        let half_px = 50.0 / 950.0 / 0.2f64.tan() * 270.0;
        let (low, end) = ((480.0 - half_px - 2.0) as u32 / 8 * 8, (480.0 + half_px + 3.0) as u32);
        assert_eq!((found.first[0], found.first[0] + found.size[0]), (low, end));
    }

    #[test]
    fn unwritten_parts_of_a_region_are_empty() {
        let region = Region { first: [1, 1], size: [2, 1] };
        let written: Vec<u8> = (1..=24).collect();
        let whole = region.spread(&written, [4, 3], 0, |value| value + 100);
        assert_eq!(whole, [0, 0, 0, 0, 0, 106, 107, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 118, 119, 0, 0, 0, 0, 0]);
        assert_eq!(Region::whole([4, 3]).spread(&written, [4, 3], 0, |value| value), written);
    }
}
