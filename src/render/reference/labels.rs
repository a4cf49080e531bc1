//! Segments of a label map; twin of `shaders/lib/labels.wgsl`. Positions are voxel indices, values
//! HU.

use glam::{DVec3, DVec4};

use super::classify::classify;
use crate::labels::{Edges, Labels};
use crate::tables::Tables;

/// Colour and opacity of a value at a position.
pub(super) fn classify_at(tables: &Tables, labels: Option<&Labels>, p: DVec3, hu: f64) -> DVec4 {
    let Some(labels) = labels else { return classify(&tables.own, hu) };
    let look = labels.looks[place_at(labels, p)];
    if !look.visible {
        return DVec4::ZERO;
    }
    let sample = classify(tables.of(&look), hu);
    let rgb = sample.truncate() * (1.0 - look.tint) + DVec3::from(look.tint_rgb) * look.tint;
    rgb.extend(sample.w)
}

/// The place in the list of segments at a position.
pub(super) fn place_at(labels: &Labels, p: DVec3) -> usize {
    let [nx, ny, nz] = labels.map.grid().dims();
    let top = DVec3::new(nx as f64, ny as f64, nz as f64) - 1.0;
    let place = |voxel: DVec3| {
        let [i, j, k] = voxel.clamp(DVec3::ZERO, top).to_array().map(|x| x as usize);
        labels.map.places().at((k * ny + j) * nx + i)
    };
    if labels.edges == Edges::Voxels {
        return place((p + 0.5).floor());
    }
    let (base, share) = (p.floor(), p - p.floor());
    let corner = |n: u32| DVec3::from([0, 1, 2].map(|axis| f64::from(n >> axis & 1)));
    let places: [usize; 8] = std::array::from_fn(|n| place(base + corner(n as u32)));
    let weight = |n: u32| {
        let high = corner(n);
        (high * share + (1.0 - high) * (1.0 - share)).to_array().into_iter().product::<f64>()
    };
    let together = |of: usize| -> f64 { (0..8).filter(|&n| places[n as usize] == of).map(weight).sum() };
    let mut best = (0, -1.0);
    for of in places {
        let weight = together(of);
        if weight > best.1 {
            best = (of, weight);
        }
    }
    best.0
}
