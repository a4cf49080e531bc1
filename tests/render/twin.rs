//! The GPU against the f64 twin, over mode x projection x depth rule x shading.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    Clip, ClipPlane, DepthRule, Mode, RenderRequest, RenderedFrame, SceneFile, VolumeLimits,
};
use relief_volume::{GradientOpacity, Grid, Orbit, PhantomKind, Volume, Window};

use super::{in_mode, renderer};

/// Shares of pixels that may differ: rounding moves a sample across an edge now and then.
const ALLOWED_SHARE: f64 = 0.001;
const ALLOWED_DEPTH_MM: f32 = 0.05;

pub(super) fn compare(volume: &Volume, request: &RenderRequest, what: &str) {
    let Some(mut renderer) = renderer(what) else { return };
    let gpu = renderer.render(volume, request).unwrap();
    drop(renderer);
    expect_equal(&gpu, &relief_render::render_reference(volume, request).unwrap(), what);
}

fn expect_equal(gpu: &RenderedFrame, twin: &RenderedFrame, what: &str) {
    let pixels = gpu.color_rgba.len() as f64;
    let apart = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
    let colors = gpu.color_rgba.iter().zip(&twin.color_rgba).filter(|pair| apart(*pair)).count();
    let depth_apart =
        |(a, b): (&f32, &f32)| a.is_finite() != b.is_finite() || (a - b).abs() > ALLOWED_DEPTH_MM;
    let depths = gpu.depth_mm.iter().zip(&twin.depth_mm).filter(|pair| depth_apart(*pair)).count();
    let hits = twin.depth_mm.iter().filter(|mm| mm.is_finite()).count();
    println!("{what}: {colors} colours and {depths} depths of {pixels} differ, {hits} hits");
    assert!(hits as f64 > pixels * 0.05, "{what}: {hits} hits show too little to compare");
    assert!(colors as f64 <= pixels * ALLOWED_SHARE, "{what}: {colors} colours of {pixels} differ");
    assert!(depths as f64 <= pixels * ALLOWED_SHARE, "{what}: {depths} depths of {pixels} differ");
}

pub(super) fn request(volume: &Volume, preset: &str, vertical_fov_deg: f64) -> RenderRequest {
    let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg };
    let scene = SceneFile::default().with_preset(preset).with_size([112, 84]);
    scene.resolve(volume.grid(), &orbit).unwrap().request
}

/// The head, turned and stretched in patient space: axes must not be taken for granted.
pub(super) fn oblique_head() -> Volume {
    let head = common::volume(PhantomKind::Head, 64);
    let grid = head.grid();
    let turn = glam::DAffine3::from_axis_angle(glam::DVec3::new(1.0, 2.0, 0.5).normalize(), 0.6);
    let stretch = glam::DAffine3::from_scale(glam::DVec3::new(1.0, 1.1, 0.8));
    let placed = relief_base::Transform::from_affine(turn * stretch * grid.patient_from_voxel().affine);
    Volume::new(Grid::new(grid.dims(), placed).unwrap(), head.voxels_hu().to_vec()).unwrap()
}

/// Invariant: The GPU and the f64 reference agree in every mode, projection and depth rule.
#[test]
fn gpu_and_twin_agree_in_every_mode_projection_and_depth_rule() {
    let volume = oblique_head();
    // Minima and means of this volume are air's, which presets leave out: they have the next test.
    for mode in Mode::RAYS.into_iter().filter(|mode| !matches!(mode, Mode::Minip | Mode::Mean)) {
        for (projection, fov) in [("perspective", 25.0), ("orthographic", 0.0)] {
            for rule in [
                DepthRule::FirstHit,
                DepthRule::Threshold { fraction: 0.5 },
                DepthRule::Threshold { fraction: 0.95 },
            ] {
                for preset in ["bone", "soft-tissue"] {
                    let request = in_mode(mode, request(&volume, preset, fov));
                    let request = RenderRequest { depth: rule, ..request };
                    compare(&volume, &request, &format!("{mode:?}, {projection}, {rule:?}, {preset}"));
                }
            }
        }
    }
}

#[test]
fn gpu_and_twin_agree_in_projections_of_windows() {
    let head = oblique_head();
    let negated = head.voxels_hu().iter().map(|hu| -hu).collect();
    let negated = Volume::new(head.grid().clone(), negated).unwrap();
    let transfer = Window::grey(-400.0, 2000.0).translucent().unwrap();
    for fov in [25.0, 0.0] {
        for (mode, volume) in [(Mode::Minip, &negated), (Mode::Mean, &head)] {
            let transfer = transfer.clone();
            let request = RenderRequest { mode, transfer, ..request(volume, "bone", fov) };
            compare(volume, &request, &format!("{mode:?}, {fov}"));
        }
    }
}

/// Invariant: Opacity by gradient is per opacity unit: the picture does not depend on the sample
/// distance.
#[test]
fn gpu_and_twin_agree_under_opacity_by_gradient() {
    let volume = oblique_head();
    for (i, rule) in [DepthRule::FirstHit, DepthRule::Threshold { fraction: 0.5 }].into_iter().enumerate() {
        for preset in ["soft-tissue", "skin"] {
            let mut faded = request(&volume, preset, [25.0, 0.0][i]);
            let opacity = GradientOpacity::new(vec![[20.0, 0.0], [80.0, 0.4], [300.0, 1.0]]).unwrap();
            faded.transfer = faded.transfer.with_gradient_opacity(opacity);
            faded.depth = rule;
            compare(&volume, &faded, &format!("opacity by gradient, {rule:?}, {preset}"));
            faded.shading = relief_render::Shading::NONE;
            compare(&volume, &faded, &format!("opacity by gradient, unlit, {rule:?}, {preset}"));
        }
    }
}

#[test]
fn gpu_and_twin_agree_under_clip_planes_and_without_shading() {
    let volume = oblique_head();
    let center = volume.grid().center();
    let mut clipped = request(&volume, "bone", 25.0);
    clipped.background_rgb = [0.2, 0.4, 0.6];
    let mut clip = Clip::default();
    let arm = glam::DVec3::splat(60.0);
    clip.add_box(Point::from_xyz(center.xyz - arm), Point::from_xyz(center.xyz + arm));
    clip.planes.push(ClipPlane { point: center, normal: Vector::new(0.3, -1.0, 0.2) });
    clipped.clip = clip;
    compare(&volume, &clipped, "clip planes");
    let mut unshaded = request(&volume, "skin", 25.0);
    unshaded.shading = relief_render::Shading { ambient: 0.7, ..relief_render::Shading::NONE };
    compare(&volume, &unshaded, "no shading");
}

#[test]
fn gpu_and_twin_agree_where_gradients_are_not_precomputed() {
    let Some(mut renderer) = renderer("gradients of values") else { return };
    let volume = oblique_head();
    let request = RenderRequest { depth: DepthRule::FirstHit, ..request(&volume, "soft-tissue", 25.0) };
    let precomputed = renderer.render(&volume, &request).unwrap();
    renderer.forget(volume.content_hash());
    let limits = renderer.volume_limits();
    renderer.set_volume_limits(VolumeLimits { gradient_bytes: 0, ..limits });
    let values = renderer.render(&volume, &request).unwrap();
    renderer.forget(volume.content_hash());
    renderer.set_volume_limits(limits);
    drop(renderer);
    assert!(
        values.color_rgba != precomputed.color_rgba,
        "half floats round: the pictures cannot be the same"
    );
    expect_equal(&values, &precomputed, "gradients of values and precomputed ones");
    expect_equal(
        &values,
        &relief_render::render_reference(&volume, &request).unwrap(),
        "gradients of values",
    );
}
