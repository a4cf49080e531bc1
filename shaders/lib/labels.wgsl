// Labels: each segment of a label map has its own transfer function, tint and visibility.
//
// Spaces: voxel index. The label map lies on the volume's grid. Behind the table's own entries lie
// the looks, two entries for each place in the list of segments, the first for voxels without a
// segment, and behind them the tables of further transfer functions. The twins of the functions
// here have the same names in `render::processor::segments`.

override LABELLED: bool = false;
// Whether edges between segments run through voxels, where most of a voxel's surroundings change
// sides, or around them.
override SMOOTH_EDGES: bool = true;

// Places in the list of segments, counted from 1; 0 for voxels without a segment. A single texel
// where LABELLED is off.
@group(0) @binding(8) var labels: texture_3d<u32>;

// How a segment is shown.
struct Look {
    // HU of the first entry of its table, and entries per HU.
    first_hu: f32,
    entries_per_hu: f32,
    // The table's first entry, and how many lie behind that one: 0 for a segment that is not shown.
    first: u32,
    last: u32,
    // The part added to a colour, and the share of the colour that stays.
    tint: vec4<f32>,
}

// The place in the list of segments at a voxel index.
fn place_at(p: vec3<f32>) -> u32 {
    let top = vec3<i32>(frame.dims) - 1;
    if !SMOOTH_EDGES {
        return textureLoad(labels, clamp(vec3<i32>(floor(p + 0.5)), vec3<i32>(0), top), 0).x;
    }
    return weightiest(p, top);
}

// Of the eight voxels around a position, the segment whose voxels have the greatest trilinear
// weight together; between two segments that is a surface as smooth as an isosurface of the volume.
fn weightiest(p: vec3<f32>, top: vec3<i32>) -> u32 {
    let base = floor(p);
    let low = clamp(vec3<i32>(base), vec3<i32>(0), top);
    let high = clamp(vec3<i32>(base) + 1, vec3<i32>(0), top);
    var places: array<u32, 8>;
    var differ = 0u;
    for (var corner = 0u; corner < 8u; corner++) {
        let is_high = (vec3<u32>(corner) >> vec3<u32>(0u, 1u, 2u) & vec3<u32>(1u)) == vec3<u32>(1u);
        places[corner] = textureLoad(labels, select(low, high, is_high), 0).x;
        differ |= places[corner] ^ places[0];
    }
    if differ == 0u {
        return places[0];
    }
    let share = p - base;
    var best = 0u;
    var greatest = -1.0;
    for (var corner = 0u; corner < 8u; corner++) {
        var weight = 0.0;
        for (var other = 0u; other < 8u; other++) {
            if places[other] == places[corner] {
                let is_high = (vec3<u32>(other) >> vec3<u32>(0u, 1u, 2u) & vec3<u32>(1u)) == vec3<u32>(1u);
                let shares = select(1.0 - share, share, is_high);
                weight += shares.x * shares.y * shares.z;
            }
        }
        if weight > greatest {
            greatest = weight;
            best = places[corner];
        }
    }
    return best;
}

fn look_at(p: vec3<f32>) -> Look {
    let at = frame.table_last + 1u + 2u * place_at(p);
    let table = transfer_table[at];
    return Look(table.x, table.y, u32(table.z), u32(table.w), transfer_table[at + 1u]);
}

// Whether the segment at a voxel index is visible.
fn is_shown(p: vec3<f32>) -> bool {
    if !LABELLED {
        return true;
    }
    return transfer_table[frame.table_last + 1u + 2u * place_at(p)].w > 0.0;
}

// Colour and opacity of a value at a voxel index.
fn classify_at(p: vec3<f32>, hu: f32) -> vec4<f32> {
    if !LABELLED {
        return classify(hu);
    }
    let look = look_at(p);
    if look.last == 0u {
        return vec4<f32>(0.0);
    }
    let x = clamp((hu - look.first_hu) * look.entries_per_hu, 0.0, f32(look.last));
    let i = min(u32(x), look.last - 1u);
    let sample = mix(transfer_table[look.first + i], transfer_table[look.first + i + 1u], x - f32(i));
    return vec4<f32>(sample.rgb * look.tint.w + look.tint.rgb, sample.a);
}

// Opacity of a value at a voxel index.
fn opacity_of_label(p: vec3<f32>, hu: f32) -> f32 {
    if !LABELLED {
        return opacity_of(hu);
    }
    return classify_at(p, hu).a;
}
