//! Slices over HTTP: the query's scene, its orientation letters, its picks and its refusals.

use relief_render::SceneFile;
use relief_volume::Orbit;
use serde_json::{Value, json};

use crate::server::stage::{Stage, cube};

#[tokio::test]
async fn a_slice_by_query_is_the_frame_of_its_scene() {
    let stage = Stage::new();
    for (query, slice, transfer) in [
        ("", json!({}), Value::Null),
        (
            "plane=axial&offset_mm=5&window=40,350&slab_mm=2",
            json!({ "plane": "axial", "offset_mm": 5, "slab_mm": 2 }),
            json!({ "window": { "center_hu": 40, "width_hu": 350 } }),
        ),
        (
            "normal=0.2,-1,0.1&up=0,0,1&center_mm=1,2,3&slab_mm=8&slab_blend=minip&height_mm=25&letters=true&preset=lung",
            json!({ "plane": { "normal": [0.2, -1, 0.1], "up": [0, 0, 1] }, "center_mm": [1, 2, 3],
                    "slab_mm": 8, "blend": "minip", "height_mm": 25, "letters": true }),
            json!("lung"),
        ),
    ] {
        let by_query = stage.get(&stage.path(&format!("slice?size_px=32,24&{query}"))).await;
        assert_eq!(by_query.status, 200, "{}", by_query.text());
        let picture = image::load_from_memory(&by_query.body).unwrap();
        assert_eq!((picture.width(), picture.height()), (32, 24), "the picture alone");
        let mut body = json!({ "mode": "slice", "slice": slice, "size_px": [32, 24],
                               "display": { "layout": "color" } });
        if !transfer.is_null() {
            body["transfer"] = transfer;
        }
        let by_body = stage.post(&stage.path("frame"), "application/json", body.to_string()).await;
        assert_eq!(by_query.header("etag"), by_body.header("etag"), "{query}");
        assert_eq!(by_query.body, by_body.body, "{query}");
        let scene = SceneFile::parse(body.to_string().as_bytes()).unwrap();
        let camera = scene.resolve(cube().grid(), &Orbit::default()).unwrap().request.camera;
        let reported: Value = serde_json::from_str(by_query.header("relief-camera")).unwrap();
        assert_eq!(reported["camera"]["look_at_mm"], json!(camera.look_at().xyz.to_array()), "{query}");
        assert_eq!(reported["edges"], serde_json::to_value(camera.edge_labels()).unwrap(), "{query}");
    }
}

#[tokio::test]
async fn named_slices_have_the_letters_of_the_convention() {
    let stage = Stage::new();
    for (plane, edges) in [
        ("axial", json!({ "left": "R", "right": "L", "top": "A", "bottom": "P" })),
        ("coronal", json!({ "left": "R", "right": "L", "top": "H", "bottom": "F" })),
        ("sagittal", json!({ "left": "A", "right": "P", "top": "H", "bottom": "F" })),
    ] {
        let answer = stage.get(&stage.path(&format!("slice?size_px=8,8&plane={plane}"))).await;
        let reported: Value = serde_json::from_str(answer.header("relief-camera")).unwrap();
        assert_eq!(reported["edges"], edges, "{plane}");
    }
}

#[tokio::test]
async fn a_pick_on_a_slice_is_a_point_of_its_plane() {
    let stage = Stage::new();
    // 40 mm of height for 40 pixels; the axial picture's u is x + 20, its v is y + 20.
    for (plane, u, v, point) in [
        ("axial", 25.0, 33.0, [5.5, 13.5, 4.0]),
        ("coronal", 25.0, 33.0, [5.5, 4.0, -13.5]),
        ("sagittal", 25.0, 33.0, [4.0, 5.5, -13.5]),
    ] {
        let query = format!("mode=slice&plane={plane}&offset_mm=4&size_px=40,40&height_mm=40&u={u}&v={v}");
        let pick = stage.get(&stage.path(&format!("pick?{query}"))).await.json();
        let found: Vec<f64> = serde_json::from_value(pick["patient_mm"].clone()).unwrap();
        let off = found.iter().zip(point).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-4, "{plane}: {found:?} for {point:?}");
    }
}

#[tokio::test]
async fn invalid_slices_are_named() {
    let stage = Stage::new();
    for (part, status, path, detail) in [
        ("slice?plane=transverse", 400, "plane", "axial, sagittal, coronal"),
        ("slice?letters=yes", 400, "letters", "true or false"),
        ("frame?letters=true", 422, "letters", "mode=slice"),
        ("slice?slab_blend=median", 400, "slab_blend", "mean, mip, minip"),
        ("slice?mode=mip", 422, "mode", "slice"),
        ("slice?plane=axial&normal=0,0,1", 422, "normal", "exclude"),
        ("slice?up=0,0,1", 422, "up", "normal"),
        ("slice?normal=0,0,0", 422, "normal", "length above zero"),
        ("slice?normal=0,0,1", 422, "up", "across the normal"),
        ("slice?slab_mm=-1", 422, "slab_mm", "0 to 1000"),
        ("slice?slab_mm=1e9", 422, "slab_mm", "0 to 1000"),
        ("slice?height_mm=0", 422, "height_mm", "0.001"),
        ("slice?center_mm=0,0,1e9", 422, "center_mm", "-100000 to 100000"),
        ("slice?window=40,0", 422, "window", "1 to 65536"),
        ("slice?azimuth_deg=20", 422, "slice", "angles"),
        ("slice?eye_mm=0,-99,0", 422, "camera", "mode slice"),
        ("frame?plane=axial", 422, "plane", "mode=slice"),
        ("frame?slab_mm=3", 422, "slab_mm", "mode=slice"),
    ] {
        let problem = stage.get(&stage.path(part)).await.problem(status);
        assert_eq!(problem["path"], path, "{part}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(detail), "{part}: {problem}");
    }
}
