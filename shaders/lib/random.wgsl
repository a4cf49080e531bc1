// Random numbers by counting: a hash of pixel, pass, seed and of how many were drawn before.
//
// No state outlives a path, so a number depends on nothing but those four: not on tiles, nor on how
// passes are grouped. The hash is pcg4d (Jarzynski and Olano, Hash Functions for GPU Rendering,
// JCGT 2020).

struct Random {
    column: u32,
    row: u32,
    // Pass and seed in one word: passes number below 2^16, seeds too.
    stream: u32,
    drawn: u32,
}

fn random_of(pixel: vec2<u32>, pass_number: u32, seed: u32) -> Random {
    return Random(pixel.x, pixel.y, pass_number | (seed << 16u), 0u);
}

fn pcg4d(key: vec4<u32>) -> vec4<u32> {
    var v = key * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> vec4<u32>(16u);
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// Two numbers in [0, 1), of 24 bits each.
fn next_two(random: ptr<function, Random>) -> vec2<f32> {
    let hash = pcg4d(vec4<u32>((*random).column, (*random).row, (*random).stream, (*random).drawn));
    (*random).drawn += 1u;
    return vec2<f32>(hash.xy >> vec2<u32>(8u)) * 0x1p-24f;
}
