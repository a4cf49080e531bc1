//! The test of the tester: what golden images must not let pass, does not pass.
//!
//! No adapter is needed: approved goldens are altered and compared with themselves, and volumes
//! with swapped axes are rendered by the f64 twin. `command` has the same through the program.
#![allow(clippy::unwrap_used, reason = "a test may panic, in its helpers too")]

use std::fs;
use std::path::Path;

use crate::common;
use relief_golden::compare;
use relief_golden::{
    Aspect, Case, Collection, Comparison, GoldenError, MAX_FILE_BYTES, Mismatch, Raster, Samples, Tolerance,
};
use relief_render::{RenderedFrame, Renderer};
use relief_volume::Volume;

fn golden_dir() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/golden"))
}

fn case(name: &str) -> Case {
    let selected = Collection::open(golden_dir()).unwrap().select(&[name.to_owned()]).unwrap();
    selected.read(&selected.ids()[0]).unwrap()
}

/// Every approved picture of one kind, with its case.
fn goldens(aspect: Aspect) -> Vec<(Case, Raster)> {
    let all = Collection::open(golden_dir()).unwrap();
    let cases = all.ids().iter().map(|id| all.read(id).unwrap());
    let with_it = cases.filter(|case| case.aspects().contains(&aspect));
    with_it
        .map(|case| (case.expected(aspect).unwrap(), case))
        .map(|(r, c)| (c, r.expect("it is blessed")))
        .collect()
}

fn colors(raster: &mut Raster) -> &mut Vec<[u8; 4]> {
    match &mut raster.samples {
        Samples::Color(pixels) => pixels,
        Samples::DepthMm(_) => panic!("a picture in colour"),
    }
}

fn depths(raster: &mut Raster) -> &mut Vec<f32> {
    match &mut raster.samples {
        Samples::DepthMm(depths) => depths,
        Samples::Color(_) => panic!("a depth"),
    }
}

fn strictly(expected: &Raster, actual: &Raster) -> Comparison {
    compare(expected, actual, &Tolerance::STRICT)
}

/// A channel moved by this many steps, to the side with room.
fn moved(byte: u8, steps: u8) -> u8 {
    byte.checked_add(steps).unwrap_or(byte.wrapping_sub(steps))
}

#[test]
fn a_golden_is_identical_to_itself() {
    for aspect in Aspect::ALL {
        for (case, golden) in goldens(aspect) {
            let comparison = compare(&golden, &golden.clone(), &Tolerance::EXACT);
            assert!(
                comparison.is_identical() && comparison.mismatches.is_empty(),
                "{} {comparison:?}",
                case.id()
            );
        }
    }
}

/// Invariant: Any change of a golden picture fails the check.
#[test]
fn a_change_of_one_pixel_fails_in_every_picture_and_channel() {
    for aspect in [Aspect::Color, Aspect::Frame] {
        for (case, golden) in goldens(aspect) {
            let last = colors(&mut golden.clone()).len() - 1;
            for (pixel, channel) in [(0, 0), (last / 2, 1), (last, 2), (last / 3, 3)] {
                let mut changed = golden.clone();
                let byte = &mut colors(&mut changed)[pixel][channel];
                *byte = moved(*byte, 2);
                let found = compare(&golden, &changed, &case.tolerance()).mismatches;
                assert!(
                    matches!(found[..], [Mismatch::ColorOutliers { found: 1, max_steps: 2, .. }]),
                    "{}: pixel {pixel}, channel {channel}: {found:?}",
                    case.id()
                );
            }
        }
    }
}

#[test]
fn one_step_passes_on_a_thousandth_of_the_pixels_and_never_unnoticed() {
    let (_, golden) = goldens(Aspect::Color).swap_remove(0);
    let pixels = colors(&mut golden.clone()).len();
    let with_steps = |count: usize| {
        let mut changed = golden.clone();
        for pixel in colors(&mut changed).iter_mut().take(count) {
            pixel[1] = moved(pixel[1], 1);
        }
        changed
    };
    let few = with_steps(pixels / 1000);
    assert_eq!(strictly(&golden, &few).mismatches, []);
    assert!(!strictly(&golden, &few).is_identical());
    assert!(matches!(
        strictly(&golden, &with_steps(pixels / 1000 + 1)).mismatches[..],
        [Mismatch::ColorCount { .. }]
    ));
    assert!(!compare(&golden, &with_steps(1), &Tolerance::EXACT).mismatches.is_empty(), "exact is exact");
}

#[test]
fn a_depth_off_by_one_sample_fails_in_every_case() {
    for (case, golden) in goldens(Aspect::Depth) {
        let phantom = common::phantom(case.source().recipe().unwrap());
        let volume = &phantom.volume;
        let step_mm = case.scene(volume).unwrap().request.sample_distance_mm as f32;
        let hit =
            depths(&mut golden.clone()).iter().position(|mm| mm.is_finite()).expect("something is seen");
        let mut one = golden.clone();
        depths(&mut one)[hit] += step_mm;
        let found = compare(&golden, &one, &case.tolerance()).mismatches;
        assert!(matches!(found[..], [Mismatch::DepthOutliers { found: 1, .. }]), "{}: {found:?}", case.id());
        let mut all = golden.clone();
        depths(&mut all).iter_mut().for_each(|mm| *mm -= step_mm);
        let found = compare(&golden, &all, &case.tolerance()).mismatches;
        assert!(matches!(found[..], [Mismatch::DepthOutliers { .. }]), "{}: {found:?}", case.id());
    }
}

#[test]
fn a_hit_that_becomes_a_miss_and_a_miss_that_becomes_a_hit_fail() {
    for (case, golden) in goldens(Aspect::Depth) {
        let values = depths(&mut golden.clone()).clone();
        let hit = values.iter().position(|mm| mm.is_finite()).unwrap();
        let mut lost = golden.clone();
        depths(&mut lost)[hit] = f32::INFINITY;
        let mut changes = vec![(golden.clone(), lost.clone()), (lost, golden.clone())];
        if let Some(miss) = values.iter().position(|mm| mm.is_infinite()) {
            let mut gained = golden.clone();
            depths(&mut gained)[miss] = values[hit];
            changes.push((golden.clone(), gained));
        }
        for (expected, actual) in changes {
            let found = compare(&expected, &actual, &case.tolerance()).mismatches;
            assert!(matches!(found[..], [Mismatch::Hits { found: 1, .. }]), "{}: {found:?}", case.id());
        }
    }
}

#[test]
fn invalid_depths_fail_even_if_the_golden_has_them() {
    let (_, golden) = goldens(Aspect::Depth).swap_remove(0);
    for nonsense in [f32::NAN, f32::NEG_INFINITY, -1.0] {
        let mut wrong = golden.clone();
        depths(&mut wrong)[7] = nonsense;
        for (expected, actual) in [(&golden, &wrong), (&wrong, &golden), (&wrong, &wrong)] {
            let comparison = strictly(expected, actual);
            assert!(matches!(comparison.mismatches[..], [Mismatch::Invalid { found: 1, .. }]), "{nonsense}");
            assert!(!comparison.is_identical(), "{nonsense}");
        }
    }
}

#[test]
fn a_picture_of_another_size_or_kind_fails() {
    let (color, depth) = (goldens(Aspect::Color).swap_remove(0).1, goldens(Aspect::Depth).swap_remove(0).1);
    let [width, height] = color.size_px;
    let mut turned = color.clone();
    turned.size_px = [height, width];
    let mut cut = color.clone();
    cut.size_px = [width, height - 1];
    colors(&mut cut).truncate((width * (height - 1)) as usize);
    let mut lying = color.clone();
    colors(&mut lying).pop();
    for other in [turned, cut, lying, depth] {
        assert!(
            matches!(strictly(&color, &other).mismatches[..], [Mismatch::Size { .. }]),
            "{:?}",
            other.size_px
        );
    }
}

#[test]
fn a_mirrored_picture_and_swapped_channels_fail() {
    for (case, golden) in goldens(Aspect::Color) {
        let width = golden.size_px[0] as usize;
        let mut right_to_left = golden.clone();
        colors(&mut right_to_left).chunks_exact_mut(width).for_each(<[_]>::reverse);
        let mut turned = golden.clone();
        colors(&mut turned).reverse();
        let mut upside_down = right_to_left.clone();
        colors(&mut upside_down).reverse();
        let mut blue_first = golden.clone();
        colors(&mut blue_first).iter_mut().for_each(|pixel| pixel.swap(0, 2));
        let changes = [("mirrored", right_to_left), ("turned", turned), ("upside down", upside_down)];
        for (what, changed) in changes.into_iter().filter(|_| !is_round(&case)) {
            assert!(!strictly(&golden, &changed).mismatches.is_empty(), "{} {what}", case.id());
        }
        let gray = colors(&mut golden.clone()).iter().all(|[r, _, b, _]| r == b);
        assert!(
            gray || !strictly(&golden, &blue_first).mismatches.is_empty(),
            "{} with blue first",
            case.id()
        );
    }
}

/// A ball seen head-on, or so: its mirror image is its like.
fn is_round(case: &Case) -> bool {
    case.id().to_string() == "composite/coarse-steps"
}

/// The volume with its voxels taken from elsewhere, as by a reader that mixes up axes or
/// directions.
fn rearranged(volume: &Volume, source: impl Fn([usize; 3]) -> [usize; 3]) -> Volume {
    let [nx, ny, nz] = volume.grid().dims();
    let indices = (0..nx * ny * nz).map(|n| [n % nx, n / nx % ny, n / (nx * ny)]);
    Volume::new(volume.grid().clone(), indices.map(|ijk| volume.hu(source(ijk))).collect()).unwrap()
}

#[test]
fn swapped_and_mirrored_axes_of_the_volume_fail_in_every_view() {
    let mut renderer = Renderer::on_processor();
    for view in ["front", "left", "back", "right", "head", "feet", "rolled"] {
        let case = case(&format!("camera/{view}"));
        let phantom = common::phantom(case.source().recipe().unwrap());
        let volume = &phantom.volume;
        let request = case.scene(volume).unwrap().request;
        let last = volume.grid().dims()[0] - 1;
        let wrong = [
            ("i and j swapped", rearranged(volume, |[i, j, k]| [j, i, k])),
            ("j and k swapped", rearranged(volume, |[i, j, k]| [i, k, j])),
            ("i and k swapped", rearranged(volume, |[i, j, k]| [k, j, i])),
            ("i mirrored", rearranged(volume, |[i, j, k]| [last - i, j, k])),
            ("j mirrored", rearranged(volume, |[i, j, k]| [i, last - j, k])),
            ("k mirrored", rearranged(volume, |[i, j, k]| [i, j, last - k])),
        ];
        for (what, volume) in wrong {
            let frame = renderer.render(&volume, &request).unwrap();
            for (aspect, actual) in both(&frame) {
                let golden = case.expected(aspect).unwrap().expect("it is blessed");
                // Even by the looser tolerance for renderers that round differently.
                let found = compare(&golden, &actual, &Tolerance::TWIN).mismatches;
                assert!(!found.is_empty(), "{view}: {what} does not show in {}", aspect.name());
            }
        }
    }
}

fn both(frame: &RenderedFrame) -> [(Aspect, Raster); 2] {
    let raster = |samples| Raster { size_px: frame.size_px, samples };
    [
        (Aspect::Color, raster(Samples::Color(frame.color_rgba.clone()))),
        (Aspect::Depth, raster(Samples::DepthMm(frame.depth_mm.clone()))),
    ]
}

/// A folder with one case, a copy of `composite/ramp-planes`.
fn copied() -> (tempfile::TempDir, std::path::PathBuf) {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("composite/ramp-planes");
    fs::create_dir_all(&folder).unwrap();
    for entry in fs::read_dir(golden_dir().join("composite/ramp-planes")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
    }
    (parent, folder)
}

fn read_copied(parent: &tempfile::TempDir) -> Result<Case, GoldenError> {
    let collection = Collection::open(parent.path())?;
    collection.read(&collection.ids()[0])
}

#[test]
fn a_case_file_with_anything_unknown_is_refused() {
    let (parent, folder) = copied();
    read_copied(&parent).expect("the copy is a case");
    let path = folder.join("case.toml");
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, part) in [
        ("tolerance", "tolarance", "tolarance"),
        ("[volume]", "ignore = true\n[volume]", "ignore"),
        ("size = 32", "size = 32\nspacing = 2", "spacing"),
        ("\"strict\"", "\"loose\"", "loose"),
        ("\"strict\"", "\"twin\"", "twin"),
        ("\"strict\"", "0.5", "tolerance"),
        ("\"depth\"", "\"dept\"", "dept"),
        ("\"ramp\"", "\"torso\"", "torso"),
        ("size = 32", "size = 8", "8 voxels"),
        ("size = 32", "size = 512", "at most 128"),
        ("[\"color\", \"depth\"]", "[]", "color, depth, frame"),
        ("purpose", "# purpose", "purpose"),
    ] {
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from} is in the file");
        fs::write(&path, changed).unwrap();
        let message = read_copied(&parent).expect_err("a refusal").to_string();
        assert!(message.contains(part), "{from} -> {to}: {message}");
    }
}

#[test]
fn a_scene_with_anything_unknown_or_out_of_range_is_refused() {
    let (parent, folder) = copied();
    let path = folder.join("scene.json");
    fs::write(&path, r#"{"size_px": [64, 48], "sise": 1}"#).unwrap();
    assert!(read_copied(&parent).unwrap_err().to_string().contains("sise"));
    let ramp = common::phantom(case("composite/ramp-planes").source().recipe().unwrap());
    for (scene, part) in [
        (r#"{"sample_distance_mm": 0.02}"#, "four times the tolerance"), // a step would hide in the tolerance
        (r#"{"sample_distance_mm": 0}"#, "0.000001 to 100"),
    ] {
        fs::write(&path, scene).unwrap();
        let message = read_copied(&parent).unwrap().scene(&ramp.volume).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("scene.json"), "{message}");
    }
}

#[test]
fn no_case_at_all_is_an_error() {
    let parent = tempfile::tempdir().unwrap();
    let open = || Collection::open(parent.path());
    assert!(matches!(open().unwrap_err(), GoldenError::NoCases { .. }));
    fs::create_dir(parent.path().join("suite")).unwrap();
    assert!(matches!(open().unwrap_err(), GoldenError::NoCases { .. }), "a suite without cases");
    assert!(matches!(Collection::open(&parent.path().join("gone")).unwrap_err(), GoldenError::Read { .. }));
    let all = Collection::open(golden_dir()).unwrap();
    for name in ["camera/fron", "camer", "", "camera/front/color.png", "../golden"] {
        let refused = all.clone().select(&[name.to_owned()]).unwrap_err();
        assert!(matches!(refused, GoldenError::UnknownCase { .. }), "{name}");
    }
}

#[test]
fn missing_and_extra_files_of_a_case_are_errors() {
    let (parent, folder) = copied();
    let golden = folder.join("color.png");
    let expected = |aspect| read_copied(&parent).unwrap().expected(aspect);
    assert!(expected(Aspect::Color).unwrap().is_some());
    fs::remove_file(&golden).unwrap();
    assert!(expected(Aspect::Color).unwrap().is_none(), "missing, and said so");
    for damage in [&b"not a picture"[..], &fs::read(folder.join("depth.exr")).unwrap()] {
        fs::write(&golden, damage).unwrap();
        assert!(matches!(expected(Aspect::Color).unwrap_err(), GoldenError::Decode { .. }));
    }
    let frame = fs::read(golden_dir().join("display/rgbd/frame.png")).unwrap();
    fs::write(&golden, frame).unwrap();
    assert!(expected(Aspect::Color).unwrap_err().to_string().contains("Rgba8"), "a golden without coverage");
    fs::write(&golden, vec![0; MAX_FILE_BYTES as usize + 1]).unwrap();
    assert!(matches!(expected(Aspect::Color).unwrap_err(), GoldenError::FileTooLarge { bytes: 65537, .. }));
    fs::write(folder.join("colour.png"), "").unwrap();
    assert!(
        matches!(read_copied(&parent).unwrap_err(), GoldenError::Stray { .. }),
        "a file that nothing compares"
    );
    fs::remove_file(folder.join("colour.png")).unwrap();
    fs::remove_file(folder.join("case.toml")).unwrap();
    assert!(
        matches!(read_copied(&parent).unwrap_err(), GoldenError::Read { .. }),
        "a case that lost its file"
    );
    fs::write(parent.path().join("composite/loose.png"), "").unwrap();
    assert!(matches!(Collection::open(parent.path()).unwrap_err(), GoldenError::Stray { .. }));
    fs::remove_file(parent.path().join("composite/loose.png")).unwrap();
    fs::create_dir(parent.path().join("composite/a name; with spaces")).unwrap();
    assert!(matches!(Collection::open(parent.path()).unwrap_err(), GoldenError::Name { .. }));
}
