// Measures how fast this driver filters: parallel rays through the volume, nothing but trilinear
// fetches.
//
// The sum is written out so that no fetch can be dropped. Neighbouring rays are about a voxel
// apart, as in a picture.

@group(0) @binding(0) var plain_volume: texture_3d<f32>;
@group(0) @binding(1) var plain_sampler: sampler;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

const SIDE: u32 = 320u;
const STEPS: u32 = 192u;

@compute @workgroup_size(8, 8)
fn calibrate(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= vec2<u32>(SIDE)) {
        return;
    }
    let start = vec3<f32>((vec2<f32>(id.xy) + 0.5) / f32(SIDE), 0.0);
    // A slight slope, so that fetches do not fall on voxel centres.
    let step = vec3<f32>(0.0003, 0.0002, 1.0 / f32(STEPS));
    var sum = 0.0;
    for (var k = 0u; k < STEPS; k++) {
        sum += textureSampleLevel(plain_volume, plain_sampler, start + step * f32(k), 0.0).x;
    }
    sums[id.y * SIDE + id.x] = sum;
}
