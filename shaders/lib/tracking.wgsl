// Where light collides on its way through the volume, and how much of it passes.
//
// Extinction is per mm. Flight uses delta tracking and transmittance uses ratio tracking, both
// brick by brick with the largest extinction that a brick can have. Where it is 0, the ray crosses
// the whole empty cube around the brick at once. Both are unbiased: the bound of a brick changes
// the number of steps, not the mean.
//
// Spaces: start space (see frame.wgsl) in mm, and voxel index.

// Above 0: the brick's largest extinction per mm. Else: minus the Chebyshev distance to the nearest
// visible brick.
@group(1) @binding(1) var brick_bounds: texture_3d<f32>;
// Linear red, green, blue and extinction per mm, by HU.
@group(1) @binding(2) var<storage, read> medium_table: array<vec4<f32>>;

const NO_COLLISION: f32 = 0x1p+127f;
// Rays step over faces by this many voxels, so that the next look-up is beyond the face.
const ACROSS_VOXELS: f32 = 1e-3;
// Light below this share plays for its life: it ends, or goes on twice as strong.
const FAINT: f32 = 0.05;

// Points origin + direction * t in start space, for t from `begin` to `end` mm.
struct Segment {
    origin_voxel: vec3<f32>,
    step_voxel: vec3<f32>,
    begin: f32,
    end: f32,
    // A distance that crosses a face for certain, mm.
    across: f32,
}

struct Brick {
    bound: f32,
    // Where the segment leaves it, or the empty cube around it.
    leave: f32,
}

// The part inside box and clip planes, at most `longest` mm.
fn segment_of(origin: vec3<f32>, direction: vec3<f32>, longest: f32) -> Segment {
    var segment: Segment;
    segment.origin_voxel = (frame.voxel_from_start * vec4<f32>(origin, 1.0)).xyz;
    segment.step_voxel = (frame.voxel_from_start * vec4<f32>(direction, 0.0)).xyz;
    let inside = box_interval(segment.origin_voxel, segment.step_voxel, 0.5);
    let kept = clip_interval(origin, direction, vec2<f32>(max(inside.x, 0.0), min(inside.y, longest)));
    segment.begin = kept.x;
    segment.end = kept.y;
    let fastest = max(max(abs(segment.step_voxel.x), abs(segment.step_voxel.y)), abs(segment.step_voxel.z));
    segment.across = ACROSS_VOXELS / max(fastest, 1e-20);
    return segment;
}

fn segment_voxel(segment: Segment, t: f32) -> vec3<f32> {
    return segment.origin_voxel + segment.step_voxel * t;
}

fn medium_at(hu: f32) -> vec4<f32> {
    let x = clamp((hu - path.table_first_hu) / path.table_step_hu, 0.0, f32(path.table_last));
    let i = min(u32(x), path.table_last - 1u);
    return mix(medium_table[i], medium_table[i + 1u], x - f32(i));
}

fn extinction_at(p: vec3<f32>) -> f32 {
    let hu = sample_hu(p);
    let x = clamp((hu - path.table_first_hu) / path.table_step_hu, 0.0, f32(path.table_last));
    let i = min(u32(x), path.table_last - 1u);
    return mix(medium_table[i].w, medium_table[i + 1u].w, x - f32(i));
}

fn brick_at(segment: Segment, t: f32) -> Brick {
    let edge = f32(path.brick_edge);
    let p = segment_voxel(segment, t);
    let last = vec3<f32>(textureDimensions(brick_bounds)) - 1.0;
    let index = clamp(floor(p / edge), vec3<f32>(0.0), last);
    let bound = textureLoad(brick_bounds, vec3<i32>(index), 0).x;
    let reach = max(-bound, 1.0);
    // The outermost bricks include the space outside them.
    let low = (index - (reach - 1.0)) * edge;
    let faces = select(select(low, vec3<f32>(-1.0), low <= vec3<f32>(0.0)), (index + reach) * edge,
        segment.step_voxel > vec3<f32>(0.0));
    let step = segment.step_voxel;
    let away = select((faces - p) / step, vec3<f32>(1e30), abs(step) < vec3<f32>(1e-12));
    let onwards = max(min(min(away.x, away.y), away.z), 0.0);
    return Brick(bound, t + onwards + max(segment.across, abs(t) * 1e-6));
}

// Exponentially distributed, mean 1; u in [0, 1).
fn optical_length(u: f32) -> f32 {
    return -log(1.0 - u);
}

// Distance of a collision, in proportion to the extinction and to the light that reaches it; or
// none.
fn free_flight(segment: Segment, random: ptr<function, Random>) -> f32 {
    var t = segment.begin;
    while t < segment.end {
        let brick = brick_at(segment, t);
        if brick.bound <= 0.0 {
            t = brick.leave;
            continue;
        }
        while t < brick.leave {
            let u = next_two(random);
            t += optical_length(u.x) / brick.bound;
            if t >= brick.leave || t >= segment.end {
                break;
            }
            if u.y * brick.bound < extinction_at(segment_voxel(segment, t)) {
                return t;
            }
        }
        // A flight beyond the face says no more than that it got there: the next brick starts anew.
        t = min(t, brick.leave);
    }
    return NO_COLLISION;
}

// An estimate of the share of light that passes, whose mean is exp(-optical depth).
fn transmittance(segment: Segment, random: ptr<function, Random>) -> f32 {
    var share = 1.0;
    var t = segment.begin;
    while t < segment.end {
        let brick = brick_at(segment, t);
        if brick.bound <= 0.0 {
            t = brick.leave;
            continue;
        }
        while t < brick.leave {
            let u = next_two(random);
            t += optical_length(u.x) / brick.bound;
            if t >= brick.leave || t >= segment.end {
                break;
            }
            share *= max(1.0 - extinction_at(segment_voxel(segment, t)) / brick.bound, 0.0);
            if share < FAINT {
                if u.y < 0.5 {
                    return 0.0;
                }
                share *= 2.0;
            }
        }
        t = min(t, brick.leave);
    }
    return share;
}
