//! Stepping over empty space changes not one byte, and does skip.

use std::sync::Arc;

use super::{in_mode, renderer};
use crate::common;
use relief_render::{DepthRule, EmptySpaceSkipping, Mode, Overlays, RenderRequest, Renderer, SceneFile};
use relief_volume::{Camera, GradientOpacity, Orbit, PhantomKind, Projection, Volume};

fn requests(volume: &Volume) -> Vec<RenderRequest> {
    let mut requests = Vec::new();
    for preset in ["bone", "skin", "lung", "vessels", "soft-tissue"] {
        for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (37.0, 21.0), (180.0, 0.0), (0.0, 90.0)] {
            for vertical_fov_deg in [0.0, 30.0] {
                let orbit = Orbit { azimuth_deg, elevation_deg, zoom: 1.3, vertical_fov_deg };
                let scene = SceneFile::default().with_preset(preset).with_size([97, 61]);
                requests.push(scene.resolve(volume.grid(), &orbit).unwrap().request);
            }
        }
    }
    let far = requests[2].camera;
    let arm = (far.eye().xyz - far.look_at().xyz) * 400.0;
    let eye = relief_base::Point::from_xyz(far.look_at().xyz + arm);
    let narrow = Projection::Perspective { vertical_fov: 0.12f64.to_radians() };
    let camera = Camera::new(eye, far.look_at(), far.up(), narrow).unwrap();
    requests.push(RenderRequest { camera, ..requests[2].clone() });
    requests
}

/// Slices take every sample, whatever the bricks say.
fn slices(volume: &Volume) -> Vec<RenderRequest> {
    let scene = |blend: &str| {
        let json = format!(
            r#"{{"mode": "slice", "size_px": [97, 61], "transfer": "bone", "sample_distance_mm": 1.3,
                "slice": {{"plane": "coronal", "slab_mm": 20, "blend": "{blend}"}}}}"#
        );
        SceneFile::parse(json.as_bytes()).unwrap().resolve(volume.grid(), &Orbit::default()).unwrap().request
    };
    ["mean", "mip", "minip"].map(scene).to_vec()
}

/// Invariant: EmptySpaceSkipping empty space changes no byte of a picture.
///
/// Invariant: EmptySpaceSkipping empty space changes no byte of a picture.
#[test]
fn skipping_changes_not_one_byte() {
    let Some(mut renderer) = renderer("skipping_changes_not_one_byte") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    for (i, mut request) in requests(&volume).into_iter().enumerate() {
        request.sample_distance_mm = [0.7, 1.0, 2.3][i % 3];
        if i % 2 == 1 {
            request = in_mode(Mode::RAYS[i / 2 % Mode::RAYS.len()], request);
        }
        request.depth = if i % 2 == 0 { DepthRule::FirstHit } else { DepthRule::Threshold { fraction: 0.5 } };
        if i % 5 == 0 {
            request.overlays = Arc::new(Overlays { bounding_box: true, ..Overlays::default() });
        }
        assert_same_bytes(&mut renderer, &volume, &request);
    }
    for mut request in requests(&volume).into_iter().step_by(7) {
        let opacity = GradientOpacity::new(vec![[30.0, 0.0], [200.0, 1.0]]).unwrap();
        request.transfer = request.transfer.with_gradient_opacity(opacity);
        assert_same_bytes(&mut renderer, &volume, &request);
    }
    for request in slices(&volume) {
        assert_same_bytes(&mut renderer, &volume, &request);
    }
}

fn assert_same_bytes(renderer: &mut Renderer, volume: &Volume, request: &RenderRequest) {
    let on = renderer.render_with(volume, request, EmptySpaceSkipping::On).unwrap();
    let off = renderer.render_with(volume, request, EmptySpaceSkipping::Off).unwrap();
    assert!(on.color_rgba == off.color_rgba, "colour of {request:?}");
    let bits = |depths: &[f32]| depths.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
    assert!(bits(&on.depth_mm) == bits(&off.depth_mm), "depth of {request:?}");
}

#[test]
fn skipping_skips() {
    let Some(mut renderer) = renderer("skipping_skips") else { return };
    let volume = common::volume(PhantomKind::Sphere, 128);
    let scene = SceneFile::default().with_size([64, 64]).resolve(volume.grid(), &Orbit::default()).unwrap();
    let taken = renderer.count_samples(&volume, &scene.request, EmptySpaceSkipping::On).unwrap();
    let all = renderer.count_samples(&volume, &scene.request, EmptySpaceSkipping::Off).unwrap();
    let Projection::Perspective { .. } = scene.request.camera.projection() else { panic!("a perspective") };
    // Without skipping each of some 2000 rays that meet the box would take about 256 samples.
    assert!(taken < 2000 * 40, "{taken} samples");
    assert!(taken > 1000, "{taken} samples");
    assert!(all > 4 * taken, "{taken} of {all} samples");
}
