//! Requests that cannot be rendered are refused in words that help.

use crate::common;
use relief_render::SceneFile;
use relief_volume::{Grid, Orbit, PhantomKind, Volume};

use super::renderer;

#[test]
fn a_volume_over_the_adapters_limit_is_refused_with_the_limit_and_a_factor() {
    let Some(mut renderer) = renderer("a_volume_over_the_adapters_limit") else { return };
    let limit = renderer.gpu().expect("a graphics adapter").limits().texture_3d_side as usize;
    let grid = Grid::axis_aligned([limit * 2 + 1, 1, 1], [0.1, 1.0, 1.0], [0.0; 3]).unwrap();
    let volume = Volume::new(grid, vec![0; limit * 2 + 1]).unwrap();
    let scene = SceneFile::default().resolve(volume.grid(), &Orbit::default()).unwrap();
    let message = renderer.render(&volume, &scene.request).unwrap_err().to_string();
    assert!(message.contains(&format!("at most {limit} along a side")), "{message}");
    assert!(message.contains("--downsample 3"), "{message}");
    let smaller = volume.downsampled(3);
    renderer.render(&smaller, &scene.request).expect("the factor that was offered fits");
}

#[test]
fn a_request_out_of_range_is_refused_and_harms_no_later_one() {
    let Some(mut renderer) = renderer("a_request_out_of_range") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    let scene = SceneFile::default().with_size([32, 32]).resolve(volume.grid(), &Orbit::default()).unwrap();
    let mut bad = scene.request.clone();
    bad.sample_distance_mm = f64::NAN;
    let message = renderer.render(&volume, &bad).unwrap_err().to_string();
    assert!(message.contains("sample_distance_mm is NaN, allowed: 0.000001 to 100"), "{message}");
    renderer.render(&volume, &scene.request).expect("a good request still renders");
}
