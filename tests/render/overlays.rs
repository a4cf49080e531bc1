//! Overlays against their closed forms: outlines and depths of balls, lines, boxes; hidden parts;
//! frames that decode.
//!
//! Pictures are those of the f64 renderer, so that most of this needs no adapter; the formulas are
//! written down again here.

use glam::{DMat3, DVec2, DVec3};
use serde_json::{Value, json};

use super::renderer;
use crate::common;
use relief_base::{Point, Vector};
use relief_display::inspect_png;
use relief_render::{RenderRequest, RenderedFrame, SceneFile};
use relief_session::{FileFormat, Product, encode};
use relief_volume::{Camera, Grid, Orbit, PhantomKind, Projection, Volume};

/// A few voxels of air, which show nothing.
fn air() -> Volume {
    let grid = Grid::axis_aligned([4, 5, 6], [30.0, 20.0, 10.0], [-45.0, -40.0, -25.0]).unwrap();
    Volume::new(grid, vec![-1000; 120]).unwrap()
}

const PROJECTIONS: [Projection; 2] =
    [Projection::Perspective { vertical_fov: 0.6 }, Projection::Orthographic { height_mm: 240.0 }];

fn camera(projection: Projection) -> Camera {
    let (eye, at) = (Point::new(120.0, -330.0, 90.0), Point::new(4.0, -3.0, 2.0));
    Camera::new(eye, at, Vector::new(0.1, 0.0, 1.0), projection).unwrap()
}

fn request(volume: &Volume, camera: Camera, size_px: [u32; 2], overlays: &Value) -> RenderRequest {
    let json = json!({ "overlays": overlays, "size_px": size_px }).to_string();
    let scene = SceneFile::parse(json.as_bytes()).unwrap().resolve(volume.grid(), &Orbit::default()).unwrap();
    RenderRequest { camera, ..scene.request }
}

fn over_air(camera: Camera, size_px: [u32; 2], overlays: &Value) -> RenderedFrame {
    let volume = air();
    relief_render::render_reference(&volume, &request(&volume, camera, size_px, overlays)).unwrap()
}

/// Origin and unit direction of the ray through a place of the picture, in patient space, and the
/// viewing axis.
fn ray(camera: &Camera, [width, height]: [u32; 2], pixel: DVec2) -> (DVec3, DVec3, DVec3) {
    let forwards = (camera.look_at().xyz - camera.eye().xyz).normalize();
    let right = forwards.cross(camera.up().xyz).normalize();
    let up = right.cross(forwards);
    let (width, height) = (f64::from(width), f64::from(height));
    let (x, y) = ((2.0 * pixel.x - width) / height, (height - 2.0 * pixel.y) / height);
    match camera.projection() {
        Projection::Perspective { vertical_fov } => {
            let half = (vertical_fov / 2.0).tan();
            (camera.eye().xyz, (forwards + (right * x + up * y) * half).normalize(), forwards)
        }
        Projection::Orthographic { height_mm } => {
            (camera.eye().xyz + (right * x + up * y) * height_mm / 2.0, forwards, forwards)
        }
    }
}

fn centers([width, height]: [u32; 2]) -> impl Iterator<Item = (usize, DVec2)> {
    let corner = move |i: u32| DVec2::new(f64::from(i % width), f64::from(i / width));
    (0..width * height).map(move |i| (i as usize, corner(i) + 0.5))
}

/// Distance between a ray and a point, and how far along the ray the point is.
fn off_ray(origin: DVec3, direction: DVec3, point: DVec3) -> (f64, f64) {
    let along = (point - origin).dot(direction);
    ((point - origin - direction * along).length(), along)
}

/// Invariant: Outlines and depths of balls, lines, meshes and the bounding box follow their closed
/// forms.
#[test]
fn a_balls_outline_and_depth_are_those_of_a_sphere() {
    let size = [97, 81];
    let (center, radius) = (DVec3::new(30.0, 20.0, -25.0), 42.0);
    for projection in PROJECTIONS {
        let camera = camera(projection);
        let ball =
            json!({ "landmark": { "at_mm": center.to_array(), "radius_mm": radius, "rgb": [1, 1, 1] } });
        let frame = over_air(camera, size, &json!({ "items": [ball] }));
        let (mut inside, mut outside, mut edge) = (0, 0, 0);
        for (i, pixel) in centers(size) {
            let hits = |pixel: DVec2| {
                let (origin, direction, _) = ray(&camera, size, pixel);
                off_ray(origin, direction, center).0 <= radius
            };
            let of_part = |part: i32| f64::from(part) / 15.0 - 0.5;
            let parts = (0..256).map(|part| DVec2::new(of_part(part % 16), of_part(part / 16)));
            let covered = parts.filter(|part| hits(pixel + *part * 15.0 / 16.0)).count();
            let coverage = f64::from(frame.color_rgba[i][3]) / 255.0;
            let depth = f64::from(frame.depth_mm[i]);
            match covered {
                0 => {
                    assert!(coverage == 0.0 && depth.is_infinite(), "{projection:?} {pixel}: outside");
                    outside += 1;
                }
                256 => {
                    let (origin, direction, forwards) = ray(&camera, size, pixel);
                    let (off, along) = off_ray(origin, direction, center);
                    let half_chord = (radius * radius - off * off).sqrt();
                    let expected =
                        (origin + direction * (along - half_chord) - camera.eye().xyz).dot(forwards);
                    assert!(
                        (depth - expected).abs() < 1e-3,
                        "{projection:?} {pixel}: {depth} for {expected}"
                    );
                    let lit = 255.0 * (0.35 + 0.65 * half_chord / radius);
                    assert!((f64::from(frame.color_rgba[i][0]) - lit).abs() <= 1.0, "{projection:?} {pixel}");
                    assert_eq!(coverage, 1.0);
                    inside += 1;
                }
                _ => {
                    let off = (coverage - covered as f64 / 256.0).abs();
                    // Sixteen points count it.
                    assert!(off < 0.15, "{projection:?} {pixel}: {coverage} for {covered} of 256");
                    assert_eq!(depth.is_finite(), (coverage * 16.0).round() >= 8.0, "{projection:?} {pixel}");
                    edge += 1;
                }
            }
        }
        assert!(
            inside > 500 && outside > 3000 && edge > 60,
            "{inside} in, {outside} out, {edge} on the edge"
        );
    }
}

#[test]
fn a_ball_of_pixels_has_its_size_at_any_distance() {
    for projection in PROJECTIONS {
        let camera = camera(projection);
        for share in [0.4, 1.0, 1.7] {
            let at = camera.eye().xyz.lerp(camera.look_at().xyz, share).to_array();
            let frame = over_air(
                camera,
                [101, 101],
                &json!({ "items": [{ "landmark": { "at_mm": at, "radius_px": 20 } }] }),
            );
            let area: f64 = frame.color_rgba.iter().map(|pixel| f64::from(pixel[3]) / 255.0).sum();
            let radius = (area / std::f64::consts::PI).sqrt();
            // A ball's outline is a little larger than its section at the depth of its centre.
            assert!((19.9..20.5).contains(&radius), "{projection:?}, {share}: {radius} px");
        }
    }
}

/// Invariant: Outlines and depths of balls, lines, meshes and the bounding box follow their closed
/// forms.
#[test]
fn depth_along_a_line_is_perspective() {
    let size = [160, 120];
    let (from, to) = (DVec3::new(-55.0, -70.0, -30.0), DVec3::new(70.0, 80.0, 35.0));
    for projection in PROJECTIONS {
        let camera = camera(projection);
        let line = json!({ "line": { "from_mm": from.to_array(), "to_mm": to.to_array(), "width_px": 4 } });
        let frame = over_air(camera, size, &json!({ "items": [line] }));
        let [a, b] = [from, to].map(|end| camera.project(Point::from_xyz(end), size).unwrap());
        let (start, along) = (DVec2::new(a.0, a.1), DVec2::new(b.0 - a.0, b.1 - a.1));
        let mut seen = 0;
        for (i, pixel) in centers(size) {
            let share = (pixel - start).dot(along) / along.length_squared();
            let off = (pixel - start).perp_dot(along).abs() / along.length();
            if !(0.0..=1.0).contains(&share) || off > 1.2 {
                let beyond = (share - share.clamp(0.0, 1.0)).abs() * along.length();
                assert!(off + beyond < 3.5 || frame.depth_mm[i].is_infinite(), "{projection:?} {pixel}");
                continue;
            }
            // Two pixels, half its width, nearer than its axis.
            let (axis, mm_per_px) = match projection {
                Projection::Perspective { vertical_fov } => {
                    let depth = 1.0 / (1.0 / a.2 + (1.0 / b.2 - 1.0 / a.2) * share);
                    (depth, depth * 2.0 * (vertical_fov / 2.0).tan() / 120.0)
                }
                Projection::Orthographic { height_mm } => (a.2 + (b.2 - a.2) * share, height_mm / 120.0),
            };
            let off = f64::from(frame.depth_mm[i]) - (axis - 2.0 * mm_per_px);
            assert!(off.abs() < 1e-3, "{projection:?} {pixel}: off by {off} mm");
            seen += 1;
        }
        assert!(seen > 150, "{seen} pixels of the line");
    }
}

/// The twelve triangles of a box.
fn box_mesh(low: DVec3, high: DVec3, opacity: f64) -> Value {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
    let vertices: Vec<_> = (0..8).map(corner).collect();
    let mut triangles = Vec::new();
    for [a, b, c, d] in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        as [[usize; 4]; 6]
    {
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    json!({ "mesh": { "vertices_mm": vertices, "triangles": triangles, "rgb": [1, 1, 1], "opacity": opacity } })
}

/// Where a ray enters and leaves a box, and along which axis it enters.
fn ray_box(origin: DVec3, direction: DVec3, low: DVec3, high: DVec3) -> Option<(f64, f64, usize)> {
    let (a, b) = ((low - origin) / direction, (high - origin) / direction);
    let (enters, leaves) = (a.min(b), a.max(b));
    let axis = enters.max_position();
    (enters.max_element() < leaves.min_element()).then(|| (enters.max_element(), leaves.min_element(), axis))
}

/// Invariant: Outlines and depths of balls, lines, meshes and the bounding box follow their closed
/// forms.
#[test]
fn a_mesh_box_is_where_rays_meet_the_box() {
    let size = [120, 90];
    let (low, high) = (DVec3::new(-40.0, -30.0, -20.0), DVec3::new(35.0, 45.0, 30.0));
    for projection in PROJECTIONS {
        let camera = camera(projection);
        let frame = over_air(camera, size, &json!({ "items": [box_mesh(low, high, 1.0)] }));
        let mut inside = 0;
        for (i, pixel) in centers(size) {
            let meets = |off: DVec2| {
                let (origin, direction, _) = ray(&camera, size, pixel + off);
                ray_box(origin, direction, low, high)
            };
            let around =
                [DVec2::new(-0.5, -0.5), DVec2::new(0.5, -0.5), DVec2::new(-0.5, 0.5), DVec2::splat(0.5)];
            let corners = around.map(meets);
            let [coverage, shade] = [frame.color_rgba[i][3], frame.color_rgba[i][0]];
            if corners.iter().all(Option::is_none) && meets(DVec2::ZERO).is_none() {
                assert!(coverage < 64, "{projection:?} {pixel}: outside");
            }
            let Some((enters, _, axis)) = meets(DVec2::ZERO) else { continue };
            if corners.iter().any(|corner| corner.is_none_or(|found| found.2 != axis)) {
                continue; // an edge of the box is in the pixel
            }
            let (origin, direction, forwards) = ray(&camera, size, pixel);
            let expected = (origin + direction * enters - camera.eye().xyz).dot(forwards);
            let depth = f64::from(frame.depth_mm[i]);
            assert!((depth - expected).abs() < 1e-3, "{projection:?} {pixel}: {depth} for {expected}");
            // No seam: two triangles that share an edge cover its pixels together, once.
            assert_eq!(coverage, 255, "{projection:?} {pixel}");
            let lit = 255.0 * (0.35 + 0.65 * direction[axis].abs());
            assert!((f64::from(shade) - lit).abs() <= 1.0, "{projection:?} {pixel}: {shade} for {lit}");
            inside += 1;
        }
        assert!(inside > 600, "{inside} pixels inside faces");
    }
}

#[test]
fn a_translucent_box_shows_both_of_its_walls_and_writes_no_depth() {
    let size = [120, 90];
    let (low, high) = (DVec3::splat(-40.0), DVec3::splat(40.0));
    let camera = camera(PROJECTIONS[1]);
    let frame = over_air(camera, size, &json!({ "items": [box_mesh(low, high, 0.4)] }));
    let mut seen = 0;
    for (i, pixel) in centers(size) {
        let meets = |off: f64| {
            let (origin, direction, _) = ray(&camera, size, pixel + off);
            ray_box(origin, direction, low, high)
        };
        if meets(0.0).is_some_and(|(a, b, _)| b - a > 3.0) && meets(1.5).is_some() && meets(-1.5).is_some() {
            let expected = 255.0 * (1.0 - 0.6 * 0.6);
            assert!((f64::from(frame.color_rgba[i][3]) - expected).abs() <= 1.0, "{pixel}");
            seen += 1;
        }
    }
    assert!(seen > 1000, "{seen} pixels through two walls");
    assert!(frame.depth_mm.iter().all(|mm| mm.is_infinite()), "0.4 is too thin to have a depth");
}

/// Invariant: The depth of a pixel is that of the volume or of an overlay, never a mixture; hidden
/// overlays are dimmed and write no depth.
#[test]
fn the_sphere_hides_what_is_inside_of_it() {
    let volume = common::volume(PhantomKind::Sphere, 64);
    let size = [90, 90];
    let camera = camera(PROJECTIONS[0]);
    let with = |overlays: &Value| {
        let mut request = request(&volume, camera, size, overlays);
        request.transfer = SceneFile::default()
            .with_preset("bone")
            .resolve(volume.grid(), &Orbit::default())
            .unwrap()
            .request
            .transfer;
        relief_render::render_reference(&volume, &request).unwrap()
    };
    let alone = with(&json!({}));
    // One in the middle, and one on the surface towards the eye, half of it outside.
    let towards = (camera.eye().xyz.normalize() * 79.0).to_array();
    let ball = |at: [f64; 3]| json!({ "landmark": { "at_mm": at, "radius_mm": 14, "rgb": [0, 0, 1] } });
    let inner = with(&json!({ "items": [ball([0.0; 3])] }));
    let bits = |frame: &RenderedFrame| frame.depth_mm.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&inner), bits(&alone), "what is hidden writes no depth");
    let dimmed: Vec<_> = (0..8100).filter(|&i| inner.color_rgba[i] != alone.color_rgba[i]).collect();
    assert!(dimmed.len() > 60, "{} pixels of the hidden ball", dimmed.len());
    let middle = 45 * 90 + 45;
    let [red, green, ..] = alone.color_rgba[middle];
    let expected = [f64::from(red) * 0.75, f64::from(green) * 0.75];
    for (found, expected) in inner.color_rgba[middle].into_iter().zip(expected) {
        assert!((f64::from(found) - expected).abs() <= 1.0, "{found} for {expected}: a quarter of the ball");
    }
    assert_eq!(with(&json!({ "items": [ball([0.0; 3])], "occluded": 0 })).color_rgba, alone.color_rgba);

    let outer = with(&json!({ "items": [ball(towards)] }));
    let (mut nearer, mut same) = (0, 0);
    for (i, pixel) in centers(size) {
        let (depth, before) = (outer.depth_mm[i], alone.depth_mm[i]);
        if depth.to_bits() == before.to_bits() {
            same += 1;
            continue;
        }
        // Not the volume's: then the ball's own, and before the volume.
        let (origin, direction, forwards) = ray(&camera, size, pixel);
        let (off, along) = off_ray(origin, direction, towards.into());
        let front = along - (14.0 * 14.0 - off * off).max(0.0).sqrt();
        let expected = front * direction.dot(forwards);
        assert!(depth < before, "{pixel}: {depth} mm is behind {before} mm");
        assert!((f64::from(depth) - expected).abs() < 0.01 || off > 13.0, "{pixel}: {depth} for {expected}");
        nearer += 1;
    }
    assert!(nearer > 80 && same > 7000, "{nearer} pixels are the ball's, {same} as before");
}

/// Invariant: Outlines and depths of balls, lines, meshes and the bounding box follow their closed
/// forms.
#[test]
fn the_bounding_box_joins_the_projected_corners() {
    // An oblique grid: the box is the volume's, not one along the patient's axes.
    let axes = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(0.3);
    let (step, origin) =
        (axes * DMat3::from_diagonal(DVec3::new(10.0, 14.0, 18.0)), DVec3::new(-30.0, -60.0, -30.0));
    let placed = relief_base::Transform::from_axes(step.x_axis, step.y_axis, step.z_axis, origin);
    let volume = Volume::new(Grid::new([7, 6, 5], placed).unwrap(), vec![-1000; 210]).unwrap();
    let size = [160, 120];
    let camera = camera(PROJECTIONS[0]);
    let frame = relief_render::render_reference(
        &volume,
        &request(&volume, camera, size, &json!({ "bounding_box": true })),
    )
    .unwrap();
    let project = |index: DVec3| {
        let position = origin + step * index;
        let forwards = (camera.look_at().xyz - camera.eye().xyz).normalize();
        let right = forwards.cross(camera.up().xyz).normalize();
        let arm = position - camera.eye().xyz;
        let scale = 60.0 / (0.3f64.tan() * arm.dot(forwards));
        DVec2::new(80.0 + arm.dot(right) * scale, 60.0 - arm.dot(right.cross(forwards)) * scale)
    };
    let high = DVec3::new(6.5, 5.5, 4.5);
    let corner =
        |i: usize| DVec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { -0.5 }));
    let mut edges = Vec::new();
    for from in 0..8usize {
        edges.extend([1, 2, 4].into_iter().filter(|bit| from & bit == 0).map(|bit| (from, from | bit)));
    }
    assert_eq!(edges.len(), 12);
    let ends: Vec<_> = edges.iter().map(|&(a, b)| [a, b].map(|i| project(corner(i)))).collect();
    let distance = |[a, b]: &[DVec2; 2], pixel: DVec2| {
        let share = ((pixel - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        pixel.distance(a.lerp(*b, share))
    };
    let mut lit = 0;
    for (i, pixel) in centers(size) {
        let nearest = ends.iter().map(|edge| distance(edge, pixel)).fold(f64::INFINITY, f64::min);
        let coverage = frame.color_rgba[i][3];
        // Lines of two pixels: places nearer than 0.25 px to an axis are covered, places farther
        // than 1.75 px are not.
        assert!(nearest > 0.25 || coverage == 255, "{pixel}: {coverage} at {nearest} px");
        assert!(nearest < 1.75 || coverage == 0, "{pixel}: {coverage} at {nearest} px");
        lit += usize::from(coverage > 0);
    }
    assert!(lit > 500, "{lit} pixels of the box");
}

#[test]
fn a_frame_with_overlays_still_decodes_and_its_depth_is_that_of_the_overlay() {
    let Some(mut renderer) = renderer("a_frame_with_overlays_still_decodes") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    let ball = json!({ "landmark": { "at_mm": [0, -95, 0], "radius_mm": 10 } });
    let json =
        json!({ "overlays": { "items": [ball], "bounding_box": true }, "display": { "layout": "wowvx" } });
    let scene = SceneFile::parse(json.to_string().as_bytes()).unwrap();
    let scene = scene.resolve(volume.grid(), &Orbit::default()).unwrap();
    let frame = renderer.render(&volume, &scene.request).unwrap();
    let twin = relief_render::render_reference(&volume, &scene.request).unwrap();
    let png = encode(&frame, &scene.display, Product::Frame, FileFormat::Png).unwrap();
    let report = inspect_png(&png).unwrap();
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    let depth = f64::from(frame.depth_at([480, 270]).0);
    assert!((depth - (frame.camera.distance_mm() - 105.0)).abs() < 0.1, "{depth} mm");
    let picked = frame.pick([480, 270]).unwrap();
    assert!(picked.distance(Point::new(0.0, -105.0, 0.0)) < 1.0, "{picked:?}");
    let apart = frame
        .depth_mm
        .iter()
        .zip(&twin.depth_mm)
        .filter(|(a, b)| a.is_finite() != b.is_finite() || (*a - *b).abs() > 0.05);
    assert!(apart.count() < 500, "the pass is the same over the GPU's picture and the twin's");
}
