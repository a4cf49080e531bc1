// The layers that views are made of, and where their pixels are in one view.
//
// Places along a line are whole numbers of 1/4096 pixel. A pixel has red in its lowest byte, then
// green, blue and the disparity D (255 nearest).

struct ViewJob {
    // Width and height of the layers and of the view, pixels.
    size_px: vec2<u32>,
    // Whole pixels that a disparity moves at most.
    reach_px: i32,
    // 1 where there is a background layer.
    has_back: u32,
}

@group(0) @binding(0) var<uniform> job: ViewJob;
// How far each disparity moves to the right, 1/4096 pixel; even numbers.
@group(0) @binding(1) var<storage, read> shifts: array<i32, 256>;
// The front layer, then the background layer, rows from the top.
@group(0) @binding(2) var<storage, read> layers: array<u32>;
// Where each pixel of the layers begins and ends.
@group(0) @binding(3) var<storage, read_write> spans: array<vec2<i32>>;
// The view: red, green and blue from the lowest byte on.
@group(0) @binding(4) var<storage, read_write> view: array<u32>;

const UNIT: i32 = 4096;
// Disparities of neighbours on one surface differ by at most this.
const SURFACE_STEP: i32 = 4;

fn index_of(layer: u32, x: i32, y: u32) -> u32 {
    return (layer * job.size_px.y + y) * job.size_px.x + u32(x);
}

fn disparity_at(layer: u32, x: i32, y: u32) -> i32 {
    return i32(layers[index_of(layer, x, y)] >> 24u);
}

fn color_at(layer: u32, x: i32, y: u32) -> vec3<i32> {
    let pixel = layers[index_of(layer, x, y)];
    return vec3<i32>(vec3<u32>(pixel, pixel >> 8u, pixel >> 16u) & vec3<u32>(255u));
}
