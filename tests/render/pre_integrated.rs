//! Pre-integrated classification: a thin layer's closed form, the twin, skipping, and the error at
//! twice the sample distance.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{Classification, DepthRule, EmptySpaceSkipping, RenderRequest, RenderedFrame, Shading};
use relief_volume::{Camera, ControlPoint, PhantomKind, Projection, TransferFunction, Volume};

use super::renderer;
use super::twin::{compare, oblique_head, request};

/// A layer around 50 HU, 2 HU to both sides, whose opacity per mm rises to 0.9 and falls again.
fn thin_layer() -> TransferFunction {
    let point = |hu: f64, opacity: f64| ControlPoint { hu, rgba: [1.0, 0.5, 0.25, opacity] };
    TransferFunction::new(vec![point(48.0, 0.0), point(50.0, 0.9), point(52.0, 0.0)], 1.0).unwrap()
}

/// Along y, where the ramp rises by 4 HU/mm: the layer is 1 mm thick.
fn layer_request(volume: &Volume, classification: Classification, sample_mm: f64) -> RenderRequest {
    let (eye, at) = (Point::new(0.0, -600.0, 0.0), Point::new(0.0, 0.0, 0.0));
    let parallel = Projection::Orthographic { height_mm: 1.0 };
    RenderRequest {
        camera: Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), parallel).unwrap(),
        size_px: [9, 9],
        transfer: thin_layer(),
        shading: Shading::NONE,
        sample_distance_mm: sample_mm,
        depth: DepthRule::FirstHit,
        classification,
        ..request(volume, "bone", 0.0)
    }
}

fn farthest(frame: &RenderedFrame, expected: f64) -> f64 {
    let off = |pixel: &[u8; 4]| (f64::from(pixel[0]) - expected).abs();
    frame.color_rgba.iter().map(off).fold(0.0, f64::max)
}

/// Depths are where the ramp reaches 48 HU, which is known from its three slopes and the value in
/// the middle.
fn expect_layers_plane(volume: &Volume, frame: &RenderedFrame, sample_mm: f64) {
    for (at, &mm) in frame.depth_mm.iter().enumerate() {
        let (column, row) = ((at % 9) as f64 - 4.0, (at / 9) as f64 - 4.0);
        let patient = Point::new(column / 9.0, f64::from(mm) - 600.0, -row / 9.0);
        let voxel = volume.grid().voxel_from_patient() * patient;
        let [i, j, k] = voxel.xyz.floor().to_array().map(|x| x as usize);
        let rest = voxel.xyz - voxel.xyz.floor();
        let corner = f64::from(volume.hu([i, j, k]));
        let along = |high: [usize; 3]| f64::from(volume.hu(high)) - corner;
        let slopes = glam::DVec3::new(along([i + 1, j, k]), along([i, j + 1, k]), along([i, j, k + 1]));
        let hu = corner + slopes.dot(rest);
        assert!((hu - 48.0).abs() < 0.5, "{sample_mm} mm, pixel {at}: {hu} HU at the first hit");
    }
}

#[test]
fn a_layer_thinner_than_a_sample_absorbs_what_it_should() {
    let Some(mut renderer) = renderer("a_layer_thinner_than_a_sample") else { return };
    let volume = common::volume(PhantomKind::Ramp, 64);
    // The mean of -ln(1 - h u) over u from 0 to 1, over 4 HU at 4 HU/mm.
    let h = 0.9f64;
    let depth = ((1.0 - h) * (1.0 - h).ln() + h) / h;
    let expected = 255.0 * (1.0 - (-depth).exp());
    for sample_mm in [0.5, 1.0, 2.0] {
        let mut of =
            |classification| renderer.render(&volume, &layer_request(&volume, classification, sample_mm));
        let pre_integrated = of(Classification::PreIntegrated).unwrap();
        let off = farthest(&pre_integrated, expected);
        let sampled = farthest(&of(Classification::Sampled).unwrap(), expected);
        println!("{sample_mm} mm: {off:.1}/255 off, sampled {sampled:.1}");
        assert!(off <= 1.5, "{sample_mm} mm: {off}/255 from {expected}");
        if sample_mm == 2.0 {
            assert!(sampled > 60.0, "sampling misses the layer or takes it for thick: {sampled}");
        }
        expect_layers_plane(&volume, &pre_integrated, sample_mm);
    }
}

#[test]
fn gpu_and_twin_agree_about_pre_integrated_samples() {
    let volume = oblique_head();
    for (i, preset) in ["bone", "skin", "soft-tissue"].into_iter().enumerate() {
        for depth in [
            DepthRule::FirstHit,
            DepthRule::Threshold { fraction: 0.5 },
            DepthRule::Expected,
            DepthRule::TwoLayer { fraction: 0.5 },
        ] {
            let request = RenderRequest {
                classification: Classification::PreIntegrated,
                sample_distance_mm: [2.0, 1.0, 5.0][i],
                depth,
                ..request(&volume, preset, [25.0, 0.0, 25.0][i])
            };
            compare(&volume, &request, &format!("pre-integrated {preset}, {depth:?}"));
        }
    }
}

#[test]
fn skipping_changes_no_byte_of_pre_integrated_pictures() {
    let Some(mut renderer) = renderer("skipping_changes_no_byte_of_pre_integrated_pictures") else { return };
    let volume = oblique_head();
    for (preset, sample_mm) in
        [("bone", 0.7), ("bone", 3.0), ("skin", 2.3), ("vessels", 4.0), ("lung", 1.0), ("bone", 40.0)]
    {
        let request = RenderRequest {
            classification: Classification::PreIntegrated,
            sample_distance_mm: sample_mm,
            ..request(&volume, preset, 25.0)
        };
        let skipped = renderer.render(&volume, &request).unwrap();
        let whole = renderer.render_with(&volume, &request, EmptySpaceSkipping::Off).unwrap();
        assert!(skipped.color_rgba == whole.color_rgba, "{preset} at {sample_mm} mm: colours differ");
        assert!(skipped.depth_mm == whole.depth_mm, "{preset} at {sample_mm} mm: depths differ");
    }
}

/// The mean absolute difference of colours, of 255.
fn difference(a: &RenderedFrame, b: &RenderedFrame) -> f64 {
    let pairs = a.color_rgba.as_flattened().iter().zip(b.color_rgba.as_flattened());
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / (4 * a.color_rgba.len()) as f64
}

#[test]
fn at_a_double_sample_distance_it_is_no_further_from_the_converged_picture() {
    let volume = common::volume(PhantomKind::Head, 96);
    let Some(mut renderer) = renderer("at_a_double_sample_distance") else { return };
    for preset in ["bone", "skin", "soft-tissue"] {
        let mut of = |classification, sample_distance_mm| {
            let request = request(&volume, preset, 25.0);
            let request = RenderRequest { classification, sample_distance_mm, ..request };
            renderer.render(&volume, &request).unwrap()
        };
        let converged = of(Classification::Sampled, 0.1);
        // From about the voxels' size on: at shorter steps both are within a fifth of a byte's
        // step.
        for sample_mm in [2.0, 2.5, 3.0] {
            let sampled = difference(&of(Classification::Sampled, sample_mm), &converged);
            let doubled = difference(&of(Classification::PreIntegrated, 2.0 * sample_mm), &converged);
            println!("{preset}: {sampled:.2} at {sample_mm} mm, pre-integrated {doubled:.2} at twice that");
            assert!(doubled <= sampled, "{preset}: {doubled} above {sampled} at {sample_mm} mm");
        }
    }
}
