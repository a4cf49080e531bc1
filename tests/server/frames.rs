//! Frames, depth and picks: media types, tags, and the rendered pixels in the response.

use relief_display::{DecodedDepth, Frame, Layout, Pixels, decode_exr, inspect_png};
use relief_render::{RenderRequest, SceneFile};
use relief_volume::Orbit;
use serde_json::{Value, json};

use crate::server::stage::{Answer, SPHERE_MM, Stage, cube, sphere_depths};

const SCENE: &str =
    "preset=bone&layout=rgbd&size_px=32,24&azimuth_deg=40&elevation_deg=10&depth_range=volume";

/// The render request of [`SCENE`], made without the server.
fn scene_request() -> RenderRequest {
    let orbit = Orbit { azimuth_deg: 40.0, elevation_deg: 10.0, ..Orbit::default() };
    let scene = SceneFile::parse(br#"{"transfer":"bone","size_px":[32,24]}"#).unwrap();
    scene.resolve(cube().grid(), &orbit).unwrap().request
}

fn expected_depth() -> Vec<f32> {
    sphere_depths(&scene_request())
}

fn png(answer: &Answer) -> Frame {
    let image = image::load_from_memory_with_format(&answer.body, image::ImageFormat::Png).unwrap();
    let size = [image.width(), image.height()];
    let pixels = match image {
        image::DynamicImage::ImageRgb8(rgb) => Pixels::Rgb8(rgb.into_raw()),
        image::DynamicImage::ImageLuma16(grey) => Pixels::Gray16(grey.into_raw()),
        other => panic!("a PNG of {:?}", other.color()),
    };
    Frame::new(size, pixels).unwrap()
}

#[tokio::test]
async fn a_frame_carries_picture_headers_and_camera() {
    let stage = Stage::new();
    let answer = stage.get(&stage.path(&format!("frame?{SCENE}"))).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "image/png");
    assert_eq!(answer.header("vary"), "Accept");
    assert!(answer.header("cache-control").starts_with("private, max-age="));
    assert!(answer.header("etag").starts_with("W/\""));
    for part in ["queue;dur=", "upload;dur=1.00", "render;dur=2.00", "overlay;dur=0.00", "encode;dur="] {
        assert!(answer.header("server-timing").contains(part), "{}", answer.header("server-timing"));
    }
    let decoded = Layout::Rgbd.decode(&png(&answer)).unwrap();
    let hits: Vec<bool> = expected_depth().iter().map(|depth| depth.is_finite()).collect();
    assert!(hits.iter().any(|hit| *hit) && !hits.iter().all(|hit| *hit));
    assert_eq!(decoded.color.iter().map(|c| *c == [200, 40, 20]).collect::<Vec<_>>(), hits);
    let DecodedDepth::Disparity(d) = decoded.depth else { panic!("rgbd has disparity") };
    assert!(d.iter().zip(&hits).all(|(d, hit)| (*d > 0) == *hit), "a miss is the far limit, D = 0");

    let camera: Value = serde_json::from_str(answer.header("relief-camera")).unwrap();
    let distance = scene_request().camera.distance_mm();
    assert_eq!(camera["size_px"], json!([32, 24]));
    assert!((camera["near_mm"].as_f64().unwrap() - (distance - 50.0)).abs() < 1e-9);
    // The camera is in a request's own words: sent back, it gives the same view.
    let again = json!({ "camera": camera["camera"], "transfer": "bone", "size_px": [32, 24],
                        "display": { "layout": "rgbd", "depth_range": "volume" } });
    let again = stage.post(&stage.path("frame"), "application/json", again.to_string()).await;
    assert_eq!(again.body, answer.body);
}

#[tokio::test]
async fn a_picture_without_depth_says_what_caused_it() {
    let stage = Stage::new();
    assert!(!stage.get(&stage.path(&format!("frame?{SCENE}"))).await.headers.contains_key("relief-warning"));
    let flat = stage.get(&stage.path("frame?preset=bone&size_px=32,24&layout=rgbd&near_mm=1&far_mm=2")).await;
    assert_eq!(flat.status, 200, "{}", flat.text());
    let warning = flat.header("relief-warning");
    assert!(warning.starts_with("flat-depth; near_mm and far_mm, 1.0 to 2.0, leave out all"), "{warning}");
}

#[tokio::test]
async fn the_default_frame_is_a_valid_wowvx_frame() {
    let stage = Stage::new();
    let answer = stage.get(&stage.path("frame?factor=80&offset=100&content=movie")).await;
    let report = inspect_png(&answer.body).unwrap();
    assert_eq!((report.frame_px, report.layout), ([1920, 1080], Layout::Wowvx), "{report:?}");
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    assert_eq!((report.factor, report.offset), (Some(80), Some(100)));
}

#[tokio::test]
async fn query_and_body_give_the_same_frame_and_tag() {
    let stage = Stage::new();
    for (query, body) in [
        ("", json!({})),
        ("preset=lung&mode=mip", json!({ "transfer": "lung", "mode": "mip" })),
        (
            "frame=tissue&table=keep&depth_range=volume",
            json!({ "frame": "tissue", "table": "keep", "display": { "depth_range": "volume" } }),
        ),
        (
            "window_hu=40,400&depth_rule=first-hit&background_rgb=0.1,0.2,0.3&sample_distance_mm=2",
            json!({ "transfer": { "window": { "center_hu": 40, "width_hu": 400 } },
                    "depth": { "rule": "first-hit" }, "background_rgb": [0.1, 0.2, 0.3], "sample_distance_mm": 2 }),
        ),
        (
            "preset=skin&lights=studio&shadows=0.8&occlusion=0.5&occlusion_radius_mm=9",
            json!({ "transfer": "skin", "lights": "studio",
                    "shading": { "shadows": 0.8, "occlusion": { "strength": 0.5, "radius_mm": 9 } } }),
        ),
        (
            "eye_mm=0,-300,5&look_at_mm=0,0,5&up=0,0,1&vertical_fov_deg=20&depth_rule=threshold&depth_fraction=0.3",
            json!({ "camera": { "eye_mm": [0, -300, 5], "look_at_mm": [0, 0, 5], "up": [0, 0, 1],
                                "projection": { "perspective": { "vertical_fov_deg": 20 } } },
                    "depth": { "rule": "threshold", "fraction": 0.3 } }),
        ),
        (
            "clip_planes_mm=0,0,0,0,1,0,5,0,0,-1,0,0.5&clip_sphere_mm=0,0,10,4",
            json!({ "clip": { "planes": [ { "point_mm": [0, 0, 0], "normal": [0, 1, 0] },
                                          { "point_mm": [5, 0, 0], "normal": [-1, 0, 0.5] } ],
                              "sphere": { "center_mm": [0, 0, 10], "radius_mm": 4 } } }),
        ),
        (
            "layout=color&size_px=64,32&clip_box_mm=-5,-5,-5,5,5,5&near_mm=100&far_mm=400&vz=7",
            json!({ "size_px": [64, 32], "clip": { "box_mm": [[-5, -5, -5], [5, 5, 5]] },
                    "display": { "layout": "color", "near_mm": 100, "far_mm": 400, "profile": { "vz": 7 } } }),
        ),
    ] {
        let got = stage.get(&stage.path(&format!("frame?{query}"))).await;
        let posted = stage.post(&stage.path("frame"), "application/json", body.to_string()).await;
        assert_eq!((got.status.as_u16(), posted.status.as_u16()), (200, 200), "{query}");
        assert_eq!(got.header("etag"), posted.header("etag"), "{query}");
        assert_eq!(got.body, posted.body, "{query}");
    }
}

#[tokio::test]
async fn accept_chooses_the_media_type() {
    let stage = Stage::new();
    let path = stage.path(&format!("frame?{SCENE}"));
    let jpeg = stage.get_with(&path, &[("accept", "image/jpeg")]).await;
    assert_eq!(jpeg.header("content-type"), "image/jpeg");
    let picture = image::load_from_memory_with_format(&jpeg.body, image::ImageFormat::Jpeg).unwrap();
    assert_eq!([picture.width(), picture.height()], [32, 24]);

    let exr = stage.get_with(&path, &[("accept", "image/x-exr, image/png;q=0.9")]).await;
    assert_eq!(exr.header("content-type"), "image/x-exr");
    let decoded = decode_exr(&exr.body).unwrap();
    assert_eq!(
        (decoded.size_px, decoded.depth_mm, decoded.color.is_some()),
        ([32, 24], expected_depth(), true)
    );

    let raw = stage.get_with(&path, &[("accept", "application/octet-stream")]).await;
    assert_eq!(raw.header("content-type"), "application/octet-stream");
    assert_eq!(&raw.body[..16], b"RLFR\x01\x00\x20\x00\x20\x00\x00\x00\x18\x00\x00\x00");
    let distance = scene_request().camera.distance_mm();
    assert_eq!(raw.body[16..24], (distance - 50.0).to_le_bytes());
    assert_eq!(raw.body.len(), 32 + 32 * 24 * 8);
    let depth: Vec<f32> =
        raw.body[32 + 32 * 24 * 4..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(depth, expected_depth());
    assert_eq!(stage.gate.count(), 1, "one render, three encodings");

    let none = stage.get_with(&path, &[("accept", "text/html, image/png;q=0")]).await;
    assert_eq!(none.header("vary"), "Accept");
    let offers = json!(["image/png", "image/jpeg", "image/x-exr", "application/octet-stream"]);
    assert_eq!(none.problem(406)["offers"], offers);
}

#[tokio::test]
async fn depth_comes_as_16_bit_png_exr_or_floats() {
    let stage = Stage::new();
    let path =
        stage.path("depth?size_px=32,24&azimuth_deg=40&elevation_deg=10&preset=bone&depth_range=volume");
    let expected = expected_depth();
    let distance = scene_request().camera.distance_mm();

    let grey = stage.get(&path).await;
    let DecodedDepth::Scaled16(z) = Layout::Depth16.decode(&png(&grey)).unwrap().depth else {
        panic!("16 bits")
    };
    for (value, mm) in z.iter().zip(&expected) {
        let scaled = ((f64::from(*mm) - (distance - 50.0)) / 100.0).clamp(0.0, 1.0);
        assert!((f64::from(*value) - 65535.0 * (1.0 - scaled)).abs() <= 0.51, "{value} for {mm} mm");
    }
    let floats = stage.get_with(&path, &[("accept", "application/octet-stream")]).await;
    let bytes: Vec<u8> = expected.iter().flat_map(|mm| mm.to_le_bytes()).collect();
    assert_eq!(floats.body, bytes);
    let exr = stage.get_with(&path, &[("accept", "image/x-exr")]).await;
    let decoded = decode_exr(&exr.body).unwrap();
    assert_eq!((decoded.depth_mm, decoded.color), (expected, None));
    let tags = [&grey, &floats, &exr].map(|answer| answer.header("etag").to_owned());
    assert!(tags[0] != tags[1] && tags[1] != tags[2] && tags[0] != tags[2]);
    stage.get_with(&path, &[("accept", "image/jpeg")]).await.problem(406);
}

/// Invariant: An entity tag that the client knows is answered without rendering.
#[tokio::test]
async fn a_known_tag_is_answered_without_rendering() {
    let stage = Stage::new();
    let path = stage.path(&format!("frame?{SCENE}"));
    let tag = stage.get(&path).await.header("etag").to_owned();
    let strong = tag.trim_start_matches("W/").to_owned();
    // Nothing can be rendered any more, so whatever is answered was not.
    stage.service.shut_down();
    for known in [tag.clone(), strong, format!("\"other\", {tag}"), "*".to_owned()] {
        let answer = stage.get_with(&path, &[("if-none-match", &known)]).await;
        assert_eq!(answer.status, 304, "{known}");
        assert!(answer.body.is_empty());
        assert_eq!(answer.header("etag"), tag);
        assert_eq!(answer.header("vary"), "Accept");
        assert!(answer.header("cache-control").starts_with("private"));
    }
    assert_eq!(stage.gate.count(), 1);
    stage.get_with(&stage.path("frame?preset=skin"), &[("if-none-match", &tag)]).await.problem(503);
}

#[tokio::test]
async fn a_posted_scene_with_a_known_tag_fails_its_precondition() {
    let stage = Stage::new();
    let tag = stage.post(&stage.path("frame"), "application/json", "{}").await.header("etag").to_owned();
    let request = axum::http::Request::post(stage.path("frame"))
        .header("content-type", "application/json")
        .header("if-none-match", &tag);
    assert_eq!(stage.ask(request.body("{}".into()).unwrap()).await.status, 412);
    assert_eq!(stage.gate.count(), 1);
}

#[tokio::test]
async fn the_tag_changes_with_everything_that_changes_the_frame() {
    let stage = Stage::new();
    let mut tags = std::collections::BTreeSet::new();
    let queries = [
        "size_px=32,24&layout=rgbd",
        "size_px=32,26&layout=rgbd",
        "size_px=32,24&layout=color",
        "size_px=32,24&layout=rgbd&preset=lung",
        "size_px=32,24&layout=rgbd&azimuth_deg=1e-9",
        "size_px=32,24&layout=rgbd&mode=mip",
        "size_px=32,24&layout=rgbd&near_mm=1",
        "size_px=32,24&layout=rgbd&profile=philips-20",
        "size_px=32,24&layout=rgbd&depth_rule=first-hit",
        "size_px=32,24&layout=rgbd&background_rgb=0,0,0.001",
    ];
    for query in queries {
        tags.insert(stage.get(&stage.path(&format!("frame?{query}"))).await.header("etag").to_owned());
    }
    assert_eq!(tags.len(), queries.len());
    let config = relief_server::Config { identity: "another build".to_owned(), ..Default::default() };
    let other = Stage::with(config, relief_session::QueueConfig::default());
    assert!(
        tags.insert(other.get(&other.path(&format!("frame?{}", queries[0]))).await.header("etag").to_owned())
    );
}

#[tokio::test]
async fn a_pick_is_the_patient_position_under_the_pixel() {
    let stage = Stage::new();
    stage.get(&stage.path(&format!("frame?{SCENE}"))).await;
    let found = stage.get(&stage.path(&format!("pick?u=18.5&v=10&{SCENE}"))).await.json();
    assert_eq!((&found["hit"], &found["pixel"]), (&json!(true), &json!([18, 10])));
    let request = scene_request();
    let depth = f64::from(sphere_depths(&request)[10 * 32 + 18]);
    assert!((found["depth_mm"].as_f64().unwrap() - depth).abs() < 1e-4);
    let at: Vec<f64> = found["patient_mm"].as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect();
    let point = relief_base::Point::new(at[0], at[1], at[2]);
    assert!((point.distance(request.camera.look_at()) - SPHERE_MM).abs() < 1e-4, "on the sphere: {at:?}");
    let (u, v, z) = request.camera.project(point, [32, 24]).unwrap();
    assert!((u - 18.5).abs() < 1e-6 && (v - 10.5).abs() < 1e-6 && (z - depth).abs() < 1e-4, "{u} {v} {z}");

    let miss = stage.get(&stage.path(&format!("pick?u=0&v=0&{SCENE}"))).await.json();
    assert_eq!(
        (&miss["hit"], &miss["patient_mm"], &miss["depth_mm"]),
        (&json!(false), &Value::Null, &Value::Null)
    );
    assert_eq!(stage.gate.count(), 1, "picks look into the frame that was rendered");

    let body =
        json!({ "transfer": "bone", "size_px": [32, 24], "display": { "layout": "rgbd" } }).to_string();
    let posted = stage.post(&stage.path("pick?u=16&v=12"), "application/json", body).await;
    assert_eq!(posted.json()["hit"], json!(true));
    for (query, status) in
        [("v=3", 400), ("u=x&v=3", 400), ("u=32&v=3", 422), ("u=-1&v=3", 422), ("u=NaN&v=3", 400)]
    {
        stage.get(&stage.path(&format!("pick?{query}&{SCENE}"))).await.problem(status);
    }
}

#[tokio::test]
async fn a_size_that_contradicts_the_layout_is_refused_for_a_png_alone() {
    let stage = Stage::new();
    let path = stage.path("frame?layout=wowvx&size_px=64,32");
    let problem = stage.get(&path).await.problem(422);
    assert_eq!(
        (&problem["path"], &problem["allowed"].as_str().unwrap()[..9]),
        (&json!("size_px"), "960 x 540")
    );
    let jpeg = stage.get_with(&path, &[("accept", "image/jpeg")]).await;
    let picture = image::load_from_memory(&jpeg.body).unwrap();
    assert_eq!([picture.width(), picture.height()], [64, 32]);
    let full =
        stage.get_with(&stage.path("frame?layout=wowvx-full-height"), &[("accept", "image/jpeg")]).await;
    let picture = image::load_from_memory(&full.body).unwrap();
    assert_eq!([picture.width(), picture.height()], [960, 1080]);
}

/// Invariant: Depth filters return input values only and change no pick.
#[tokio::test]
async fn a_depth_filter_changes_frames_and_no_pick() {
    let stage = Stage::new();
    let depth_of = async |filter: &str| {
        let answer = stage.get(&stage.path(&format!("frame?{SCENE}&depth_filter={filter}"))).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        let decoded = Layout::Rgbd.decode(&png(&answer)).unwrap();
        let DecodedDepth::Disparity(d) = decoded.depth else { panic!("rgbd has disparity") };
        (decoded.color, d)
    };
    let (color, plain) = depth_of("none").await;
    let (same, filtered) = depth_of("median-5").await;
    assert_eq!(color, same);
    // The filter changes no pick: neither at a pixel whose depth it changes, nor inside the ball.
    let changed = (0..plain.len()).find(|i| plain[*i] != filtered[*i]).unwrap();
    let inside = plain.len() / 2 + 16;
    for at in [changed, inside] {
        let (u, v) = (at % 32, at / 32);
        let picks = ["none", "median-5"].map(|filter| {
            let path = format!("pick?{SCENE}&depth_filter={filter}&u={u}.5&v={v}.5");
            stage.path(&path)
        });
        let [one, other] = [stage.get(&picks[0]).await.json(), stage.get(&picks[1]).await.json()];
        assert_eq!(one, other);
        assert!(at == changed || one["hit"] == json!(true), "{one}");
    }
    let refused = stage.get(&stage.path("frame?depth_filter=blur")).await.problem(400);
    assert_eq!(refused["path"], "depth_filter");
    assert!(refused["detail"].as_str().unwrap().contains("median-5"), "{refused}");
}

/// Layouts of views go as the others do: by query and by body, and the size is that of a view.
#[tokio::test]
async fn views_come_in_their_layout_and_say_what_they_are() {
    let stage = Stage::new();
    let scene = "frame?preset=bone&size_px=32,24&azimuth_deg=40&elevation_deg=10";
    for (layout, frame_px) in [
        ("stereo", [64, 24]),
        ("views-9", [96, 72]),
        ("views-4x1", [128, 24]),
        ("anaglyph", [32, 24]),
        ("wiggle", [32, 24]),
    ] {
        let answer = stage.get(&stage.path(&format!("{scene}&layout={layout}&view_span=1.5"))).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert_eq!(answer.header("content-type"), "image/png");
        let report = inspect_png(&answer.body).unwrap();
        assert_eq!((report.layout.to_string().as_str(), report.frame_px), (layout, frame_px));
        assert_eq!(report.problems, []);
    }
    let straight = json!({ "transfer": "bone", "size_px": [32, 24], "display": { "layout": "views-3x1", "view_span": 0 } });
    let answer = stage.post(&stage.path("frame"), "application/json", straight.to_string()).await;
    let views = "views-3x1".parse::<Layout>().unwrap().decode(&png(&answer)).unwrap().views.unwrap();
    assert_eq!((views.size_px(), views.pictures()[0] == views.pictures()[2]), ([32, 24], true));
    for (query, part) in [
        ("layout=views-200", "2 to 128 views"),
        ("layout=stereo&view_span=-1", "eye separations"),
        ("layout=stereo&view_cone_deg=91", "0 to 90 degrees"),
        (
            "layout=stereo&view_cone_deg=35&eye_mm=0,-500,0&look_at_mm=0,0,0&height_mm=200",
            "parallel projection",
        ),
        ("layout=stereo&view_cone_deg=35&near_mm=-900&far_mm=-500", "screen is behind the camera"),
        ("layout=views-128&size_px=2000,2000", "views of 2000x2000"),
    ] {
        let answer = stage.get(&stage.path(&format!("frame?preset=bone&{query}"))).await;
        assert!(
            answer.status.is_client_error() && answer.text().contains(part),
            "{query}: {}",
            answer.text()
        );
    }
}
