// Where each pixel of the layers is in one view: its shift, and the edges that it shares with
// neighbours on the same surface.

fn edge_beside(own_disparity: i32, own_shift: i32, neighbour: i32) -> i32 {
    let shift = shifts[neighbour];
    let is_joined = abs(own_disparity - neighbour) <= SURFACE_STEP && abs(own_shift - shift) < UNIT;
    return select(own_shift, (own_shift + shift) / 2, is_joined);
}

@compute @workgroup_size(64)
fn view_spans(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= job.size_px.x {
        return;
    }
    let x = i32(id.x);
    let own = disparity_at(id.z, x, id.y);
    let shift = shifts[own];
    var span = vec2<i32>(shift);
    if x > 0 {
        span.x = edge_beside(own, shift, disparity_at(id.z, x - 1, id.y));
    }
    if x + 1 < i32(job.size_px.x) {
        span.y = edge_beside(own, shift, disparity_at(id.z, x + 1, id.y));
    }
    spans[index_of(id.z, x, id.y)] = span + vec2<i32>(x, x + 1) * UNIT;
}
