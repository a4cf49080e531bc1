//! Pictures of fewer rays, enlarged: in their size, in their place, with depths that were there
//! before.

use std::sync::Arc;

use super::renderer;
use crate::common;
use relief_render::{Detail, Overlays, RenderRequest, Renderer, SceneFile};
use relief_session::SpeedBook;
use relief_volume::{Orbit, PhantomKind, Volume};

fn request(volume: &Volume, json: &str) -> RenderRequest {
    let scene = SceneFile::parse(json.as_bytes()).unwrap().with_size([192, 108]);
    scene.resolve(volume.grid(), &Orbit { azimuth_deg: 30.0, ..Orbit::default() }).unwrap().request
}

/// Invariant: A time budget is kept by measured speed; a reduced picture has the requested size and
/// depths that were rendered; without a budget nothing is reduced.
#[test]
fn a_reduced_picture_is_the_small_one_enlarged() {
    let Some(mut renderer) = renderer("a_reduced_picture_is_the_small_one_enlarged") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    for json in [
        r#"{"transfer": "skin"}"#,
        r#"{"mode": "mip"}"#,
        r#"{"transfer": "skin", "depth": {"rule": "two-layer"}}"#,
        r#"{"mode": "path-traced", "path_trace": {"passes": 4}}"#,
    ] {
        let whole = request(&volume, json);
        let reduced = RenderRequest { reduced_px: Some([64, 36]), ..whole.clone() };
        let small = renderer.render(&volume, &RenderRequest { size_px: [64, 36], ..whole.clone() }).unwrap();
        let large = renderer.render(&volume, &reduced).unwrap();
        assert_eq!((large.size_px, large.depth_mm.len()), ([192, 108], 192 * 108), "{json}");
        // Three times as large: the middle of each block of 3x3 is the small picture's pixel, in
        // colour and in depth.
        let back = large.back.as_ref().zip(small.back.as_ref());
        for (row, column) in (0..36).flat_map(|row| (0..64).map(move |column| (row, column))) {
            let (from, to) = (row * 64 + column, (3 * row + 1) * 192 + 3 * column + 1);
            assert_eq!(large.color_rgba[to], small.color_rgba[from], "{json} at {column}, {row}");
            for (down, across) in (0..3).flat_map(|down| (0..3).map(move |across| (down, across))) {
                let near = (3 * row + down) * 192 + 3 * column + across;
                assert_eq!(large.depth_mm[near].to_bits(), small.depth_mm[from].to_bits(), "{json}");
                if let Some((large, small)) = back {
                    assert_eq!(large.depth_mm[near].to_bits(), small.depth_mm[from].to_bits(), "{json}");
                }
            }
        }
        assert_eq!(large.back.is_some(), json.contains("two-layer"));
    }
}

#[test]
fn a_reduced_picture_shows_what_the_whole_one_shows_where_it_is() {
    let Some(mut renderer) = renderer("a_reduced_picture_shows_what_the_whole_one_shows") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    let whole = request(&volume, r#"{"transfer": "bone", "depth": {"rule": "first-hit"}}"#);
    let least = SpeedBook::least(&whole);
    assert_eq!(
        (least.reduced_px, least.sample_distance_mm),
        (Some([24, 14]), 4.0 * whole.sample_distance_mm)
    );
    for (reduced, allowed) in
        [(RenderRequest { reduced_px: Some([96, 54]), ..whole.clone() }, 4.0), (least, 12.0)]
    {
        let expected = renderer.render(&volume, &whole).unwrap();
        let found = renderer.render(&volume, &reduced).unwrap();
        let difference: f64 = expected
            .color_rgba
            .iter()
            .zip(&found.color_rgba)
            .flat_map(|(a, b)| (0..3).map(|i| f64::from(a[i].abs_diff(b[i]))))
            .sum();
        let mean = difference / (3 * expected.color_rgba.len()) as f64;
        assert!(mean < allowed, "{mean:.2} of 255 with {:?} rays", reduced.reduced_px);
        // The middle of the ball is where it was.
        let at = [96, 54];
        let off = (found.depth_at(at).0 - expected.depth_at(at).0).abs();
        assert!(off < 3.0, "{off} mm");
    }
}

#[test]
fn overlays_are_drawn_over_the_enlarged_picture_and_over_light_paths() {
    let Some(mut renderer) = renderer("overlays_are_drawn_over_the_enlarged_picture") else { return };
    let volume = common::volume(PhantomKind::Sphere, 32);
    let overlays = Arc::new(Overlays { scale_bar: true, ..Overlays::default() });
    for json in [r#"{"transfer": "bone"}"#, r#"{"mode": "path-traced", "path_trace": {"passes": 1}}"#] {
        let plain = request(&volume, json);
        let bar = |request: &RenderRequest, renderer: &mut Renderer| {
            let with = RenderRequest { overlays: Arc::clone(&overlays), ..request.clone() };
            let [without, with] = [request, &with].map(|request| renderer.render(&volume, request).unwrap());
            let pairs = without.color_rgba.iter().zip(&with.color_rgba);
            pairs.enumerate().filter(|(_, (a, b))| a != b).map(|(at, _)| at).collect::<Vec<_>>()
        };
        let reduced = RenderRequest { reduced_px: Some([48, 27]), ..plain.clone() };
        let (expected, found) = (bar(&plain, &mut renderer), bar(&reduced, &mut renderer));
        assert!(!expected.is_empty(), "no scale bar: {json}");
        assert_eq!(found, expected, "as sharp as in the whole picture: {json}");
    }
}

#[test]
fn more_rays_than_pixels_are_refused() {
    let Some(mut renderer) = renderer("more_rays_than_pixels_are_refused") else { return };
    let volume = common::volume(PhantomKind::Sphere, 32);
    let request = RenderRequest { reduced_px: Some([193, 108]), ..request(&volume, "{}") };
    let message = renderer.render(&volume, &request).unwrap_err().to_string();
    assert!(message.contains("reduced_px is 193, allowed: 1 to 192"), "{message}");
}

/// Invariant: A coarse picture is the picture of the means of 2x2x2 voxels; on a graphics adapter it
/// is that of all voxels.
#[test]
fn a_coarse_picture_is_that_of_the_means_of_voxels() {
    let volume = common::volume(PhantomKind::Head, 96);
    let whole = request(&volume, r#"{"transfer": "skin", "depth": {"rule": "first-hit"}}"#);
    let coarse = RenderRequest { detail: Detail::Coarse, ..whole.clone() };
    let mut processor = Renderer::on_processor();
    let [full, quick] = [&whole, &coarse].map(|request| processor.render(&volume, request).unwrap());
    // The means are made here without the renderer: a series that was read with --downsample 2.
    let means = volume.downsampled(2);
    let [x, y, z] = means.grid().spacing_mm();
    let sample_distance_mm = x.min(y).min(z) / 2.0;
    let sampled = RenderRequest { sample_distance_mm, ..whole.clone() };
    let expected = processor.render(&means, &sampled).unwrap();
    assert_eq!(quick.color_rgba, expected.color_rgba);
    assert_eq!(quick.depth_mm, expected.depth_mm);
    assert_eq!(quick.limits, full.limits, "the box of all voxels");
    // It shows the same: surfaces are off by less than a voxel.
    let mut off: Vec<f32> = full
        .depth_mm
        .iter()
        .zip(&quick.depth_mm)
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .map(|(a, b)| (a - b).abs())
        .collect();
    off.sort_by(f32::total_cmp);
    assert!(off.len() > 1000 && f64::from(off[off.len() / 2]) < x / 2.0, "{} mm", off[off.len() / 2]);
    // With the volume its means are forgotten.
    processor.forget(means.content_hash());
    assert!(processor.memory().used_bytes > 0);
    processor.forget(volume.content_hash());
    assert_eq!(processor.memory().used_bytes, 0);
    let Some(mut adapter) = renderer("a_coarse_picture_on_a_graphics_adapter") else { return };
    let [all, same] = [&whole, &coarse].map(|request| adapter.render(&volume, request).unwrap());
    assert_eq!(all.color_rgba, same.color_rgba);
}
