//! Placed lights, shadows and occlusion of ray-cast modes: closed forms, the f64 twin, and the
//! settings with and without effect. Solids are 96³ voxels of 1 mm, centred; pictures look down on
//! a floor, 1 mm a pixel, x to the right.

use glam::DVec3;

use super::twin::{compare, oblique_head, request};
use super::{in_mode, renderer};
use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    Classification, EmptySpaceSkipping, Illumination, Light, Mode, Occlusion, PathTrace, Placement,
    RenderRequest, RenderedFrame, SceneFile, Shading, Surface,
};
use relief_volume::{
    Camera, ControlPoint, GradientOpacity, Grid, PhantomKind, Projection, TransferFunction, Volume,
    linear_from_srgb,
};

const SIDE: usize = 96;
/// Where the floor of the solids begins.
const FLOOR_MM: f64 = -20.0;
/// Cells of 2 voxels.
const CELL_MM: f64 = 2.0;
/// Extinction per mm of a voxel of 200 HU.
const EXTINCTION: f64 = 0.02;

/// 1000 HU where `solid` is above 0 (a distance inside, mm), 200 HU where `veil` is, edges 1 mm
/// wide.
fn solids(solid: impl Fn(DVec3) -> f64, veil: impl Fn(DVec3) -> f64) -> Volume {
    let grid = Grid::axis_aligned([SIDE; 3], [1.0; 3], [-47.5; 3]).unwrap();
    let covered = |distance: f64| (distance + 0.5).clamp(0.0, 1.0);
    let hu = |at: usize| {
        let index = Point::new((at % SIDE) as f64, (at / SIDE % SIDE) as f64, (at / SIDE / SIDE) as f64);
        let place = (grid.patient_from_voxel() * index).xyz;
        (1000.0 * covered(solid(place))).max(200.0 * covered(veil(place))).round() as i16
    };
    let voxels = (0..SIDE.pow(3)).map(hu).collect();
    Volume::new(grid, voxels).unwrap()
}

fn floor(place: DVec3) -> f64 {
    FLOOR_MM - place.z
}

fn nothing(_: DVec3) -> f64 {
    -1e3
}

fn transfer() -> TransferFunction {
    let point = |hu, a| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, a] };
    let thin = 1.0 - (-EXTINCTION).exp();
    let points = vec![point(0.0, 0.0), point(200.0, thin), point(480.0, thin), point(520.0, 1.0)];
    TransferFunction::new(points, 1.0).unwrap()
}

fn distant(direction: DVec3, size: f64) -> Light {
    let placement = Placement::PatientDirection(Vector::from_xyz(direction));
    Light { placement, rgb: [1.0; 3], intensity: 1.0, size }
}

/// Down on the floor, with diffuse light only.
fn looking_down(volume: &Volume, lights: Vec<Light>, illumination: Illumination) -> RenderRequest {
    let (eye, at) = (Point::new(0.0, 0.0, 400.0), Point::new(0.0, 0.0, 0.0));
    let projection = Projection::Orthographic { height_mm: 90.0 };
    let camera = Camera::new(eye, at, Vector::new(0.0, 1.0, 0.0), projection).unwrap();
    let scene = SceneFile::default().with_size([90, 90]);
    let request = scene.resolve(volume.grid(), &relief_volume::Orbit::default()).unwrap().request;
    let shading = Shading { ambient: 0.0, diffuse: 1.0, specular: 0.0, shininess: 1.0 };
    let transfer = transfer();
    RenderRequest { camera, transfer, shading, lights, illumination, sample_distance_mm: 0.5, ..request }
}

fn shadows() -> Illumination {
    Illumination { shadows: 1.0, ..Illumination::default() }
}

fn occlusion(radius_mm: f64) -> Illumination {
    Illumination { shadows: 0.0, occlusion: Occlusion { strength: 1.0, radius_mm } }
}

/// Brightness by place: x and y in mm.
fn brightness(frame: &RenderedFrame) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
    frame.color_rgba.iter().enumerate().map(|(i, pixel)| {
        let (x, y) = ((i % 90) as f64 - 44.5, 44.5 - (i / 90) as f64);
        (x, y, f64::from(pixel[0]) / 255.0)
    })
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    assert!(count > 0.0, "a mean of nothing");
    sum / count
}

/// Invariant: Placed lights, shadows and openness follow their closed forms, and shadows lie where
/// the path tracer has them.
#[test]
fn a_veil_between_light_and_floor_takes_light_by_the_exponential_law() {
    let Some(mut renderer) = renderer("a_veil_between_light_and_floor") else { return };
    let veil = |p: DVec3| (p.x - 10.0).min(45.0 - p.x).min(p.z).min(30.0 - p.z);
    let volume = solids(floor, veil);
    // From the right at half a right angle: what reaches x = -8 has crossed 30 mm of height.
    let slanted = DVec3::new(1.0, 0.0, 1.0).normalize();
    for (strength, share) in [(1.0, 1.0), (0.5, 0.5), (0.0, 0.0)] {
        let illumination = Illumination { shadows: strength, ..Illumination::default() };
        let request = looking_down(&volume, vec![distant(slanted, 0.0)], illumination);
        let frame = renderer.render(&volume, &request).unwrap();
        let at = |low: f64, high: f64| {
            let places = brightness(&frame).filter(move |(x, y, _)| *x > low && *x < high && y.abs() < 30.0);
            mean(places.map(|(_, _, value)| value))
        };
        let passed = (-EXTINCTION * 30.0 * 2.0f64.sqrt()).exp();
        let expected = slanted.z * (1.0 - share * (1.0 - passed));
        println!(
            "shadows {strength}: {:.4} for {expected:.4}, beside {:.4}",
            at(-10.0, -6.0),
            at(-44.0, -40.0)
        );
        assert!((at(-10.0, -6.0) - expected).abs() < 0.01, "{} for {expected}", at(-10.0, -6.0));
        assert!((at(-44.0, -40.0) - slanted.z).abs() < 0.005, "{} beside the shadow", at(-44.0, -40.0));
    }
}

/// A ball over the floor under a slanted light: its shadow is an ellipse.
const BALL: DVec3 = DVec3::new(0.0, 0.0, 15.0);
const BALL_MM: f64 = 12.0;
const SLANTED: DVec3 = DVec3::new(0.6, 0.0, 0.8);

fn ball_over_floor() -> Volume {
    solids(|p| floor(p).max(BALL_MM - p.distance(BALL)), nothing)
}

/// How far out in the shadow's ellipse a place of the floor is: 1 on its outline.
fn out_of_shadow(x: f64, y: f64) -> f64 {
    let center = BALL.x - SLANTED.x / SLANTED.z * (BALL.z - FLOOR_MM);
    ((x - center) / (BALL_MM / SLANTED.z)).hypot(y / BALL_MM)
}

fn is_bare_floor(x: f64, y: f64) -> bool {
    x.hypot(y) > BALL_MM + 1.5
}

/// Invariant: Placed lights, shadows and openness follow their closed forms, and shadows lie where
/// the path tracer has them.
#[test]
fn the_shadow_of_a_ball_has_its_outline() {
    let Some(mut renderer) = renderer("the_shadow_of_a_ball") else { return };
    let volume = ball_over_floor();
    let half = vec![Surface::opaque(500.0, &transfer())];
    for (mode, surfaces) in [(Mode::Composite, vec![]), (Mode::Isosurface, half)] {
        let request = looking_down(&volume, vec![distant(SLANTED, 0.0)], shadows());
        let frame = renderer.render(&volume, &RenderRequest { mode, surfaces, ..request }).unwrap();
        let floor = || brightness(&frame).filter(|(x, y, _)| is_bare_floor(*x, *y) && *x < 25.0);
        let margin = 1.5 * CELL_MM / BALL_MM;
        for (x, y, value) in floor() {
            let out = out_of_shadow(x, y);
            if out < 1.0 - margin {
                assert!(value < 0.1, "{mode:?}: {value} in the shadow at {x}, {y}");
            } else if out > 1.0 + margin {
                assert!((value - SLANTED.z).abs() < 0.02, "{mode:?}: {value} beside the shadow at {x}, {y}");
            }
        }
        let dark = floor().filter(|(_, _, value)| *value < SLANTED.z / 2.0).count() as f64;
        let area = floor().filter(|(x, y, _)| out_of_shadow(*x, *y) < 1.0).count() as f64;
        println!("{mode:?}: a shadow of {dark} mm² for {area}");
        assert!(area > 500.0 && (dark / area - 1.0).abs() < 0.06, "{mode:?}: {dark} for {area}");
    }
}

/// Invariant: Placed lights, shadows and openness follow their closed forms, and shadows lie where
/// the path tracer has them.
#[test]
fn path_traced_shadows_lie_where_these_do() {
    let Some(mut renderer) = renderer("path_traced_shadows") else { return };
    let volume = ball_over_floor();
    let cast = looking_down(&volume, vec![distant(SLANTED, 0.0)], shadows());
    let path_trace = PathTrace {
        passes: 48,
        environment: 0.0,
        exposure: 1.0,
        surface_hu_per_mm: 0.01,
        ..PathTrace::default()
    };
    let traced = RenderRequest { mode: Mode::PathTraced, path_trace, ..cast.clone() };
    let cast = renderer.render(&volume, &cast).unwrap();
    let traced = renderer.render(&volume, &traced).unwrap();
    let pairs = brightness(&cast).zip(brightness(&traced)).filter(|((x, y, _), _)| is_bare_floor(*x, *y));
    let (mut agreeing, mut all, mut dark) = (0.0, 0.0, 0.0);
    for ((_, _, cast), (_, _, traced)) in pairs {
        let is_dark = cast < SLANTED.z / 2.0;
        agreeing += f64::from(u8::from(is_dark == (linear_from_srgb(traced) < SLANTED.z / 4.0)));
        dark += f64::from(u8::from(is_dark));
        all += 1.0;
    }
    println!("{agreeing} of {all} pixels agree, {dark} in shadow");
    assert!(dark > 400.0 && agreeing / all > 0.985, "{agreeing} of {all} agree, {dark} in shadow");
}

#[test]
fn larger_lights_cast_softer_shadows() {
    let Some(mut renderer) = renderer("larger_lights") else { return };
    let volume = ball_over_floor();
    let penumbra = [0.0f64, 20.0].map(|degrees| {
        let request = looking_down(&volume, vec![distant(SLANTED, degrees.to_radians())], shadows());
        let frame = renderer.render(&volume, &request).unwrap();
        let floor = brightness(&frame).filter(|(x, y, _)| is_bare_floor(*x, *y) && *x < 25.0);
        floor.filter(|(_, _, value)| (0.1..0.7).contains(value)).count()
    });
    println!("pixels between dark and lit: {penumbra:?}");
    // Penumbrae of a disc of 20 degrees over 44 mm are 15 mm wide.
    assert!(penumbra[0] < 200 && penumbra[1] > 3 * penumbra[0], "{penumbra:?}");
}

#[test]
fn a_near_light_casts_a_shadow_away_from_itself() {
    let Some(mut renderer) = renderer("a_near_light_casts_a_shadow") else { return };
    let volume = ball_over_floor();
    // 13 mm above the ball's top: its tangents meet the floor at a circle around the place below.
    let lamp =
        Light { placement: Placement::PatientPosition(Point::new(0.0, 0.0, 40.0)), ..distant(SLANTED, 0.0) };
    let request = looking_down(&volume, vec![lamp], shadows());
    let frame = renderer.render(&volume, &request).unwrap();
    let distance = 40.0 - BALL.z;
    let radius = (40.0 - FLOOR_MM) * BALL_MM / (distance * distance - BALL_MM * BALL_MM).sqrt();
    let (mut dark, mut lit) = (0, 0);
    for (x, y, value) in brightness(&frame).filter(|(x, y, _)| is_bare_floor(*x, *y)) {
        let (off, up) = (x.hypot(y), 40.0 - FLOOR_MM);
        if off < radius - 2.0 * CELL_MM {
            assert!(value < 0.1, "{value} in the shadow at {x}, {y}");
            dark += 1;
        } else if off > radius + 2.0 * CELL_MM {
            let facing = up / off.hypot(up);
            assert!((value - facing).abs() < 0.02, "{value} for {facing} at {x}, {y}");
            lit += 1;
        }
    }
    assert!(dark > 300 && lit > 1500, "{dark} pixels in shadow, {lit} in the light, radius {radius}");
}

/// The open share of all directions at height `h` over the floor and distance `s` from the wall, of
/// things within `r`.
fn corner_openness(h: f64, s: f64, r: f64) -> f64 {
    let steps = 400;
    let mut open = 0.0;
    for i in 0..steps {
        let z = 2.0 * (f64::from(i) + 0.5) / f64::from(steps) - 1.0;
        for j in 0..steps {
            let turn = (f64::from(j) + 0.5) / f64::from(steps) * std::f64::consts::TAU;
            let x = (1.0 - z * z).sqrt() * turn.cos();
            open += f64::from(u8::from(-z * r < h && -x * r < s));
        }
    }
    open / f64::from(steps * steps)
}

/// Invariant: Placed lights, shadows and openness follow their closed forms, and shadows lie where
/// the path tracer has them.
#[test]
fn an_even_floor_is_open_and_a_corner_is_not() {
    let Some(mut renderer) = renderer("an_even_floor_is_open") else { return };
    const RADIUS_MM: f64 = 15.0;
    let plain = solids(floor, nothing);
    let bare = renderer.render(&plain, &looking_down(&plain, vec![], Illumination::default())).unwrap();
    let open = renderer.render(&plain, &looking_down(&plain, vec![], occlusion(RADIUS_MM))).unwrap();
    assert!(bare.color_rgba.iter().all(|pixel| pixel[0] >= 254), "the floor faces the light");
    let worst = bare.color_rgba.iter().zip(&open.color_rgba).map(|(a, b)| a[0].abs_diff(b[0])).max();
    assert!(worst <= Some(2), "half of all directions are open before a floor: {worst:?} of 255 darker");
    // A wall on the left, 30 mm high.
    let corner = solids(|p| floor(p).max((FLOOR_MM - p.x).min(10.0 - p.z)), nothing);
    let frame = renderer.render(&corner, &looking_down(&corner, vec![], occlusion(RADIUS_MM))).unwrap();
    let mut worst = 0.0f64;
    for step in 0..14 {
        let x = FLOOR_MM + 1.5 + f64::from(step);
        let column = brightness(&frame).filter(|(at, y, _)| (at - x).abs() < 0.1 && y.abs() < 25.0);
        let found = mean(column.map(|(_, _, value)| value));
        let expected = (2.0 * corner_openness(CELL_MM, x - FLOOR_MM, RADIUS_MM)).min(1.0);
        println!("{:.1} mm from the wall: {found:.3} for {expected:.3}", x - FLOOR_MM);
        worst = worst.max((found - expected).abs());
    }
    // 32 directions, cells of 2 mm.
    assert!(worst < 0.06, "{worst} away from the share of open directions");
}

#[test]
fn a_light_at_the_eye_is_the_headlight() {
    let Some(mut renderer) = renderer("a_light_at_the_eye") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    for mode in [Mode::Composite, Mode::Isosurface] {
        let mut request = in_mode(mode, request(&volume, "skin", 0.0));
        request.shading = Shading { ambient: 0.2, diffuse: 0.6, specular: 0.3, shininess: 12.0 };
        let headlight = renderer.render(&volume, &request).unwrap();
        let placement = Placement::ViewDirection(Vector::new(0.0, 0.0, 1.0));
        request.lights = vec![Light { placement, ..distant(DVec3::Z, 0.0) }];
        let placed = renderer.render(&volume, &request).unwrap();
        let pairs = headlight.color_rgba.iter().zip(&placed.color_rgba);
        let worst = pairs.map(|(a, b)| (0..4).map(|c| a[c].abs_diff(b[c])).max().unwrap()).max();
        assert!(worst <= Some(1), "{mode:?}: {worst:?} of 255 apart");
    }
}

/// Invariant: Placed lights, shadows and openness follow their closed forms, and shadows lie where
/// the path tracer has them.
#[test]
fn a_ball_is_lit_by_lamberts_cosine_and_blinns_highlight() {
    let Some(mut renderer) = renderer("a_ball_is_lit_by_lamberts_cosine") else { return };
    let volume = solids(|p| (35.0 - p.length()) / 40.0, nothing);
    let toward = DVec3::new(0.5, 0.4, 0.7).normalize();
    let mut request = looking_down(&volume, vec![], Illumination::default());
    // Half-way, 35 mm from the centre; 25 HU a mm everywhere about it.
    (request.mode, request.surfaces) =
        (Mode::Isosurface, vec![Surface { hu: 500.0, rgb: [0.8; 3], opacity: 1.0 }]);
    request.shading = Shading { ambient: 0.1, diffuse: 0.5, specular: 0.3, shininess: 9.0 };
    request.lights = vec![Light { rgb: [1.0, 0.5, 0.25], intensity: 1.2, ..distant(toward, 0.0) }];
    let frame = renderer.render(&volume, &request).unwrap();
    let (mut errors, mut shaded) = (Vec::new(), 0);
    for (i, (x, y, _)) in brightness(&frame).enumerate() {
        if x.hypot(y) > 31.0 {
            continue;
        }
        let normal = DVec3::new(x, y, (35.0f64 * 35.0 - x * x - y * y).sqrt()) / 35.0;
        let facing = normal.dot(toward);
        let across = normal.dot((toward + DVec3::Z).normalize()).max(0.0);
        let given = if facing > 0.0 { 0.4 * facing + 0.3 * across.powi(9) } else { 0.0 };
        shaded += usize::from(facing <= 0.0);
        for (channel, rgb) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            let found = f64::from(frame.color_rgba[i][channel]) / 255.0;
            errors.push(found - (0.08 + 1.2 * rgb * given).min(1.0));
        }
    }
    let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    println!("{} values, rms {rms:.4}, {shaded} pixels on the dark side", errors.len());
    assert!(errors.len() > 8000 && shaded > 30 && rms < 0.008, "rms {rms}, {shaded} dark");
}

/// The head under lights in both spaces, soft and sharp, with shadows and occlusion.
fn lit_head(volume: &Volume, mode: Mode, preset: &str, fov: f64) -> RenderRequest {
    let mut request = in_mode(mode, request(volume, preset, fov));
    request.shading = Shading { ambient: 0.3, diffuse: 0.6, specular: 0.2, shininess: 20.0 };
    let lamp = Placement::PatientPosition(volume.grid().center() + Vector::new(-150.0, -220.0, 90.0));
    let beside = Placement::ViewDirection(Vector::new(-1.0, 0.3, 0.2));
    let white = distant(DVec3::Z, 0.0);
    request.lights = vec![
        Light { placement: beside, size: 0.3, rgb: [1.0, 0.9, 0.8], ..white },
        Light { placement: lamp, intensity: 0.4, ..white },
    ];
    request.illumination =
        Illumination { shadows: 0.9, occlusion: Occlusion { strength: 0.8, radius_mm: 24.0 } };
    request
}

/// Invariant: The GPU and the f64 reference agree about lights, shadows and occlusion.
#[test]
fn gpu_and_twin_agree_about_lights_shadows_and_occlusion() {
    let volume = oblique_head();
    for mode in [Mode::Composite, Mode::Isosurface] {
        for (fov, preset) in [(25.0, "bone"), (0.0, "soft-tissue")] {
            let request = lit_head(&volume, mode, preset, fov);
            compare(&volume, &request, &format!("lights, {mode:?}, {fov}, {preset}"));
        }
    }
    let mut clipped = lit_head(&volume, Mode::Composite, "skin", 25.0);
    let center = volume.grid().center();
    let normal = Vector::new(0.3, -1.0, 0.2);
    clipped.clip.planes.push(relief_render::ClipPlane { point: center, normal });
    clipped.clip.sphere =
        Some(relief_render::ClipSphere { center: center + Vector::new(0.0, -60.0, 20.0), radius_mm: 35.0 });
    compare(&volume, &clipped, "lights, clipped");
    let surfaces = RenderRequest { clip: clipped.clip, ..lit_head(&volume, Mode::Isosurface, "skin", 0.0) };
    compare(&volume, &surfaces, "lights, clipped surfaces");
    let mut faded = lit_head(&volume, Mode::Composite, "skin", 0.0);
    let opacity = GradientOpacity::new(vec![[20.0, 0.0], [80.0, 0.4], [300.0, 1.0]]).unwrap();
    faded.transfer = faded.transfer.with_gradient_opacity(opacity);
    compare(&volume, &faded, "lights, opacity by gradient");
    let mut smooth = lit_head(&volume, Mode::Composite, "soft-tissue", 25.0);
    smooth.classification = Classification::PreIntegrated;
    compare(&volume, &smooth, "lights, pre-integrated");
    let mut ambient = lit_head(&volume, Mode::Composite, "bone", 25.0);
    ambient.shading = Shading { ambient: 0.9, ..Shading::NONE };
    compare(&volume, &ambient, "occlusion of ambient light alone");
}

/// Invariant: Light changes no depth, and its cells do not depend on the camera for which they were
/// first computed.
#[test]
fn light_changes_no_depth_and_skipping_no_byte() {
    let Some(mut renderer) = renderer("light_changes_no_depth") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    for mode in [Mode::Composite, Mode::Isosurface] {
        let lit = lit_head(&volume, mode, "skin", 25.0);
        let plain = RenderRequest { lights: vec![], illumination: Illumination::default(), ..lit.clone() };
        let [with, without] = [&lit, &plain].map(|request| renderer.render(&volume, request).unwrap());
        // Two pipelines: the last bit may differ.
        let apart = |(a, b): (&f32, &f32)| if a == b { 0.0 } else { (a - b).abs() };
        let worst = with.depth_mm.iter().zip(&without.depth_mm).map(apart).fold(0.0, f32::max);
        println!("{mode:?}: light moves depth by {worst} mm");
        assert!(worst < 0.001, "{mode:?}: light moves depth by {worst} mm");
        assert!(with.color_rgba != without.color_rgba, "{mode:?}: light changes nothing");
        let unskipped = renderer.render_with(&volume, &lit, EmptySpaceSkipping::Off).unwrap();
        assert!(with.color_rgba == unskipped.color_rgba, "{mode:?}: skipping changes bytes");
    }
}

/// Invariant: Light changes no depth, and its cells do not depend on the camera for which they were
/// first computed.
#[test]
fn cells_are_filled_once_and_do_not_depend_on_who_looked_first() {
    let Some(mut renderer) = renderer("cells_are_filled_once") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let mut request = lit_head(&volume, Mode::Composite, "bone", 25.0);
    let placement = Placement::PatientDirection(Vector::new(-0.5, -0.7, 0.6));
    request.lights = vec![Light { placement, ..distant(DVec3::Z, 0.0) }];
    let turned = RenderRequest { camera: request.camera.orbited(0.7), ..request.clone() };
    let first = renderer.render(&volume, &request).unwrap();
    assert!(first.timings.upload_ms > 0.0, "nothing was filled");
    let second = renderer.render(&volume, &turned).unwrap();
    assert!(second.timings.upload_ms == 0.0, "lights that stay with the patient are filled once");
    // The other way round, from nothing.
    renderer.forget(volume.content_hash());
    let again = renderer.render(&volume, &turned).unwrap();
    assert!(again.timings.upload_ms > 0.0 && again.color_rgba == second.color_rgba, "who looked first shows");
    let plain = RenderRequest { lights: vec![], illumination: Illumination::default(), ..turned.clone() };
    renderer.render(&volume, &plain).unwrap();
    assert!(renderer.render(&volume, &turned).unwrap().color_rgba == second.color_rgba);
    // A light that goes with the camera has other cells wherever that is.
    let placement = Placement::ViewDirection(Vector::new(-0.5, 0.7, 0.6));
    request.lights[0].placement = placement;
    renderer.render(&volume, &request).unwrap();
    request.camera = request.camera.orbited(0.1);
    assert!(renderer.render(&volume, &request).unwrap().timings.upload_ms > 0.0);
    assert!(renderer.render(&volume, &request).unwrap().timings.upload_ms == 0.0);
}
