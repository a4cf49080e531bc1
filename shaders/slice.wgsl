// Cuts the volume by a plane across the viewing axis, or by a slab around it: colour over the
// background, and view depth in mm.
//
// The twins of the functions here have the same names in `render::processor::slice`. Rays and the
// volume's box are those of lib/frame.wgsl, so clip planes hold here too. Samples lie on the plane
// and, in pairs, before and behind it up to the faces of the slab; those outside the volume or
// clipped are left out.

override BLEND: u32 = 0u;
// Writes the number of volume samples in place of the depth, for measuring.
override COUNT_SAMPLES: bool = false;

const BLEND_MEAN: u32 = 0u;
const BLEND_MIP: u32 = 1u;

// Bending below this, in HU per squared sample distance, is rounding.
const FLAT_HU: f32 = 0.05;
const MISS: f32 = 0x1p+127f;

struct Slab {
    // Distance of the plane along every ray, mm.
    plane_t: f32,
    // Between neighbouring samples, mm.
    spacing_mm: f32,
    // Samples before the plane, and as many behind it.
    pairs: u32,
    padding: u32,
}

// Rows from the top: red, green, blue, coverage as bytes from the lowest on.
@group(0) @binding(5) var<storage, read_write> color_out: array<u32>;
// Rows from the top: view depth in mm; anything above 1e38 is a miss.
@group(0) @binding(6) var<storage, read_write> depth_out: array<f32>;
@group(0) @binding(9) var<uniform> slab: Slab;

// The result of a ray in the slab.
struct Cut {
    hu: f32,
    // Distance along the ray, mm; MISS when no sample is inside.
    t: f32,
    // Voxel index whose segment it has.
    p: vec3<f32>,
    samples: u32,
}

@compute @workgroup_size(8, 8)
fn slice(@builtin(global_invocation_id) place: vec3<u32>) {
    let id = place.xy + vec2<u32>(frame.first_column, frame.first_row);
    if any(id >= frame.size_px) {
        return;
    }
    let ray = ray_of_pixel(id);
    var cut: Cut;
    if BLEND == BLEND_MEAN {
        cut = mean_of_slab(ray);
    } else {
        cut = extreme_of_slab(ray);
    }
    var color = vec4<f32>(0.0);
    if cut.t < MISS {
        color = classify_at(cut.p, cut.hu);
    }
    let over = mix(frame.background_rgb, color.rgb, color.a);
    let at = id.y * frame.size_px.x + id.x;
    color_out[at] = pack4x8unorm(vec4<f32>(over, color.a));
    if COUNT_SAMPLES {
        depth_out[at] = f32(cut.samples);
    } else {
        depth_out[at] = select(view_depth(ray, cut.t), MISS, cut.t >= MISS);
    }
}

// Whether a sample is inside the visible part.
fn is_inside(ray: Ray, t: f32) -> bool {
    return t >= ray.entry && t <= ray.exit && !is_cut(ray, t) && is_shown(voxel_at(ray, t));
}

// Distance of sample k, counted from the plane: negative ones are before it.
fn slab_t(k: i32) -> f32 {
    return slab.plane_t + f32(k) * slab.spacing_mm;
}

// The mean over the part inside the slab, by the trapezoidal rule: samples on its faces count half.
fn mean_of_slab(ray: Ray) -> Cut {
    let pairs = i32(slab.pairs);
    var cut = Cut(0.0, MISS, vec3<f32>(0.0), 0u);
    var weights = 0.0;
    for (var k = -pairs; k <= pairs; k++) {
        let t = slab_t(k);
        if is_inside(ray, t) {
            let weight = select(1.0, 0.5, pairs > 0 && abs(k) == pairs);
            cut.hu += weight * sample_hu(voxel_at(ray, t));
            cut.samples += 1u;
            weights += weight;
        }
    }
    if weights > 0.0 {
        cut.hu /= weights;
        // The plane itself, or the part of the slab next to it where the plane is outside.
        cut.t = clamp(slab.plane_t, ray.entry, ray.exit);
        cut.p = voxel_at(ray, cut.t);
    }
    return cut;
}

// The largest value in the slab, or the smallest; from the plane outwards, so that of equal ones
// the nearest to it.
fn extreme_of_slab(ray: Ray) -> Cut {
    let sign = select(-1.0, 1.0, BLEND == BLEND_MIP);
    var cut = Cut(0.0, MISS, vec3<f32>(0.0), 0u);
    var best = -1e30;
    for (var k = 0; k <= i32(slab.pairs); k++) {
        for (var side = -1; side <= 1; side += 2) {
            let t = slab_t(side * k);
            if (k > 0 || side > 0) && is_inside(ray, t) {
                let value = sign * sample_hu(voxel_at(ray, t));
                cut.samples += 1u;
                if value > best {
                    best = value;
                    cut.t = t;
                }
            }
        }
    }
    if cut.samples > 0u {
        cut.hu = sign * best;
        cut.p = voxel_at(ray, cut.t);
        cut.t = top_t(ray, cut.t, best, sign);
    }
    return cut;
}

// The top of the parabola through the extreme sample and its neighbours, at most half a sample away
// and inside the slab.
fn top_t(ray: Ray, t: f32, best: f32, sign: f32) -> f32 {
    let before = sign * sample_hu(voxel_at(ray, t - slab.spacing_mm));
    let after = sign * sample_hu(voxel_at(ray, t + slab.spacing_mm));
    let curvature = before - 2.0 * best + after;
    var offset = 0.0;
    if curvature < -FLAT_HU {
        offset = clamp(0.5 * (before - after) / curvature, -0.5, 0.5);
    }
    let pairs = i32(slab.pairs);
    let low = max(ray.entry, slab_t(-pairs));
    let high = min(ray.exit, slab_t(pairs));
    return clamp(t + offset * slab.spacing_mm, low, high);
}
