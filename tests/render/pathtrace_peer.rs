//! Mode path-traced against Mitsuba 3, a path tracer that is not ours: media of a phantom and of a
//! real series, with one scattering and many.
//!
//! Runs where `RELIEF_PEERS_PYTHON` names a Python that has it, and says aloud where it does not.
//! Surfaces are left out: Mitsuba has nothing that is a medium and a surface in one place.

use std::path::Path;
use std::process::Command;

use relief_base::{Point, Vector};
use relief_dicom::Strictness;
use relief_render::{Light, Mode, PathTrace, Placement, RenderRequest, SceneFile, Shading};
use relief_volume::{
    Camera, ControlPoint, Grid, MediumTable, Orbit, PhantomKind, Projection, TransferFunction, Volume,
    linear_from_srgb,
};
use serde_json::json;

use super::renderer;
use crate::common;

/// Mitsuba interpolates extinction and albedo, Relief values: cells as small as this share of a
/// voxel make that the same.
const CELLS_PER_VOXEL: usize = 3;
const SIZE_PX: [u32; 2] = [48, 32];

struct Case {
    name: &'static str,
    volume: Volume,
    request: RenderRequest,
    toward: Option<[f64; 3]>,
}

/// A block from the middle of a volume, along the axes of patient space.
fn block(volume: &Volume, dims: [usize; 3]) -> Volume {
    let whole = volume.grid().dims();
    let dims: [usize; 3] = std::array::from_fn(|axis| dims[axis].min(whole[axis]));
    let first: [usize; 3] = std::array::from_fn(|axis| (whole[axis] - dims[axis]) / 2);
    let at = |x: usize, y: usize, z: usize| volume.voxels_hu()[(z * whole[1] + y) * whole[0] + x];
    let voxels = (0..dims[2])
        .flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| (x, y, z))))
        .map(|(x, y, z)| at(first[0] + x, first[1] + y, first[2] + z))
        .collect();
    let spacing = volume.grid().spacing_mm();
    let origin = std::array::from_fn(|axis| -spacing[axis] * (dims[axis] - 1) as f64 / 2.0);
    Volume::new(Grid::axis_aligned(dims, spacing, origin).unwrap(), voxels).unwrap()
}

fn request(
    volume: &Volume,
    transfer: TransferFunction,
    path_trace: PathTrace,
    lights: Vec<Light>,
) -> RenderRequest {
    let height_mm = volume.grid().bounding_radius_mm() * 1.2;
    let (eye, at) = (Point::new(300.0, -500.0, 200.0), Point::new(0.0, 0.0, 0.0));
    let camera =
        Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), Projection::Orthographic { height_mm }).unwrap();
    let scene = SceneFile::default().with_mode(Mode::PathTraced).with_size(SIZE_PX);
    let usual = scene.resolve(volume.grid(), &Orbit::default()).unwrap().request;
    let path_trace = PathTrace { surface: 0.0, ..path_trace };
    RenderRequest {
        camera,
        transfer,
        path_trace,
        lights,
        shading: Shading::NONE,
        sample_distance_mm: 2.0,
        ..usual
    }
}

fn transfer(points: &[(f64, [f64; 4])]) -> TransferFunction {
    let points = points.iter().map(|&(hu, rgba)| ControlPoint { hu, rgba }).collect();
    TransferFunction::new(points, 1.0).unwrap()
}

fn distant(toward: [f64; 3]) -> Light {
    let [x, y, z] = toward;
    Light {
        placement: Placement::PatientDirection(Vector::new(x, y, z)),
        rgb: [1.0; 3],
        intensity: 1.0,
        size: 0.0,
    }
}

fn case(name: &'static str, volume: &Volume, path_trace: PathTrace, toward: Option<glam::DVec3>) -> Case {
    let soft = transfer(&[
        (-900.0, [0.9, 0.6, 0.5, 0.0]),
        (100.0, [0.9, 0.7, 0.6, 0.02]),
        (1500.0, [0.98, 0.95, 0.9, 0.08]),
    ]);
    let toward = toward.map(|toward| toward.to_array());
    let request = request(volume, soft, path_trace, toward.map(distant).into_iter().collect());
    Case { name, volume: volume.clone(), request, toward }
}

fn lit(scatterings: u32, anisotropy: f64, environment: f64) -> PathTrace {
    // Dark pictures use the bytes better.
    let exposure = if environment > 0.0 { 1.5 } else { 4.0 };
    PathTrace { scatterings, anisotropy, environment, passes: 512, exposure, ..PathTrace::default() }
}

/// Towards the patient's right, front and head.
fn aside() -> Option<glam::DVec3> {
    Some(glam::DVec3::new(-0.5, -0.6, 0.7).normalize())
}

fn head_cases() -> [Case; 3] {
    let head = block(&common::volume(PhantomKind::Head, 64), [56, 56, 56]);
    [
        case("head, one scattering", &head, lit(1, 0.0, 0.0), aside()),
        case("head, 8 scatterings, g 0.4", &head, lit(8, 0.4, 0.0), aside()),
        case("head, 32 scatterings, surroundings", &head, lit(32, -0.3, 0.5), None),
    ]
}

/// `None` with a message where the series is not there.
fn abdomen_case() -> Option<Case> {
    let folder = common::any_series("a CT beside Mitsuba", &["crlm-ct-1004", "totalseg-abdomen-j2k"])?;
    let found = relief_dicom::discover(&folder, Strictness::Lenient, &|_| ()).unwrap();
    let series = relief_dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap();
    let abdomen = block(&series.volume, [72, 72, 24]);
    Some(case("abdomen, 16 scatterings", &abdomen, lit(16, 0.2, 0.2), aside()))
}

/// Extinction per mm and albedo in the middle of small cells of the volume.
fn medium(case: &Case) -> (Vec<f32>, Vec<f32>, [usize; 3]) {
    let table = MediumTable::new(
        &case.request.transfer,
        case.request.path_trace.density,
        case.volume.grid().unit_mm(),
    );
    let dims = case.volume.grid().dims();
    let cells = dims.map(|count| count * CELLS_PER_VOXEL);
    let hu = |i: [usize; 3]| {
        let p = [0, 1, 2].map(|axis| {
            let place = (i[axis] as f64 + 0.5) / CELLS_PER_VOXEL as f64 - 0.5;
            place.clamp(0.0, (dims[axis] - 1) as f64)
        });
        trilinear(&case.volume, p)
    };
    let (mut extinction, mut albedo) = (Vec::new(), Vec::new());
    for z in 0..cells[2] {
        for y in 0..cells[1] {
            for x in 0..cells[0] {
                let place = (hu([x, y, z]) - f64::from(table.first_hu)) / f64::from(table.step_hu);
                let place = place.clamp(0.0, (table.entries.len() - 1) as f64);
                let low = (place as usize).min(table.entries.len() - 2);
                let share = (place - low as f64) as f32;
                let [r, g, b, per_mm] = std::array::from_fn(|channel| {
                    table.entries[low][channel] * (1.0 - share) + table.entries[low + 1][channel] * share
                });
                extinction.push(per_mm);
                albedo.extend([r, g, b]);
            }
        }
    }
    (extinction, albedo, cells)
}

fn trilinear(volume: &Volume, p: [f64; 3]) -> f64 {
    let dims = volume.grid().dims();
    let low: [usize; 3] = std::array::from_fn(|axis| (p[axis] as usize).min(dims[axis] - 2));
    let mut sum = 0.0;
    for corner in 0..8 {
        let mut weight = 1.0;
        let at: [usize; 3] = std::array::from_fn(|axis| {
            let (upper, share) = (corner >> axis & 1, p[axis] - low[axis] as f64);
            weight *= if upper == 1 { share } else { 1.0 - share };
            low[axis] + upper
        });
        sum += weight * f64::from(volume.voxels_hu()[(at[2] * dims[1] + at[1]) * dims[0] + at[0]]);
    }
    sum
}

/// The peer's parameters of a scene.
fn work(case: &Case, index: usize, folder: &Path) -> serde_json::Value {
    let (extinction, albedo, dims) = medium(case);
    let file = |name: &str| folder.join(format!("{index}.{name}"));
    std::fs::write(file("extinction"), bytemuck::cast_slice::<f32, u8>(&extinction)).unwrap();
    std::fs::write(file("albedo"), bytemuck::cast_slice::<f32, u8>(&albedo)).unwrap();
    let grid = case.volume.grid();
    let half: [f64; 3] = std::array::from_fn(|axis| grid.spacing_mm()[axis] * grid.dims()[axis] as f64 / 2.0);
    let camera = &case.request.camera;
    let Projection::Orthographic { height_mm } = camera.projection() else {
        panic!("an orthographic camera")
    };
    let settings = &case.request.path_trace;
    let light = |toward: [f64; 3]| json!({ "toward": toward, "rgb": [1, 1, 1] });
    json!({
        "dims": dims, "extinction": file("extinction"), "albedo": file("albedo"), "out": file("out"),
        "box_mm": [half.map(|mm| -mm), half], "anisotropy": settings.anisotropy,
        "environment": settings.environment, "scatterings": settings.scatterings, "passes": 256,
        "lights": case.toward.map(light).into_iter().collect::<Vec<_>>(), "size_px": SIZE_PX,
        "camera": { "eye_mm": camera.eye().xyz.to_array(), "look_at_mm": camera.look_at().xyz.to_array(),
                    "up": camera.up().xyz.to_array(), "height_mm": height_mm },
    })
}

/// Means of blocks of 8 x 8 pixels, by channel.
fn blocks(light: &[[f64; 3]]) -> Vec<f64> {
    let [width, height] = SIZE_PX.map(|side| side as usize);
    let mut means = Vec::new();
    for (top, left) in
        (0..height).step_by(8).flat_map(|top| (0..width).step_by(8).map(move |left| (top, left)))
    {
        let pixels = || (0..64).map(|i| light[(top + i / 8) * width + left + i % 8]);
        means.extend([0, 1, 2].map(|channel| pixels().map(|pixel| pixel[channel]).sum::<f64>() / 64.0));
    }
    means
}

/// Invariant: Path-traced media have the brightness that Mitsuba 3 gives them, with one scattering
/// and with many.
#[test]
fn a_head_is_as_bright_as_mitsuba_renders_it() {
    compare(&head_cases()[1..2]);
}

/// Invariant: Path-traced media have the brightness that Mitsuba 3 gives them, with one scattering
/// and with many.
#[test]
#[ignore = "takes a minute: more media, in scripts/test --all"]
fn media_are_as_bright_as_mitsuba_renders_them() {
    let cases: Vec<Case> = head_cases().into_iter().chain(abdomen_case()).collect();
    compare(&cases);
}

fn compare(cases: &[Case]) {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: path tracing against Mitsuba (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let Some(mut renderer) = renderer("path tracing against Mitsuba") else { return };
    let folder = tempfile::tempdir().unwrap();
    let scenes: Vec<_> = (0..).zip(cases).map(|(i, case)| work(case, i, folder.path())).collect();
    let list = folder.path().join("work.json");
    std::fs::write(&list, json!({ "scenes": scenes }).to_string()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/render/pathtrace_peer.py");
    let peer = Command::new(python).arg(script).arg(&list).output().unwrap();
    assert!(peer.status.success(), "{}", String::from_utf8_lossy(&peer.stderr));
    for (i, case) in cases.iter().enumerate() {
        let bytes = std::fs::read(folder.path().join(format!("{i}.out"))).unwrap();
        let expected: Vec<[f64; 3]> = bytemuck::pod_collect_to_vec(&bytes);
        let frame = renderer.render(&case.volume, &case.request).unwrap();
        let exposure = case.request.path_trace.exposure;
        let linear =
            |pixel: &[u8; 4]| [0, 1, 2].map(|c| linear_from_srgb(f64::from(pixel[c]) / 255.0) / exposure);
        let found: Vec<[f64; 3]> = frame.color_rgba.iter().map(linear).collect();
        let (found, expected) = (blocks(&found), blocks(&expected));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let ratio = mean(&found) / mean(&expected);
        let apart = |(a, b): (&f64, &f64)| (a - b).abs();
        let worst = found.iter().zip(&expected).map(apart).fold(0.0, f64::max) / mean(&expected);
        println!(
            "{}: mean {:.5}, Mitsuba's {:.5}, blocks differ by {worst:.4}",
            case.name,
            mean(&found),
            mean(&expected)
        );
        assert!(mean(&expected) > 0.01, "{}: nothing is lit", case.name);
        assert!((ratio - 1.0).abs() < 0.01, "{}: {ratio} of Mitsuba's mean", case.name);
        assert!(worst < 0.1, "{}: a block differs by {worst} of the mean", case.name);
    }
}
