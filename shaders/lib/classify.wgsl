// From a value to a lit colour.
//
// Colours are display-referred sRGB 0..1, not premultiplied; opacity is that of one sample.

// Whether there is a highlight at all.
override HIGHLIGHT: bool = true;

// Squared length below which a gradient is rounding.
const NO_GRADIENT: f32 = 1e-12;

fn classify(hu: f32) -> vec4<f32> {
    let x = clamp((hu - frame.table_first_hu) * frame.table_entries_per_hu, 0.0, f32(frame.table_last));
    let i = min(u32(x), frame.table_last - 1u);
    return mix(transfer_table[i], transfer_table[i + 1u], x - f32(i));
}

fn opacity_of(hu: f32) -> f32 {
    let x = clamp((hu - frame.table_first_hu) * frame.table_entries_per_hu, 0.0, f32(frame.table_last));
    let i = min(u32(x), frame.table_last - 1u);
    return mix(transfer_table[i].w, transfer_table[i + 1u].w, x - f32(i));
}

// Headlight at the eye, two-sided. A gradient of no length has no direction: ambient light alone.
// `gradient` and `direction` along the patient axes; the gradient's length does not matter.
fn shade(rgb: vec3<f32>, gradient: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    let length_squared = dot(gradient, gradient);
    if length_squared < NO_GRADIENT {
        return rgb * frame.ambient;
    }
    let facing = min(abs(dot(gradient, direction)) * inverseSqrt(length_squared), 1.0);
    let lit = rgb * (frame.ambient + frame.diffuse * facing);
    if !HIGHLIGHT {
        return lit;
    }
    return lit + frame.specular * pow(facing, frame.shininess);
}
