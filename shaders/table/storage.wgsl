// The transfer table in a storage buffer: for graphics cards, whose uniforms are slow to read at
// indices that differ.

@group(0) @binding(4) var<storage, read> transfer_table: array<vec4<f32>>;
