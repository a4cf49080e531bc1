// Pre-integrated classification: a sample stands for all values that its path passes, not for the
// one in its middle.
//
// Values are taken at the ends of a sample's path, half a sample distance to both sides, and in its
// middle, and are linear between. Behind the transfer table's entries lie their integrals over
// values (HU), one for each entry: see `transfer::integral`. Twin: `processor::passage`.

override PRE_INTEGRATED: bool = false;

// Values closer than this, in table entries, are one: a difference of integrals would be rounding.
const ALIKE_ENTRIES: f32 = 8.0;
// Optical depth of an opaque sample.
const OPAQUE_DEPTH: f32 = 12.0;

// The values that a sample's path passes, HU.
struct Passage {
    front: f32,
    middle: f32,
    back: f32,
}

// A passage as two samples in a row, each with half of the path: colour, and contribution.
struct Passed {
    front: vec4<f32>,
    back: vec4<f32>,
}

// The value at fractional sample number k. Clipped samples do not count.
fn hu_along(ray: Ray, k: f32) -> f32 {
    return sample_hu(voxel_at(ray, clamp(sample_t(ray, k), ray.entry, ray.exit)));
}

fn passage_of_sample(ray: Ray, k: f32) -> Passage {
    return Passage(hu_along(ray, k - 0.5), hu_along(ray, k), hu_along(ray, k + 0.5));
}

fn optical_depth(opacity: f32) -> f32 {
    return min(-log(max(1.0 - opacity, 1e-30)), OPAQUE_DEPTH);
}

// The integral up to a value: of colour times optical depth, and of optical depth. Beyond the
// table, its end goes on.
fn integral_to(hu: f32) -> vec4<f32> {
    let last = f32(frame.table_last);
    let x = (hu - frame.table_first_hu) * frame.table_entries_per_hu;
    let inside = clamp(x, 0.0, last);
    let i = min(u32(inside), frame.table_last - 1u);
    let head = frame.table_last + 1u;
    let sum = mix(transfer_table[head + i], transfer_table[head + i + 1u], inside - f32(i));
    if x == inside {
        return sum;
    }
    let end = transfer_table[select(0u, frame.table_last, x > last)];
    let depth = optical_depth(end.a);
    return sum + (x - inside) / frame.table_entries_per_hu * vec4<f32>(end.rgb * depth, depth);
}

// Half a sample's path from one value to another: colour times optical depth, and optical depth.
fn half_passed(front: f32, back: f32) -> vec4<f32> {
    let change = back - front;
    if abs(change) * frame.table_entries_per_hu < ALIKE_ENTRIES {
        let sample = classify(0.5 * (front + back));
        let depth = 0.5 * optical_depth(sample.a);
        return vec4<f32>(sample.rgb * depth, depth);
    }
    return 0.5 * (integral_to(back) - integral_to(front)) / change;
}

// Two straight lines whose means are those of the parabola through the three values.
fn straightened(passage: Passage) -> Passage {
    let bend = (passage.front - 2.0 * passage.middle + passage.back) / 12.0;
    return Passage(passage.front - bend, passage.middle - bend, passage.back - bend);
}

// Whether any table entry from one value to the other is visible: equal sums mean that nothing lies
// between them. Empty bricks must show nothing, although lines reach beyond the values that they
// connect.
fn is_visible_between(low: f32, high: f32) -> bool {
    let x = (vec2<f32>(low, high) - frame.table_first_hu) * frame.table_entries_per_hu;
    let last = f32(frame.table_last);
    let first = u32(clamp(floor(x.x), 0.0, last - 1.0));
    let end = max(u32(clamp(ceil(x.y), 0.0, last)), first + 1u);
    let head = frame.table_last + 1u;
    return transfer_table[head + end].w > transfer_table[head + first].w;
}

fn classify_passage(passage: Passage) -> Passed {
    let low = min(min(passage.front, passage.middle), passage.back);
    let high = max(max(passage.front, passage.middle), passage.back);
    var passed: Passed;
    if !is_visible_between(low, high) {
        return passed;
    }
    let straight = straightened(passage);
    let front = half_passed(straight.front, straight.middle);
    let back = half_passed(straight.middle, straight.back);
    let through = exp(-front.w);
    passed.front = vec4<f32>(front.rgb / max(front.w, 1e-12), 1.0 - through);
    passed.back = vec4<f32>(back.rgb / max(back.w, 1e-12), through * (1.0 - exp(-back.w)));
    return passed;
}

fn passed_opacity(passed: Passed) -> f32 {
    return passed.front.a + passed.back.a;
}
