//! Pictures in bands equal those of one dispatch, and a cancelled one ends with its band.

use std::ops::ControlFlow;

use super::{in_mode, renderer};
use crate::common;
use relief_render::{
    DepthRule, Mode, Progress, RenderError, RenderRequest, RenderedFrame, Renderer, SceneFile,
};
use relief_volume::{Orbit, PhantomKind, Volume};

/// A width and a height that are no whole numbers of tiles.
const SIZE: [u32; 2] = [97, 61];
/// Rows of tiles of that size: bands at the smallest.
const TILE_ROWS: u64 = 8;

fn request(volume: &Volume, json: &str) -> RenderRequest {
    let scene = SceneFile::parse(json.as_bytes()).unwrap().with_size(SIZE);
    scene.resolve(volume.grid(), &Orbit { azimuth_deg: 30.0, ..Orbit::default() }).unwrap().request
}

fn slice(volume: &Volume) -> RenderRequest {
    let json = r#"{"mode": "slice", "slice": {"plane": "coronal", "slab_mm": 20, "blend": "mip"}}"#;
    let scene = SceneFile::parse(json.as_bytes()).unwrap().with_size(SIZE);
    scene.resolve(volume.grid(), &Orbit::default()).unwrap().request
}

fn bits(depths: &[f32]) -> Vec<u32> {
    depths.iter().map(|mm| mm.to_bits()).collect()
}

fn assert_same(a: &RenderedFrame, b: &RenderedFrame, what: &str) {
    assert!(a.color_rgba == b.color_rgba, "colour of {what}");
    assert!(bits(&a.depth_mm) == bits(&b.depth_mm), "depth of {what}");
    let displayed = |frame: &RenderedFrame| frame.display_mm.as_deref().map(bits);
    assert!(displayed(a) == displayed(b), "depth for displays of {what}");
    let back = |frame: &RenderedFrame| {
        frame.back.as_ref().map(|back| (back.color_rgba.clone(), bits(&back.depth_mm)))
    };
    assert!(back(a) == back(b), "what lies behind, of {what}");
}

/// Invariant: Bands change no byte of a picture, and cancelling ends a picture after its current
/// band.
#[test]
fn bands_change_not_one_byte() {
    let Some(mut renderer) = renderer("bands_change_not_one_byte") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let base = request(&volume, r#"{"transfer": "skin"}"#);
    let mut requests: Vec<_> = Mode::RAYS.map(|mode| in_mode(mode, base.clone())).to_vec();
    requests.push(RenderRequest { depth: DepthRule::TwoLayer { fraction: 0.5 }, ..base });
    requests.push(request(
        &volume,
        r#"{"mode": "path-traced", "transfer": "skin", "path_trace": {"passes": 5}}"#,
    ));
    requests.push(slice(&volume));
    for request in requests {
        let what = format!("{:?}", request.mode);
        let [whole, cut, fine] = [u32::MAX, 97 * 24, 1].map(|pixels| {
            renderer.set_band_pixels(pixels);
            // A path-traced picture would be continued, not recreated.
            renderer.forget(volume.content_hash());
            renderer.render(&volume, &request).unwrap()
        });
        renderer.set_band_pixels(1 << 16);
        assert_same(&whole, &cut, &what);
        assert_same(&whole, &fine, &what);
    }
}

/// Invariant: Bands change no byte of a picture, and cancelling ends a picture after its current
/// band.
#[test]
fn a_cancelled_picture_ends_with_its_band_and_harms_no_later_one() {
    let Some(mut renderer) = renderer("a_cancelled_picture_ends_with_its_band") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let bone = r#"{"transfer": "bone", "depth": {"rule": "threshold"}}"#;
    for json in [bone, r#"{"mode": "path-traced", "path_trace": {"passes": 64}}"#] {
        let request = request(&volume, json);
        let whole = renderer.render(&volume, &request).unwrap();
        renderer.set_band_pixels(1);
        // The rows of tiles that something can be seen in: not all.
        let mut rows = 0;
        let cast = r#"{"transfer": "bone", "depth": {"rule": "threshold"}}"#;
        let mut counts = |progress: Progress| {
            rows = progress.bands;
            ControlFlow::Continue(())
        };
        renderer.render_watched(&volume, &self::request(&volume, cast), &mut counts).unwrap();
        assert!(rows > 3 && rows < TILE_ROWS, "{rows} rows of tiles");
        for last in [1, 3, rows + 2] {
            renderer.forget(volume.content_hash());
            let mut asked = Vec::new();
            let mut goes_on = |progress: Progress| {
                asked.push(progress.bands);
                if progress.bands < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            };
            let outcome = renderer.render_watched(&volume, &request, &mut goes_on);
            if request.mode == Mode::PathTraced || last <= rows {
                assert!(matches!(outcome, Err(RenderError::Cancelled)), "{json} after {last}");
                assert_eq!(asked, (1..=last).collect::<Vec<_>>(), "{json}");
            } else {
                assert_same(&outcome.unwrap(), &whole, json);
                assert_eq!(asked.len() as u64, rows);
            }
        }
        let again = renderer.render(&volume, &request).unwrap();
        renderer.set_band_pixels(1 << 16);
        assert_same(&again, &whole, json);
    }
}

/// Invariant: A picture that was cancelled is continued by an equal request, with others between, and
/// has the bytes of one that was not.
#[test]
fn a_cancelled_picture_is_continued_and_has_the_same_bytes() {
    continues(&mut Renderer::on_processor(), 0);
    let Some(mut renderer) = renderer("a_cancelled_picture_is_continued") else { return };
    continues(&mut renderer, 1);
}

/// `ahead` is the number of bands that are submitted and not counted when a picture is cancelled.
fn continues(renderer: &mut Renderer, ahead: u64) {
    let volume = common::volume(PhantomKind::Head, 64);
    let base = request(&volume, r#"{"transfer": "skin"}"#);
    let mut requests: Vec<_> = Mode::RAYS.map(|mode| in_mode(mode, base.clone())).to_vec();
    requests.push(RenderRequest { depth: DepthRule::TwoLayer { fraction: 0.5 }, ..base.clone() });
    requests.push(slice(&volume));
    let other = RenderRequest { background_rgb: [1.0, 0.0, 0.0], ..base };
    renderer.set_band_pixels(1);
    for request in requests {
        let what = format!("{:?}", request.mode);
        // Two views beside a picture have as many rows of tiles together.
        let (pictures, most) = if request.casts_views_beside() { (3, 2 * TILE_ROWS) } else { (1, TILE_ROWS) };
        let mut whole_bands = 0;
        let mut counts = |progress: Progress| {
            whole_bands = progress.bands;
            ControlFlow::Continue(())
        };
        let whole = renderer.render_watched(&volume, &request, &mut counts).unwrap();
        let (mut bands, mut interruptions) = (0, 0);
        let continued = loop {
            let mut done = 0;
            let mut goes_on = |progress: Progress| {
                done = progress.bands;
                if progress.is_kept { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let outcome = renderer.render_watched(&volume, &request, &mut goes_on);
            bands += done;
            match outcome {
                Ok(frame) => break frame,
                Err(RenderError::Cancelled) => interruptions += 1,
                Err(error) => panic!("{what}: {error}"),
            }
            assert!(interruptions < most, "{what} comes to no end");
            renderer.render(&volume, &other).unwrap();
        };
        assert_same(&continued, &whole, &what);
        assert!(interruptions > 1, "{what}: {interruptions} interruptions");
        // One row of a picture may come twice where bands are submitted ahead.
        assert!(
            bands + ahead * interruptions <= whole_bands + pictures * ahead,
            "{what}: {bands} of {whole_bands} bands"
        );
    }
}
