//! Cut faces, where the volume's edge, a clip plane or the cut-away sphere opens a body: against
//! closed forms, in a body of noise.

use glam::{DAffine3, DVec3};
use relief_base::{Point, Transform, Vector, ViewDepth};
use relief_render::{
    ClipPlane, ClipSphere, CutFaces, DepthRule, Mode, RenderRequest, RenderedFrame, Renderer, SceneFile,
    Shading, render_reference,
};
use relief_volume::{ControlPoint, Grid, Orbit, TransferFunction, Volume};

use super::renderer;

const SIDE: usize = 40;
const SIZE_PX: [u32; 2] = [96, 72];
const SHADING: Shading = Shading { ambient: 0.25, diffuse: 0.6, specular: 0.0, shininess: 10.0 };

/// A body without surfaces: its gradients point anywhere. Its grid is turned and stretched.
fn noise() -> Volume {
    let turn = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 0.6);
    let stretch = DAffine3::from_scale(DVec3::new(1.0, 1.3, 2.0));
    let center = DAffine3::from_translation(DVec3::splat(-0.5 * (SIDE - 1) as f64));
    let grid = Grid::new([SIDE; 3], Transform::from_affine(turn * stretch * center)).unwrap();
    let value = |at: usize| {
        let mixed = (at as u64 ^ 0x9e37).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) % 200) as i16
    };
    Volume::new(grid, (0..SIDE.pow(3)).map(value).collect()).unwrap()
}

/// The body, opaque and of one colour.
fn request(volume: &Volume, vertical_fov_deg: f64) -> RenderRequest {
    let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.4, vertical_fov_deg };
    let scene = SceneFile::default().with_size(SIZE_PX).resolve(volume.grid(), &orbit).unwrap();
    let point = |hu: f64, opacity: f64| ControlPoint { hu, rgba: [1.0, 0.8, 0.6, opacity] };
    RenderRequest {
        transfer: TransferFunction::new(vec![point(-200.0, 0.0), point(-100.0, 1.0)], 1.0).unwrap(),
        mode: Mode::Composite,
        shading: SHADING,
        sample_distance_mm: 0.9,
        depth: DepthRule::Threshold { fraction: 0.5 },
        ..scene.request
    }
}

/// The face through which a ray enters the visible part: distance from the eye, and normal.
struct Entry {
    t_mm: f64,
    normal: DVec3,
    /// How much nearer the next face is, mm: rays near an edge may meet either.
    margin_mm: f64,
}

/// The eye's ray through a pixel: its origin and its direction.
fn ray(frame: &RenderedFrame, pixel: [u32; 2]) -> (DVec3, DVec3) {
    let at = |mm: f32| frame.point_at(pixel, ViewDepth(mm)).unwrap().xyz;
    let direction = (at(2000.0) - at(1.0)).normalize();
    (at(1.0), direction)
}

/// The planes that bound the visible part, as points and normals to the inside.
fn planes(volume: &Volume, request: &RenderRequest) -> Vec<(DVec3, DVec3)> {
    let grid = volume.grid();
    let affine = grid.patient_from_voxel().affine;
    let last = (SIDE - 1) as f64;
    let mut planes: Vec<(DVec3, DVec3)> =
        request.clip.planes.iter().map(|plane| (plane.point.xyz, plane.normal.xyz.normalize())).collect();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        // The axes are orthogonal: the normal of a face is an axis' own direction.
        let along = affine.transform_vector3(axis).normalize();
        planes.push((affine.transform_point3(-0.5 * axis), along));
        planes.push((affine.transform_point3((last + 0.5) * axis), -along));
    }
    planes
}

fn entry(planes: &[(DVec3, DVec3)], (origin, direction): (DVec3, DVec3)) -> Option<Entry> {
    let met =
        |&(point, normal): &(DVec3, DVec3)| (normal.dot(point - origin) / normal.dot(direction), normal);
    let (into, out): (Vec<_>, Vec<_>) = planes.iter().partition(|(_, normal)| normal.dot(direction) > 0.0);
    let mut into: Vec<(f64, DVec3)> = into.into_iter().map(met).collect();
    into.sort_by(|a, b| b.0.total_cmp(&a.0));
    let exit = out.into_iter().map(|plane| met(plane).0).fold(f64::INFINITY, f64::min);
    let (t_mm, normal) = into[0];
    // Thin corners may fall between two samples.
    (exit - t_mm > 4.0).then(|| Entry { t_mm, normal: -normal, margin_mm: t_mm - into[1].0 })
}

fn pixels() -> impl Iterator<Item = [u32; 2]> {
    (0..SIZE_PX[1]).flat_map(|row| (0..SIZE_PX[0]).map(move |column| [column, row]))
}

fn color(frame: &RenderedFrame, [column, row]: [u32; 2]) -> [u8; 4] {
    frame.color_rgba[(row * SIZE_PX[0] + column) as usize]
}

/// The picture by the graphics adapter, the processor and the reference.
fn pictures(
    gpu: &mut Renderer,
    volume: &Volume,
    request: &RenderRequest,
) -> [(&'static str, RenderedFrame); 3] {
    [
        ("adapter", gpu.render(volume, request).unwrap()),
        ("processor", Renderer::on_processor().render(volume, request).unwrap()),
        ("reference", render_reference(volume, request).unwrap()),
    ]
}

/// Compares all pixels on faces with the light of a plane and with its depth; returns their number.
fn expect_faces(frame: &RenderedFrame, planes: &[(DVec3, DVec3)], forward: DVec3, what: &str) -> usize {
    let mut compared = 0;
    for pixel in pixels() {
        let ray = ray(frame, pixel);
        let Some(Entry { t_mm, normal, margin_mm }) = entry(planes, ray) else { continue };
        let depth_mm = (t_mm + 1.0 / ray.1.dot(forward)) * ray.1.dot(forward);
        let found = f64::from(frame.depth_at(pixel).0);
        assert!((found - depth_mm).abs() < 0.02, "{what} at {pixel:?}: depth {found} mm for {depth_mm}");
        // Close to an edge, the first sample lies behind the other face's fade, too.
        if margin_mm < 0.01 {
            continue;
        }
        let light = SHADING.ambient + SHADING.diffuse * normal.dot(ray.1).abs();
        for (found, channel) in color(frame, pixel).into_iter().zip([1.0, 0.8, 0.6]) {
            let expected = 255.0 * light * channel;
            assert!(
                (f64::from(found) - expected).abs() <= 1.5,
                "{what} at {pixel:?}: {found} for {expected}, depth {depth_mm} mm"
            );
        }
        compared += 1;
    }
    compared
}

/// Invariant: A cut face has the light and the depth of its plane, whatever it cuts.
#[test]
fn cut_faces_are_lit_and_deep_as_planes() {
    let Some(mut gpu) = renderer("cut_faces_are_lit_and_deep_as_planes") else { return };
    let volume = noise();
    let clip = ClipPlane { point: Point::new(0.0, -4.0, 2.0), normal: Vector::new(0.3, 1.4, -0.6) };
    for (what, fov, planes_of_clip) in
        [("edges", 25.0, vec![]), ("plane", 25.0, vec![clip]), ("plane, parallel", 0.0, vec![clip])]
    {
        let mut request = request(&volume, fov);
        request.clip.planes = planes_of_clip;
        let bounds = planes(&volume, &request);
        let forward = (request.camera.look_at() - request.camera.eye()).xyz.normalize();
        for (by, frame) in pictures(&mut gpu, &volume, &request) {
            let compared = expect_faces(&frame, &bounds, forward, &format!("{what}, {by}"));
            assert!(compared > 1500, "{what}, {by}: {compared} pixels on faces");
        }
    }
}

/// Invariant: The wall of the cut-away sphere is lit by its own normal.
#[test]
fn the_wall_of_the_sphere_is_lit_by_its_normal() {
    let Some(mut gpu) = renderer("the_wall_of_the_sphere_is_lit_by_its_normal") else { return };
    let volume = noise();
    let mut request = request(&volume, 25.0);
    // The hole takes the corner that is nearest to the eye.
    let eye = request.camera.eye();
    let nearest =
        volume.grid().corners().into_iter().min_by(|a, b| a.distance(eye).total_cmp(&b.distance(eye)));
    let (center, radius_mm) = (nearest.unwrap(), 22.0);
    request.clip.sphere = Some(ClipSphere { center, radius_mm });
    let bounds = planes(&volume, &request);
    for (by, frame) in pictures(&mut gpu, &volume, &request) {
        let mut compared = 0;
        for pixel in pixels().filter(|&pixel| frame.depth_at(pixel).is_hit()) {
            let (origin, direction) = ray(&frame, pixel);
            let at = frame.pick(pixel).unwrap();
            let Some(Entry { t_mm, .. }) = entry(&bounds, (origin, direction)) else { continue };
            // Where the wall meets a face of the body, either may be the last before a point.
            let is_wall = (at.xyz - origin).dot(direction) > t_mm + 0.1;
            if !is_wall || (at.distance(center) - radius_mm).abs() > 0.02 {
                continue;
            }
            let normal = (at - center).xyz / radius_mm;
            let light = SHADING.ambient + SHADING.diffuse * normal.dot(direction).abs();
            let found = f64::from(color(&frame, pixel)[0]);
            assert!((found - 255.0 * light).abs() <= 2.0, "{by} at {pixel:?}: {found} for {}", 255.0 * light);
            compared += 1;
        }
        assert!(compared > 500, "{by}: {compared} pixels on the wall");
    }
}

/// The value at a position between voxel centres, HU.
fn trilinear(volume: &Volume, at: DVec3) -> f64 {
    let p = volume.grid().voxel_from_patient().affine.transform_point3(at);
    let p = p.clamp(DVec3::ZERO, DVec3::splat((SIDE - 1) as f64));
    let base = p.floor().min(DVec3::splat((SIDE - 2) as f64));
    let share = p - base;
    let [x, y, z] = base.to_array().map(|n| n as usize);
    let mut sum = 0.0;
    for corner in 0..8 {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight =
            [i, j, k].into_iter().zip(share.to_array()).map(|(n, s)| if n == 1 { s } else { 1.0 - s });
        let hu = volume.voxels_hu()[((z + k) * SIDE + y + j) * SIDE + x + i];
        sum += weight.product::<f64>() * f64::from(hu);
    }
    sum
}

/// Invariant: `cut: slice` paints the slice in its window where the face is, and rays go on where
/// the value is below the window.
#[test]
fn painted_faces_show_the_slice() {
    let Some(mut gpu) = renderer("painted_faces_show_the_slice") else { return };
    let volume = noise();
    for rule in
        [DepthRule::FirstHit, DepthRule::Threshold { fraction: 0.5 }, DepthRule::TwoLayer { fraction: 0.5 }]
    {
        let mut request = request(&volume, 25.0);
        request.depth = rule;
        // Nothing of the body shows but its slice.
        let point = |hu: f64| ControlPoint { hu, rgba: [1.0, 0.0, 0.0, 0.0] };
        request.transfer = TransferFunction::new(vec![point(-200.0), point(300.0)], 1.0).unwrap();
        let clip = ClipPlane { point: Point::new(0.0, -4.0, 2.0), normal: Vector::new(0.3, 1.4, -0.6) };
        request.clip.planes = vec![clip];
        request.cut = CutFaces::Slice { window_hu: [130.0, 140.0] };
        let bounds = planes(&volume, &request);
        for (by, frame) in pictures(&mut gpu, &volume, &request) {
            let (mut painted, mut passed) = (0, 0);
            for pixel in pixels() {
                let (origin, direction) = ray(&frame, pixel);
                let Some(Entry { t_mm, margin_mm, .. }) = entry(&bounds, (origin, direction)) else {
                    continue;
                };
                if margin_mm < 0.01 {
                    continue;
                }
                let at = origin + direction * t_mm;
                let grey = (trilinear(&volume, at) - 60.0) / 140.0;
                let found = color(&frame, pixel);
                if grey > 0.01 {
                    let expected = 255.0 * grey.min(1.0);
                    assert!(
                        (f64::from(found[0]) - expected).abs() < 4.0,
                        "{by}, {pixel:?}: {found:?}, {expected}"
                    );
                    assert!(found[0] == found[1] && found[1] == found[2] && found[3] == 255, "{found:?}");
                    let picked = frame.pick(pixel).unwrap().xyz;
                    assert!(picked.distance(at) < 0.02, "{by}, {rule:?}, {pixel:?}: {picked} for {at}");
                    painted += 1;
                } else if grey < -0.01 {
                    assert!(!frame.depth_at(pixel).is_hit() && found[3] == 0, "{by}, {pixel:?}: {found:?}");
                    passed += 1;
                }
            }
            assert!(painted > 1000 && passed > 200, "{by}: {painted} painted, {passed} passed");
        }
    }
}

/// A face that the sphere opens is painted behind what lies before the sphere, by the opacity that
/// is left.
#[test]
fn a_painted_wall_is_seen_through_what_is_before_it() {
    let Some(mut gpu) = renderer("a_painted_wall_is_seen_through_what_is_before_it") else { return };
    let grid = Grid::axis_aligned([SIDE; 3], [1.0; 3], [-19.5; 3]).unwrap();
    let volume = Volume::new(grid, vec![100; SIDE.pow(3)]).unwrap();
    let mut request = request(&volume, 0.0);
    let point = |hu: f64, opacity: f64| ControlPoint { hu, rgba: [1.0, 0.0, 0.0, opacity] };
    // Half of the light passes 10 mm.
    let per_mm = 1.0 - 0.5_f64.powf(0.1);
    request.transfer = TransferFunction::new(vec![point(-200.0, 0.0), point(0.0, per_mm)], 1.0).unwrap();
    request.shading = Shading::NONE;
    request.camera = relief_volume::Camera::new(
        Point::new(0.0, -300.0, 0.0),
        Point::new(0.0, 0.0, 0.0),
        Vector::new(0.0, 0.0, 1.0),
        relief_volume::Projection::Orthographic { height_mm: 72.0 },
    )
    .unwrap();
    // The faces of the box are below the window; the wall is not painted there either. So the body
    // gets two halves: its back is brighter.
    let bright = |at: usize| if at / SIDE % SIDE >= 22 { 200 } else { 100 };
    let volume = Volume::new(volume.grid().clone(), (0..SIDE.pow(3)).map(bright).collect()).unwrap();
    request.clip.sphere = Some(ClipSphere { center: Point::new(0.0, 0.0, 0.0), radius_mm: 10.0 });
    request.cut = CutFaces::Slice { window_hu: [200.0, 100.0] };
    for (fraction, is_wall) in [(0.4, false), (0.6, true)] {
        request.depth = DepthRule::Threshold { fraction };
        for (by, frame) in pictures(&mut gpu, &volume, &request) {
            let middle = [SIZE_PX[0] / 2, SIZE_PX[1] / 2];
            // From the face at y = -20 mm to the sphere at -10 mm: half; then grey 0.5 at y = 10 mm.
            let found = color(&frame, middle);
            for (found, expected) in found.into_iter().zip([191.0, 64.0, 64.0, 255.0]) {
                assert!((f64::from(found) - expected).abs() < 8.0, "{by}: {found} for {expected}");
            }
            let depth = f64::from(frame.depth_at(middle).0);
            let expected = if is_wall { 310.0 } else { 280.0 - 10.0 * 0.6_f64.log2() };
            assert!((depth - expected).abs() < 0.6, "{by}, {fraction}: {depth} mm for {expected}");
        }
    }
}
