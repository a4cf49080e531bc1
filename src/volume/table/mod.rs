//! The table on which a patient lies: couch, headrest, straps, sheets and tubes beside the body.
//!
//! It separates the patient from other objects by shape, in cells of 2 mm, without knowledge of
//! anatomy or of the scanner. Thick tissue (from -300 HU) belongs to the patient; so do tissue within 6 mm of it and everything
//! that it encloses in a slice. A closed, round, hollow object, such as a plastic skull, counts as a
//! patient. All other tissue is thin. Thin pieces of at least 60 mm are the table, and so are sheets
//! (from -750 HU) of at least 60 mm. Shorter pieces stay: they may be an ear, a finger or a marker.
//!
//! Spaces: voxel index; lengths in mm.

use rayon::prelude::*;

use super::Volume;
use crate::cells::{CellGrid, Component, Edges, Level, filled_layer};

/// Sides of a cell, mm.
const CELL_MM: f64 = 2.0;
/// Lowest value of tissue, HU.
const TISSUE_HU: i16 = -300;
/// Lowest value of sheets and covers, HU, which are thinner than a voxel.
const SHEET_HU: i16 = -750;
/// Parts are separated after this much was taken from their surfaces, mm.
const ERODED_MM: f64 = 2.5;
/// Largest distance to the surface in a part that is thick, mm: half a little finger.
const THICK_MM: f64 = 6.0;
/// Tissue within this distance of a thick part belongs to it, mm.
const SKIN_MM: f64 = 6.0;
/// Shortest piece of a table, mm.
const PIECE_MM: f64 = 60.0;
/// The faint surroundings of a table, which go with it, mm: blurred edges and covers.
const SURROUNDINGS_MM: f64 = 6.0;
/// The margin around everything that stays, mm.
const MARGIN_MM: f64 = 2.6;
/// HU where the table was.
const AIR_HU: i16 = -1000;

/// The cells of a volume's table.
#[derive(Clone, Debug)]
pub struct Table {
    grid: CellGrid,
    is_table: Vec<bool>,
}

impl Table {
    /// The table of a volume; `None` without one.
    #[must_use]
    pub fn find(volume: &Volume) -> Option<Self> {
        let grid = CellGrid::of(volume, CELL_MM);
        if u32::try_from(grid.dims.iter().product::<usize>()).is_err() {
            return None;
        }
        let levels = [Level { hu: TISSUE_HU, of_voxels: 3 }, Level { hu: SHEET_HU, of_voxels: 6 }];
        let [tissue, mut sheets] = grid.at_least(volume, levels);
        let body = body(&grid, &tissue)?;
        let rest = tissue.par_iter().zip(&body).with_min_len(1 << 16);
        let rest: Vec<bool> = rest.map(|(tissue, body)| *tissue && !body).collect();
        let beside_body = grid.within(&body, MARGIN_MM);
        let (mut table, mut kept) = (vec![false; rest.len()], body);
        for piece in grid.components(&rest, true) {
            let set = match grid.extent_mm(&piece) >= PIECE_MM {
                true => &mut table,
                false if piece.meets(&beside_body) => &mut kept,
                // Part of a sheet, or alone.
                false => continue,
            };
            piece.join(set);
        }
        if !table.contains(&true) {
            return None;
        }
        let kept = grid.within(&kept, MARGIN_MM);
        // The inside of a couch goes with its shells.
        let mut table = grid.filled(&table);
        sheets.iter_mut().zip(&kept).for_each(|(sheet, kept)| *sheet &= !kept);
        for piece in grid.components(&sheets, true) {
            if grid.extent_mm(&piece) >= PIECE_MM {
                piece.join(&mut table);
            }
        }
        let around = grid.within(&table, SURROUNDINGS_MM);
        let is_table = around.into_par_iter().zip(kept).with_min_len(1 << 16);
        let is_table = is_table.map(|(around, kept)| around && !kept).collect();
        Some(Self { grid, is_table })
    }

    /// Whether a voxel belongs to the table or its surroundings.
    #[must_use]
    pub fn contains(&self, voxel: [usize; 3]) -> bool {
        let [nx, ny, _] = self.grid.dims;
        let [i, j, k]: [usize; 3] = std::array::from_fn(|axis| voxel[axis] / self.grid.edges[axis]);
        self.is_table[i + nx * (j + ny * k)]
    }

    /// The values of a volume with air in place of the table.
    pub(super) fn removed_from(&self, volume: &Volume) -> Vec<i16> {
        let [nx, ny, _] = volume.grid().dims();
        let [ex, ey, ez] = self.grid.edges;
        let [cx, cy, _] = self.grid.dims;
        let mut values = vec![0; volume.voxels_hu().len()];
        let rows = values.par_chunks_exact_mut(nx).zip(volume.voxels_hu().par_chunks_exact(nx));
        rows.enumerate().for_each(|(row, (values, from))| {
            values.copy_from_slice(from);
            let (j, k) = (row % ny / ey, row / ny / ez);
            let cells = &self.is_table[cx * (j + cy * k)..][..cx];
            for (run, _) in values.chunks_mut(ex).zip(cells).filter(|(_, is_table)| **is_table) {
                run.fill(AIR_HU);
            }
        });
        values
    }
}

/// The cells of the patient: thick parts with their skin and inside, and hollow objects. `None` without
/// such cells.
fn body(grid: &CellGrid, tissue: &[bool]) -> Option<Vec<bool>> {
    let eroded = grid.deeper_than(tissue, ERODED_MM);
    let thick = grid.at_least_deep(tissue, THICK_MM);
    let mut seeds = vec![false; tissue.len()];
    for part in grid.components(&eroded, false) {
        if part.meets(&thick) {
            part.join(&mut seeds);
        }
    }
    let mut near = grid.within(&seeds, SKIN_MM);
    near.par_iter_mut().zip(tissue).with_min_len(1 << 16).for_each(|(near, tissue)| *near &= tissue);
    let mut body = vec![false; near.len()];
    // Connected by tissue: a shell below a gap of air is no skin.
    for part in grid.components(&near, false) {
        if part.meets(&seeds) {
            part.join(&mut body);
        }
    }
    for object in grid.components(tissue, false) {
        if is_hollow(grid, &object) {
            object.join(&mut body);
        }
    }
    body.contains(&true).then(|| grid.filled(&body))
}

/// Whether an object is closed and round, and mostly empty inside, over 30 mm of slices. A couch is
/// closed as well, but flat.
fn is_hollow(grid: &CellGrid, object: &Component) -> bool {
    const LEAST_SIDE_MM: f64 = 60.0;
    const LEAST_LENGTH_MM: f64 = 30.0;
    let [first, last] = object.bounds;
    let sides: [usize; 2] = std::array::from_fn(|axis| last[axis] + 1 - first[axis]);
    let sides_mm: [f64; 2] = std::array::from_fn(|axis| sides[axis] as f64 * grid.spacing_mm[axis]);
    // A shell fills some percent of its box. Thinner objects are not tried: there could be thousands,
    // each with the box of the whole volume.
    let box_cells = sides[0] * sides[1] * (last[2] + 1 - first[2]);
    if sides_mm[0].min(sides_mm[1]) < LEAST_SIDE_MM || object.len() < box_cells / 100 {
        return false;
    }
    let layer = |k: usize| {
        let mut layer = vec![false; sides[0] * sides[1]];
        for run in object.runs_in(k * grid.layer_cells()..(k + 1) * grid.layer_cells()) {
            let [i, j, _] = grid.place(run.start);
            let start = i - first[0] + sides[0] * (j - first[1]);
            layer[start..start + run.len()].fill(true);
        }
        layer
    };
    let is_round = |layer: Vec<bool>| {
        let filled = filled_layer(&layer, sides, Edges::All);
        let count = |set: &[bool]| set.iter().filter(|is_in| **is_in).count();
        let [wide, high] = extent(&filled, sides[0]);
        let [wide_mm, high_mm] = [wide as f64 * grid.spacing_mm[0], high as f64 * grid.spacing_mm[1]];
        count(&filled) >= 2 * count(&layer)
            && 2 * count(&filled) >= wide * high
            && wide_mm.min(high_mm) >= LEAST_SIDE_MM
            && wide_mm.min(high_mm) >= 0.4 * wide_mm.max(high_mm)
    };
    let round = (first[2]..=last[2]).into_par_iter().filter(|&k| is_round(layer(k))).count();
    round as f64 * grid.spacing_mm[2] >= LEAST_LENGTH_MM
}

/// Width and height of the box around a layer's cells.
fn extent(layer: &[bool], width: usize) -> [usize; 2] {
    let (mut columns, mut rows) = ([usize::MAX, 0], [usize::MAX, 0]);
    for (j, row) in layer.chunks_exact(width).enumerate() {
        let Some(first) = row.iter().position(|is_in| *is_in) else { continue };
        let last = row.iter().rposition(|is_in| *is_in).unwrap_or(first);
        columns = [columns[0].min(first), columns[1].max(last + 1)];
        rows = [rows[0].min(j), j + 1];
    }
    [columns, rows].map(|[low, high]| high.saturating_sub(low))
}

#[cfg(test)]
mod tests;
