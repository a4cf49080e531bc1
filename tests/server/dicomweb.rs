//! Rendered volumes by study and series: DICOM Supplement 228, from outside.

use relief_dicom::{SeriesIdentity, WarningCode};
use relief_server::Config;
use relief_session::{LoadedVolume, QueueConfig};
use relief_volume::Quantity;
use serde_json::{Value, json};

use crate::server::stage::{Answer, Stage, cube};

const STUDY: &str = "1.2.826.0.1.3680043.8.498.1";
const SERIES: &str = "1.2.826.0.1.3680043.8.498.1.7";

fn stage() -> Stage {
    let stage = Stage::empty(Config::default(), QueueConfig::default());
    let identity = Some(SeriesIdentity::new(STUDY, SERIES));
    stage.server.add_volume(LoadedVolume {
        volume: cube(),
        warnings: Vec::new(),
        identity,
        reference: None,
        labels: None,
    });
    stage
}

fn path(resource: &str) -> String {
    format!("/studies/{STUDY}/series/{SERIES}/{resource}")
}

async fn metadata(stage: &Stage, resource: &str) -> Value {
    let joint = if resource.contains('?') { '&' } else { '?' };
    let query = path(&format!("{resource}{joint}renderedvolumetricmetadata=yes"));
    let answer = stage.get_with(&query, &[("accept", "application/dicom+json")]).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    answer.json()
}

fn size(answer: &Answer) -> (u32, u32) {
    assert_eq!(answer.status, 200, "{}", answer.text());
    let picture = image::load_from_memory(&answer.body).unwrap();
    (picture.width(), picture.height())
}

/// The values of an attribute as numbers.
fn numbers(module: &Value, tag: &str) -> Vec<f64> {
    serde_json::from_value(module[tag]["Value"].clone()).unwrap_or_else(|error| panic!("{tag}: {error}"))
}

#[tokio::test]
async fn pictures_have_the_requested_media_type_and_viewport() {
    let stage = stage();
    for resource in ["rendered3D", "rendered3d", "renderedmpr"] {
        for (accept, media) in
            [("image/png", "image/png"), ("image/jpeg", "image/jpeg"), ("*/*", "image/jpeg")]
        {
            let answer =
                stage.get_with(&path(&format!("{resource}?viewport=64,48")), &[("accept", accept)]).await;
            assert_eq!(size(&answer), (64, 48), "{resource}");
            assert_eq!(answer.header("content-type"), media, "{resource} for {accept}");
            assert_eq!(answer.header("vary"), "Accept");
        }
    }
    let by_parameter = stage.get(&path("rendered3D?viewport=16,16&accept=image/png")).await;
    assert_eq!(by_parameter.header("content-type"), "image/png");
    let sizes = [10, 95].map(|quality| path(&format!("rendered3D?viewport=64,64&quality={quality}")));
    let (coarse, fine) = (stage.get(&sizes[0]).await, stage.get(&sizes[1]).await);
    assert!(coarse.body.len() < fine.body.len(), "{} and {} bytes", coarse.body.len(), fine.body.len());
    assert_ne!(coarse.header("etag"), fine.header("etag"));
    let refused = stage.get_with(&path("rendered3D"), &[("accept", "video/mp4")]).await.problem(406);
    assert_eq!(refused["offers"], json!(["image/jpeg", "image/png"]));
}

/// Invariant: DICOMweb answers and exports carry the warnings of their series.
#[tokio::test]
async fn answers_have_the_warnings_of_the_series() {
    let stage = Stage::empty(Config::default(), QueueConfig::default());
    let warnings = vec![WarningCode::BadFile, WarningCode::OtherValues, WarningCode::BadFile];
    let (reference, labels) = (None, None);
    let identity = Some(SeriesIdentity::new(STUDY, SERIES));
    let volume = cube().of_quantity(Quantity::Concentration);
    let (low, high) = volume.range_hu();
    stage.server.add_volume(LoadedVolume { volume, warnings, identity, reference, labels });
    for query in ["renderedmpr?viewport=16,16", "rendered3D?renderedvolumetricmetadata=yes"] {
        let answer = stage.get(&path(query)).await;
        let found: Vec<_> =
            answer.headers.get_all("warning").iter().map(|value| value.to_str().unwrap()).collect();
        assert_eq!(found.len(), 2, "{query}");
        assert!(found.iter().all(|text| text.starts_with("299 relief \"")), "{found:?}");
        assert!(found.iter().any(|text| text.contains("not in HU")), "{found:?}");
    }
    // The window is that of all values.
    let module = metadata(&stage, "renderedmpr").await.to_string();
    let [center, width] = [f64::from(low + high) / 2.0, f64::from(high - low)];
    assert!(module.contains(&format!("{center:?}")) && module.contains(&format!("{width:?}")), "{module}");
}

#[tokio::test]
async fn a_known_picture_is_not_rendered_again() {
    let stage = stage();
    let first = stage.get(&path("renderedmpr?viewport=16,16")).await;
    let again =
        stage.get_with(&path("renderedmpr?viewport=16,16"), &[("if-none-match", first.header("etag"))]).await;
    assert_eq!((again.status.as_u16(), stage.gate.count()), (304, 1));
}

/// Letter, direction to the eye and up: PS3.18, 8.3.5.3.4.
const SIDES: [(&str, [f64; 3], [f64; 3]); 6] = [
    ("a", [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
    ("p", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
    ("r", [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    ("l", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    ("h", [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
    ("f", [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]),
];

/// Invariant: DICOMweb requests find volumes by UID, and no log, metric or answer contains one;
/// viewpoints follow the standard, and the reported module reproduces the picture.
#[tokio::test]
async fn orientations_become_viewpoints_as_the_standard_has_them() {
    let stage = stage();
    for resource in ["rendered3D", "renderedmpr"] {
        for (letter, towards_eye, up) in SIDES {
            let module = metadata(&stage, &format!("{resource}?orientation={letter}")).await;
            let [position, look_at] = ["00701603", "00701604"].map(|tag| numbers(&module, tag));
            assert_eq!(look_at, [0.0, 0.0, 0.0], "the volume's centre");
            let length = position.iter().map(|x| x * x).sum::<f64>().sqrt();
            let direction: Vec<f64> = position.iter().map(|x| x / length).collect();
            assert_eq!(direction, towards_eye, "{resource} from {letter}");
            assert_eq!(numbers(&module, "00701605"), up, "{resource} from {letter}");
            // The returned settings give the same picture.
            let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let reported = format!(
                "{resource}?viewport=24,24&viewpointposition={}&viewpointlookat={}&viewpointup={}",
                list(&position),
                list(&look_at),
                list(&numbers(&module, "00701605"))
            );
            let [a, b] = [reported, format!("{resource}?viewport=24,24&orientation={letter}")];
            let (a, b) = (stage.get(&path(&a)).await, stage.get(&path(&b)).await);
            assert_eq!(a.header("etag"), b.header("etag"), "{resource} from {letter}");
        }
    }
}

#[tokio::test]
async fn the_response_module_says_everything_that_was_used() {
    let stage = stage();
    let module = metadata(&stage, "rendered3D?renderingmethod=volume_rendered&orientation=l").await;
    assert_eq!(module["00720510"], json!({ "vr": "CS", "Value": ["3D_RENDERING"] }));
    assert_eq!(module["0070120D"], json!({ "vr": "CS", "Value": ["VOLUME_RENDERED"] }));
    assert_eq!(module.as_object().unwrap().len(), 5, "no window, no slab, no animation: {module}");

    let module = metadata(&stage, "rendered3D?renderingmethod=maximum_ip&window=100,700,linear-exact").await;
    assert_eq!(module["0070120D"]["Value"], json!(["MAXIMUM_IP"]));
    assert_eq!(module["00281050"], json!({ "vr": "DS", "Value": [100.0] }), "centre");
    assert_eq!(module["00281051"], json!({ "vr": "DS", "Value": [700.0] }), "width");
    assert_eq!(module["00281056"], json!({ "vr": "CS", "Value": ["LINEAR_EXACT"] }));

    let module = metadata(&stage, "renderedmpr?mprslab=7.5&renderingmethod=minimum_ip").await;
    assert_eq!(module["00720510"]["Value"], json!(["MPR"]));
    assert_eq!(module["0070120D"]["Value"], json!(["MINIMUM_IP"]));
    assert_eq!(module["00701503"], json!({ "vr": "FD", "Value": [7.5] }));
    assert_eq!(module["00281056"]["Value"], json!(["LINEAR"]), "a window of the server's own");

    for method in ["maximum_ip", "minimum_ip", "average_ip"] {
        let query = format!("rendered3D?renderingmethod={method}&viewport=8,8");
        assert_eq!(metadata(&stage, &query).await["0070120D"]["Value"], json!([method.to_uppercase()]));
    }

    let plain = metadata(&stage, "renderedmpr").await;
    assert_eq!(plain["0070120D"]["Value"], json!(["AVERAGE_IP"]));
    assert!(plain.get("00701503").is_none(), "no thickness was specified");
    assert_eq!(plain, metadata(&stage, "renderedmpr").await, "identical requests, identical metadata");
    assert_eq!(stage.gate.count(), 0, "nothing was rendered");
    let refused =
        stage.get_with(&path("rendered3D?renderedvolumetricmetadata=yes"), &[("accept", "image/png")]).await;
    assert_eq!(refused.problem(406)["offers"], json!(["application/dicom+json"]));
}

#[tokio::test]
async fn the_camera_is_parallel_outside_the_volume_and_does_not_scale_when_it_moves() {
    let stage = stage();
    let camera = async |query: &str| -> Value {
        let answer = stage.get(&path(&format!("{query}viewport=32,16"))).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        serde_json::from_str(answer.header("relief-camera")).unwrap()
    };
    let plain = camera("rendered3D?").await;
    // 40 mm each way, the picture twice as wide as high.
    let height =
        |camera: &Value| camera["camera"]["projection"]["orthographic"]["height_mm"].as_f64().unwrap();
    assert!((height(&plain) - 40.0).abs() < 1e-9, "{plain}");
    assert_eq!(plain["edges"], json!({ "left": "R", "right": "L", "top": "H", "bottom": "F" }));
    // The standard's own example has its viewpoint 1 mm away: a direction, not a place to cut from.
    let near = camera("rendered3D?viewpointposition=3,-1,2&viewpointlookat=3,0,2&viewpointup=0,0,1&").await;
    assert_eq!(near["camera"]["look_at_mm"], json!([3.0, 0.0, 2.0]));
    assert!(near["camera"]["eye_mm"][1].as_f64().unwrap() < -40.0, "{near}");
    assert!((height(&near) - 40.0).abs() < 1e-9, "{near}");
    let slice = camera("renderedmpr?viewpointlookat=0,0,5&").await;
    assert_eq!(slice["edges"], json!({ "left": "R", "right": "L", "top": "A", "bottom": "P" }), "axial");
    assert!((height(&slice) - 40.0).abs() < 1e-9, "{slice}");
}

#[tokio::test]
async fn malformed_and_unsupported_parameters_are_refused_and_unknown_ones_ignored() {
    let stage = stage();
    for (query, name, detail) in [
        ("rendered3D?renderingmethod=xray", "renderingmethod", "maximum_ip"),
        ("rendered3D?renderingmethod=MAXIMUM_IP", "renderingmethod", "maximum_ip"),
        ("renderedmpr?renderingmethod=volume_rendered", "renderingmethod", "average_ip"),
        ("rendered3D?orientation=s", "orientation", "a, p, r, l, h or f"),
        ("rendered3D?orientation=a&viewpointup=0,0,1", "orientation", "one of the two"),
        ("rendered3D?orientation=a&orientation=p", "orientation", "once"),
        ("rendered3D?viewpointposition=1,2", "viewpointposition", "x,y,z"),
        ("rendered3D?viewpointposition=1,2,nan", "viewpointposition", "x,y,z"),
        ("rendered3D?viewpointposition=1,2,1e9", "viewpointposition", "100000"),
        ("rendered3D?viewpointposition=1,2,3&viewpointlookat=1,2,3", "viewpointposition", "shows nothing"),
        ("rendered3D?mprslab=5", "mprslab", "only for renderedmpr"),
        ("renderedmpr?mprslab=-5", "mprslab", "0 to 1000"),
        ("rendered3D?viewport=0,5", "viewport", "1 to 4096"),
        ("rendered3D?viewport=9,9,0,0,3,3", "viewport", "width,height"),
        ("rendered3D?window=40,400,linear", "window", "maximum_ip"),
        ("renderedmpr?window=40", "window", "center,width,shape"),
        ("renderedmpr?window=40,0,linear", "window", "1 to 65536"),
        ("renderedmpr?window=40,400,sigmoid", "window", "sigmoid"),
        ("renderedmpr?quality=0", "quality", "1 to 100"),
        ("renderedmpr?renderedvolumetricmetadata=no", "renderedvolumetricmetadata", "yes"),
        ("rendered3D?swivelrange=180&animationrate=20", "swivelrange", "not supported"),
        ("rendered3D?volumetriccurvepoint=1,2,3", "volumetriccurvepoint", "not supported"),
        ("rendered3D?annotation=patient", "annotation", "not supported"),
        ("rendered3D?iccprofile=srgb", "iccprofile", "not supported"),
        ("rendered3D?volumeinputreference=1.2.3", "volumeinputreference", "not supported"),
    ] {
        let problem = stage.get(&path(query)).await.problem(400);
        assert_eq!(problem["path"], name, "{query}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(detail), "{query}: {problem}");
    }
    let unknown = "renderedmpr?viewport=8,8&CardiacRRIntervalSpecified=140-260&x=1&x=2&iccprofile=no";
    assert_eq!(size(&stage.get(&path(unknown)).await), (8, 8));
}

/// Invariant: DICOMweb requests find volumes by UID, and no log, metric or answer contains one;
/// viewpoints follow the standard, and the reported module reproduces the picture.
#[tokio::test]
async fn uids_are_matched_exactly_and_never_shown() {
    let stage = stage();
    for wrong in [
        format!("/studies/{STUDY}/series/{STUDY}/rendered3D"),
        format!("/studies/{SERIES}/series/{SERIES}/renderedmpr"),
        format!("/studies/{STUDY}0/series/{SERIES}/rendered3D"),
        "/studies//series//rendered3D".to_owned(),
    ] {
        let problem = stage.get(&wrong).await.problem(404);
        assert!(!problem.to_string().contains("1.2.826"), "{problem}");
    }
    let nameless = Stage::new();
    nameless.get(&path("rendered3D")).await.problem(404);
    stage.get(&path("rendered3D?viewport=8,8")).await;
    for place in ["/metrics", "/v1/volumes", "/readyz"] {
        let reported = stage.get(place).await;
        assert!(!reported.text().contains("1.2.826"), "{place}: {}", reported.text());
    }
    assert!(stage.get("/metrics").await.text().contains("/studies/{study}/series/{series}/rendered3D"));
}
