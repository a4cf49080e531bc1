//! The outline of the scanner's table in slices: pictures leave the table out, slices show it.
//!
//! A pixel belongs to the outline when the table covers it and one of its neighbours is beside the
//! table. Drawn on the CPU after read-back, at the depth of the slice's plane. Slabs are marked by
//! their middle plane. Spaces: pixels, columns from the left, rows from the top; voxel index.

use super::frame::RenderedFrame;
use relief_base::{Point, Transform, View, Voxel};
use relief_volume::{Grid, Table};

/// Amber: neither a grey of a slice nor a usual colour of a segment.
pub(super) const MARK_RGBA: [u8; 4] = [255, 176, 0, 255];

/// Draws the outline of the table into a slice.
pub(super) fn draw(frame: &mut RenderedFrame, grid: &Grid, table: &Table) {
    let [width, height] = frame.size_px.map(|side| side as usize);
    let depth_mm = frame.camera.distance_mm();
    let voxel_from_view = grid.voxel_from_patient() * frame.camera.patient_from_view();
    let [half_x, half_y] = frame.camera.half_extent(frame.size_px);
    let on_plane = |column: usize, row: usize| {
        let x = (2.0 * (column as f64 + 0.5) / width as f64 - 1.0) * half_x;
        let y = (1.0 - 2.0 * (row as f64 + 0.5) / height as f64) * half_y;
        Point::new(x, y, -depth_mm)
    };
    let is_table: Vec<bool> = (0..width * height)
        .map(|at| covers(table, grid.dims(), voxel_from_view, on_plane(at % width, at / width)))
        .collect();
    let beside = |column: usize, row: usize| {
        let neighbours = [
            (column.wrapping_sub(1), row),
            (column + 1, row),
            (column, row.wrapping_sub(1)),
            (column, row + 1),
        ];
        neighbours.into_iter().any(|(x, y)| x < width && y < height && !is_table[y * width + x])
    };
    for at in (0..width * height).filter(|&at| is_table[at] && beside(at % width, at / width)) {
        frame.color_rgba[at] = MARK_RGBA;
        frame.depth_mm[at] = depth_mm as f32;
    }
}

/// Whether the table covers the voxel around a point.
fn covers(
    table: &Table,
    dims: [usize; 3],
    voxel_from_view: Transform<Voxel, View>,
    point: Point<View>,
) -> bool {
    let nearest = (voxel_from_view * point).xyz.round().to_array();
    let inside = (0..3).all(|axis| nearest[axis] >= 0.0 && nearest[axis] < dims[axis] as f64);
    inside && table.contains(nearest.map(|index| index as usize))
}
