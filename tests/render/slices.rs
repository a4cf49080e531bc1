//! Slices whose pixels can be written down: ramps, slabs of ramps, the balls of the axes phantom;
//! and the f64 twin.

use glam::DVec3;
use relief_base::{Point, Vector};
use relief_render::{Clip, ClipPlane, RenderRequest, RenderedFrame, SceneFile};
use relief_volume::{Grid, Orbit, Phantom, Volume};

use super::renderer;
use super::twin::{compare, oblique_head};

fn slice(volume: &Volume, scene: &str) -> RenderRequest {
    let scene = SceneFile::parse(scene.as_bytes()).unwrap();
    scene.resolve(volume.grid(), &Orbit::default()).unwrap().request
}

/// Pixels (column, row) of a frame, with colour and depth.
fn pixels(frame: &RenderedFrame) -> impl Iterator<Item = ([u32; 2], [u8; 4], f32)> {
    let width = frame.size_px[0];
    let places = (0..width * frame.size_px[1]).map(move |i| [i % width, i / width]);
    places.zip(&frame.color_rgba).zip(&frame.depth_mm).map(|((at, color), depth)| (at, *color, *depth))
}

/// The planes of the tests below: standard ones and an oblique one.
const PLANES: [&str; 4] =
    [r#""axial""#, r#""sagittal""#, r#""coronal""#, r#"{"normal": [0.4, -0.8, 0.3], "up": [0.2, 0.1, 1]}"#];

/// Where a pixel of a parallel picture looks, on the plane through the focal point, by the camera's
/// own axes.
fn on_the_plane(request: &RenderRequest, [column, row]: [u32; 2]) -> DVec3 {
    let camera = &request.camera;
    let [half_x, half_y] = camera.half_extent(request.size_px);
    let share = |at: u32, side: u32| (f64::from(at) + 0.5) / f64::from(side) * 2.0 - 1.0;
    let towards_eye = (camera.eye().xyz - camera.look_at().xyz).normalize();
    let right = camera.up().xyz.cross(towards_eye).normalize();
    let up = towards_eye.cross(right);
    let x = share(column, request.size_px[0]) * half_x;
    let y = -share(row, request.size_px[1]) * half_y;
    camera.look_at().xyz + right * x + up * y
}

/// Invariant: Slices are linear where the volume is, lie at the depth of the plane, and agree with
/// an independent resampler.
#[test]
fn a_slice_through_a_ramp_is_exactly_linear_and_lies_at_one_depth() {
    let Some(mut renderer) = renderer("a_slice_through_a_ramp_is_exactly_linear") else { return };
    let phantom = Phantom::ramp(64).unwrap();
    let gradient = DVec3::from(phantom.truth.gradient_hu_per_mm.unwrap());
    for plane in PLANES {
        // Window 0, 510: half a grey a HU.
        let scene = format!(
            r#"{{"mode": "slice", "size_px": [48, 40], "slice": {{"plane": {plane}, "center_mm": [1.3, -2.6, 3.1],
                "height_mm": 25}}, "transfer": {{"window": {{"center_hu": 0, "width_hu": 510}}}}}}"#
        );
        let request = slice(&phantom.volume, &scene);
        let frame = renderer.render(&phantom.volume, &request).unwrap();
        let distance = request.camera.distance_mm();
        for (at, [red, green, blue, coverage], depth) in pixels(&frame) {
            let position = on_the_plane(&request, at);
            let grey = (gradient.dot(position) / 2.0 + 127.5).clamp(0.0, 255.0);
            // Half a step of rounding, and the error of the sampler's 8-bit weights for 6 HU
            // between voxels.
            assert!((f64::from(red) - grey).abs() <= 0.55, "{plane} at {at:?}: {red} for {grey:.2}");
            assert_eq!((green, blue, coverage), (red, red, 255), "{plane}: opaque grey");
            assert!((f64::from(depth) - distance).abs() < 1e-3, "{plane}: {depth} mm for {distance} mm");
            let picked = frame.pick(at).unwrap().xyz;
            assert!(picked.distance(position) < 1e-3, "{plane} at {at:?}: picked {picked} for {position}");
        }
    }
}

/// Invariant: Slices are linear where the volume is, lie at the depth of the plane, and agree with
/// an independent resampler.
#[test]
fn slabs_of_a_ramp_have_its_mean_on_the_plane_and_its_extremes_on_the_faces() {
    let Some(mut renderer) = renderer("slabs_of_a_ramp") else { return };
    let phantom = Phantom::ramp(64).unwrap();
    let gradient = DVec3::from(phantom.truth.gradient_hu_per_mm.unwrap());
    for plane in PLANES {
        for (blend, side) in [("mean", 0.0), ("mip", 1.0), ("minip", -1.0)] {
            let scene = format!(
                r#"{{"mode": "slice", "size_px": [24, 24], "sample_distance_mm": 0.7,
                    "slice": {{"plane": {plane}, "height_mm": 20, "slab_mm": 9, "blend": "{blend}"}},
                    "transfer": {{"window": {{"center_hu": 0, "width_hu": 510}}}}}}"#
            );
            let request = slice(&phantom.volume, &scene);
            let frame = renderer.render(&phantom.volume, &request).unwrap();
            let away = (request.camera.look_at().xyz - request.camera.eye().xyz).normalize();
            let slope = gradient.dot(away);
            // The extreme of a linear function is on the face towards which it rises or falls.
            let face_mm = 4.5 * slope.signum() * side;
            for (at, color, depth) in pixels(&frame) {
                let hu = gradient.dot(on_the_plane(&request, at)) + slope * face_mm;
                let grey = (hu / 2.0 + 127.5).clamp(0.0, 255.0);
                let what = format!("{blend} of {plane} at {at:?}");
                assert!((f64::from(color[0]) - grey).abs() <= 0.55, "{what}: {} for {grey:.2}", color[0]);
                let expected = request.camera.distance_mm() + face_mm;
                assert!((f64::from(depth) - expected).abs() < 1e-2, "{what}: {depth} mm for {expected} mm");
            }
        }
    }
}

/// Name, the phantom's axes that point right and up in the picture, and that along which offsets
/// count.
const CONVENTION: [(&str, DVec3, DVec3, DVec3); 3] = [
    ("axial", DVec3::X, DVec3::NEG_Y, DVec3::Z),
    ("sagittal", DVec3::Y, DVec3::Z, DVec3::X),
    ("coronal", DVec3::X, DVec3::Z, DVec3::Y),
];

#[test]
fn every_ball_lies_where_the_convention_puts_it() {
    let Some(mut renderer) = renderer("every_ball_lies_where_the_convention_puts_it") else { return };
    let phantom = Phantom::axes(64).unwrap();
    let mut seen = 0;
    for (plane, right, up, along) in CONVENTION {
        for landmark in phantom.truth.surfaces.iter().filter_map(|surface| match surface.shape {
            relief_volume::SurfaceShape::Sphere { center_mm, .. } => Some(DVec3::from(center_mm)),
            _ => None,
        }) {
            let scene = format!(
                r#"{{"mode": "slice", "size_px": [128, 128], "slice": {{"plane": "{plane}", "offset_mm": {},
                    "height_mm": 128}}, "transfer": {{"window": {{"center_hu": -600, "width_hu": 2}}}}}}"#,
                along.dot(landmark)
            );
            let frame = renderer.render(&phantom.volume, &slice(&phantom.volume, &scene)).unwrap();
            // One pixel is one mm. The ball's middle is white, and its mirror images are air but
            // for other balls.
            let [column, row] = [64.0 + right.dot(landmark), 64.0 - up.dot(landmark)].map(|at| at as u32);
            let lit = |column: u32, row: u32| frame.color_rgba[(row * 128 + column) as usize][0] == 255;
            assert!(lit(column, row), "{plane}: nothing at {column}, {row} for the ball at {landmark}");
            let area = pixels(&frame).filter(|(_, color, _)| color[0] == 255).count();
            let alone = along.dot(landmark) != 0.0;
            assert!(!alone || area < 1000, "{plane}: the ball at {landmark} is not alone: {area} pixels");
            seen += 1;
        }
    }
    assert_eq!(seen, 18);
}

/// Invariant: Slices follow the radiological convention, and their edge labels say so.
///
/// The axial slice through four balls of different size: each size is where its side belongs.
#[test]
fn left_right_front_and_back_have_markers_of_different_size() {
    let Some(mut renderer) = renderer("left_right_front_and_back") else { return };
    let phantom = Phantom::axes(64).unwrap();
    let scene = r#"{"mode": "slice", "size_px": [128, 128], "slice": {"plane": "axial", "height_mm": 128},
                    "transfer": {"window": {"center_hu": -350, "width_hu": 2}}}"#;
    let frame = renderer.render(&phantom.volume, &slice(&phantom.volume, scene)).unwrap();
    let area = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| {
        let inside = |at: &[u32; 2]| columns.contains(&at[0]) && rows.contains(&at[1]);
        pixels(&frame).filter(|(at, color, _)| inside(at) && color[0] == 255).count() as f64
    };
    // Radii 14 (left), 12 (right), 10 (back), 8 (front): the patient's right is on the left, the
    // front above.
    for (side, area, radius) in [
        ("left", area(84..128, 40..88), 14.0f64),
        ("right", area(0..44, 40..88), 12.0),
        ("back", area(40..88, 84..128), 10.0),
        ("front", area(40..88, 0..44), 8.0),
    ] {
        // The threshold is not half-way for every ball: half a voxel of 2 mm at most.
        let found = (area / std::f64::consts::PI).sqrt();
        assert!((found - radius).abs() < 1.0, "{side}: a radius of {found:.2} mm for {radius} mm");
    }
}

#[test]
fn outside_the_volume_is_background_without_depth() {
    let Some(mut renderer) = renderer("outside_the_volume_is_background") else { return };
    // 20 x 10 x 6 mm around the origin.
    let grid = Grid::axis_aligned([20, 10, 6], [1.0; 3], [-9.5, -4.5, -2.5]).unwrap();
    let volume = Volume::new(grid, vec![0; 1200]).unwrap();
    let scene = |more: &str| {
        format!(
            r#"{{"mode": "slice", "size_px": [40, 40], "background_rgb": [0, 0, 1],
                "slice": {{"plane": "axial", "height_mm": 40{more}}}}}"#
        )
    };
    let frame = renderer.render(&volume, &slice(&volume, &scene(""))).unwrap();
    for ([column, row], color, depth) in pixels(&frame) {
        let inside = (10..30).contains(&column) && (15..25).contains(&row);
        let expected = if inside { [102, 102, 102, 255] } else { [0, 0, 255, 0] };
        assert_eq!(color, expected, "{column}, {row}");
        assert_eq!(depth.is_finite(), inside, "{column}, {row}");
    }
    let beyond = renderer.render(&volume, &slice(&volume, &scene(r#", "offset_mm": 3.2"#))).unwrap();
    assert!(beyond.depth_mm.iter().all(|depth| depth.is_infinite()), "the plane passes by the volume");
    let reaching = slice(&volume, &scene(r#", "offset_mm": 3.2, "slab_mm": 2"#));
    let reached = renderer.render(&volume, &reaching).unwrap();
    let hit = reached.pick([20, 20]).expect("the slab reaches the volume");
    assert!((hit.xyz.z - 3.0).abs() < 1e-3, "the part of the volume next to the plane: {hit:?}");
}

#[test]
fn slices_leave_out_clipped_voxels() {
    let Some(mut renderer) = renderer("slices_leave_out_clipped_voxels") else { return };
    let phantom = Phantom::ramp(32).unwrap();
    let mut request = slice(
        &phantom.volume,
        r#"{"mode": "slice", "size_px": [32, 32], "slice": {"plane": "axial", "height_mm": 32}}"#,
    );
    let mut clip = Clip::default();
    clip.planes.push(ClipPlane { point: Point::new(3.0, 0.0, 0.0), normal: Vector::new(1.0, 0.0, 0.0) });
    request.clip = clip;
    let frame = renderer.render(&phantom.volume, &request).unwrap();
    for ([column, row], color, depth) in pixels(&frame) {
        let kept = column >= 19; // the patient's left is on the right
        assert_eq!((depth.is_finite(), color[3] == 255), (kept, kept), "{column}, {row}");
    }
}

/// A patient on a table: a cylinder of tissue along z above a plate, 2 mm apart from voxel to voxel.
fn patient_on_a_table() -> Volume {
    const SIDE: usize = 96;
    let hu = |x: f64, y: f64| match (x.hypot(y / 0.7) < 60.0, (72.0..76.0).contains(&y) && x.abs() < 85.0) {
        (true, _) => 40,
        (_, true) => 120,
        _ => -1000,
    };
    let at = |index: usize| index as f64 * 2.0 - 95.0;
    let voxels = (0..SIDE.pow(3)).map(|i| hu(at(i % SIDE), at(i / SIDE % SIDE))).collect();
    Volume::new(Grid::axis_aligned([SIDE; 3], [2.0; 3], [-95.0; 3]).unwrap(), voxels).unwrap()
}

/// Invariant: A slice outlines the table that pictures leave out, and changes no other pixel.
#[test]
fn slices_outline_the_table() {
    const AMBER: [u8; 4] = [255, 176, 0, 255];
    let Some(mut renderer) = renderer("slices_outline_the_table") else { return };
    let volume = patient_on_a_table();
    let table = volume.table().expect("a table");
    let mut slice_of = |table: &str| {
        let scene = format!(
            r#"{{"mode": "slice", "size_px": [96, 96], "table": "{table}",
                 "slice": {{"plane": "axial", "height_mm": 192, "letters": false}}}}"#
        );
        renderer.render(&volume, &slice(&volume, &scene)).unwrap()
    };
    let (marked, kept) = (slice_of("remove"), slice_of("keep"));
    // One pixel is one voxel; the middle of the volume lies between two slices.
    let is_table = |x: u32, y: u32| x < 96 && y < 96 && table.contains([x as usize, y as usize, 48]);
    let mut outlined = 0;
    for (([x, y], color, depth), (_, before, _)) in pixels(&marked).zip(pixels(&kept)) {
        assert_ne!(before, AMBER, "{x}, {y}: marked although the table is kept");
        let inside = x > 0 && x < 95 && y > 0 && y < 95;
        let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        if inside && is_table(x, y) && beside.into_iter().any(|(x, y)| !is_table(x, y)) {
            assert_eq!((color, depth.is_finite()), (AMBER, true), "{x}, {y}");
            outlined += 1;
        } else if inside {
            assert_eq!(color, before, "{x}, {y}");
        }
    }
    // The plate is 170 mm wide: both of its sides.
    assert!(outlined > 2 * 80, "{outlined} pixels of outline");
}

#[test]
fn gpu_and_twin_agree_on_slices_and_slabs() {
    let volume = oblique_head();
    for plane in PLANES {
        for (blend, slab_mm) in
            [("mean", 0.0), ("mean", 12.0), ("mip", 12.0), ("minip", 12.0), ("mip", 400.0)]
        {
            for transfer in [r#"{"window": {"center_hu": 300, "width_hu": 2000}}"#, r#""bone""#] {
                let scene = format!(
                    r#"{{"mode": "slice", "size_px": [120, 90], "background_rgb": [0.2, 0.4, 0.6],
                        "slice": {{"plane": {plane}, "offset_mm": 7.3, "slab_mm": {slab_mm}, "blend": "{blend}"}},
                        "sample_distance_mm": 0.9, "transfer": {transfer}}}"#
                );
                let request = slice(&volume, &scene);
                compare(&volume, &request, &format!("{plane}, {blend} of {slab_mm} mm, {transfer}"));
            }
        }
    }
}
