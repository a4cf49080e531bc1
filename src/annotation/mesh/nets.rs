//! Surface nets of a mask: a corner for every sheet of surface between eight voxels, a
//! quadrilateral across every pair of neighbours of which one is in.
//!
//! S. Gibson, "Constrained elastic surface nets", 1998, with a corner for each sheet instead of one
//! for each cell, as G. Nielson does in "Dual marching cubes", 2004. The mesh is the dual of a
//! closed surface, so it is closed whatever the mask, and a 2-manifold but for one case: two sheets
//! that meet twice, on both sides of a face whose corners are in across from each other. Their two
//! joints then get a corner of their own on that face, and the quadrilaterals next to it one in
//! their middle. So every edge has two triangles and every corner one fan of them. What is outside
//! of the grid is not in: a region that ends at the grid's end is closed there.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::cells::{CELLS, edge, face};
use super::{MeshError, TriangleMesh};
use relief_base::{Patient, Point, Transform, Voxel};
use relief_volume::Mask;

/// Layers of cells that are worked on by one thread at a time; the layer before them is looked at
/// again.
const LAYERS: usize = 8;

/// The surface of a mask.
///
/// Corners lie between the voxel centres, in the mean of the middles of what their sheet crosses;
/// nothing is smoothed. As many layers as there are voxels along k are worked on side by side.
///
/// # Errors
/// When the mask is empty, or its surface has more than [`TriangleMesh::MOST_TRIANGLES`].
pub fn surface_nets(mask: &Mask) -> Result<TriangleMesh, MeshError> {
    let net = Net::new(mask);
    let layers = mask.grid().dims()[2] + 1;
    let counts: Vec<[usize; 2]> = (0..layers).into_par_iter().map(|layer| net.count(layer)).collect();
    let [corners, quads] = counts.iter().fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
    if quads == 0 {
        return Err(MeshError::Empty);
    }
    let found = 2 * quads as u64;
    if found > TriangleMesh::MOST_TRIANGLES {
        return Err(MeshError::TooLarge { found, allowed: TriangleMesh::MOST_TRIANGLES });
    }
    let mut vertices = vec![Point::new(0.0, 0.0, 0.0); corners];
    let mut triangles = vec![[0u32; 3]; 2 * quads];
    let mut parts = Vec::new();
    let (mut rest_corners, mut rest_triangles) = (&mut vertices[..], &mut triangles[..]);
    let (mut first, mut slot, mut before) = (0, 0, 0);
    for (chunk, counts) in counts.chunks(LAYERS).enumerate() {
        let [own, faces] =
            counts.iter().fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + 2 * count[1]]);
        let (corners, triangles);
        (corners, rest_corners) = std::mem::take(&mut rest_corners).split_at_mut(own);
        (triangles, rest_triangles) = std::mem::take(&mut rest_triangles).split_at_mut(faces);
        let layers = chunk * LAYERS..chunk * LAYERS + counts.len();
        parts.push(Part { layers, first, before, slot, corners, triangles });
        (first, slot, before) = (first + own, slot + faces, counts[counts.len() - 1][0]);
    }
    let knots: Vec<Vec<PinchedQuad>> = parts.into_par_iter().map(|part| net.fill(part)).collect();
    let mut mesh = TriangleMesh { vertices, triangles };
    net.untie(&mut mesh, knots.into_iter().flatten());
    Ok(mesh)
}

/// A run of layers and where their output goes.
struct Part<'a> {
    layers: std::ops::Range<usize>,
    /// Index of the first corner.
    first: usize,
    /// Corners of the layer before.
    before: usize,
    /// Index of the first triangle.
    slot: usize,
    corners: &'a mut [Point<Patient>],
    triangles: &'a mut [[u32; 3]],
}

/// A quadrilateral with sheets that meet twice on a side: what replaces it is known when all
/// corners are numbered.
struct PinchedQuad {
    /// Its first triangle.
    slot: usize,
    /// Its corners, counter-clockwise from outside.
    ring: [u32; 4],
    /// The axes between a corner and the next.
    splits: [Option<Split>; 4],
    /// Its middle, in voxels.
    middle: DVec3,
}

/// A joint's own corner on a face. Two quadrilaterals ask for each.
#[derive(Clone, Copy)]
struct Split {
    /// The face, by the cell above it and its axis, and the voxel that the joint cuts off.
    key: (u64, u64),
    /// Its place, in voxels.
    place: DVec3,
}

/// One layer of cells: the data of cells that the surface crosses. Other entries are stale.
struct Layer {
    first: Vec<u32>,
    cases: Vec<u8>,
}

struct Net<'a> {
    mask: &'a Mask,
    patient_from_voxel: Transform<Patient, Voxel>,
    /// Cells along i and j.
    size: [usize; 2],
    /// Whether the axes are left-handed, so that counter-clockwise in voxels is clockwise in mm.
    is_mirrored: bool,
}

impl<'a> Net<'a> {
    fn new(mask: &'a Mask) -> Self {
        let patient_from_voxel = mask.grid().patient_from_voxel();
        let [nx, ny, _] = mask.grid().dims();
        let is_mirrored = patient_from_voxel.linear().determinant() < 0.0;
        Self { mask, patient_from_voxel, size: [nx + 1, ny + 1], is_mirrored }
    }

    /// Goes through the cells of a layer that the surface passes: (i, j, case). Cell (i, j, k) has
    /// voxel (i, j, k) at its corner 7.
    fn each(&self, layer: usize, mut cell: impl FnMut(usize, usize, u8)) {
        let none = vec![0u64; self.mask.row_words()];
        let row = |j: usize, k: usize| self.mask.row(j, k).unwrap_or(&none);
        for j in 0..self.size[1] {
            let (lower, below) = (j.wrapping_sub(1), layer.wrapping_sub(1));
            let rows = [row(lower, below), row(j, below), row(lower, layer), row(j, layer)];
            for word in 0..self.size[0].div_ceil(64) {
                // Bits of the voxels at a cell's upper end, and those at its lower end, one voxel
                // before.
                let high = rows.map(|row| row.get(word).copied().unwrap_or(0));
                let carried = |n: usize| word.checked_sub(1).map_or(0, |before| rows[n][before] >> 63);
                let low: [u64; 4] = std::array::from_fn(|n| high[n] << 1 | carried(n));
                let any = high.iter().chain(&low).fold(0, |any, bits| any | bits);
                let all = high.iter().chain(&low).fold(u64::MAX, |all, bits| all & bits);
                let mut passed = any & !all;
                while passed != 0 {
                    let bit = passed.trailing_zeros();
                    passed &= passed - 1;
                    let corner = |n: usize| (low[n] >> bit & 1) as u8 | ((high[n] >> bit & 1) as u8) << 1;
                    let case = corner(0) | corner(1) << 2 | corner(2) << 4 | corner(3) << 6;
                    cell(word * 64 + bit as usize, j, case);
                }
            }
        }
    }

    /// Corners and quadrilaterals of a layer.
    fn count(&self, layer: usize) -> [usize; 2] {
        let (cells, mut count) = (&*CELLS, [0, 0]);
        self.each(layer, |_, _, case| {
            count[0] += usize::from(cells.sheets[usize::from(case)]);
            count[1] += usize::from(cells.quads[usize::from(case)]);
        });
        count
    }

    /// Numbers the vertices of a layer from `first` on, and returns their positions.
    fn number(&self, into: &mut Layer, layer: usize, first: usize, mut corner: impl FnMut(DVec3)) {
        let (cells, mut next) = (&*CELLS, first as u32);
        self.each(layer, |i, j, case| {
            let at = j * self.size[0] + i;
            (into.first[at], into.cases[at]) = (next, case);
            let case = usize::from(case);
            let low = DVec3::new(i as f64, j as f64, layer as f64) - 1.0;
            for place in &cells.places[case][..usize::from(cells.sheets[case])] {
                corner(low + DVec3::from(*place));
                next += 1;
            }
        });
    }

    fn fill(&self, part: Part) -> Vec<PinchedQuad> {
        let count = self.size[0] * self.size[1];
        let empty = || Layer { first: vec![0; count], cases: vec![0; count] };
        let (mut below, mut own) = (empty(), empty());
        let Part { layers, first, before, slot, corners, triangles } = part;
        if let Some(last) = layers.start.checked_sub(1) {
            self.number(&mut below, last, first - before, |_| ());
        }
        let mut knots = Vec::new();
        let (mut corner, mut triangle) = (0, 0);
        for layer in layers {
            self.number(&mut own, layer, first + corner, |place| {
                corners[corner] = self.patient_from_voxel * Point::from_xyz(place);
                corner += 1;
            });
            self.each(layer, |i, j, case| {
                for axis in (0..3).filter(|axis| (case ^ case >> (1 << axis)) & 1 == 1) {
                    let quad = self.quad([i, j, layer], axis, case & 1 == 1, [&below, &own]);
                    let [a, b, c, d] = quad.ring;
                    let halves = if quad.is_other { [[b, c, d], [b, d, a]] } else { [[a, b, c], [a, c, d]] };
                    triangles[triangle..triangle + 2].copy_from_slice(&halves);
                    if quad.splits.iter().any(Option::is_some) {
                        let (ring, splits, middle) = (quad.ring, quad.splits, quad.middle);
                        knots.push(PinchedQuad { slot: slot + triangle, ring, splits, middle });
                    }
                    triangle += 2;
                }
            });
            std::mem::swap(&mut below, &mut own);
        }
        knots
    }

    /// The quadrilateral across the edge at corner 0 of cell `at`, along `axis`; `is_low` where its
    /// lower end is in.
    fn quad(&self, at: [usize; 3], axis: usize, is_low: bool, layers: [&Layer; 2]) -> Quad {
        let cells = &*CELLS;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // Counter-clockwise as seen from the axis' upper end: u before v.
        let steps = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let cell = |[du, dv]: [usize; 2]| {
            let mut index = at;
            index[u] -= du;
            index[v] -= dv;
            let layer = layers[usize::from(index[2] == at[2])];
            let place = index[1] * self.size[0] + index[0];
            let case = usize::from(layer.cases[place]);
            let sheet = cells.sheet_of[case][edge(axis, du, dv)];
            (index, case, layer.first[place] + u32::from(sheet), cells.places[case][usize::from(sheet)])
        };
        let found = steps.map(cell);
        let mut ring = found.map(|(_, _, corner, _)| corner);
        // The shorter diagonal; of equal ones the first.
        let place = |n: usize| {
            let (index, _, _, place) = found[n];
            DVec3::from(index.map(|i| i as f64)) + DVec3::from(place)
        };
        let length =
            |a: usize, b: usize| (self.patient_from_voxel.linear() * (place(a) - place(b))).length_squared();
        let is_other = length(1, 3) < length(0, 2) * (1.0 - 1e-9);
        // The face between a cell and the next: its axis, and on which side of the first it is.
        let sides = [(u, 0), (v, 0), (u, 1), (v, 1)];
        let mut splits = [None; 4];
        if found.iter().any(|(_, case, ..)| cells.twice[*case] != 0) {
            splits = std::array::from_fn(|n| {
                let ((one, case, ..), (other, next, ..)) = (found[n], found[(n + 1) % 4]);
                let (across, side) = sides[n];
                let is_twice = cells.twice[case] >> face(across, side) & 1 == 1
                    && cells.twice[next] >> face(across, 1 - side) & 1 == 1;
                is_twice.then(|| self.split(if side == 0 { one } else { other }, across, at, axis, is_low))
            });
        }
        if is_low == self.is_mirrored {
            ring = [ring[0], ring[3], ring[2], ring[1]];
            splits = [splits[3], splits[2], splits[1], splits[0]];
        }
        let mut middle = DVec3::from(at.map(|i| i as f64)) - 1.0;
        middle[axis] += 0.5;
        Quad { ring, is_other, splits, middle }
    }

    /// The joint that the edge at corner 0 of cell `at` has on the lower face of cell `above`
    /// across `across`.
    fn split(&self, above: [usize; 3], across: usize, at: [usize; 3], axis: usize, is_low: bool) -> Split {
        let mut voxel = at; // plus one in each direction, as cells are
        voxel[axis] += usize::from(!is_low);
        let number = |index: [usize; 3]| {
            (index[2] as u64 * (self.size[1] as u64 + 1) + index[1] as u64) * (self.size[0] as u64 + 1)
                + index[0] as u64
        };
        let mut center = DVec3::from(above.map(|i| i as f64)) - 0.5;
        center[across] -= 0.5;
        let voxel_place = DVec3::from(voxel.map(|i| i as f64)) - 1.0;
        Split { key: (number(above) * 3 + across as u64, number(voxel)), place: (center + voxel_place) / 2.0 }
    }

    /// Replaces quadrilaterals with sheets that meet twice by fans around their middles.
    fn untie(&self, mesh: &mut TriangleMesh, knots: impl Iterator<Item = PinchedQuad>) {
        let mut known: HashMap<(u64, u64), u32> = HashMap::new();
        for PinchedQuad { slot, ring, splits, middle } in knots {
            let mut add = |place: DVec3| {
                mesh.vertices.push(self.patient_from_voxel * Point::from_xyz(place));
                mesh.vertices.len() as u32 - 1
            };
            let mut loop_around = Vec::with_capacity(8);
            for (corner, split) in ring.into_iter().zip(splits) {
                loop_around.push(corner);
                loop_around
                    .extend(split.map(|split| *known.entry(split.key).or_insert_with(|| add(split.place))));
            }
            let middle = add(middle);
            let next = |n: usize| loop_around[(n + 1) % loop_around.len()];
            let mut fan = (0..loop_around.len()).map(|n| [loop_around[n], next(n), middle]);
            for place in &mut mesh.triangles[slot..slot + 2] {
                *place = fan.next().unwrap_or_default();
            }
            mesh.triangles.extend(fan);
        }
    }
}

struct Quad {
    ring: [u32; 4],
    /// Whether it is cut between its second and fourth corner, instead of its first and third.
    is_other: bool,
    splits: [Option<Split>; 4],
    middle: DVec3,
}
