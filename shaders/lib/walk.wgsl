// Empty space: from one sample of a ray to the next that may show something.
//
// Spaces: bricks (brick index; a brick is `1 / bricks_per_voxel` voxels wide) and sample numbers.
// Always a whole number of samples is skipped, so that those that are taken lie where they would
// without skipping.

// Chebyshev distance in bricks to the nearest brick with something visible, a byte each, four to a
// word, i fastest; 0 where there is something.
@group(0) @binding(3) var<storage, read> brick_distances: array<u32>;

// Everything about a ray and the bricks that is linear in the sample's number.
struct Walk {
    // Brick position of sample 0, and bricks from sample to sample.
    brick: vec3<f32>,
    brick_step: vec3<f32>,
    // The ray leaves the cube of bricks nearer than d to brick b at sample b * per_brick + d *
    // per_distance + constant.
    per_brick: vec3<f32>,
    per_distance: vec3<f32>,
    constant: vec3<f32>,
    // The sphere that is cut away hides the samples from the first number on, up to and without the
    // second.
    cut_first: f32,
    cut_end: f32,
}

// Whether a sphere is cut away. Without a sphere this is not evaluated.
override CUT_AWAY: bool = false;
// A ray that moves less than this many voxels a sample along an axis never leaves a brick through
// that axis' faces.
const STILL: f32 = 1e-7;
// Skips end this much before the face, in samples, so that rounding never takes them beyond it.
const BEFORE_FACE: f32 = 0.01;
// Further than any ray has samples.
const NEVER: f32 = 1e6;

fn walk_of(ray: Ray) -> Walk {
    var walk: Walk;
    walk.brick = ray.first_voxel * frame.bricks_per_voxel;
    walk.brick_step = ray.sample_voxels * frame.bricks_per_voxel;
    let still = abs(ray.sample_voxels) < vec3<f32>(STILL);
    let samples_per_brick = select(1.0 / walk.brick_step, vec3<f32>(0.0), still);
    // The cube spans bricks b - (d - 1) to b + (d - 1): its far face is b + d ahead, b + 1 - d
    // behind.
    let forward = walk.brick_step > vec3<f32>(0.0);
    walk.per_brick = samples_per_brick;
    walk.per_distance = select(-samples_per_brick, samples_per_brick, forward);
    let face = select(samples_per_brick, vec3<f32>(0.0), forward);
    walk.constant = select(face - walk.brick * samples_per_brick, vec3<f32>(NEVER), still) - BEFORE_FACE;
    walk.cut_first = floor((ray.cut_in - ray.first) / frame.sample_distance_mm) + 1.0;
    walk.cut_end = ceil((ray.cut_out - ray.first) / frame.sample_distance_mm);
    return walk;
}

// Whether the sphere hides sample k.
fn is_hidden(walk: Walk, k: f32) -> bool {
    return CUT_AWAY && k >= walk.cut_first && k < walk.cut_end;
}

// How many of a ray's samples the sphere hides.
fn hidden_count(walk: Walk, count: f32) -> f32 {
    if !CUT_AWAY {
        return 0.0;
    }
    return max(clamp(walk.cut_end, 0.0, count) - clamp(walk.cut_first, 0.0, count), 0.0);
}

// The first sample from k on that is not certain to be invisible: k itself when its brick may show
// something.
fn next_sample(walk: Walk, k: f32) -> f32 {
    if is_hidden(walk, k) {
        return walk.cut_end;
    }
    return next_in_bricks(walk, k);
}

// The same whatever the sphere hides.
fn next_in_bricks(walk: Walk, k: f32) -> f32 {
    let brick = max(floor(walk.brick + walk.brick_step * k), vec3<f32>(0.0));
    let at = u32(i32((brick.z * frame.brick_dims.y + brick.y) * frame.brick_dims.x + brick.x));
    var distance = f32((brick_distances[at >> 2u] >> ((at & 3u) * 8u)) & 255u);
    if PRE_INTEGRATED {
        // A sample's path reaches into neighbouring bricks, which have to be empty too; half a path
        // is no longer than a brick.
        distance = max(distance - 1.0, 0.0);
    }
    if distance == 0.0 || frame.skipping == 0u {
        return k;
    }
    let leave = brick * walk.per_brick + distance * walk.per_distance + walk.constant;
    return max(k + 1.0, ceil(min(min(leave.x, leave.y), min(leave.z, NEVER))));
}
