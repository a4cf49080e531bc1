// Opacity by gradient.
//
// Behind the transfer table's entries lie one of two numbers, entries per HU/mm and a sample's path in opacity units, and
// then the opacity by magnitude. Where it is used, the table's own opacities are per opacity unit.

override GRADIENT_OPACITY: bool = false;

const GRADIENT_LAST: u32 = 1023u;

// Opacity of one sample at voxel index p from that of its value, per opacity unit.
fn modulated(opacity: f32, p: vec3<f32>) -> f32 {
    if opacity <= 0.0 {
        return 0.0;
    }
    let head = frame.table_last + 1u;
    let scale = transfer_table[head].xy;
    let x = min(length(gradient_at(p)) * scale.x, f32(GRADIENT_LAST));
    let i = min(u32(x), GRADIENT_LAST - 1u);
    let low = transfer_table[head + 1u + i].x;
    let high = transfer_table[head + 2u + i].x;
    let product = opacity * mix(low, high, x - f32(i));
    return 1.0 - pow(max(1.0 - product, 1e-30), scale.y);
}

// Opacity of the sample at a voxel index.
fn voxel_opacity(p: vec3<f32>) -> f32 {
    let opacity = opacity_of(sample_hu(p));
    if GRADIENT_OPACITY {
        return modulated(opacity, p);
    }
    return opacity;
}
