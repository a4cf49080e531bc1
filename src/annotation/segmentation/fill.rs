//! The region inside closed curves on several levels.
//!
//! On a level a place is inside by the even-odd rule, so curves within curves are holes. Between
//! two levels its signed distances from the curves of both are interpolated by height, and it is
//! inside where that is 0 or more (S. Raya and J. Udupa, "Shape-based interpolation of
//! multidimensional objects", 1990). Nothing is added beyond the outermost levels but the other
//! half of the voxels that they run through: curves on every slice of a series, as radiotherapy
//! structures have them, fill these slices whole, and their volume is the sum of areas times the
//! slice distance.
//!
//! Accuracy: on a level, voxel centres are classified exactly. Distances are those from the exact
//! edges, but the nearest edge is found on a raster of half a voxel, so a distance may be that of
//! the second nearest edge: less than half a voxel too long. Memory: 4 bytes for each raster point;
//! rasters become coarser beyond 2^27 points.

use glam::DVec2;
use rayon::prelude::*;

use super::contours::{Contour, FillError, Level, Levels};
use relief_base::Point;
use relief_volume::{Grid, Mask};

/// Most places of all rasters together: half a GiB.
const MOST_PLACES: f64 = (1u64 << 27) as f64;

/// The voxels of a grid that lie within the contours.
///
/// # Errors
/// When there is no contour, or one that is not planar, not parallel to the others, without area,
/// or far away: see [`FillError`].
pub fn fill_contours(grid: &Grid, contours: &[Contour]) -> Result<Mask, FillError> {
    let Levels { axes, levels } = Levels::of(contours)?;
    let linear = grid.patient_from_voxel().linear();
    let smallest = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    // How far a voxel reaches along the levels' axis, and half of that.
    let half =
        [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.dot(axes[2]).abs()).iter().sum::<f64>()
            / 2.0;
    let step = step(&levels, smallest / 2.0);
    let rasters: Vec<Raster> = levels.into_par_iter().map(|level| Raster::new(level, step)).collect();
    let (lowest, highest) = (rasters[0].height - half, rasters[rasters.len() - 1].height + half);
    // Rounding must not decide about voxels half in: they are, at the lower end.
    let tiny = half * 1e-6;
    let mut mask = Mask::empty(grid.clone());
    let (words, [nx, ny, _]) = (mask.row_words(), grid.dims());
    mask.words_mut().par_chunks_mut(words).enumerate().for_each(|(row, out)| {
        let start = grid.patient_from_voxel() * Point::new(0.0, (row % ny) as f64, (row / ny) as f64);
        for i in 0..nx {
            let [u, v, w] = axes.map(|axis| axis.dot(start.xyz + linear.x_axis * i as f64));
            if w >= lowest - tiny && w < highest - tiny && is_inside(&rasters, DVec2::new(u, v), w) {
                out[i / 64] |= 1 << (i % 64);
            }
        }
    });
    Ok(mask)
}

/// Distance between places of the rasters: the wanted one where that is not too many places.
fn step(levels: &[Level], wanted: f64) -> f64 {
    let area: f64 = levels
        .iter()
        .map(|level| {
            let [low, high] = level.span();
            let size = high - low;
            size.x * size.y
        })
        .sum();
    wanted.max((area / MOST_PLACES).sqrt())
}

fn is_inside(rasters: &[Raster], place: DVec2, height: f64) -> bool {
    let above = rasters.partition_point(|raster| raster.height < height);
    let after = rasters.get(above);
    let before = above.checked_sub(1).map(|at| &rasters[at]);
    match (before, after) {
        (Some(before), Some(after)) => {
            let share = (height - before.height) / (after.height - before.height);
            if share <= 1e-9 {
                return before.distance(place) >= 0.0;
            }
            if share >= 1.0 - 1e-9 {
                return after.distance(place) >= 0.0;
            }
            let [low, high] = [before, after].map(|raster| raster.distance(place));
            low + (high - low) * share >= 0.0
        }
        (Some(only), None) | (None, Some(only)) => only.distance(place) >= 0.0,
        (None, None) => false,
    }
}

impl Level {
    /// Smallest and largest u and v.
    fn span(&self) -> [DVec2; 2] {
        let points = self.edges.iter().flatten();
        points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], point| {
            [low.min(*point), high.max(*point)]
        })
    }
}

/// Signed distances from a level's curves.
struct Raster {
    height: f64,
    edges: Vec<[DVec2; 2]>,
    origin: DVec2,
    step: f64,
    size: [usize; 2],
    /// For every place the nearest edge, and in the highest bit whether it is inside.
    places: Vec<u32>,
}

const INSIDE: u32 = 1 << 31;
const NONE: u32 = INSIDE - 1;

impl Raster {
    fn new(level: Level, step: f64) -> Self {
        let [low, high] = level.span();
        let origin = low - DVec2::splat(2.0 * step);
        let size = ((high - origin) / step).to_array().map(|n| n.ceil() as usize + 3);
        let places = vec![NONE; size[0] * size[1]];
        let mut raster = Self { height: level.height, edges: level.edges, origin, step, size, places };
        raster.rasterise_edges();
        raster.sweep();
        raster.mark_inside();
        raster
    }

    fn at(&self, [a, b]: [usize; 2]) -> DVec2 {
        self.origin + DVec2::new(a as f64, b as f64) * self.step
    }

    fn squared(&self, edge: u32, place: DVec2) -> f64 {
        self.edges.get(edge as usize).map_or(f64::INFINITY, |[a, b]| {
            let along = *b - *a;
            let share = ((place - *a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            (*a + along * share).distance_squared(place)
        })
    }

    /// Offers an edge to a place, which keeps the nearer one.
    fn offer(&mut self, index: [usize; 2], edge: u32) {
        let (place, at) = (self.at(index), index[1] * self.size[0] + index[0]);
        if self.squared(edge, place) < self.squared(self.places[at], place) {
            self.places[at] = edge;
        }
    }

    /// Places next to an edge know it.
    fn rasterise_edges(&mut self) {
        for edge in 0..self.edges.len() {
            let [a, b] = self.edges[edge].map(|end| (end - self.origin) / self.step);
            let parts = ((b - a).length().ceil() as usize).max(1);
            for part in 0..=parts {
                let near = a.lerp(b, part as f64 / parts as f64).floor();
                let [i, j] = near.to_array().map(|n| n as usize);
                for index in [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]] {
                    if index[0] < self.size[0] && index[1] < self.size[1] {
                        self.offer(index, edge as u32);
                    }
                }
            }
        }
    }

    /// All other places learn from their neighbours: from the first to the last and back, twice.
    fn sweep(&mut self) {
        let [nu, nv] = self.size;
        for pass in 0..4 {
            for n in 0..nu * nv {
                let at = if pass % 2 == 0 { n } else { nu * nv - 1 - n };
                let (i, j) = (at % nu, at / nu);
                for (di, dj) in [(-1, 0), (-1, -1), (0, -1), (1, -1)] {
                    let turn = if pass % 2 == 0 { 1 } else { -1 };
                    let (Some(a), Some(b)) =
                        (i.checked_add_signed(di * turn), j.checked_add_signed(dj * turn))
                    else {
                        continue;
                    };
                    if a < nu && b < nv {
                        let edge = self.places[b * nu + a];
                        if edge != self.places[at] {
                            self.offer([i, j], edge);
                        }
                    }
                }
            }
        }
    }

    /// Even-odd along each row. An edge crosses a row that its lower end is on or below and its
    /// upper end above.
    fn mark_inside(&mut self) {
        let [nu, nv] = self.size;
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); nv];
        for [a, b] in &self.edges {
            let (low, high) = if a.y <= b.y { (a, b) } else { (b, a) };
            let first = ((low.y - self.origin.y) / self.step).floor().max(0.0) as usize;
            for (row, crossings) in crossings.iter_mut().enumerate().skip(first) {
                let y = self.origin.y + row as f64 * self.step;
                if y >= high.y {
                    break;
                }
                if y >= low.y {
                    crossings.push(low.x + (high.x - low.x) * (y - low.y) / (high.y - low.y));
                }
            }
        }
        for (row, crossings) in crossings.iter_mut().enumerate() {
            crossings.sort_by(f64::total_cmp);
            let mut passed = 0;
            for i in 0..nu {
                let x = self.origin.x + i as f64 * self.step;
                while crossings.get(passed).is_some_and(|crossing| *crossing <= x) {
                    passed += 1;
                }
                if passed % 2 == 1 {
                    self.places[row * nu + i] |= INSIDE;
                }
            }
        }
    }

    /// Distance from the nearest edge: above 0 inside. Outside of the raster that of its nearest
    /// place adds to the way there.
    fn distance(&self, place: DVec2) -> f64 {
        let [nu, nv] = self.size;
        let inner = ((place - self.origin) / self.step)
            .clamp(DVec2::ZERO, DVec2::new((nu - 1) as f64, (nv - 1) as f64));
        let [i, j] = inner.floor().to_array().map(|n| n as usize);
        let mut nearest = f64::INFINITY;
        for index in [
            [i, j],
            [(i + 1).min(nu - 1), j],
            [i, (j + 1).min(nv - 1)],
            [(i + 1).min(nu - 1), (j + 1).min(nv - 1)],
        ] {
            nearest = nearest.min(self.squared(self.places[index[1] * nu + index[0]] & NONE, place));
        }
        let distance = nearest.sqrt();
        let [a, b] = inner.round().to_array().map(|n| n as usize);
        // No edge lies between a place and another that is nearer than the nearest edge.
        let is_sure = distance > self.at([a, b]).distance(place);
        let is_inside = if is_sure { self.places[b * nu + a] & INSIDE != 0 } else { self.is_within(place) };
        if is_inside { distance } else { -distance }
    }

    /// Even-odd, asking every edge.
    fn is_within(&self, place: DVec2) -> bool {
        let crosses = |[a, b]: &&[DVec2; 2]| {
            (a.y <= place.y) != (b.y <= place.y)
                && a.x + (b.x - a.x) * (place.y - a.y) / (b.y - a.y) <= place.x
        };
        self.edges.iter().filter(crosses).count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use relief_base::{Patient, Transform};

    fn ring(at: impl Fn(f64) -> DVec3, count: usize) -> Contour {
        let points = (0..count)
            .map(|n| Point::<Patient>::from_xyz(at(std::f64::consts::TAU * n as f64 / count as f64)));
        Contour { points: points.collect() }
    }

    /// Circles of these radii at these heights along an axis, on a grid that is turned otherwise.
    fn volume_ml(rings: &[(f64, f64)], tilt: f64, spacing: [f64; 3]) -> f64 {
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, tilt, 0.6 * tilt, -0.3 * tilt);
        let contours: Vec<Contour> = rings
            .iter()
            .map(|&(radius, height)| {
                ring(|t| turn * DVec3::new(radius * t.cos(), radius * t.sin(), height), 180)
            })
            .collect();
        let dims = spacing.map(|step| (90.0 / step) as usize);
        let axes = spacing.map(|step| step);
        let corner = DVec3::splat(-45.0) + DVec3::new(0.31, 0.17, 0.0);
        let grid = Grid::new(
            dims,
            Transform::from_axes(DVec3::X * axes[0], DVec3::Y * axes[1], DVec3::Z * axes[2], corner),
        );
        fill_contours(&grid.unwrap(), &contours).unwrap().volume_ml()
    }

    #[test]
    fn circles_on_levels_become_cylinders_and_cones_of_their_volume() {
        let pi = std::f64::consts::PI;
        for tilt in [0.0, 0.5] {
            // A layer beyond both ends is half a voxel thick along the axis: a whole voxel is
            // allowed for.
            let cylinder = volume_ml(&[(20.0, -20.0), (20.0, 20.0)], tilt, [0.7, 0.8, 1.0]);
            let truth = pi * 400.0 * 40.0 / 1000.0;
            let layer = pi * 400.0 * 2.0 / 1000.0;
            assert!(cylinder > truth * 0.995 && cylinder < truth + layer, "{cylinder} of {truth} ml");
            // Between circles of different size distances are linear in height: a cone's frustum.
            let cone = volume_ml(&[(30.0, -20.0), (10.0, 20.0)], tilt, [0.7, 0.8, 1.0]);
            let truth = pi * 40.0 / 3.0 * (900.0 + 300.0 + 100.0) / 1000.0;
            let layer = pi * (900.0 + 100.0) / 1000.0;
            assert!(cone > truth * 0.995 && cone < truth + layer, "{cone} of {truth} ml");
        }
    }

    #[test]
    fn curves_on_every_slice_fill_whole_slices_and_holes_stay() {
        let heights = [0.0, 3.0, 6.0, 9.0];
        let mut contours: Vec<Contour> = Vec::new();
        for z in heights {
            contours.push(ring(|t| DVec3::new(20.0 * t.cos(), 20.0 * t.sin(), z), 90));
            contours.push(ring(|t| DVec3::new(8.0 * t.sin(), 8.0 * t.cos(), z), 60));
        }
        let grid = Grid::axis_aligned([101, 101, 8], [0.5, 0.5, 3.0], [-25.0, -25.0, -6.0]).unwrap();
        let mask = fill_contours(&grid, &contours).unwrap();
        let slices: Vec<u64> = (0..8)
            .map(|k| (0..101).flat_map(|j| mask.row(j, k).unwrap()).map(|w| u64::from(w.count_ones())).sum())
            .collect();
        assert_eq!(
            slices.iter().map(|n| *n > 0).collect::<Vec<_>>(),
            [false, false, true, true, true, true, false, false]
        );
        let polygon = |r: f64, n: f64| n / 2.0 * r * r * (std::f64::consts::TAU / n).sin();
        let truth = (polygon(20.0, 90.0) - polygon(8.0, 60.0)) * 12.0 / 1000.0;
        assert!((mask.volume_ml() / truth - 1.0).abs() < 0.003, "{} of {truth} ml", mask.volume_ml());
        assert!(!mask.contains([50, 50, 3]), "the hole");
        // On levels every voxel centre is classified exactly.
        let inside = |x: f64, y: f64, contour: &Contour| {
            let edges = contour.points.iter().zip(contour.points.iter().cycle().skip(1));
            edges
                .filter(|(a, b)| {
                    (a.xyz.y <= y) != (b.xyz.y <= y)
                        && a.xyz.x + (b.xyz.x - a.xyz.x) * (y - a.xyz.y) / (b.xyz.y - a.xyz.y) <= x
                })
                .count()
                % 2
                == 1
        };
        let mut differ = 0;
        for (i, j) in (0..101).flat_map(|i| (0..101).map(move |j| (i, j))) {
            let (x, y) = (-25.0 + i as f64 * 0.5, -25.0 + j as f64 * 0.5);
            let expected = inside(x, y, &contours[0]) != inside(x, y, &contours[1]);
            differ += usize::from(mask.contains([i, j, 3]) != expected);
        }
        // Points that lie on an edge exactly may fall to either side.
        assert!(differ <= 4, "{differ} voxels");
    }

    #[test]
    fn fill_names_contours_that_it_cannot_use() {
        let grid = Grid::axis_aligned([10, 10, 10], [1.0; 3], [0.0; 3]).unwrap();
        let good = ring(|t| DVec3::new(5.0 * t.cos(), 5.0 * t.sin(), 4.0), 12);
        let says = |contours: &[Contour], text: &str| {
            let refused = fill_contours(&grid, contours).unwrap_err().to_string();
            assert!(refused.contains(text), "{refused}");
        };
        says(&[], "no contour");
        let line = Contour {
            points: vec![Point::new(0.0, 0.0, 0.0), Point::new(1.0, 1.0, 1.0), Point::new(2.0, 2.0, 2.0)],
        };
        says(&[good.clone(), line], "contour 2 encloses no area");
        let bent = ring(|t| DVec3::new(5.0 * t.cos(), 5.0 * t.sin(), 8.0 * (2.0 * t).sin()), 24);
        says(&[bent], "contour 1 is not planar: a point is 8.0 mm off its plane");
        let tilted = ring(|t| DVec3::new(5.0 * t.cos(), 5.0 * t.sin(), 2.0 * t.sin()), 24);
        says(&[good.clone(), tilted], "contour 2 is 21.8 degrees off");
        let mut nowhere = good;
        nowhere.points[3] = Point::new(f64::NAN, 0.0, 0.0);
        says(&[nowhere], "contour 1: point 4 is not within 1000000 mm");
    }
}
