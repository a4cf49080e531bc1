//! Text and instruments over a picture: position, depth, and the patient's sides that they name.

use glam::{DMat3, DVec2, DVec3};
use relief_base::{Point, Vector};
use relief_render::{RenderRequest, RenderedFrame, SceneFile};
use relief_volume::{Camera, Grid, Orbit, Projection, Volume};
use serde_json::{Value, json};

const SIZE: [u32; 2] = [320, 240];

fn air() -> Volume {
    let grid = Grid::axis_aligned([4, 4, 4], [20.0; 3], [-30.0; 3]).unwrap();
    Volume::new(grid, vec![-1000; 64]).unwrap()
}

fn camera(projection: Projection) -> Camera {
    let (eye, at) = (Point::new(160.0, -300.0, 140.0), Point::new(0.0, 0.0, 0.0));
    Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), projection).unwrap()
}

fn over_air(camera: Camera, overlays: &Value) -> RenderedFrame {
    let volume = air();
    let json = json!({ "overlays": overlays, "size_px": SIZE }).to_string();
    let scene = SceneFile::parse(json.as_bytes()).unwrap().resolve(volume.grid(), &Orbit::default()).unwrap();
    relief_render::render_reference(&volume, &RenderRequest { camera, ..scene.request }).unwrap()
}

const PARALLEL: Projection = Projection::Orthographic { height_mm: 120.0 };
const PERSPECTIVE: Projection = Projection::Perspective { vertical_fov: 0.35 };

/// Pixels with a depth: column, row, depth, colour.
fn seen(frame: &RenderedFrame) -> Vec<(DVec2, f32, [u8; 4])> {
    let place = |i: usize| DVec2::new((i % 320) as f64, (i / 320) as f64) + 0.5;
    let pixels = frame.depth_mm.iter().zip(&frame.color_rgba).enumerate();
    pixels.filter(|(_, (mm, _))| mm.is_finite()).map(|(i, (mm, rgba))| (place(i), *mm, *rgba)).collect()
}

/// Invariant: A text has one depth; the cube turns with the patient; the scale bar has the length
/// that it states.
#[test]
fn a_text_has_one_depth_and_stands_around_its_point() {
    for projection in [PARALLEL, PERSPECTIVE] {
        let camera = camera(projection);
        let at = Point::new(10.0, -20.0, 15.0);
        let text = json!({ "text": { "at_mm": at.xyz.to_array(), "text": "HOH", "height_px": 30 } });
        let seen = seen(&over_air(camera, &json!({ "items": [text] })));
        let (u, v, depth) = camera.project(at, SIZE).unwrap();
        assert!(
            seen.iter().all(|(_, mm, _)| f64::from(*mm) == f64::from(depth as f32)),
            "one depth: {depth}"
        );
        let low = seen.iter().map(|(place, ..)| *place).reduce(DVec2::min).unwrap();
        let high = seen.iter().map(|(place, ..)| *place).reduce(DVec2::max).unwrap();
        assert!(((low + high) / 2.0).distance(DVec2::new(u, v)) < 2.0, "{low} to {high} around {u}, {v}");
        // Capitals of 30 px, half a stroke and a rim on both sides.
        assert!((high.y - low.y - 30.0 - 2.0 * (1.9 + 3.0)).abs() < 3.0, "{low} to {high}");
        let bright = seen.iter().filter(|(.., rgba)| rgba[0] > 250).count();
        let dark = seen.iter().filter(|(.., rgba)| rgba[0] < 20).count();
        assert!(bright > 400 && dark > 400, "{bright} pixels of ink, {dark} of the rim");
    }
}

#[test]
fn a_label_stands_beside_its_landmark_at_the_depth_of_its_front() {
    for projection in [PARALLEL, PERSPECTIVE] {
        let camera = camera(projection);
        let item =
            json!({ "landmark": { "at_mm": [0, 0, 0], "radius_mm": 6, "rgb": [1, 0, 0], "label": "Sella" } });
        let frame = over_air(camera, &json!({ "items": [item] }));
        let front = camera.distance_mm() - 6.0;
        let label: Vec<_> = seen(&frame).into_iter().filter(|(place, ..)| place.x > 190.0).collect();
        assert!(label.len() > 300, "{} pixels to the right", label.len());
        assert!(label.iter().all(|(_, mm, _)| (f64::from(*mm) - front).abs() < 1e-3), "at {front} mm");
        let rows = label.iter().map(|(place, ..)| place.y);
        let (top, bottom) = rows.fold((f64::INFINITY, 0.0f64), |(low, high), y| (low.min(y), high.max(y)));
        assert!(((top + bottom) / 2.0 - 120.0).abs() < 3.0, "rows {top} to {bottom}");
    }
}

/// Invariant: A text has one depth; the cube turns with the patient; the scale bar has the length
/// that it states.
#[test]
fn the_scale_bar_has_the_length_that_it_says() {
    for (projection, mm_per_px) in [(PARALLEL, 0.5), (PERSPECTIVE, 0.0)] {
        let camera = camera(projection);
        let mm_per_px =
            if mm_per_px > 0.0 { mm_per_px } else { 2.0 * camera.distance_mm() * 0.175f64.tan() / 240.0 };
        // A quarter of the width: 40 mm and 43 mm, so that 20 mm is the round length.
        assert!((40.0..44.0).contains(&(80.0 * mm_per_px)));
        let seen = seen(&over_air(camera, &json!({ "scale_bar": true })));
        let focal = camera.distance_mm() as f32;
        assert!(seen.iter().all(|(place, mm, _)| *mm == focal && place.x < 160.0 && place.y > 160.0));
        // The bar itself is the lowest row with ink; its middle lines are at both ends' ticks.
        let ink: Vec<DVec2> =
            seen.iter().filter(|(.., rgba)| rgba[0] > 250).map(|(place, ..)| *place).collect();
        let lowest = ink.iter().map(|place| place.y).fold(0.0, f64::max);
        let bar = ink.iter().filter(|place| place.y == lowest).map(|place| place.x);
        let (left, right) = bar.fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
        let length = (right - left) * mm_per_px;
        // Round ends add up to half the bar's width at each end.
        assert!((length - 20.0).abs() < 2.5 * mm_per_px, "{length} mm");
    }
}

/// Invariant: A text has one depth; the cube turns with the patient; the scale bar has the length
/// that it states.
#[test]
fn the_cube_is_turned_as_the_patient_is_and_stands_at_the_focal_depth() {
    let camera = camera(PARALLEL);
    let frame = over_air(camera, &json!({ "orientation_cube": true }));
    // The camera's axes in patient space, and the cube as a box of half sides around its middle.
    let backwards = (camera.eye().xyz - camera.look_at().xyz).normalize();
    let right = camera.up().xyz.cross(backwards).normalize();
    let patient_from_view = DMat3::from_cols(right, backwards.cross(right), backwards);
    let half = 0.06 * 240.0;
    let middle = DVec2::new(320.0, 240.0) - 2.1 * half;
    let mut faces = [0; 6];
    for (place, mm, rgba) in seen(&frame) {
        let off = (place - middle) / half;
        let origin = patient_from_view * DVec3::new(off.x, -off.y, 10.0);
        let direction = -backwards;
        let enters = ((-direction.signum() - origin) / direction).to_array();
        let axis = (0..3).max_by(|&a, &b| enters[a].total_cmp(&enters[b])).unwrap();
        let hit = origin + direction * enters[axis];
        let inside = (0..3).filter(|&other| other != axis).all(|other| hit[other].abs() < 0.9);
        let is_ink = rgba[..3].iter().all(|channel| *channel < 150);
        if !inside || is_ink {
            continue;
        }
        // Heights above the focal plane in half sides, 0.5 mm a pixel.
        let expected = camera.distance_mm() - (10.0 - enters[axis]) * half * 0.5;
        // A letter stands a little before its face.
        assert!((f64::from(mm) - expected).abs() < 0.5, "{place}: {mm} for {expected} mm");
        let brightest = (0..3).max_by_key(|&channel| rgba[channel]).unwrap();
        assert_eq!(brightest, axis, "{place}: {rgba:?} on the face of axis {axis}");
        faces[axis * 2 + usize::from(hit[axis] > 0.0)] += 1;
    }
    // From the left, front and above: L, A and H are seen, their opposites are not.
    assert!(faces[1] > 20 && faces[2] > 20 && faces[5] > 20, "{faces:?}");
    assert_eq!([faces[0], faces[3], faces[4]], [0; 3]);
}

#[test]
fn instruments_are_seen_before_everything() {
    let camera = camera(PARALLEL);
    // A wall just before the eye.
    let at = |x: f64, y: f64| {
        let (eye, forwards) = (camera.eye().xyz, (camera.look_at().xyz - camera.eye().xyz).normalize());
        let right = forwards.cross(camera.up().xyz).normalize();
        (eye + forwards * 5.0 + right * x + right.cross(forwards) * y).to_array()
    };
    let wall = json!({ "mesh": {
        "vertices_mm": [at(-500.0, -500.0), at(500.0, -500.0), at(0.0, 900.0)], "triangles": [[0, 1, 2]] } });
    let instruments = json!({ "scale_bar": true, "orientation_cube": true });
    let mut with_wall = instruments.clone();
    with_wall["items"] = json!([wall]);
    let (alone, behind) = (over_air(camera, &instruments), over_air(camera, &with_wall));
    // Where wall and instrument share a pixel evenly either may have it.
    let pairs = alone.depth_mm.iter().zip(&behind.depth_mm).filter(|(mm, _)| mm.is_finite());
    let (same, shared): (Vec<_>, Vec<_>) = pairs.partition(|(alone, behind)| alone == behind);
    assert!(same.len() > 1000, "{} pixels of instruments", same.len());
    assert!(
        shared.len() * 50 < same.len(),
        "{} of {} pixels have the wall's depth",
        shared.len(),
        same.len()
    );
    assert!((f64::from(behind.depth_mm[0]) - 5.0).abs() < 1e-3, "the wall is there");
}
