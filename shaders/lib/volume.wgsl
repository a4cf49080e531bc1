// Values and gradients of the volume.
//
// Spaces: voxel index in; HU, and HU/mm along the patient axes out. Values are trilinear between
// voxel centres and clamp outside the outermost ones.

@group(0) @binding(1) var volume: texture_3d<f32>;
@group(0) @binding(2) var volume_sampler: sampler;
// Gradients of the voxels along the patient axes, and their values; a single texel where
// PRECOMPUTED_GRADIENTS is off.
@group(0) @binding(7) var gradients: texture_3d<f32>;

// HU of a texel value of 1: 32767 for signed normalised 16 bit, 1 for floating point.
override HU_SCALE: f32 = 32767.0;

fn sample_hu(p: vec3<f32>) -> f32 {
    return textureSampleLevel(volume, volume_sampler, (p + 0.5) * frame.texture_per_voxel, 0.0).x * HU_SCALE;
}

// One fetch of gradients made when the volume went up, or six of values.
override PRECOMPUTED_GRADIENTS: bool = true;

// HU/mm along the patient axes.
fn gradient_at(p: vec3<f32>) -> vec3<f32> {
    if PRECOMPUTED_GRADIENTS {
        return gradient_and_hu(p).xyz;
    }
    return frame.patient_from_voxel_gradient * central_differences(p);
}

// Gradient, HU/mm along the patient axes, and value, HU, by one fetch of precomputed ones.
fn gradient_and_hu(p: vec3<f32>) -> vec4<f32> {
    let texel = textureSampleLevel(gradients, volume_sampler, (p + 0.5) * frame.texture_per_voxel, 0.0);
    return texel * vec4<f32>(vec3<f32>(frame.gradient_scale), HU_SCALE);
}

// Over one voxel to both sides: HU per two voxels, along i, j, k. Beyond the outermost voxel centres
// they are those of the nearest point between them, as interpolation of precomputed ones has it.
fn central_differences(position: vec3<f32>) -> vec3<f32> {
    let p = clamp(position, vec3<f32>(0.0), frame.dims - 1.0);
    let x = vec3<f32>(1.0, 0.0, 0.0);
    let y = vec3<f32>(0.0, 1.0, 0.0);
    let z = vec3<f32>(0.0, 0.0, 1.0);
    return vec3<f32>(
        sample_hu(p + x) - sample_hu(p - x),
        sample_hu(p + y) - sample_hu(p - y),
        sample_hu(p + z) - sample_hu(p - z),
    );
}
