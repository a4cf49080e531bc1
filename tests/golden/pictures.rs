//! The golden images of this repository: rendered again, and held against a renderer that did not
//! make them.
//!
//! The first test needs a software adapter. Without one it fails if `RELIEF_REQUIRE_ADAPTER=1`, and
//! prints a message otherwise. The others need none: goldens were approved by eye, and the
//! f64 twin verifies that they are also right to the last step.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may panic and print, in its helpers too"
)]

use crate::common;
use relief_golden::compare;
use relief_session::encode;

use std::path::{Path, PathBuf};

use common::software_adapter;
use relief_golden::{Artefacts, Aspect, Case, Collection, Harness, Raster, Samples, Tolerance};
use relief_render::{Mode, RenderedFrame, Renderer, Scene};
use relief_session::{FileFormat, Product};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn goldens() -> Collection {
    Collection::open(&root().join("golden")).unwrap()
}

#[test]
fn every_picture_is_as_expected() {
    let Some(gpu) = software_adapter("golden images") else { return };
    let mut harness = Harness::new(Renderer::new(gpu).unwrap());
    let out: PathBuf = root().join("target/golden");
    let artefacts = Artefacts::new(out, "cargo run -- golden bless".to_owned());
    let report = harness.check(&goldens(), &artefacts).unwrap();
    for case in &report.cases {
        println!("{:?} {}", case.verdict, case.case);
    }
    let failures: Vec<String> = report
        .failures()
        .map(|case| format!("{}\n    {}\n    {}", case.case, case.problems.join("\n    "), case.bless))
        .collect();
    assert!(
        report.passed(),
        "{} of {} golden images differ on {}; see {}\n{}",
        failures.len(),
        report.cases.len(),
        report.adapter,
        artefacts.index().display(),
        failures.join("\n")
    );
}

/// Largest mean difference of colours, of 255, and median difference of depths, mm, between the
/// processor's ray caster and a software adapter.
const PROCESSOR_COLOR: f64 = 0.05;
const PROCESSOR_DEPTH_MM: f32 = 0.01;

/// Invariant: The processor's ray caster draws the golden images that it casts.
#[test]
fn every_golden_that_the_processor_casts_is_as_expected() {
    let goldens = goldens();
    let mut renderer = Renderer::on_processor();
    let (mut cast, mut wrong) = (0, Vec::new());
    for id in goldens.ids() {
        let case = goldens.read(id).unwrap();
        let phantom = common::phantom(case.source().recipe().unwrap());
        let scene = case.scene(&phantom.volume).unwrap();
        if relief_render::left_by_processor(&phantom.volume, &scene.request).is_some() {
            continue;
        }
        cast += 1;
        let frame = renderer.render(&phantom.volume, &scene.request).unwrap();
        for &aspect in case.aspects() {
            let expected = case.expected(aspect).unwrap().expect("every golden is there");
            let [mean, median_mm] =
                differences(&expected.samples, &twin_picture(&scene, &frame, aspect).samples);
            println!("{id} {}: {mean:.4} of 255, {median_mm} mm", aspect.name());
            if mean > PROCESSOR_COLOR || median_mm > f64::from(PROCESSOR_DEPTH_MM) {
                wrong.push(format!("{id} {}: {mean:.4} of 255, {median_mm} mm", aspect.name()));
            }
        }
    }
    assert!(cast >= 20, "{cast} goldens are too few to compare");
    assert!(wrong.is_empty(), "{} of {cast} goldens:\n{}", wrong.len(), wrong.join("\n"));
}

/// The mean difference of colours, or the median difference of depths that both have; the other is 0.
fn differences(expected: &Samples, actual: &Samples) -> [f64; 2] {
    match (expected, actual) {
        (Samples::Color(expected), Samples::Color(actual)) => {
            let pairs = expected.as_flattened().iter().zip(actual.as_flattened());
            let sum: f64 = pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
            [sum / expected.as_flattened().len() as f64, 0.0]
        }
        (Samples::DepthMm(expected), Samples::DepthMm(actual)) => {
            let pairs = expected.iter().zip(actual).filter(|(a, b)| a.is_finite() && b.is_finite());
            let mut apart: Vec<f32> = pairs.map(|(a, b)| (a - b).abs()).collect();
            apart.sort_by(f32::total_cmp);
            [0.0, apart.get(apart.len() / 2).copied().unwrap_or(0.0).into()]
        }
        _ => panic!("a picture and its golden have the same kind of samples"),
    }
}

#[test]
fn every_sixth_golden_agrees_with_the_f64_twin() {
    expect_twins(6);
}

#[test]
#[ignore = "takes a minute of two cores: all goldens in place of a sixth, in scripts/test --all"]
fn every_golden_agrees_with_the_f64_twin() {
    expect_twins(1);
}

/// Compares every `step`-th golden with the f64 twin.
fn expect_twins(step: usize) {
    let goldens = goldens();
    let mut wrong = Vec::new();
    for id in goldens.ids().iter().step_by(step) {
        let case = goldens.read(id).unwrap();
        let phantom = common::phantom(case.source().recipe().unwrap());
        let volume = &phantom.volume;
        let scene = case.scene(volume).unwrap();
        let frame = relief_render::render_reference(volume, &scene.request).unwrap();
        for &aspect in case.aspects() {
            // The twin follows no paths; `tests/render/pathtrace.rs` holds them against closed
            // forms.
            if scene.request.mode == Mode::PathTraced && aspect != Aspect::Depth {
                continue;
            }
            let Some(golden) = case.expected(aspect).unwrap() else {
                wrong.push(format!("{id}: {} is missing", aspect.file_name()));
                continue;
            };
            let comparison = compare(&golden, &twin_picture(&scene, &frame, aspect), &Tolerance::TWIN);
            println!("{id} {}: {:?}", aspect.name(), comparison.difference);
            wrong.extend(comparison.mismatches.iter().map(|m| format!("{id}: {}: {m}", aspect.name())));
        }
    }
    assert!(wrong.is_empty(), "{} goldens are not what the twin renders:\n{}", wrong.len(), wrong.join("\n"));
}

/// The twin's picture for one aspect of a case.
fn twin_picture(scene: &Scene, frame: &RenderedFrame, aspect: Aspect) -> Raster {
    let samples = match aspect {
        Aspect::Color => Samples::Color(frame.color_rgba.clone()),
        Aspect::Depth => Samples::DepthMm(frame.depth_mm.clone()),
        Aspect::Frame => {
            let png = encode(frame, &scene.display, Product::Frame, FileFormat::Png).unwrap();
            let picture = image::load_from_memory(&png).unwrap().into_rgba8();
            let size_px = [picture.width(), picture.height()];
            return Raster {
                size_px,
                samples: Samples::Color(picture.pixels().map(|pixel| pixel.0).collect()),
            };
        }
    };
    Raster { size_px: frame.size_px, samples }
}

#[test]
fn every_suite_and_every_view_is_there() {
    let goldens = goldens();
    let names: Vec<String> = goldens.ids().iter().map(ToString::to_string).collect();
    let views = ["front", "left", "back", "right", "head", "feet"].map(|view| format!("camera/{view}"));
    for name in
        views.iter().map(String::as_str).chain(["mip/axes", "depth/first-hit", "clip/box", "display/wowvx"])
    {
        assert!(names.iter().any(|known| known == name), "{name} is gone");
    }
    for preset in relief_volume::PRESETS {
        assert!(names.contains(&format!("presets/{}", preset.name)), "preset {} has no golden", preset.name);
    }
}

/// Invariant: A depth rule changes no colour and puts the depth where its definition says.
///
/// The three depth cases differ only in their rule, and the rule must have an effect.
#[test]
fn depth_rules_lie_behind_one_another() {
    let read = |name: &str| {
        let goldens = goldens().select(&[name.to_owned()]).unwrap();
        let case: Case = goldens.read(&goldens.ids()[0]).unwrap();
        [Aspect::Color, Aspect::Depth].map(|aspect| case.expected(aspect).unwrap().expect("it is blessed"))
    };
    let [first, half, late] = ["depth/first-hit", "depth/threshold-half", "depth/threshold-late"].map(read);
    assert_eq!(first[0], half[0], "the rule changes no colour");
    assert_eq!(first[0], late[0], "the rule changes no colour");
    let depths = |raster: &Raster| match &raster.samples {
        Samples::DepthMm(depths) => depths.clone(),
        Samples::Color(_) => panic!("a depth"),
    };
    let (first, half, late) = (depths(&first[1]), depths(&half[1]), depths(&late[1]));
    for (index, ((first, half), late)) in first.iter().zip(&half).zip(&late).enumerate() {
        assert!(first <= half && half <= late, "pixel {index}: {first} mm, {half} mm, {late} mm");
    }
    let differs = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| *b - *a > 5.0).count();
    assert!(differs(&first, &half) > 1000 && differs(&half, &late) > 1000, "the rules differ by millimetres");
}

/// Depth of a plane in parallel projection is linear over the picture, if it is measured along the
/// viewing axis.
#[test]
fn the_slanted_slabs_depth_is_a_plane() {
    let goldens = goldens().select(&["depth/slab-slanted".to_owned()]).unwrap();
    let case = goldens.read(&goldens.ids()[0]).unwrap();
    let golden = case.expected(Aspect::Depth).unwrap().expect("it is blessed");
    // The front face, y = -50 mm, through the pixels' rays: origin and direction from the scene's
    // camera.
    let phantom = common::phantom(case.source().recipe().unwrap());
    let volume = &phantom.volume;
    let camera = case.scene(volume).unwrap().request.camera;
    let [half_x, half_y] = camera.half_extent(golden.size_px);
    let [width, height] = golden.size_px;
    let expected = (0..width * height).map(|index| {
        let x = ((f64::from(index % width) + 0.5) / f64::from(width) * 2.0 - 1.0) * half_x;
        let y = (1.0 - (f64::from(index / width) + 0.5) / f64::from(height) * 2.0) * half_y;
        let at = |z: f64| (camera.patient_from_view() * relief_base::Point::new(x, y, z)).xyz.y;
        let (start, slope) = (at(0.0), at(-1.0) - at(0.0));
        ((-50.0 - start) / slope) as f32
    });
    let Samples::DepthMm(found) = &golden.samples else { panic!("a depth") };
    let on_the_face = expected.zip(found).filter(|(plane, mm)| (**mm - plane).abs() < 0.3).count();
    assert!(on_the_face > 4000, "{on_the_face} pixels lie on the front face");
}
