// One dispatch's parameters of the path tracer: passes, light, medium.
//
// Spaces: start space (see frame.wgsl), mm. Light: linear, 1 is white.

const MAX_LIGHTS: u32 = 4u;

struct PathLight {
    // Start space: unit vector towards a distant light, or the place of a near one.
    toward: vec3<f32>,
    is_near: u32,
    // Linear colour times intensity.
    radiance: vec3<f32>,
    // Cosine of half the angle that the light fills as seen from anywhere.
    cos_half: f32,
}

struct Path {
    // The passes of this dispatch: the first and their number. The sum holds all earlier passes.
    first_pass: u32,
    passes: u32,
    seed: u32,
    light_count: u32,
    // Linear light from everywhere.
    environment: vec3<f32>,
    // The factor of sums before they are written.
    exposure: f32,
    // Linear light behind everything; not exposed.
    background: vec3<f32>,
    // Mean cosine of the medium's scattering.
    anisotropy: f32,
    // Largest share of a surface, and the gradient at which it is half of that.
    surface: f32,
    surface_hu_per_mm: f32,
    // The medium table: HU of entry 0, HU per entry, index of the last entry.
    table_first_hu: f32,
    table_step_hu: f32,
    table_last: u32,
    // Edge of a brick in voxels.
    brick_edge: u32,
    // How often a path may scatter, at least once.
    scatterings: u32,
    padding: u32,
    lights: array<PathLight, MAX_LIGHTS>,
}

@group(1) @binding(0) var<uniform> path: Path;
