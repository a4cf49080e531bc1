// Values and gradients of the volume, and how far empty bricks reach.
//
// Spaces: voxel index in, HU out. Values are trilinear between voxel centres and clamp outside the outermost ones.

@group(0) @binding(1) var volume: texture_3d<f32>;
@group(0) @binding(2) var volume_sampler: sampler;
// Chebyshev distance in bricks to the nearest brick with something visible; 0 where there is something.
@group(0) @binding(3) var brick_distances: texture_3d<u32>;

// HU of a texel value of 1: 32767 for signed normalised 16 bit, 1 for floating point.
override HU_SCALE: f32 = 32767.0;

fn sample_hu(p: vec3<f32>) -> f32 {
    return textureSampleLevel(volume, volume_sampler, (p + 0.5) / frame.dims, 0.0).x * HU_SCALE;
}

// Central differences over one voxel to both sides: HU per two voxels, along i, j, k.
fn gradient_hu(p: vec3<f32>) -> vec3<f32> {
    let x = vec3<f32>(1.0, 0.0, 0.0);
    let y = vec3<f32>(0.0, 1.0, 0.0);
    let z = vec3<f32>(0.0, 0.0, 1.0);
    return vec3<f32>(
        sample_hu(p + x) - sample_hu(p - x),
        sample_hu(p + y) - sample_hu(p - y),
        sample_hu(p + z) - sample_hu(p - z),
    );
}

// How many samples from the one at `p` on are certain to be invisible; 0 when the brick may show something.
//
// A whole number of samples, so that those that are taken lie where they would without skipping. All bricks nearer
// than the distance d of this one are empty: the ray is followed to the far face of that cube of 2 d - 1 bricks.
// One hundredth of a sample short of it, so that rounding never skips a sample beyond the face.
fn samples_to_skip(p: vec3<f32>, ray: Ray) -> i32 {
    if frame.brick_edge == 0u {
        return 0;
    }
    let edge = f32(frame.brick_edge);
    let last = vec3<f32>(textureDimensions(brick_distances)) - 1.0;
    let brick = clamp(floor(p / edge), vec3<f32>(0.0), last);
    let distance = f32(textureLoad(brick_distances, vec3<i32>(brick), 0).x);
    if distance == 0.0 {
        return 0;
    }
    let step = ray.step_voxel;
    let forward = step > vec3<f32>(0.0);
    let face = select(brick - (distance - 1.0), brick + distance, forward) * edge;
    let away = select((face - p) / step, vec3<f32>(1e30), abs(step) < vec3<f32>(1e-12));
    let reach = min(min(away.x, away.y), away.z) / frame.sample_distance_mm;
    return 1 + i32(max(0.0, floor(min(reach, 1e6) - 0.01)));
}
