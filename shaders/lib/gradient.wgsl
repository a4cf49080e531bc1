// Opacity by gradient.
//
// Behind the transfer table's entries lie one of two numbers, entries per HU/mm and a sample's path
// in opacity units, and then the opacity by magnitude. Where it is used, the table's own opacities
// are per opacity unit.

override GRADIENT_OPACITY: bool = false;

const GRADIENT_LAST: u32 = 1023u;

// The factor of a value's opacity at voxel index p.
fn gradient_factor(p: vec3<f32>) -> f32 {
    let head = frame.table_last + 1u;
    let x = min(length(gradient_at(p)) * transfer_table[head].x, f32(GRADIENT_LAST));
    let i = min(u32(x), GRADIENT_LAST - 1u);
    return mix(transfer_table[head + 1u + i].x, transfer_table[head + 2u + i].x, x - f32(i));
}

// Opacity of one sample from that of its value, per opacity unit, and its factor.
fn modulated(opacity: f32, factor: f32) -> f32 {
    return 1.0 - pow(max(1.0 - opacity * factor, 1e-30), transfer_table[frame.table_last + 1u].y);
}

// The inputs of the opacity of a sample at a voxel index: its value, HU, and its factor.
fn opacity_basis(p: vec3<f32>) -> vec2<f32> {
    let hu = sample_hu(p);
    if GRADIENT_OPACITY && hu >= frame.lowest_visible_hu {
        return vec2<f32>(hu, gradient_factor(p));
    }
    return vec2<f32>(hu, 1.0);
}

// Opacity of the sample at a voxel index from its inputs; the opacity of its segment is looked up
// here.
fn opacity_from(p: vec3<f32>, basis: vec2<f32>) -> f32 {
    let opacity = opacity_of_label(p, basis.x);
    if GRADIENT_OPACITY && opacity > 0.0 {
        return modulated(opacity, basis.y);
    }
    return opacity;
}

// Opacity of the sample at a voxel index.
fn voxel_opacity(p: vec3<f32>) -> f32 {
    return opacity_from(p, opacity_basis(p));
}
