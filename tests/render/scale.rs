//! Volumes of another scale than bodies: micro-CT looks like a volume of 1 mm with the same voxels.

use relief_display::DisplaySettings;
use relief_render::{PictureWarning, RenderedFrame, Renderer, SceneFile, Subject};
use relief_volume::{Grid, Orbit, PhantomKind, Volume};

use super::renderer;
use crate::common;

/// A head of 64 voxels along each side, whatever they measure.
fn head(spacing_mm: f64) -> Volume {
    let made = common::volume(PhantomKind::Head, 64);
    let grid = Grid::axis_aligned(made.grid().dims(), [spacing_mm; 3], [-20.0 * spacing_mm; 3]).unwrap();
    Volume::new(grid, made.voxels_hu().to_vec()).unwrap()
}

fn rendered(renderer: &mut Renderer, volume: &Volume, scene: &str) -> RenderedFrame {
    let scene: SceneFile = serde_json::from_str(scene).unwrap();
    let scene = scene.with_size([160, 120]);
    let request = scene.resolve_for(&Subject::of(volume, None), &Orbit::default()).unwrap().request;
    renderer.render(volume, &request).unwrap()
}

/// Invariant: A volume of a smaller scale looks like one of 1 mm with the same voxels.
#[test]
fn micro_ct_looks_like_a_volume_of_1_mm() {
    let Some(mut renderer) = renderer("micro_ct_looks_like_a_volume_of_1_mm") else { return };
    let whole = head(1.0);
    for scene in [
        "{}",
        r#"{"transfer": "skin"}"#,
        r#"{"transfer": "vessels"}"#,
        r#"{"transfer": "x-ray"}"#,
        r#"{"mode": "mip"}"#,
        r#"{"mode": "isosurface"}"#,
        r#"{"mode": "path-traced", "path_trace": {"passes": 2}}"#,
        r#"{"transfer": {"window": {"center_hu": 40, "width_hu": 400}}}"#,
    ] {
        let expected = rendered(&mut renderer, &whole, scene);
        assert!(expected.depth_mm.iter().filter(|depth| depth.is_finite()).count() > 2000, "{scene}");
        let limits = expected.limits_for(&DisplaySettings::default()).unwrap();
        // A power of two divides exactly; 35 µm and 1 µm round.
        for (spacing_mm, most) in [(0.031_25, 0.0), (0.035, 0.2), (0.001, 0.2)] {
            let found = rendered(&mut renderer, &head(spacing_mm), scene);
            let pairs = expected.color_rgba.as_flattened().iter().zip(found.color_rgba.as_flattened());
            let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            let mean = sum as f64 / (4 * found.color_rgba.len()) as f64;
            assert!(mean <= most, "{scene}, voxels of {spacing_mm} mm: {mean:.3} of 255 on average");
            let own = found.limits_for(&DisplaySettings::default()).unwrap();
            for (own, all) in [(own.near_mm, limits.near_mm), (own.far_mm, limits.far_mm)] {
                let off = (own / spacing_mm - all).abs();
                assert!(off < 0.5, "{scene}, voxels of {spacing_mm} mm: depth limits {off:.2} voxels off");
            }
        }
    }
}

#[test]
fn an_empty_projection_blames_its_window() {
    let Some(mut renderer) = renderer("an_empty_projection_blames_its_window") else { return };
    let volume = head(1.0);
    let said = |renderer: &mut Renderer, text: &str| {
        let scene: SceneFile = serde_json::from_str(text).unwrap();
        let subject = Subject::of(&volume, None);
        let scene = scene.with_size([64, 48]).resolve_for(&subject, &Orbit::default()).unwrap();
        let frame = renderer.render(&volume, &scene.request).unwrap();
        let warning = PictureWarning::of(&frame, &scene.display, &scene.request, &subject, volume.range_hu());
        warning.map(|warning| warning.to_string()).unwrap_or_default()
    };
    let dark = r#""transfer": {"window": {"center_hu": 9000, "width_hu": 100}}"#;
    for mode in ["mip", "mean"] {
        let found = said(&mut renderer, &format!(r#"{{"mode": "{mode}", {dark}}}"#));
        assert!(found.contains("the projection has no value"), "{mode}: {found}");
    }
    let away = r#""camera": {"eye_mm": [0, -500, 0], "look_at_mm": [0, -900, 0], "up": [0, 0, 1]}"#;
    let found = said(&mut renderer, &format!(r#"{{"mode": "mip", {away}}}"#));
    assert!(found.contains("camera"), "{found}");
}
