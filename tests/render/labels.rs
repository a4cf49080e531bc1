//! Segments: each with its own transfer function, tint and visibility; a hidden segment is cut off
//! in colour, depth and picks.

use std::sync::Arc;

use super::renderer;
use super::twin::{compare, oblique_head};
use crate::common;
use relief_base::{Patient, Point, Vector};
use relief_render::{
    ClipPlane, DepthRule, EmptySpaceSkipping, Illumination, Labels, Light, Mode, Occlusion, Placement,
    RenderRequest, RenderedFrame, SceneFile, Shading, SlabBlend, Subject,
};
use relief_volume::{
    Camera, ControlPoint, Grid, LabelMap, Orbit, PhantomKind, Projection, Segment, TransferFunction, Volume,
};

/// Labels by the index and the patient position of each voxel.
fn label_map(grid: &Grid, label: impl Fn([usize; 3], Point<Patient>) -> u16) -> Arc<LabelMap> {
    let [nx, ny, _] = grid.dims();
    let index = |at: usize| [at % nx, at / nx % ny, at / nx / ny];
    let position = |i: [usize; 3]| {
        let [x, y, z] = i.map(|i| i as f64);
        grid.patient_from_voxel() * Point::new(x, y, z)
    };
    let labels: Vec<u16> = (0..grid.voxel_count()).map(|at| label(index(at), position(index(at)))).collect();
    let described = vec![
        Segment::new(1, Some("near"), Some([1.0, 0.0, 0.0])),
        Segment::new(2, Some("far"), Some([0.0, 0.0, 1.0])),
    ];
    Arc::new(LabelMap::new(grid.clone(), &labels, described).unwrap())
}

/// The request of a scene on a labelled volume, seen from an oblique side unless the scene has a
/// camera.
fn resolved(volume: &Volume, map: &Arc<LabelMap>, json: &str) -> RenderRequest {
    let scene = SceneFile::parse(json.as_bytes()).unwrap();
    let orbit = match scene.is_slice() {
        true => Orbit::default(),
        false => Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg: 25.0 },
    };
    scene
        .resolve_for(&Subject { labels: Some(map), ..Subject::of_grid(volume.grid()) }, &orbit)
        .unwrap()
        .request
}

/// The slab phantom in two halves, nearer and farther than y = 0, seen along y from 600 mm.
fn halved_slab(scene: &str) -> (Volume, RenderRequest) {
    let volume = common::volume(PhantomKind::Slab, 128);
    let map = label_map(volume.grid(), |_, at| if at.xyz.y < 0.0 { 1 } else { 2 });
    let request = resolved(&volume, &map, scene);
    let (eye, at) = (Point::new(0.0, -600.0, 0.0), Point::new(0.0, 0.0, 0.0));
    let parallel = Projection::Orthographic { height_mm: 100.0 };
    let camera = Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), parallel).unwrap();
    (volume, RenderRequest { camera, shading: Shading::NONE, size_px: [8, 8], ..request })
}

/// White of an opacity per mm that is proportional to the covered part of a voxel.
fn white(opacity_per_mm: f64) -> String {
    let point = |hu: f64, a: f64| format!(r#"{{"hu": {hu}, "rgba": [1, 1, 1, {a}]}}"#);
    format!(r#"{{"points": [{}, {}]}}"#, point(-1000.0, 0.0), point(300.0, opacity_per_mm))
}

/// Invariant: Each segment absorbs by its own law, and a tint changes colours only.
#[test]
fn two_halves_of_a_slab_absorb_by_a_law_each() {
    let Some(mut renderer) = renderer("two_halves_of_a_slab") else { return };
    for edges in ["smooth", "voxels"] {
        for [near, far] in [[0.02, 0.005], [0.005, 0.02], [0.0, 0.01], [0.01, 0.0]] {
            let scene = format!(
                r#"{{"sample_distance_mm": 0.5, "transfer": {}, "labels": {{"edges": "{edges}", "tint": 0,
                    "segments": [{{"label": "near", "transfer": {}}}, {{"label": 2, "transfer": {}}}]}}}}"#,
                white(1.0),
                white(near),
                white(far)
            );
            let (volume, request) = halved_slab(&scene);
            let frame = renderer.render(&volume, &request).unwrap();
            let expected = 255.0 * (1.0 - (1.0 - near).powi(50) * (1.0 - far).powi(50));
            for pixel in &frame.color_rgba {
                let off = (f64::from(pixel[0]) - expected).abs();
                assert!(off <= 1.0, "{near} and {far} per mm, {edges}: {} for {expected}", pixel[0]);
            }
        }
    }
}

/// Invariant: Hiding segments cuts them off exactly, in colour, depth and picks.
#[test]
fn every_depth_rule_and_every_pick_meets_the_first_segment_that_is_shown() {
    let Some(mut renderer) = renderer("every_depth_rule_meets_the_first_segment") else { return };
    for hidden in [
        r#""labels": {"segments": [{"label": 1, "visible": false}, {"label": 0, "visible": false}]}"#,
        r#""clip": {"labels": {"cut": ["near"]}}"#,
        r#""clip": {"labels": {"keep": [2]}}"#,
    ] {
        let step = r#"{"points": [{"hu": -351, "rgba": [1, 1, 1, 0]}, {"hu": -349, "rgba": [1, 1, 1, 1]}]}"#;
        let (volume, request) = halved_slab(&format!(r#"{{"transfer": {step}, {hidden}}}"#));
        for name in ["first-hit", "threshold", "wysiwyp", "max-opacity", "most-contributing"] {
            let depth = DepthRule::from_name(name).unwrap();
            let frame = renderer.render(&volume, &RenderRequest { depth, ..request.clone() }).unwrap();
            for &mm in &frame.depth_mm {
                assert!((mm - 600.0).abs() < 0.02, "{name}, {hidden}: {mm} mm for the middle at 600 mm");
            }
            assert!(frame.pick([3, 4]).unwrap().xyz.y.abs() < 0.02, "{name}");
        }
        let shown = renderer.render(&volume, &RenderRequest { labels: None, ..request.clone() }).unwrap();
        assert!(shown.depth_mm.iter().all(|mm| (mm - 550.0).abs() < 0.02), "without labels the face is near");
    }
}

/// Invariant: Each segment absorbs by its own law, and a tint changes colours only.
#[test]
fn a_tint_takes_its_share_of_the_colour_and_no_opacity() {
    let Some(mut renderer) = renderer("a_tint_takes_its_share") else { return };
    let solid = r#"{"points": [{"hu": 0, "rgba": [0.2, 0.6, 1, 1]}]}"#;
    for (labels, expected) in [
        ("{}", [0.6, 0.3, 0.5]), // half of the file's red
        (r#"{"tint": 0.25}"#, [0.4, 0.45, 0.75]),
        (r#"{"others": {"tint": 1}}"#, [1.0, 0.0, 0.0]),
        (r#"{"segments": [{"label": 1, "tint_rgb": [1, 1, 0], "tint": 0.5}]}"#, [0.6, 0.8, 0.5]),
        (r#"{"segments": [{"label": 1, "tint": 0}]}"#, [0.2, 0.6, 1.0]),
        (r#"{"segments": [{"label": 2, "tint": 1}], "tint": 0}"#, [0.2, 0.6, 1.0]),
    ] {
        let (volume, request) = halved_slab(&format!(r#"{{"transfer": {solid}, "labels": {labels}}}"#));
        let frame = renderer.render(&volume, &request).unwrap();
        for pixel in &frame.color_rgba {
            let found = [0, 1, 2].map(|c| f64::from(pixel[c]) / 255.0);
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 0.006, "{labels}: {found:?} for {expected:?}");
            assert_eq!(pixel[3], 255);
        }
    }
}

/// A half of the head, by the index along i; and the plane that cuts the same off.
fn half_of(volume: &Volume) -> (Arc<LabelMap>, ClipPlane) {
    let map = label_map(volume.grid(), |[i, ..], _| if i < 30 { 1 } else { 2 });
    let between = volume.grid().patient_from_voxel() * Point::new(29.5, 0.0, 0.0);
    // Planes turn by the inverse transpose; this grid's axes are not all of one length, but at
    // right angles.
    let normal = volume.grid().patient_from_voxel() * Vector::new(1.0, 0.0, 0.0);
    (map, ClipPlane { point: between, normal })
}

/// Shares of pixels whose colours, and whose depths, are apart.
fn apart(a: &RenderedFrame, b: &RenderedFrame, depth_mm: f32) -> [f64; 2] {
    let pixels = a.color_rgba.len() as f64;
    let differ = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
    let colors = a.color_rgba.iter().zip(&b.color_rgba).filter(|pair| differ(*pair)).count();
    let far = |(a, b): (&f32, &f32)| a.is_finite() != b.is_finite() || (a - b).abs() > depth_mm;
    let depths = a.depth_mm.iter().zip(&b.depth_mm).filter(|pair| far(*pair)).count();
    [colors, depths].map(|count| count as f64 / pixels)
}

/// Invariant: Hiding segments cuts them off exactly, in colour, depth and picks.
///
/// Hiding the part on one side of a plane equals cutting it off there: clip planes are tested
/// against closed forms.
#[test]
fn hiding_half_of_a_volume_is_cutting_it_off() {
    let Some(mut renderer) = renderer("hiding_half_of_a_volume") else { return };
    // Voxel axes at right angles, but turned.
    let head = common::volume(PhantomKind::Head, 64);
    let turn = glam::DAffine3::from_axis_angle(glam::DVec3::new(1.0, 2.0, 0.5).normalize(), 0.6);
    let affine = turn * head.grid().patient_from_voxel().affine;
    let placed = Grid::new(head.grid().dims(), relief_base::Transform::from_affine(affine)).unwrap();
    let volume = Volume::new(placed, head.voxels_hu().to_vec()).unwrap();
    // Least values of a head are air's: turned upside down, they are bone's.
    let negated = volume.voxels_hu().iter().map(|hu| -hu).collect();
    let negated = Volume::new(volume.grid().clone(), negated).unwrap();
    let (map, plane) = half_of(&volume);
    let window = r#"{"window": {"center_hu": -400, "width_hu": 2000}}"#;
    for (mode, transfer, volume) in [
        ("composite", "\"bone\"", &volume),
        ("composite", "\"soft-tissue\"", &volume),
        ("mip", "\"mip\"", &volume),
        ("minip", window, &negated),
    ] {
        for edges in ["smooth", "voxels"] {
            let scene = format!(
                r#"{{"mode": "{mode}", "transfer": {transfer}, "size_px": [112, 84],
                    "labels": {{"edges": "{edges}", "tint": 0, "segments": [{{"label": 1, "visible": false}}]}}}}"#
            );
            let hidden = resolved(volume, &map, &scene);
            let mut clipped = RenderRequest { labels: None, ..hidden.clone() };
            clipped.clip.planes.push(plane);
            let frames = [&hidden, &clipped].map(|request| renderer.render(volume, request).unwrap());
            let plain = RenderRequest { labels: None, ..hidden.clone() };
            let whole = renderer.render(volume, &plain).unwrap();
            let [colors, depths] = apart(&frames[0], &frames[1], 0.15);
            println!(
                "{mode}, {transfer}, {edges}: {colors:.4} of the colours, {depths:.4} of the depths differ"
            );
            assert!(
                apart(&frames[0], &whole, 1.0)[0] > 0.05,
                "{mode}, {transfer}: hardly anything is hidden"
            );
            assert!(colors <= 0.003, "{mode}, {transfer}, {edges}: {colors} of the colours");
            // The refinement of a depth sees past a clip plane, and stops at it.
            assert!(depths <= 0.01, "{mode}, {transfer}, {edges}: {depths} of the depths");
        }
    }
}

/// Boxes and a ball of labels that cross each other and the head's surfaces.
fn patchwork(grid: &Grid) -> Arc<LabelMap> {
    let center = grid.center();
    label_map(grid, |[i, j, k], at| match () {
        () if at.distance(center) < 45.0 => 7,
        () if (i / 11 + j / 9 + k / 13) % 3 == 0 => 1,
        () if (i / 11 + j / 9 + k / 13) % 3 == 1 => 2,
        () => 0,
    })
}

const PATCHWORK: &str = r#"{"size_px": [112, 84], "transfer": "soft-tissue", "labels": {"edges": "EDGES", "tint": 0.4,
    "others": {"tint": 0.8}, "segments": [{"label": 0, "transfer": "bone"}, {"label": "near", "transfer": "skin"},
    {"label": 7, "visible": false}]}}"#;

#[test]
fn gpu_and_twin_agree_about_segments_in_every_mode_and_rule() {
    let volume = oblique_head();
    let map = patchwork(volume.grid());
    for (i, name) in DepthRule::names().iter().enumerate() {
        let edges = ["smooth", "voxels"][i % 2];
        let request = resolved(&volume, &map, &PATCHWORK.replace("EDGES", edges));
        let depth = DepthRule::from_name(name).unwrap();
        compare(&volume, &RenderRequest { depth, ..request }, &format!("segments, {edges}, {name}"));
    }
    for (mode, edges) in [(Mode::Mip, "smooth"), (Mode::Mip, "voxels"), (Mode::Minip, "smooth")] {
        let request = resolved(&volume, &map, &PATCHWORK.replace("EDGES", edges));
        // Least values are air's, which presets leave clear.
        let clear = TransferFunction::new(vec![ControlPoint { hu: -800.0, rgba: [0.3, 0.5, 0.7, 0.6] }], 1.0);
        let transfer = if mode == Mode::Minip { clear.unwrap() } else { request.transfer.clone() };
        let request = RenderRequest { mode, transfer, ..request };
        compare(&volume, &request, &format!("segments, {mode:?}, {edges}"));
    }
}

#[test]
fn hidden_segments_cast_no_shadow() {
    let volume = oblique_head();
    let map = patchwork(volume.grid());
    for edges in ["smooth", "voxels"] {
        let request = resolved(&volume, &map, &PATCHWORK.replace("EDGES", edges));
        let placement = Placement::ViewDirection(Vector::new(-0.8, 0.7, 0.6));
        let light = Light { placement, rgb: [1.0; 3], intensity: 1.0, size: 0.3 };
        let illumination =
            Illumination { shadows: 0.9, occlusion: Occlusion { strength: 0.8, radius_mm: 24.0 } };
        let lit = RenderRequest { lights: vec![light], illumination, ..request };
        compare(&volume, &lit, &format!("shadows of segments, {edges}"));
        // Shadows and occlusion of hidden segments would darken the rest.
        let Some(mut renderer) = renderer("hidden_segments_cast_no_shadow") else { return };
        let brightness = |frame: RenderedFrame| {
            let channels = frame.color_rgba.iter().flat_map(|pixel| pixel[..3].to_vec());
            channels.map(u64::from).sum::<u64>()
        };
        let alone = resolved(
            &volume,
            &map,
            r#"{"transfer": "bone", "size_px": [112, 84], "clip": {"labels": {"keep": [7]}}}"#,
        );
        let alone = RenderRequest { lights: lit.lights.clone(), illumination, ..alone };
        let unshaded = RenderRequest { illumination: Illumination::default(), ..alone.clone() };
        let [shaded, unshaded] = [alone, unshaded].map(|r| brightness(renderer.render(&volume, &r).unwrap()));
        println!("{edges}: {shaded} with shadows of the ball alone, {unshaded} without any");
        assert!(shaded > unshaded / 4 && shaded < unshaded, "{shaded} of {unshaded}");
    }
}

#[test]
fn gpu_and_twin_agree_about_segments_in_slices() {
    let volume = oblique_head();
    let map = patchwork(volume.grid());
    for (slab_mm, blend) in [(0.0, SlabBlend::Mean), (12.0, SlabBlend::Mean), (12.0, SlabBlend::Mip)] {
        let scene = format!(
            r#"{{"mode": "slice", "slice": {{"plane": "coronal", "slab_mm": {slab_mm}, "blend": "{}"}},
                "size_px": [112, 84], "labels": {{"segments": [{{"label": 7, "visible": false}},
                {{"label": 2, "transfer": {{"window": {{"center_hu": 400, "width_hu": 900}}}}}}]}}}}"#,
            blend.name()
        );
        let request = resolved(&volume, &map, &scene);
        compare(&volume, &request, &format!("segments in a slice of {slab_mm} mm, {blend:?}"));
    }
}

/// Invariant: Hiding segments cuts them off exactly, in colour, depth and picks.
#[test]
fn skipping_changes_no_byte_of_segments_and_skips_what_is_hidden() {
    let Some(mut renderer) = renderer("skipping_changes_no_byte_of_segments") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let map = patchwork(volume.grid());
    for (i, mode) in ["composite", "composite", "mip", "minip"].into_iter().enumerate() {
        for edges in ["smooth", "voxels"] {
            let scene =
                PATCHWORK.replace("EDGES", edges).replacen('{', &format!(r#"{{"mode": "{mode}","#), 1);
            let mut request = resolved(&volume, &map, &scene);
            request.depth = DepthRule::from_name(["threshold", "first-hit"][i % 2]).unwrap();
            request.sample_distance_mm = [0.7, 2.3][i % 2];
            let [on, off] = [EmptySpaceSkipping::On, EmptySpaceSkipping::Off]
                .map(|skipping| renderer.render_with(&volume, &request, skipping).unwrap());
            let bits = |depth: &[f32]| depth.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
            assert!(on.color_rgba == off.color_rgba, "{mode}, {edges}: colour");
            assert!(bits(&on.depth_mm) == bits(&off.depth_mm), "{mode}, {edges}: depth");
        }
    }
    let ball = r#"{"transfer": "soft-tissue", "size_px": [112, 84], "clip": {"labels": {"keep": [7]}}}"#;
    let kept = resolved(&volume, &map, ball);
    let whole = RenderRequest { labels: None, ..kept.clone() };
    let counts = [&kept, &whole].map(|r| renderer.count_samples(&volume, r, EmptySpaceSkipping::On).unwrap());
    println!("{} samples for a ball in the head, {} for the head", counts[0], counts[1]);
    // Inside of the ball there is no skin to stop at: rays go deeper there than they would without
    // labels.
    assert!(counts[0] * 2 < counts[1] * 3, "{counts:?}");
}

#[test]
fn hundreds_of_segments_are_shown_and_what_changes_nothing_costs_nothing() {
    let Some(mut renderer) = renderer("hundreds_of_segments") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let map = label_map(volume.grid(), |[i, j, k], _| (i / 8 + 8 * (j / 8) + 64 * (k / 8)) as u16);
    assert!(map.segments().len() > 300, "{}", map.segments().len());
    let scene = r#"{"transfer": "skin", "size_px": [112, 84], "labels": {"edges": "voxels", "tint": 1}}"#;
    let request = resolved(&volume, &map, scene);
    let frame = renderer.render(&volume, &request).unwrap();
    let tints: std::collections::BTreeSet<[u8; 3]> =
        frame.color_rgba.iter().map(|p| [p[0] / 32, p[1] / 32, p[2] / 32]).collect();
    assert!(tints.len() > 30, "{} tints", tints.len());
    drop(renderer);
    compare(&volume, &request, "hundreds of segments");
    let plain = resolved(&volume, &map, r#"{"labels": {"tint": 0}}"#);
    assert!(plain.labels.is_none(), "nothing is to be looked up");
    let mean = resolved(&volume, &map, r#"{"mode": "mean"}"#);
    assert!(mean.labels.is_none(), "a scene that says nothing of labels is for modes without them too");
}

/// Voxels of labels 0, 1, 2, 0, 1 and so on.
fn striped() -> (Grid, Arc<LabelMap>) {
    let grid = Grid::axis_aligned([8; 3], [1.0; 3], [0.0; 3]).unwrap();
    let map = label_map(&grid, |[i, ..], _| (i % 3) as u16);
    (grid, map)
}

/// The error of a refused scene.
fn refused(json: &str, map: Option<&Arc<LabelMap>>) -> String {
    let scene = SceneFile::parse(json.as_bytes());
    let (grid, _) = striped();
    let resolved = scene.and_then(|scene| {
        scene.resolve_for(&Subject { labels: map, ..Subject::of_grid(&grid) }, &Orbit::default())
    });
    resolved.map(|scene| scene.request.labels).expect_err(json).to_string()
}

#[test]
fn labels_that_are_wrong_are_named_with_path_value_and_range() {
    let (_, map) = striped();
    for (json, parts) in [
        (
            r#"{"labels": {"segments": [{"label": "liver"}]}}"#,
            &["labels.segments[0].label is \"liver\"", "near, far"][..],
        ),
        (
            r#"{"labels": {"segments": [{"label": 70000}]}}"#,
            &["labels.segments[0].label", "70000", "0 to 65535"],
        ),
        (r#"{"labels": {"segments": [{"label": -1}]}}"#, &["labels.segments[0].label", "-1"]),
        (
            r#"{"labels": {"segments": [{"label": 1}, {"label": "near"}]}}"#,
            &["labels.segments[1].label", "[0] is the same"],
        ),
        (
            r#"{"labels": {"segments": [{"label": 1, "tint": 1.5}]}}"#,
            &["labels.segments[0].tint is 1.5", "0 to 1"],
        ),
        (
            r#"{"labels": {"segments": [{"label": 9, "tint_rgb": [0, 2, 0]}]}}"#,
            &["labels.segments[0].tint_rgb is 2"],
        ),
        (
            r#"{"labels": {"segments": [{"label": 1, "transfer": "bones"}]}}"#,
            &["labels.segments[0].transfer is bones", "bone, skin"],
        ),
        (
            r#"{"labels": {"segments": [{"label": 1, "transfer": {"points": [{"hu": 1, "rgba": [0, 0, 0, 2]}]}}]}}"#,
            &["labels.segments[0].transfer.points[0].rgba is 2"],
        ),
        (
            r#"{"labels": {"segments": [{"label": 1, "transfer": {"points": [{"hu": 1, "rgba": [0, 0, 0, 1]}],
                "gradient_opacity": {"points": [{"hu_per_mm": 1, "opacity": 1}]}}}]}}"#,
            &["labels.segments[0].transfer.gradient_opacity is there"],
        ),
        (r#"{"labels": {"others": {"tint": -1}}}"#, &["labels.others.tint is -1"]),
        (r#"{"labels": {"segments": [[1]]}}"#, &["labels.segments.0: found an array"]),
        (r#"{"labels": []}"#, &["labels: found an array"]),
        (r#"{"labels": {"edges": "soft"}}"#, &["labels.edges", "soft", "smooth"]),
        (r#"{"labels": {"segment": []}}"#, &["labels", "segment", "unknown field"]),
        (r#"{"clip": {"labels": {"cut": [1], "keep": [2]}}}"#, &["clip.labels is cut and keep"]),
        (r#"{"clip": {"labels": {"cut": ["liver"]}}}"#, &["clip.labels.cut[0] is \"liver\""]),
        (
            r#"{"classification": "pre-integrated", "labels": {}}"#,
            &["classification is pre-integrated", "sampled in a scene with labels"],
        ),
        (r#"{"mode": "mean", "labels": {}}"#, &["labels is there", "composite, mip, minip, slice"]),
        (r#"{"mode": "isosurface", "clip": {"labels": {"cut": [1]}}}"#, &["labels is there"]),
        (r#"{"mode": "path-traced", "labels": {"tint": 0}}"#, &["labels is there"]),
    ] {
        let message = refused(json, Some(&map));
        for part in parts {
            assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
        }
    }
}

#[test]
fn labels_beside_the_wrong_volume_or_map_are_refused() {
    let (grid, map) = striped();
    for json in [r#"{"labels": {}}"#, r#"{"clip": {"labels": {"cut": [1]}}}"#] {
        assert!(
            refused(json, None).contains("labels is there, allowed: nothing beside a volume without"),
            "{json}"
        );
    }
    let many = LabelMap::new(
        grid.clone(),
        &(0..512).map(|i| 2 * i + 1).collect::<Vec<_>>(),
        vec![Segment::new(2, None, None)],
    );
    let many = Arc::new(many.unwrap());
    assert!(
        refused(r#"{"labels": {}}"#, Some(&many))
            .contains("a map of 513 segments, allowed: maps of at most 512")
    );
    let elsewhere = Arc::new(map.resampled(&Grid::axis_aligned([8; 3], [2.0; 3], [0.0; 3]).unwrap()));
    assert!(refused(r#"{"labels": {}}"#, Some(&elsewhere)).contains("a map on the volume's grid"));
}

#[test]
fn labels_are_shared_and_equal_by_content() {
    let volume = common::volume(PhantomKind::Head, 64);
    let request = resolved(&volume, &patchwork(volume.grid()), r#"{"labels": {}}"#);
    let again = resolved(&volume, &patchwork(volume.grid()), r#"{"labels": {}}"#);
    assert_eq!(request, again, "frames are found again by content");
    assert_eq!(format!("{request:?}"), format!("{again:?}"), "entity tags are made of this");
    let other = resolved(&volume, &patchwork(volume.grid()), r#"{"labels": {"tint": 0.4}}"#);
    assert_ne!(request, other);
    assert!(Labels::are_shown_by(Mode::Composite) && !Labels::are_shown_by(Mode::Mean));
}
