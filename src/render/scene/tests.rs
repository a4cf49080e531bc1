//! Errors of invalid scenes name the key's path, the value and the permitted values.

use super::*;

fn grid() -> Grid {
    Grid::axis_aligned([10, 10, 10], [1.0; 3], [0.0; 3]).unwrap()
}

fn refused(json: &str) -> String {
    let resolved =
        SceneFile::parse(json.as_bytes()).and_then(|scene| scene.resolve(&grid(), &Orbit::default()));
    resolved.expect_err("a refusal").to_string()
}

#[test]
fn an_empty_scene_has_sane_defaults() {
    let scene = SceneFile::parse(b"{}").unwrap().resolve(&grid(), &Orbit::default()).unwrap();
    assert_eq!(scene.request.size_px, [960, 540]);
    assert_eq!(scene.request.mode, Mode::Composite);
    assert_eq!(scene.request.depth, DepthRule::Views);
    assert_eq!(scene.request.sample_distance_mm, 0.25);
}

#[test]
fn quality_decides_the_sample_distance_of_composite_pictures_alone() {
    let distance_mm = |json: &str| {
        let scene = SceneFile::parse(json.as_bytes()).unwrap();
        scene.resolve(&grid(), &Orbit::default()).unwrap().request.sample_distance_mm
    };
    assert_eq!(distance_mm(r#"{"quality":"moving"}"#), 0.5);
    assert_eq!(distance_mm(r#"{"mode":"mip"}"#), 0.5);
    assert_eq!(distance_mm(r#"{"sample_distance_mm":2}"#), 2.0);
    // With four samples a voxel it would have more than the renderer takes.
    let long = Grid::axis_aligned([10; 3], [1.0, 1.0, 100.0], [0.0; 3]).unwrap();
    let large = SceneFile::parse(br#"{"size_px":[4096,4096]}"#).unwrap();
    assert_eq!(large.resolve(&long, &Orbit::default()).unwrap().request.sample_distance_mm, 0.5);
    let both = refused(r#"{"quality":"still","sample_distance_mm":1}"#);
    assert!(both.contains("quality is \"still\", allowed: left out where"), "{both}");
    let other = refused(r#"{"quality":"still","mode":"mip"}"#);
    assert!(other.contains("quality is \"still\", allowed: left out in other modes"), "{other}");
}

#[test]
fn a_layout_with_a_background_has_the_rule_that_gives_one() {
    for (json, rule, casts_it) in [
        (r#"{"display":{"layout":"declipse"}}"#, DepthRule::Views, false),
        (
            r#"{"display":{"layout":"declipse"},"mode":"path-traced"}"#,
            DepthRule::TwoLayer { fraction: 0.5 },
            true,
        ),
        (
            r#"{"display":{"layout":"declipse"},"depth":{"rule":"two-layer"}}"#,
            DepthRule::TwoLayer { fraction: 0.5 },
            true,
        ),
    ] {
        let scene = SceneFile::parse(json.as_bytes()).unwrap().resolve(&grid(), &Orbit::default()).unwrap();
        assert_eq!(scene.request.depth, rule, "{json}");
        assert_eq!(scene.request.has_back_layer(), casts_it, "{json}");
    }
}

#[test]
fn depth_is_made_for_views_where_views_are_made_of_it() {
    let rule = |json: &str| {
        let scene = SceneFile::parse(json.as_bytes()).unwrap();
        let request = scene.resolve(&grid(), &Orbit::default()).unwrap().request;
        assert_eq!(request.for_views.is_some(), request.depth == DepthRule::Views, "{json}");
        request.depth
    };
    for json in [r#"{}"#, r#"{"display":{"layout":"rgbd"}}"#, r#"{"display":{"layout":"views-9"}}"#] {
        assert_eq!(rule(json), DepthRule::Views, "{json}");
    }
    let parallel = r#"{"camera":{"eye_mm":[0,-500,0],"look_at_mm":[0,0,0],"projection":{"orthographic":{"height_mm":100}}}}"#;
    for json in [
        r#"{"display":{"layout":"color"}}"#,
        r#"{"display":{"layout":"depth16"}}"#,
        r#"{"mode":"mip"}"#,
        r#"{"mode":"path-traced"}"#,
        r#"{"depth":{"rule":"threshold"}}"#,
        parallel,
    ] {
        assert_eq!(rule(json), DepthRule::default(), "{json}");
    }
}

/// Layouts of the same display have one request, so that a server renders once for all of them.
#[test]
fn layouts_share_a_picture_and_displays_do_not() {
    let request = |display: &str| {
        let json = format!(r#"{{"size_px":[640,360],"display":{display}}}"#);
        SceneFile::parse(json.as_bytes()).unwrap().resolve(&grid(), &Orbit::default()).unwrap().request
    };
    let frame = request(r#"{"layout":"rgbd"}"#);
    for same in
        [r#"{"layout":"wowvx"}"#, r#"{"layout":"views-9","view_span":4}"#, r#"{"depth_filter":"median-3"}"#]
    {
        assert!(request(same) == frame, "{same}");
    }
    for other in
        [r#"{"profile":"philips-20"}"#, r#"{"factor":90}"#, r#"{"near_mm":5}"#, r#"{"layout":"wowvx-4k"}"#]
    {
        assert!(request(other) != frame, "{other}");
    }
}

#[test]
fn depth_rules_and_spheres_that_are_wrong_are_named_with_path_value_and_range() {
    for (json, parts) in [
        (
            r#"{"depth":{"rule":"wysiwyp"},"display":{"layout":"declipse"}}"#,
            &["depth.rule is wysiwyp", "two-layer or views, since layout declipse needs a back layer"][..],
        ),
        (
            r#"{"mode":"mip","display":{"layout":"declipse-lines"}}"#,
            &["mode is mip", "composite, which layout declipse-lines needs"],
        ),
        (r#"{"depth":{"rule":"nearest"}}"#, &["depth.rule", "nearest", "wysiwyp"]),
        (
            r#"{"depth":{"rule":"expected","fraction":0.5}}"#,
            &["depth.fraction is 0.5", "nothing beside rule expected"],
        ),
        (r#"{"depth":{"rule":"two-layer","fraction":0}}"#, &["depth.fraction is 0", "to 1"]),
        (
            r#"{"clip":{"sphere":{"center_mm":[0,0,0],"radius_mm":0}}}"#,
            &["clip.sphere.radius_mm is 0", "0.000001 to 10000 mm"],
        ),
        (
            r#"{"clip":{"sphere":{"center_mm":[0,2e6,0],"radius_mm":5}}}"#,
            &["clip.sphere.center_mm is [0.0, 2000000.0, 0.0]", "within 1000000 mm"],
        ),
        (r#"{"clip":{"sphere":[1,2]}}"#, &["clip.sphere: found an array"]),
    ] {
        let message = refused(json);
        for part in parts {
            assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
        }
    }
}

/// Invariant: A refused request names the path of the key, the value and the allowed range.
///
/// Invariant: No bytes from outside cause a panic: DICOM files, frames, requests.
#[test]
fn every_part_that_is_wrong_is_named_with_path_value_and_range() {
    let camera = |projection: &str| {
        format!(r#"{{"camera":{{"eye_mm":[0,-9,0],"look_at_mm":[0,0,0],"projection":{projection}}}}}"#)
    };
    for (json, parts) in [
        (r#"{"sise_px":[1,1]}"#.to_owned(), &["sise_px", "unknown field"][..]),
        (r#"{"sample_distance_mm":0}"#.to_owned(), &["sample_distance_mm is 0", "0.000001 to 100"]),
        (r#"{"budget_ms":0.5}"#.to_owned(), &["budget_ms is 0.5", "1 to 60000 ms"]),
        (r#"{"sample_distance_mm":1e999}"#.to_owned(), &["sample_distance_mm", "out of range"]),
        (r#"{"size_px":[0,5]}"#.to_owned(), &["size_px is 0", "1 to 8192"]),
        (r#"{"mode":"xray"}"#.to_owned(), &["mode", "xray", "composite", "mip"]),
        ("[]".to_owned(), &["found an array, expected an object"]),
        (r#"{"shading":[0.2,0.8,0,10]}"#.to_owned(), &["shading: found an array"]),
        (r#"{"transfer":{"points":[[1,[0,0,0,0]]]}}"#.to_owned(), &["transfer.points.0: found an array"]),
        (r#"{"size_px":[8192,8192]}"#.to_owned(), &["size_px is 8192 x 8192", "at most 16777216 pixels"]),
        (r#"{"depth":{"rule":"threshold","fraction":2}}"#.to_owned(), &["depth.fraction is 2", "to 1"]),
        (r#"{"shading":{"ambient":2,"diffuse":0}}"#.to_owned(), &["shading.ambient is 2", "0 to 1"]),
        (r#"{"clip":{"box_mm":[[0,0,0],[1,-1,1]]}}"#.to_owned(), &["clip.box_mm", "min < max"]),
        (
            r#"{"clip":{"planes":[{"point_mm":[0,0,0],"normal":[0,0,0]}]}}"#.to_owned(),
            &["clip.planes[0].normal is [0.0, 0.0, 0.0]"],
        ),
        (
            camera(r#"{"perspective":{"vertical_fov_deg":400}}"#),
            &["camera.projection.perspective.vertical_fov_deg is 400", "0.1 to 170"],
        ),
        (
            r#"{"overlays":{"items":[{"line":{"from_mm":[0,0,0],"to_mm":[1,1,1],"width_px":0}}]}}"#
                .to_owned(),
            &["overlays.items[0].line.width_px is 0", "0.5 to 64"],
        ),
        (camera(r#"{"fisheye":{}}"#), &["camera.projection", "fisheye"]),
        ("{} trailing".to_owned(), &["trailing"]),
    ] {
        let message = refused(&json);
        for part in parts {
            assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn transfers_and_classifications_that_are_wrong_are_named_with_path_value_and_range() {
    for (json, parts) in [
        (r#"{"transfer":"bones"}"#, &["transfer is bones", "bone, skin"][..]),
        (
            r#"{"transfer":{"window":{"center_hu":0,"width_hu":0}}}"#,
            &["transfer.window.width_hu is 0", "1 to 65536"],
        ),
        (
            r#"{"transfer":{"window":{"center_hu":0,"width_hu":9,"map":"warm"}}}"#,
            &["transfer.window", "warm", "grey", "hot", "ice"],
        ),
        (
            r#"{"transfer":{"window":{"center_hu":0,"width_hu":9,"invert":1}}}"#,
            &["transfer.window.invert", "boolean"],
        ),
        (
            r#"{"transfer":{"points":[{"hu":1,"rgba":[0,0,0,0]},{"hu":1,"rgba":[0,0,0,0]}]}}"#,
            &["transfer.points[1].hu is 1", "more than 1"],
        ),
        (
            r#"{"transfer":{"points":[{"hu":1,"rgba":[0,0,0,2]}]}}"#,
            &["transfer.points[0].rgba is 2", "0 to 1"],
        ),
        (r#"{"transfer":{"points":[{"hu":1,"rgb":[0,0,0]}]}}"#, &["transfer.points[0]", "rgb"]),
        (r#"{"transfer":{}}"#, &["transfer is neither or both"]),
        (r#"{"classification":"2d"}"#, &["classification", "2d", "sampled, pre-integrated"]),
        (
            r#"{"classification":"pre-integrated","mode":"mip"}"#,
            &["classification is pre-integrated", "sampled in other modes than composite"],
        ),
        (
            r#"{"classification":"pre-integrated","depth":{"rule":"wysiwyp"}}"#,
            &["classification is pre-integrated", "sampled with depth rules max-opacity"],
        ),
    ] {
        let message = refused(json);
        for part in parts {
            assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn surfaces_that_are_wrong_are_named_with_path_value_and_range() {
    let surfaces = |list: &str| format!(r#"{{"mode":"isosurface","surfaces":[{list}]}}"#);
    for (json, parts) in [
        (r#"{"iso_hu":300}"#.to_owned(), &["iso_hu is 300", "only with mode isosurface"][..]),
        (r#"{"mode":"mip","surfaces":[]}"#.to_owned(), &["surfaces is 0", "only with mode isosurface"]),
        (r#"{"mode":"isosurface","surfaces":[]}"#.to_owned(), &["surfaces is 0", "1 to 8"]),
        (r#"{"mode":"isosurface","iso_hu":1e6}"#.to_owned(), &["iso_hu is 1000000", "32767"]),
        (surfaces(r#"{"hu":1},{"hu":0}"#), &["surfaces[1].hu is 0", "at least 0.1 HU above 1"]),
        (surfaces(r#"{"hu":1,"opacity":0}"#), &["surfaces[0].opacity is 0", "above 0"]),
        (surfaces(r#"{"hu":1,"rgb":[0,2,0]}"#), &["surfaces[0].rgb is 2", "0 to 1"]),
        (surfaces(r#"{"iso":1}"#), &["surfaces[0]", "iso"]),
        (surfaces("[1]"), &["surfaces.0: found an array"]),
    ] {
        let message = refused(&json);
        for part in parts {
            assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn an_opacity_by_gradient_that_is_wrong_is_named_with_path_value_and_range() {
    let transfer = |gradient: &str| {
        format!(r#""transfer":{{"points":[{{"hu":1,"rgba":[0,0,0,0]}}],"gradient_opacity":{gradient}}}"#)
    };
    for (gradient, parts) in [
        (
            r#"{"points":[{"hu_per_mm":5,"opacity":0},{"hu_per_mm":5,"opacity":1}]}"#,
            &["transfer.gradient_opacity.points[1].hu_per_mm is 5", "more than 5"][..],
        ),
        (
            r#"{"points":[{"hu_per_mm":5,"opacity":2}]}"#,
            &["transfer.gradient_opacity.points[0].opacity is 2", "0 to 1"],
        ),
        (r#"{"points":[]}"#, &["transfer.gradient_opacity.points is 0 points", "1 to 256"]),
        ("[[0,0]]", &["transfer.gradient_opacity: found an array"]),
    ] {
        let message = refused(&format!("{{{}}}", transfer(gradient)));
        for part in parts {
            assert!(message.contains(part), "{gradient}: {message:?} lacks {part:?}");
        }
    }
    let plain = transfer(r#"{"points":[{"hu_per_mm":0,"opacity":1}]}"#);
    let message = refused(&format!(r#"{{{plain},"mode":"mip"}}"#));
    assert!(message.contains("transfer.gradient_opacity is there") && message.contains("composite"));
}
