//! Views of landmarks and pictures with annotations: seen along true normals, drawn as `relief
//! render` draws them, and known by their content.

use relief_annotation::{
    CameraRecord, Change, Edit, FrameOfReference, Geometry, Item, MeshFormat, MeshSummary, Method, Placement,
    Set, TriangleMesh, write_mesh,
};
use relief_base::Point;
use relief_store::Store;

use super::*;

/// The reference for positions in a phantom.
fn the_frame_of_reference(archive: &Archive, name: &str) -> FrameOfReference {
    let slice = std::fs::read_dir(archive.path(&format!("series/{name}"))).unwrap();
    let slice = slice.map(|entry| entry.unwrap().path());
    let slice = slice.filter(|path| path.extension().is_some_and(|ending| ending == "dcm")).min().unwrap();
    let found = relief_dicom::discover(&slice, relief_dicom::Strictness::Lenient, &|_| ()).unwrap();
    FrameOfReference(found.series[0].frame_of_reference().unwrap().to_owned())
}

/// A ball of 80 mm about the origin, in air.
fn ball() -> Archive {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let out = archive.text("series/ball");
    ok(&relief(&["phantom", "--kind", "sphere", "--size", "128", "--out", &out]));
    archive
}

fn item(name: &str, geometry: Geometry, frame: &FrameOfReference) -> Item {
    let mut item = Item::new(name, "anna", Some(geometry)).unwrap();
    item.frame_of_reference = Some(frame.clone());
    item
}

fn point(name: &str, at: [f64; 3], frame: &FrameOfReference) -> Item {
    item(name, Geometry::Point { at_mm: Point::new(at[0], at[1], at[2]) }, frame)
}

fn apply(archive: &Archive, changes: Vec<Change>, blinded: Option<&str>) {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let store = Store::open(&archive.text("ann.db")).await.unwrap();
        if let Some(name) = blinded {
            let set =
                Set { name: name.to_owned(), reader: Some("ben".to_owned()), blinded: true, template: None };
            store.put_set(&set, "ben").await.unwrap();
        }
        let edit = Edit { author: "anna".to_owned(), reason: String::new(), changes };
        store.apply(&edit).await.unwrap();
        store.close().await;
    });
}

fn create(item: Item) -> Change {
    Change::Create { item: Box::new(item) }
}

fn plan_annotated(archive: &Archive, views: &str, products: &str, more: &[&str]) -> Output {
    let (root, out, log) = (archive.text("series"), archive.text("jobs.jsonl"), archive.text("ann.db"));
    let fixed =
        ["batch", "plan", "--root", &root, "--out", &out, "--preset", "bone", "--size", "64x48", "--json"];
    relief(&[&fixed[..], &["--views", views, "--products", products, "--annotations", &log], more].concat())
}

fn vector(value: &Value) -> [f64; 3] {
    common::numbers(value).try_into().unwrap()
}

fn direction([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

fn degrees_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot: f64 = direction(a).iter().zip(direction(b)).map(|(a, b)| a * b).sum();
    dot.clamp(-1.0, 1.0).acos().to_degrees()
}

/// On a ball the normal is the direction from its centre, and the middle of the picture shows the
/// landmark at the camera's distance.
#[test]
fn landmarks_are_seen_along_the_true_normal() {
    let archive = ball();
    let frame = the_frame_of_reference(&archive, "ball");
    let outwards = [[0.0, -1.0, 0.0], [0.6, 0.0, 0.8], [-0.48, 0.6, -0.64], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]];
    let outwards = outwards.map(direction);
    let names = ["nasion", "Porion (left)", "ménton", "vertex", "nasion"];
    let items = outwards.iter().zip(names).map(|(to, name)| point(name, to.map(|part| 80.0 * part), &frame));
    let plane = Geometry::Plane {
        center_mm: Point::new(-20.0, 0.0, 0.0),
        normal: [0.8, 0.6, 0.0],
        axis: [0.0, 0.0, 1.0],
        size_mm: [40.0, 30.0],
    };
    let items = items.chain([item("midsagittal", plane, &frame)]);
    let in_order = (0..).zip(items).map(|(order, item)| create(Item { order, ..item }));
    apply(&archive, in_order.collect(), None);
    // The surface itself: half of the values of ball and air.
    std::fs::write(archive.path("surface.json"), r#"{ "mode": "isosurface", "iso_hu": -250 }"#).unwrap();
    let scene = archive.text("surface.json");
    ok(&plan_annotated(&archive, "landmarks", "color,depth", &["--scene", &scene]));
    let jobs = archive.jobs();
    let names: Vec<&str> = jobs.iter().map(|job| job["view"].as_str().unwrap()).collect();
    let expected = ["nasion", "porion-left", "m-nton", "vertex", "nasion-2", "midsagittal"];
    assert_eq!(names, expected.map(|name| format!("landmark-{name}")));
    ok(&archive.run(&[]));
    for (job, to) in jobs.iter().zip(outwards) {
        let [eye, at] = ["eye_mm", "look_at_mm"].map(|key| vector(&job["scene"]["camera"][key]));
        let seen_from = [0, 1, 2].map(|axis| eye[axis] - at[axis]);
        let off = degrees_between(seen_from, to);
        assert!(off < 1.0, "{}: {off} degrees off the normal", job["view"]);
        let name = format!(
            "out/{}/{}.depth.exr",
            job["series"]["name"].as_str().unwrap(),
            job["view"].as_str().unwrap()
        );
        let depth = relief_display::decode_exr(&std::fs::read(archive.path(&name)).unwrap()).unwrap();
        // The four pixels about the middle, over a ball of 80 mm that is seen from its zenith.
        let distance = seen_from.iter().map(|part| part * part).sum::<f64>().sqrt();
        for at in [23 * 64 + 31, 24 * 64 + 32] {
            let error = f64::from(depth.depth_mm[at]) - distance;
            assert!(error.abs() < 0.3, "{name}: {error} mm");
        }
    }
    // Of a plane's two sides the outer one, here that to the patient's right.
    let camera = &jobs[5]["scene"]["camera"];
    let [eye, at] = ["eye_mm", "look_at_mm"].map(|key| vector(&camera[key]));
    assert!(degrees_between([0, 1, 2].map(|axis| eye[axis] - at[axis]), [-0.8, -0.6, 0.0]) < 1e-6);
}

/// Invariant: The key of a job depends on the annotations that are drawn and on no others;
/// annotated pictures equal those of `relief render`.
///
/// The very picture of `relief render --annotations`, and beside it the plain one of the same rays.
#[test]
fn annotated_pictures_are_those_of_render() {
    let archive = ball();
    let frame = the_frame_of_reference(&archive, "ball");
    let camera = CameraRecord {
        eye_mm: [300.0, -500.0, 100.0],
        look_at_mm: [0.0, 0.0, 0.0],
        up: [0.0, 0.0, 1.0],
        vertical_fov_deg: Some(25.0),
        height_mm: None,
    };
    let mut seen = point("seen", [0.0, -80.0, 0.0], &frame);
    seen.placement = Some(Placement {
        method: Method::Pick,
        device: None,
        camera: Some(camera.clone()),
        snapped_mm: None,
    });
    let line = Geometry::Line { ends_mm: [Point::new(-60.0, -70.0, 0.0), Point::new(60.0, -70.0, 20.0)] };
    let mut hidden = point("bens", [0.0, -80.0, 30.0], &frame);
    hidden.set = "ben".to_owned();
    apply(&archive, vec![create(seen), create(item("width", line, &frame)), create(hidden)], Some("ben"));
    ok(&plan_annotated(&archive, "cameras", "color,annotated", &[]));
    let jobs = archive.jobs();
    assert_eq!((jobs.len(), jobs[0]["view"].as_str()), (1, Some("camera-seen")));
    ok(&archive.run(&[]));
    let made = files(&archive.path("out"));
    let made = |ending: &str| made.iter().find(|(name, _)| name.ends_with(ending)).unwrap().1;
    let camera = serde_json::json!({ "camera": {
        "eye_mm": camera.eye_mm, "look_at_mm": camera.look_at_mm, "up": camera.up,
        "projection": { "perspective": { "vertical_fov_deg": 25.0 } },
    }});
    std::fs::write(archive.path("scene.json"), camera.to_string()).unwrap();
    let (series, scene, log) =
        (archive.text("series/ball"), archive.text("scene.json"), archive.text("ann.db"));
    let render = |name: &str, more: &[&str]| {
        let out = archive.text(name);
        let fixed = ["render", "--series", &series, "--scene", &scene, "--preset", "bone", "--size", "64x48"];
        ok(&relief(&[&fixed[..], &["--layout", "color", "--out", &out], more].concat()));
        std::fs::read(archive.path(name)).unwrap()
    };
    assert!(*made(".color.png") == render("plain.png", &[]), "the plain picture");
    let drawn = render("drawn.png", &["--annotations", &log]);
    assert!(*made(".annotated.png") == drawn, "the annotated picture");
    assert!(drawn != *made(".color.png"), "something is drawn");
    // A blinded set is drawn where it is named, and is another job.
    ok(&plan_annotated(&archive, "sides", "annotated", &[]));
    let open = archive.jobs()[0]["job"].clone();
    ok(&plan_annotated(&archive, "sides", "annotated", &["--set", "ben"]));
    assert_ne!(open, archive.jobs()[0]["job"]);
    let refused = plan_annotated(&archive, "sides", "annotated", &["--set", "nobody"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("there is no set \"nobody\""));
}

/// Invariant: The key of a job depends on the annotations that are drawn and on no others;
/// annotated pictures equal those of `relief render`.
#[test]
fn an_edit_makes_new_jobs_of_what_it_shows_and_no_others() {
    let archive = ball();
    let frame = the_frame_of_reference(&archive, "ball");
    let first = point("apex", [0.0, -80.0, 0.0], &frame);
    let elsewhere = point("other", [0.0, 0.0, 0.0], &FrameOfReference("1.2.3".to_owned()));
    apply(&archive, vec![create(first.clone()), create(elsewhere.clone())], None);
    let keys = |views: &str, products: &str| -> Vec<String> {
        ok(&plan_annotated(&archive, views, products, &[]));
        archive.jobs().iter().map(|job| job["job"].as_str().unwrap().to_owned()).collect()
    };
    let sets = [("sides", "annotated"), ("landmarks", "color"), ("sides", "color")];
    let before = sets.map(|(views, products)| keys(views, products));
    assert_eq!(before.each_ref().map(Vec::len), [6, 1, 6]);
    // An annotation with another frame of reference does not belong to this series.
    let described = Item { name: "moved".to_owned(), ..elsewhere };
    apply(&archive, vec![Change::Update { item: Box::new(described), version: 1 }], None);
    assert_eq!(before, sets.map(|(views, products)| keys(views, products)));
    let described = Item { description: "seen twice".to_owned(), ..first };
    apply(&archive, vec![Change::Update { item: Box::new(described.clone()), version: 1 }], None);
    assert_eq!(before, sets.map(|(views, products)| keys(views, products)), "nothing of that is drawn");
    let moved = Item { geometry: Some(Geometry::Point { at_mm: Point::new(0.0, 80.0, 0.0) }), ..described };
    apply(&archive, vec![Change::Update { item: Box::new(moved), version: 2 }], None);
    let [annotated, seen, plain] = sets.map(|(views, products)| keys(views, products));
    assert!(annotated.iter().all(|key| !before[0].contains(key)) && seen != before[1]);
    assert_eq!(plain, before[2]);
    // The file beside the manifest has the drawn annotations, but not their authors.
    ok(&plan_annotated(&archive, "sides", "annotated", &[]));
    let kept = archive.path(archive.jobs()[0]["annotations"]["path"].as_str().unwrap());
    let text = std::fs::read_to_string(&kept).unwrap();
    assert!(text.contains("apex") && !text.contains("anna") && !text.contains("seen twice"), "{text}");
    std::fs::write(&kept, text.replace("80.0", "70.0")).unwrap();
    let ran = archive.run(&[]);
    assert_eq!(ran.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&ran.stdout).contains("not those that were planned with; plan again"));
}

#[test]
fn outputs_that_need_annotations_are_refused_without_them() {
    let archive = ball();
    let plan = |more: &[&str]| {
        let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
        let refused = relief(&[&["batch", "plan", "--root", &root, "--out", &out], more].concat());
        assert!(!refused.status.success(), "{more:?}");
        String::from_utf8(refused.stderr).unwrap()
    };
    assert!(plan(&["--views", "landmarks"]).contains("say which log has them with --annotations"));
    assert!(
        plan(&["--views", "sides", "--products", "annotated"]).contains("product annotated has annotations")
    );
    assert!(plan(&["--views", "sides", "--products", "relief"]).contains("products are frame, color, depth"));
    apply(&archive, vec![create(point("a", [0.0; 3], &FrameOfReference("1.2.3".to_owned())))], None);
    let log = archive.text("ann.db");
    let none = plan(&["--views", "landmarks", "--annotations", &log]);
    assert!(none.contains("no annotation of this series to look at"), "{none}");
    let nowhere = plan(&["--views", "landmarks", "--annotations", &archive.text("nowhere.db")]);
    assert!(nowhere.contains("--annotations cannot be read"), "{nowhere}");
}

/// Two plates across the viewing axis, one before the other: closed form in every pixel but those
/// at their edges.
#[test]
fn labels_are_the_nearest_structure_in_each_pixel() {
    let archive = ball();
    let frame = the_frame_of_reference(&archive, "ball");
    let plates = [("near plate", -100.0, [-40.0, 10.0]), ("far plate", 60.0, [-10.0, 40.0])];
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let changes = plates.map(|(name, y, [from, to])| {
        let corners = [[from, -30.0], [to, -30.0], [to, 30.0], [from, 30.0]];
        let vertices = corners.map(|[x, z]| Point::new(x, y, z)).to_vec();
        let mesh = TriangleMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let file = write_mesh(MeshFormat::Ply, &mesh, name).unwrap();
        let content = runtime.block_on(async {
            let store = Store::open(&archive.text("ann.db")).await.unwrap();
            let content = store.put_content("model/ply", &file).await.unwrap();
            store.close().await;
            content
        });
        let area_mm2 = (to - from) * 60.0;
        let mesh = MeshSummary { content, vertices: 4, triangles: 2, area_mm2, volume_ml: None };
        create(item(name, Geometry::Mesh(mesh), &frame))
    });
    apply(&archive, changes.to_vec(), None);
    ok(&plan_annotated(&archive, "sides", "labels,annotated", &["--zoom", "2", "--frame", "volume"]));
    ok(&archive.run(&[]));
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let record: Value =
        serde_json::from_slice(&std::fs::read(folder.join("anterior.json")).unwrap()).unwrap();
    assert_eq!(record["structures"], serde_json::json!(["near plate", "far plate"]));
    let labels = image::open(folder.join("anterior.labels.png")).unwrap();
    let image::DynamicImage::ImageLuma8(labels) = labels else { panic!("8-bit grey") };
    // From the front the eye is on -y, at zoom 2 half as wide as the ball that holds the box of 256
    // mm.
    let distance = 128.0 * 3f64.sqrt() / 11f64.to_radians().sin();
    let px_per_mm = |depth: f64| 48.0 / (11f64.to_radians().tan() * depth);
    let mut counted = [0; 3];
    for (column, row, label) in labels.enumerate_pixels() {
        let hits = plates.map(|(_, y, [from, to])| {
            let scale = px_per_mm(distance + y);
            let [x, z] = [(f64::from(column) + 0.5 - 32.0) / scale, (24.0 - f64::from(row) - 0.5) / scale];
            // How far inside the plate, px.
            (x - from).min(to - x).min(z + 30.0).min(30.0 - z) * scale
        });
        if hits.iter().any(|inside| inside.abs() < 1.0) {
            continue;
        }
        let expected = hits.iter().position(|inside| *inside > 0.0).map_or(0, |index| index + 1);
        assert_eq!(usize::from(label.0[0]), expected, "at {column}, {row}");
        counted[expected] += 1;
    }
    assert!(counted.iter().all(|count| *count > 30), "{counted:?}");
}
