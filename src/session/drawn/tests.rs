//! Shapes of items, compared with geometry.

use std::sync::Arc;

use super::*;
use relief_annotation::{ContentId, MeshSummary, State};
use relief_base::ViewDepth;
use relief_render::{Scene, SceneFile};
use relief_volume::{NamedPlane, Orbit};

fn grid() -> Grid {
    Grid::axis_aligned([40; 3], [5.0; 3], [-97.5; 3]).unwrap()
}

fn scene(json: &str) -> Scene {
    SceneFile::parse(json.as_bytes()).unwrap().resolve(&grid(), &Orbit::default()).unwrap()
}

fn item(name: &str, geometry: Geometry) -> Item {
    Item::new(name, "anna", Some(geometry)).unwrap()
}

fn points<const N: usize>(xyz: [[f64; 3]; N]) -> [Point<Patient>; N] {
    xyz.map(|[x, y, z]| Point::new(x, y, z))
}

/// A cube of half a side `half` around the origin, seen from outside.
fn cube(half: f64) -> SurfaceMesh {
    let corner = |i: u32| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { half } else { -half });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    SurfaceMesh {
        vertices: (0..8).map(|i| Point::from_xyz(corner(i).into())).collect(),
        triangles: quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
    }
}

fn mesh() -> Geometry {
    let content = ContentId::of(b"cube");
    Geometry::Mesh(MeshSummary { content, vertices: 8, triangles: 12, area_mm2: 1.0, volume_ml: None })
}

fn drawn(items: &[Item], scene: &Scene) -> (RenderRequest, LeftOutCounts) {
    let drawables = Drawables::new(items, |_| Some(Arc::new(cube(30.0))));
    let mut request = scene.request.clone();
    let drawn = drawables.draw(&mut request, &scene.display, &grid());
    request.validate_on(&grid()).unwrap();
    (request, drawn)
}

fn labels(request: &RenderRequest) -> Vec<&str> {
    let items = request.overlays.items.iter();
    let labels = items.filter_map(|item| match item {
        OverlayItem::Landmark(landmark) => landmark.label.as_deref(),
        _ => None,
    });
    labels.collect()
}

#[test]
fn items_are_drawn_with_their_measures_and_missing_ones_are_not() {
    let [a, b, c] = points([[0.0; 3], [30.0, 0.0, 0.0], [0.0, 40.0, 0.0]]);
    let hidden = Item { visible: false, ..item("hidden", Geometry::Point { at_mm: a }) };
    let missing = Item::new("missing", "anna", None).unwrap();
    let skipped = Item { state: State::Skipped, ..missing.clone() };
    let items = [
        item("nasion", Geometry::Point { at_mm: a }),
        item("width", Geometry::Line { ends_mm: [b, c] }),
        item("angle", Geometry::Angle { points_mm: [b, a, c] }),
        item("rim", Geometry::Curve { points_mm: vec![a, b, c], closed: true, smooth: false }),
        item("bone", mesh()),
        hidden,
        missing,
        skipped,
    ];
    let (request, drawn) = drawn(&items, &scene("{}"));
    assert_eq!(drawn, LeftOutCounts { drawn: 5, left_out: 0, unlabelled: 0 });
    assert_eq!(labels(&request), ["nasion", "width 50.0 mm", "angle 90.0°", "rim 120.0 mm", "bone"]);
}

/// Invariant: Annotations are drawn at their place and depth, with the same bytes by `relief
/// render`; slices show outlines; labels stand where they can be read.
#[test]
fn a_slice_shows_what_is_near_and_outlines_of_what_it_cuts() {
    let plane = |offset: f64| {
        scene(&format!(r#"{{"mode":"slice","slice":{{"plane":"axial","offset_mm":{offset}}}}}"#))
    };
    let [near, far, below] = points([[10.0, 5.0, 2.0], [10.0, 5.0, 9.0], [10.0, 5.0, -9.0]]);
    let items = [
        item("near", Geometry::Point { at_mm: near }),
        item("far", Geometry::Point { at_mm: far }),
        item("through", Geometry::Line { ends_mm: [far, below] }),
        item("cube", mesh()),
    ];
    let scene = plane(0.5);
    let (request, _) = drawn(&items, &scene);
    assert_eq!(labels(&request), ["near", "through 18.0 mm", "cube"]);
    let eye_from_plane = NamedPlane::Axial.view().towards_eye;
    let curves: Vec<&Curve> = request
        .overlays
        .items
        .iter()
        .filter_map(|item| match item {
            OverlayItem::Curve(curve) => Some(curve),
            _ => None,
        })
        .collect();
    assert_eq!(curves.len(), 2, "the line, and one outline of the cube");
    for point in curves.iter().flat_map(|curve| curve.points.iter()) {
        let before = (*point - Point::new(0.0, 0.0, 0.5)).dot(eye_from_plane);
        assert!((0.0..0.02).contains(&before), "{point:?} lies in the plane");
    }
    let outline = &curves[1].points;
    assert_eq!(outline.first(), outline.last(), "closed");
    let length: f64 = outline.windows(2).map(|ends| ends[0].distance(ends[1])).sum();
    assert!((length - 240.0).abs() < 1e-9, "around the cube: {length}");
    assert!(labels(&drawn(&items, &plane(60.0)).0).is_empty(), "beyond the cube");
}

#[test]
fn items_beyond_the_limit_are_counted() {
    let items: Vec<Item> = (0..20)
        .map(|i| item(&format!("m{i}"), mesh()))
        .chain([item("p", Geometry::Point { at_mm: Point::new(0.0, 0.0, 0.0) })])
        .collect();
    let large =
        SurfaceMesh { vertices: cube(30.0).vertices.repeat(2000).into(), triangles: cube(30.0).triangles };
    let drawables = Drawables::new(&items, |_| Some(Arc::new(large.clone())));
    let scene = scene("{}");
    let mut request = scene.request.clone();
    let drawn = drawables.draw(&mut request, &scene.display, &grid());
    assert_eq!(
        drawn,
        LeftOutCounts { drawn: 13, left_out: 8, unlabelled: 0 },
        "12 of 16000 corners fit, and the point"
    );
    request.validate_on(&grid()).unwrap();
}

/// Invariant: A picture that has no room for all names still draws every item.
///
/// 1,500 names of 100 characters are more than a picture has room for: every item is drawn, the
/// first thousand have their names.
#[test]
fn names_beyond_the_words_of_a_picture_leave_no_item_out() {
    let name = |i: u16| format!("{i:04} {}", "x".repeat(95));
    let places = (0..1500u16).map(|i| Point::new(f64::from(i % 40), f64::from(i / 40), 0.0));
    let kinds = (0..1500u16).zip(places).map(|(i, at_mm)| {
        let geometry = match i % 2 {
            0 => Geometry::Point { at_mm },
            _ => Geometry::Plane {
                center_mm: at_mm,
                normal: [0.0, 0.0, 1.0],
                axis: [1.0, 0.0, 0.0],
                size_mm: [5.0; 2],
            },
        };
        item(&name(i), geometry)
    });
    let items: Vec<Item> = kinds.collect();
    let (request, drawn) = drawn(&items, &scene("{}"));
    assert_eq!(drawn, LeftOutCounts { drawn: 1500, left_out: 0, unlabelled: 500 });
    let labels = labels(&request);
    assert_eq!(labels.len(), 1000);
    assert!((0u16..).zip(&labels).all(|(i, label)| *label == name(i)), "the first");
    let overlays = &request.overlays.items;
    let balls = overlays
        .iter()
        .filter(|item| matches!(item, OverlayItem::Landmark(ball) if ball.radius == Radius::Px(6.0)));
    let curves = overlays.iter().filter(|item| matches!(item, OverlayItem::Curve(_)));
    assert_eq!((balls.count(), curves.count()), (750, 750));
    assert_eq!(overlays.len(), 2000, "a ball that carries a name goes with it");
}

/// Invariant: Annotations are drawn at their place and depth, with the same bytes by `relief
/// render`; slices show outlines; labels stand where they can be read.
///
/// The rule in numbers: between the depths that it gives, the parallax of the display is at most a
/// stroke's width.
#[test]
fn labels_stand_where_their_ghost_is_no_wider_than_a_stroke() {
    let items = [item("a", Geometry::Point { at_mm: Point::new(0.0, 0.0, 0.0) })];
    let mut reaches = Vec::new();
    for profile in ["philips-20", "philips-42"] {
        let scene = scene(&format!(r#"{{"display":{{"profile":"{profile}"}}}}"#));
        let (request, _) = drawn(&items, &scene);
        let depths = request.overlays.label_depths_mm.unwrap();
        let limits = scene.display.limits(depth_limits(&request.camera, &grid())).unwrap();
        let profile = scene.display.profile().unwrap();
        let px_per_eyes = 63.0 / profile.screen_width_mm() * 960.0;
        let parallax = depths.map(|mm| {
            let d = profile.disparity(limits.scaled(ViewDepth(mm as f32))).0;
            (d - profile.constants().c) / profile.constants().m * px_per_eyes
        });
        let stroke = relief_render::label_stroke_px(20);
        assert!((parallax[0] + stroke).abs() < 0.01 && (parallax[1] - stroke).abs() < 0.01, "{parallax:?}");
        assert!(limits.near_mm < depths[0] && depths[1] < limits.far_mm);
        reaches.push((depths[1] - depths[0]) / (limits.far_mm - limits.near_mm));
    }
    assert!((0.2..0.3).contains(&reaches[0]) && (0.55..0.65).contains(&reaches[1]), "{reaches:?}");
}
