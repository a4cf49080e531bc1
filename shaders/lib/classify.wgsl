// From a value to a lit colour.
//
// Colours are display-referred sRGB 0..1, not premultiplied; opacity is that of one sample.

@group(0) @binding(4) var<storage, read> transfer_table: array<vec4<f32>>;

fn classify(hu: f32) -> vec4<f32> {
    let x = clamp((hu - frame.table_first_hu) / frame.table_step_hu, 0.0, f32(frame.table_last));
    let i = min(u32(x), frame.table_last - 1u);
    return mix(transfer_table[i], transfer_table[i + 1u], x - f32(i));
}

fn opacity_of(hu: f32) -> f32 {
    let x = clamp((hu - frame.table_first_hu) / frame.table_step_hu, 0.0, f32(frame.table_last));
    let i = min(u32(x), frame.table_last - 1u);
    return mix(transfer_table[i].w, transfer_table[i + 1u].w, x - f32(i));
}

// Headlight at the eye, two-sided. A gradient of no length has no direction: ambient light alone.
fn shade(rgb: vec3<f32>, gradient: vec3<f32>, ray: Ray) -> vec3<f32> {
    // Gradients transform by the transpose of the points' inverse, here voxel -> view; start space has the same axes.
    let in_view = gradient * mat3x3<f32>(
        frame.voxel_from_start[0].xyz,
        frame.voxel_from_start[1].xyz,
        frame.voxel_from_start[2].xyz,
    );
    let length_squared = dot(in_view, in_view);
    if length_squared < 1e-12 {
        return rgb * frame.ambient;
    }
    let facing = min(abs(dot(in_view, ray.direction)) * inverseSqrt(length_squared), 1.0);
    return rgb * (frame.ambient + frame.diffuse * facing) + frame.specular * pow(facing, frame.shininess);
}
