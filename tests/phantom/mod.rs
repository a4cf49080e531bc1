//! Phantoms against closed forms, and the DICOM series made of them against readers that this
//! project didn't write.
//!
//! Oracles: geometry in closed form (integrals over voxels computed here by brute force),
//! `truth.json` against the voxels, `dicom-object` as reader, and pydicom where
//! `RELIEF_PEERS_PYTHON` names a Python that has it.

use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use dicom_dictionary_std::tags;
use relief_base::{Patient, Point, Voxel};
use relief_dicom::{ExistingFolder, SeriesFolder, SeriesLabels, slice_file_name};
use relief_volume::{Phantom, PhantomKind, PhantomRecipe, PhantomTruth, SurfaceShape, Volume};

const AIR_HU: f64 = -1000.0;

/// Trilinear value at a patient position, clamped at the faces.
fn sample_hu(volume: &Volume, position: Point<Patient>) -> f64 {
    let at: Point<Voxel> = volume.grid().voxel_from_patient() * position;
    let dims = volume.grid().dims();
    let corner = |axis: usize, offset: usize| {
        let low = at.xyz[axis].clamp(0.0, dims[axis] as f64 - 1.0).floor() as usize;
        (low + offset).min(dims[axis] - 1)
    };
    let weight = |axis: usize, offset: usize| {
        let clamped = at.xyz[axis].clamp(0.0, dims[axis] as f64 - 1.0);
        let high = clamped - clamped.floor();
        if offset == 1 { high } else { 1.0 - high }
    };
    let mut sum = 0.0;
    for n in 0..8 {
        let [a, b, c] = [n & 1, n >> 1 & 1, n >> 2 & 1];
        let hu = volume.hu([corner(0, a), corner(1, b), corner(2, c)]);
        sum += weight(0, a) * weight(1, b) * weight(2, c) * f64::from(hu);
    }
    sum
}

/// Share of a voxel's box inside a ball around the origin, by counting 40³ points.
fn counted_fraction(center: [f64; 3], size: [f64; 3], radius: f64) -> f64 {
    const N: usize = 40;
    let offset = |n: usize| (n as f64 + 0.5) / N as f64 - 0.5;
    let squared = |axis: usize, n: usize| (center[axis] + size[axis] * offset(n)).powi(2);
    let mut inside = 0usize;
    for c in 0..N {
        for b in 0..N {
            let rest = radius * radius - squared(1, b) - squared(2, c);
            inside += (0..N).filter(|&a| squared(0, a) <= rest).count();
        }
    }
    inside as f64 / (N * N * N) as f64
}

#[test]
fn the_default_sphere_and_slab_are_what_the_design_says() {
    for kind in [PhantomKind::Sphere, PhantomKind::Slab] {
        let Phantom { volume, truth } = PhantomRecipe::new(kind).make();
        assert_eq!(volume.grid().dims(), [256; 3]);
        assert_eq!(volume.grid().spacing_mm(), [1.0; 3]);
        assert_eq!(volume.grid().origin().xyz.to_array(), [-127.5; 3]);
        assert_eq!(volume.range_hu(), (-1000, truth.material_hu(kind.name()).unwrap() as i16));
    }
}

#[test]
fn edge_voxels_of_the_sphere_carry_their_covered_fraction() {
    let Phantom { volume, .. } = Phantom::sphere(64).unwrap();
    let (dims, spacing) = (volume.grid().dims(), volume.grid().spacing_mm());
    let (mut edges, mut worst) = (0, 0.0f64);
    for k in 0..dims[2] / 2 {
        for j in 0..dims[1] / 2 {
            for i in 0..dims[0] / 2 {
                let hu = volume.hu([i, j, k]);
                if hu == -1000 || hu == 500 || (i * 7 + j * 3 + k) % 5 != 0 {
                    continue;
                }
                let center = volume.grid().patient_from_voxel() * Point::new(i as f64, j as f64, k as f64);
                let expected = counted_fraction(center.xyz.to_array(), spacing, 80.0);
                worst = worst
                    .max((f64::from(hu) - AIR_HU) / 1500.0 - expected)
                    .max(expected - (f64::from(hu) - AIR_HU) / 1500.0);
                edges += 1;
            }
        }
    }
    assert!(edges > 150, "only {edges} edge voxels were checked");
    assert!(worst < 0.005, "a voxel's fraction is off by {worst}");
}

#[test]
fn the_sphere_and_the_slab_have_their_volume() {
    for size in [32, 100, 256] {
        let covered = |phantom: &Phantom, hu: f64| {
            let [x, y, z] = phantom.volume.grid().spacing_mm();
            let sum: f64 = phantom.volume.voxels_hu().iter().map(|&v| f64::from(v) - AIR_HU).sum();
            sum / (hu - AIR_HU) * x * y * z
        };
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 80f64.powi(3);
        let found = covered(&Phantom::sphere(size).unwrap(), 500.0);
        assert!((found / ball - 1.0).abs() < 1e-3, "size {size}: ball of {found} mm³, expected {ball}");
        let slab = 256.0 * 256.0 * 100.0;
        let found = covered(&Phantom::slab(size).unwrap(), 300.0);
        assert!((found / slab - 1.0).abs() < 1e-3, "size {size}: slab of {found} mm³, expected {slab}");
    }
}

#[test]
fn the_ramp_is_linear_and_its_gradient_is_the_one_told() {
    let Phantom { volume, truth } = Phantom::ramp(32).unwrap();
    let [gx, gy, gz] = truth.gradient_hu_per_mm.unwrap();
    for [x, y, z] in [[0.0, 0.0, 0.0], [3.25, -7.5, 11.125], [-15.5, 15.5, 0.3], [15.5, -15.5, -15.5]] {
        let found = sample_hu(&volume, Point::new(x, y, z));
        let expected = gx * x + gy * y + gz * z;
        assert!((found - expected).abs() < 1e-9, "{found} HU at {x} {y} {z}, expected {expected}");
    }
}

#[test]
fn the_axes_phantom_tells_all_six_directions_apart() {
    let Phantom { volume, truth } = Phantom::axes(64).unwrap();
    let axes = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    for ([x, y, z], expected) in axes.into_iter().zip([300.0, 600.0, 900.0, 1200.0, 1500.0, 1800.0]) {
        assert_eq!(sample_hu(&volume, Point::new(40.0 * x, 40.0 * y, 40.0 * z)), expected, "{x} {y} {z}");
    }
    assert_eq!(truth.surfaces.len(), 6);
}

#[test]
fn closed_surfaces_are_where_the_truth_says() {
    for phantom in [Phantom::sphere(256), Phantom::slab(100), Phantom::axes(128)].map(Result::unwrap) {
        for surface in &phantom.truth.surfaces {
            let (point, outward) = surface_point(&surface.shape);
            let at = |mm: f64| {
                let p: [f64; 3] = std::array::from_fn(|a| point[a] + mm * outward[a]);
                sample_hu(&phantom.volume, Point::new(p[0], p[1], p[2]))
            };
            let inside = phantom.truth.material_hu(&surface.inside).unwrap();
            let outside = phantom.truth.material_hu(&surface.outside).unwrap();
            let reach = 2.5 * phantom.truth.spacing_mm[0];
            assert!((at(-reach) - inside).abs() < 1e-6, "{}: {} HU inside", surface.name, at(-reach));
            assert!((at(reach) - outside).abs() < 1e-6, "{}: {} HU outside", surface.name, at(reach));
            // The level halfway lies at the surface to well below a voxel.
            assert!(at(-0.2 * reach) > (inside + outside) / 2.0, "{}", surface.name);
            assert!(at(0.2 * reach) < (inside + outside) / 2.0, "{}", surface.name);
        }
    }
}

/// A point of a surface and the outward unit normal there.
fn surface_point(shape: &SurfaceShape) -> ([f64; 3], [f64; 3]) {
    let outward = [0.48, -0.6, 0.64];
    match *shape {
        SurfaceShape::Sphere { center_mm, radius_mm } => {
            (std::array::from_fn(|a| center_mm[a] + radius_mm * outward[a]), outward)
        }
        SurfaceShape::Ellipsoid { .. } => panic!("no phantom here has an ellipsoid"),
        SurfaceShape::Plane { point_mm, normal } => (point_mm, normal),
    }
}

#[test]
fn sizes_and_names_outside_the_range_are_refused() {
    for size in [0, 15, 1025, usize::MAX] {
        let error = PhantomRecipe::new(PhantomKind::Head).with_size(size).unwrap_err().to_string();
        assert_eq!(error, format!("the size is {size} voxels, allowed: 16 to 1024"));
    }
    for kind in PhantomKind::ALL {
        assert_eq!(kind.name().parse::<PhantomKind>().unwrap(), kind);
    }
    assert!("torso".parse::<PhantomKind>().unwrap_err().to_string().contains("torso"));
}

#[test]
fn the_truth_survives_its_json() {
    let Phantom { truth, .. } = Phantom::axes(32).unwrap();
    let text = serde_json::to_string(&truth).unwrap();
    assert_eq!(serde_json::from_str::<PhantomTruth>(&text).unwrap(), truth);
}

/// The head in its default size, made once for all tests that look at it.
fn head() -> &'static Phantom {
    static HEAD: OnceLock<Phantom> = OnceLock::new();
    HEAD.get_or_init(|| PhantomRecipe::new(PhantomKind::Head).make())
}

const HEAD_LANDMARKS: [&str; 20] = [
    "vertex",
    "pronasale",
    "nasion",
    "anterior nasal spine",
    "tip of left upper central incisor",
    "tip of left lower central incisor",
    "pogonion",
    "menton",
    "left gonion",
    "right gonion",
    "left zygion",
    "right zygion",
    "left orbitale",
    "right orbitale",
    "left external auditory meatus",
    "right external auditory meatus",
    "inion",
    "basion",
    "opisthion",
    "sella",
];

#[test]
fn the_head_has_its_landmarks_in_a_stable_order_at_every_seed() {
    for seed in [0, 1, 99] {
        let recipe = PhantomRecipe::new(PhantomKind::Head).with_size(32).unwrap().with_seed(seed);
        let names: Vec<String> = recipe.make().truth.landmarks.into_iter().map(|l| l.name).collect();
        assert_eq!(names, HEAD_LANDMARKS, "seed {seed}");
    }
}

#[test]
fn the_value_crosses_within_a_voxel_of_every_landmark() {
    let Phantom { volume, truth } = head();
    let voxel = truth.spacing_mm.into_iter().fold(0.0, f64::max);
    for landmark in &truth.landmarks {
        let at = |mm: f64| {
            let p: [f64; 3] = std::array::from_fn(|a| landmark.position_mm[a] + mm * landmark.outward[a]);
            sample_hu(volume, Point::new(p[0], p[1], p[2]))
        };
        let (inside, outside) = (at(-voxel), at(voxel));
        let level = landmark.level_hu;
        assert!(
            inside > level && outside < level,
            "{}: {inside} to {outside}, not over {level}",
            landmark.name
        );
    }
}

#[test]
fn the_head_is_oriented_left_posterior_superior_and_has_human_measures() {
    let truth = &head().truth;
    let at = |name: &str| truth.landmark(name).unwrap().position_mm;
    for pair in ["gonion", "zygion", "orbitale", "external auditory meatus"] {
        let [left, right] = ["left", "right"].map(|side| at(&format!("{side} {pair}")));
        assert!(left[0] > 20.0 && right[0] < -20.0, "{pair}: left at {left:?}, right at {right:?}");
        assert!((left[0] + right[0]).abs() < 2.0 && (left[1] - right[1]).abs() < 2.0, "{pair}");
    }
    assert!(at("pronasale")[1] < at("nasion")[1] && at("nasion")[1] < -80.0, "the nose points to -y");
    assert!(at("inion")[1] > 80.0 && at("vertex")[2] > 120.0 && at("menton")[2] < -80.0);
    // Wide ranges of plausible adult measures between bony landmarks, mm: they catch a wrong scale
    // or axis.
    let distance =
        |a: &str, b: &str| Point::<Patient>::from_xyz(at(a).into()).distance(Point::from_xyz(at(b).into()));
    assert!((105.0..140.0).contains(&distance("nasion", "menton")), "face height");
    assert!((125.0..155.0).contains(&distance("left zygion", "right zygion")), "face breadth");
    assert!((85.0..125.0).contains(&distance("left gonion", "right gonion")), "jaw breadth");
}

#[test]
fn the_one_filling_is_in_a_left_lower_molar() {
    let Phantom { volume, truth } = head();
    let limit = (0.5 * (truth.material_hu("enamel").unwrap() + truth.material_hu("amalgam").unwrap())) as i16;
    let [nx, ny, _] = volume.grid().dims();
    let bright = volume.voxels_hu().iter().enumerate().filter(|&(_, &hu)| hu > limit);
    let places: Vec<[f64; 3]> = bright
        .map(|(n, _)| [n % nx, n / nx % ny, n / nx / ny].map(|v| v as f64))
        .map(|[i, j, k]| (volume.grid().patient_from_voxel() * Point::new(i, j, k)).xyz.to_array())
        .collect();
    assert!(places.len() > 10, "{} voxels of amalgam", places.len());
    for [x, y, z] in places {
        assert!((18.0..32.0).contains(&x) && (-75.0..-45.0).contains(&y) && (-48.0..-38.0).contains(&z));
    }
}

#[test]
fn eyeballs_are_spheres_of_the_told_place_and_size() {
    let Phantom { volume, truth } = head();
    for name in ["left eyeball", "right eyeball"] {
        let surface = truth.surfaces.iter().find(|surface| surface.name == name).unwrap();
        let SurfaceShape::Sphere { center_mm: [x, y, z], radius_mm } = surface.shape else {
            panic!("{name}")
        };
        let vitreous = truth.material_hu("vitreous body").unwrap();
        let center = sample_hu(volume, Point::new(x, y, z));
        assert!((center - vitreous).abs() < 30.0, "{name}: {center} HU in the middle");
        // Behind and between the muscles there is fat: the mean over four such directions crosses
        // at the radius.
        let mean = |r: f64| {
            let c = r * (1.0f64 / 3.0).sqrt();
            let corners = [(c, c), (c, -c), (-c, c), (-c, -c)];
            corners.iter().map(|(a, b)| sample_hu(volume, Point::new(x + a, y + c, z + b))).sum::<f64>() / 4.0
        };
        assert!(mean(radius_mm - 0.8) > 0.0, "{name}: {} HU inside", mean(radius_mm - 0.8));
        assert!(mean(radius_mm + 2.0) < -60.0, "{name}: {} HU outside", mean(radius_mm + 2.0));
    }
}

#[test]
fn the_brain_has_the_values_of_its_tissues_and_the_noise_its_deviation() {
    let Phantom { volume, truth } = head();
    let around = |x: f64, y: f64, z: f64, half: i32| {
        let offsets = -half..=half;
        let mut values = Vec::new();
        for (a, b, c) in offsets
            .clone()
            .flat_map(|a| offsets.clone().flat_map(move |b| (-half..=half).map(move |c| (a, b, c))))
        {
            let at = volume.grid().voxel_from_patient() * Point::new(x, y, z);
            let index = [at.xyz.x, at.xyz.y, at.xyz.z].map(|v| v.round() as i32);
            values.push(f64::from(volume.hu([index[0] + a, index[1] + b, index[2] + c].map(|v| v as usize))));
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        (mean, variance.sqrt())
    };
    let (ventricle, _) = around(9.5, -19.0, 57.0, 2);
    let fluid = truth.material_hu("cerebrospinal fluid").unwrap();
    let (midbrain, sigma) = around(0.0, 8.0, 8.0, 4);
    assert!((ventricle - fluid).abs() < 12.0, "{ventricle} HU in the left frontal horn");
    assert!(midbrain > fluid + 15.0, "{midbrain} HU in the pons");
    let ratio = sigma / truth.noise_sigma_hu;
    assert!((0.85..1.15).contains(&ratio), "noise of {sigma} HU, reported {}", truth.noise_sigma_hu);
}

#[test]
fn equal_recipes_make_equal_heads_on_any_number_of_threads_and_other_seeds_others() {
    let recipe = PhantomRecipe::new(PhantomKind::Head).with_size(64).unwrap();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let many = rayon::ThreadPoolBuilder::new().num_threads(5).build().unwrap();
    let (first, second) = (alone.install(|| recipe.make()), many.install(|| recipe.make()));
    assert_eq!(first.volume.grid().dims(), [64, 64, 55]);
    assert_eq!(first.volume.content_hash(), second.volume.content_hash());
    assert_eq!(first.truth, second.truth);
    let other = recipe.with_seed(1).make();
    assert_ne!(first.volume.content_hash(), other.volume.content_hash());
    assert_ne!(first.truth.stack_sha256, other.truth.stack_sha256);
}

#[test]
fn a_finer_head_is_the_same_head() {
    let (coarse, fine) = (Phantom::head(48).unwrap(), Phantom::head(96).unwrap());
    let means = fine.volume.downsampled(2);
    assert_eq!(means.grid().dims()[..2], coarse.volume.grid().dims()[..2]);
    for (a, b) in coarse.truth.landmarks.iter().zip(&fine.truth.landmarks) {
        assert_eq!(a, b);
    }
    let total = |volume: &Volume| {
        let sum: f64 = volume.voxels_hu().iter().map(|&hu| f64::from(hu) - AIR_HU).sum();
        sum * volume.grid().spacing_mm().iter().product::<f64>()
    };
    let ratio = total(&coarse.volume) / total(&fine.volume);
    assert!((ratio - 1.0).abs() < 0.01, "mass changes by {ratio} with the size");
}

fn labels() -> SeriesLabels {
    SeriesLabels {
        patient_name: "PHANTOM^TEST".to_owned(),
        patient_id: "PHANTOM-TEST".to_owned(),
        description: "Procedural phantom".to_owned(),
        body_part: "HEAD".to_owned(),
        window_hu: (40, 400),
    }
}

fn write(volume: &Volume, place: &Path, existing: ExistingFolder) {
    let folder = SeriesFolder::create(place, existing).expect("the place is free");
    folder.write_slices(volume, &labels(), &|_| {}).expect("the volume is a small one");
    folder.finish().expect("nothing came in between");
}

#[test]
fn a_written_series_reads_back_exactly() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("deep").join("series");
    let Phantom { volume, .. } = PhantomRecipe::new(PhantomKind::Axes).with_size(48).unwrap().make();
    write(&volume, &place, ExistingFolder::Keep);
    let [nx, ny, nz] = volume.grid().dims();
    assert_eq!(std::fs::read_dir(&place).unwrap().count(), nz);
    for k in 0..nz {
        let slice = dicom_object::open_file(place.join(slice_file_name(k))).unwrap();
        let numbers = |tag| slice.element(tag).unwrap().to_multi_float64().unwrap();
        let expected = volume.grid().patient_from_voxel() * Point::new(0.0, 0.0, k as f64);
        for (found, expected) in numbers(tags::IMAGE_POSITION_PATIENT).iter().zip(expected.xyz.to_array()) {
            assert!((found - expected).abs() < 1e-9, "slice {k} lies at {found}, expected {expected}");
        }
        assert_eq!(numbers(tags::IMAGE_ORIENTATION_PATIENT), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert!((numbers(tags::PIXEL_SPACING)[0] - 128.0 / 48.0).abs() < 1e-9);
        assert_eq!(numbers(tags::RESCALE_SLOPE), [1.0]);
        assert_eq!(numbers(tags::RESCALE_INTERCEPT), [0.0]);
        let bytes = slice.element(tags::PIXEL_DATA).unwrap().to_bytes().unwrap();
        let expected = &volume.voxels_hu()[k * nx * ny..(k + 1) * nx * ny];
        let expected: Vec<u8> = expected.iter().flat_map(|hu| hu.to_le_bytes()).collect();
        assert_eq!(bytes.as_ref(), expected, "pixels of slice {k}");
    }
}

#[test]
fn equal_volumes_make_equal_files_and_others_other_uids() {
    let parent = tempfile::tempdir().unwrap();
    let volume = Phantom::axes(16).unwrap().volume;
    let [first, again, other] = ["first", "again", "other"].map(|name| parent.path().join(name));
    write(&volume, &first, ExistingFolder::Keep);
    write(&volume, &again, ExistingFolder::Keep);
    write(&volume, &again, ExistingFolder::Replace);
    write(&Phantom::ramp(16).unwrap().volume, &other, ExistingFolder::Keep);
    let read = |folder: &Path, k| std::fs::read(folder.join(slice_file_name(k))).unwrap();
    for k in 0..16 {
        assert_eq!(read(&first, k), read(&again, k), "slice {k}");
    }
    let uid = |folder: &Path, k, tag| {
        let slice = dicom_object::open_file(folder.join(slice_file_name(k))).unwrap();
        slice.element(tag).unwrap().to_str().unwrap().into_owned()
    };
    assert_eq!(uid(&first, 0, tags::SERIES_INSTANCE_UID), uid(&first, 9, tags::SERIES_INSTANCE_UID));
    assert_ne!(uid(&first, 0, tags::SOP_INSTANCE_UID), uid(&first, 9, tags::SOP_INSTANCE_UID));
    assert_ne!(uid(&first, 0, tags::SERIES_INSTANCE_UID), uid(&other, 0, tags::SERIES_INSTANCE_UID));
    assert_ne!(uid(&first, 0, tags::STUDY_INSTANCE_UID), uid(&first, 0, tags::FRAME_OF_REFERENCE_UID));
}

/// Prints the properties of a folder by pydicom: HU stack hash, geometry, and any warning.
const PYDICOM_SCRIPT: &str = "
import hashlib, pathlib, sys, warnings
import pydicom
warnings.simplefilter('error')
pydicom.config.settings.reading_validation_mode = pydicom.config.RAISE
slices = [pydicom.dcmread(path) for path in pathlib.Path(sys.argv[1]).glob('*.dcm')]
slices.sort(key=lambda s: float(s.ImagePositionPatient[2]))
stack = hashlib.sha256()
for s in slices:
    str(s)  # decodes every value
    assert s.pixel_array.dtype == 'int16' and s.RescaleSlope == 1 and s.RescaleIntercept == 0
    stack.update(s.pixel_array.tobytes())
first = slices[0]
print(stack.hexdigest(), first.Rows, first.Columns, len(slices), *first.ImagePositionPatient, first.PatientName)
";

#[test]
fn pydicom_reads_the_same_voxels() {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: pydicom reads the same voxels (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("series");
    let Phantom { volume, truth } = Phantom::sphere(20).unwrap();
    write(&volume, &place, ExistingFolder::Keep);
    let output = Command::new(&python).arg("-c").arg(PYDICOM_SCRIPT).arg(&place).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found = String::from_utf8(output.stdout).unwrap();
    let expected = format!("{} 20 20 20 -121.6 -121.6 -121.6 PHANTOM^TEST", truth.stack_sha256);
    assert_eq!(found.trim(), expected);
}
