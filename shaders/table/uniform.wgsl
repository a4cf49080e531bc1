// The transfer table in a uniform buffer: software drivers gather from those in a third of a
// storage buffer's time.

@group(0) @binding(4) var<uniform> transfer_table: array<vec4<f32>, 4096>;
