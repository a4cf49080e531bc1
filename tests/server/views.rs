//! True views, compared with the closed form of a sphere.

use relief_display::{Frame, Layout, Pixels, Views};
use serde_json::json;

use crate::server::stage::{Answer, Stage};

const SCENE: &str = "preset=bone&size_px=64,48&azimuth_deg=0&elevation_deg=0&depth_range=volume";

fn views(answer: &Answer, layout: Layout) -> Views {
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "image/png");
    let image =
        image::load_from_memory_with_format(&answer.body, image::ImageFormat::Png).unwrap().into_rgb8();
    let frame = Frame::new([image.width(), image.height()], Pixels::Rgb8(image.into_raw())).unwrap();
    layout.decode(&frame).unwrap().views.unwrap()
}

/// The mean column of the pixels that show the sphere.
fn column_of_sphere(view: &[[u8; 3]], width: usize) -> f64 {
    let lit = || view.iter().enumerate().filter(|(_, color)| **color == [200, 40, 20]);
    lit().map(|(at, _)| (at % width) as f64 + 0.5).sum::<f64>() / lit().count() as f64
}

#[tokio::test]
async fn each_view_is_rendered_from_its_own_eye() {
    let stage = Stage::new();
    // With the screen at the near limit, the whole sphere is behind it, so the left eye sees it further to
    // the left.
    for (offset, is_behind) in [(255, true), (0, false)] {
        let path = stage.path(&format!("views?{SCENE}&layout=views-5x1&offset={offset}&factor=255"));
        let seen =
            views(&stage.get(&path).await, Layout::Views(relief_display::ViewGrid::new(5, 1).unwrap()));
        assert_eq!((seen.size_px(), seen.pictures().len()), ([64, 48], 5));
        let columns: Vec<f64> = seen.pictures().iter().map(|view| column_of_sphere(view, 64)).collect();
        assert!((columns[2] - 32.0).abs() < 0.1, "the middle view is that of the scene: {columns:?}");
        assert!(
            columns.windows(2).all(|pair| (pair[0] < pair[1]) == is_behind),
            "offset {offset}: {columns:?}"
        );
        for (left, right) in [(0, 4), (1, 3)] {
            // The sphere is symmetric, so eyes at equal distances from the middle see mirror images.
            assert!((columns[left] + columns[right] - 64.0).abs() < 0.3, "{columns:?}");
        }
        // Parallax is proportional to the distance of the eye from the middle.
        let [inner, outer] = [columns[3] - 32.0, columns[4] - 32.0];
        assert!((outer - 2.0 * inner).abs() < 0.5 && outer.abs() > 0.8, "{columns:?}");
    }
}

#[tokio::test]
async fn query_and_body_agree_and_known_views_are_not_rendered_again() {
    let stage = Stage::new();
    let path = stage.path(&format!("views?{SCENE}&layout=stereo"));
    let answer = stage.get(&path).await;
    let scene = json!({ "transfer": "bone", "size_px": [64, 48],
                        "display": { "layout": "stereo", "depth_range": "volume" } });
    let again = stage.post(&stage.path("views"), "application/json", scene.to_string()).await;
    assert_eq!(
        again.body,
        stage.get(&stage.path("views?preset=bone&size_px=64,48&depth_range=volume&layout=stereo")).await.body
    );
    let tag = answer.header("etag").to_owned();
    assert_ne!(tag, stage.get(&stage.path(&format!("frame?{SCENE}&layout=stereo"))).await.header("etag"));
    let known = stage.get_with(&path, &[("if-none-match", &tag)]).await;
    assert_eq!((known.status.as_u16(), known.body.len()), (304, 0));
}

#[tokio::test]
async fn views_that_cannot_be_are_refused_with_the_reason() {
    let stage = Stage::new();
    for (query, code, words) in [
        ("layout=wowvx", "out-of-range", "a layout of views"),
        ("layout=stereo&vertical_fov_deg=0", "no-true-views", "parallel projection has no eye"),
        ("layout=views-9&size_px=16384,16", "out-of-range", "size_px"),
    ] {
        let answer = stage.get(&stage.path(&format!("views?preset=bone&{query}"))).await;
        assert_eq!(answer.status, 422, "{query}: {}", answer.text());
        assert!(answer.text().contains(code) && answer.text().contains(words), "{query}: {}", answer.text());
    }
    let exr = stage.get_with(&stage.path("views?layout=stereo"), &[("accept", "image/x-exr")]).await;
    assert_eq!(exr.status, 406, "{}", exr.text());
}
