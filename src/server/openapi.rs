//! The API description: OpenAPI 3.1, from a template whose closed sets are filled in from the
//! tables of the code.
//!
//! `"x-relief-values": SET` in `openapi.json` becomes `"enum": [...]`. Routes and parameters are
//! compared with the code by tests.

use std::sync::LazyLock;

use serde_json::{Value, json};

use super::query::parameter_names;
use relief_annotation::SnapFeature;
use relief_display::{ContentType, DepthFilter, Layout, MAX_VIEWS, ProfileName};
use relief_exchange::Format;
use relief_render::{Classification, CutFaces, DepthRule, Edges, Lighting, Mode, Overlays, SlabBlend};
use relief_volume::{NamedPlane, PresetGroup, WindowMap};

/// The description without its closed sets.
const TEMPLATE: &str = include_str!("openapi.json");
/// The key that names a closed set.
const KEY: &str = "x-relief-values";
/// Stands for the media types of annotation formats that are written.
const MEDIA_KEY: &str = "x-relief-media";

/// Stands for the pattern of the layouts of views.
const GRIDS: &str = "x-relief-view-grids";

/// Stands for the parameters of a scene.
const SCENE: &str = "x-relief-scene";

/// The description as it is served.
pub(super) static DOCUMENT: LazyLock<String> = LazyLock::new(|| filled().to_string());

/// The description with all closed sets.
fn filled() -> Value {
    // A malformed template fails the tests of this module; a server would describe nothing.
    let mut document = serde_json::from_str(TEMPLATE).unwrap_or(Value::Null);
    fill(&mut document);
    document
}

fn fill(value: &mut Value) {
    match value {
        Value::Object(members) => {
            let set = members.get(KEY).and_then(Value::as_str).and_then(values);
            if let Some(values) = set {
                members.remove(KEY);
                members.insert("enum".to_owned(), json!(values));
            }
            if members.get("pattern").is_some_and(|pattern| pattern == GRIDS) {
                members.insert("pattern".to_owned(), view_grids().into());
            }
            if members.remove(MEDIA_KEY).is_some() {
                let media = Format::ALL.into_iter().filter(|format| format.can_write());
                members.extend(media.map(|format| (format.media_type().to_owned(), json!({}))));
                members.insert("application/json".to_owned(), json!({})); // the report
            }
            if let Some(parameters) = members.get_mut("parameters").filter(|parameters| *parameters == SCENE)
            {
                let reference = |name| json!({ "$ref": format!("#/components/parameters/{name}") });
                *parameters = parameter_names().map(reference).collect();
            }
            members.values_mut().for_each(fill);
        }
        Value::Array(items) => items.iter_mut().for_each(fill),
        _ => {}
    }
}

/// A regular expression of `views-N`, `views-COLUMNSxROWS` and `lenses-N` with 2 to [`MAX_VIEWS`]
/// views.
fn view_grids() -> String {
    let alternatives = |numbers: std::ops::RangeInclusive<u32>| -> String {
        numbers.map(|number| number.to_string()).collect::<Vec<_>>().join("|")
    };
    let grids = (1..=MAX_VIEWS).map(|columns| {
        let rows = if columns == 1 { 2 } else { 1 }..=MAX_VIEWS / columns;
        format!("|{columns}x({})", alternatives(rows))
    });
    let counts = alternatives(2..=MAX_VIEWS);
    format!("^(views-({counts}{})|lenses-({counts}))$", grids.collect::<String>())
}

/// The names of a closed set.
fn values(set: &str) -> Option<Vec<String>> {
    fn names<T: Copy>(all: &[T], name: impl Fn(T) -> &'static str) -> Vec<String> {
        all.iter().map(|one| name(*one).to_owned()).collect()
    }
    Some(match set {
        "annotation-formats" => names(&Format::ALL, Format::name),
        "annotation-formats-written" => {
            Format::ALL.into_iter().filter(|format| format.can_write()).map(|f| f.name().to_owned()).collect()
        }
        "classifications" => names(&Classification::ALL, Classification::name),
        "cuts" => CutFaces::NAMES.map(str::to_owned).to_vec(),
        "contents" => names(&ContentType::ALL, ContentType::name),
        "depth-filters" => names(&DepthFilter::ALL, DepthFilter::name),
        "depth-rules" => DepthRule::TABLE.iter().map(|entry| entry.name.to_owned()).collect(),
        "label-edges" => names(&Edges::ALL, Edges::name),
        "layouts" => Layout::ALL.into_iter().map(|layout| layout.name().into_owned()).collect(),
        "lights" => Lighting::ALL.iter().map(|lighting| lighting.name.to_owned()).collect(),
        "modes" => names(&Mode::ALL, Mode::name),
        "overlays" => Overlays::SWITCHES.iter().map(|(name, _)| (*name).to_owned()).collect(),
        "planes" => names(&NamedPlane::ALL, NamedPlane::name),
        "preset-groups" => names(&PresetGroup::ALL, PresetGroup::name),
        "profiles" => names(&ProfileName::ALL, ProfileName::name),
        "slab-blends" => names(&SlabBlend::ALL, SlabBlend::name),
        "snap-features" => SnapFeature::NAMES.map(str::to_owned).to_vec(),
        "window-maps" => names(&WindowMap::ALL, WindowMap::name),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use relief_display::DisplaySettings;
    use relief_render::{PathTrace, Quality};
    use relief_volume::Orbit;

    #[test]
    fn every_closed_set_is_filled_in() {
        let template: Value = serde_json::from_str(TEMPLATE).unwrap();
        assert!(template.to_string().matches(KEY).count() > 20);
        let document = filled().to_string();
        assert!(!document.contains(KEY), "a set has no table");
        for name in ["most-contributing", "wowvx-4k", "mrk.json", "path-traced", "median-5"] {
            assert!(document.contains(name), "{name}");
            assert!(!template.to_string().contains(&format!("\"{name}\"]")), "{name} is listed by hand");
        }
    }

    /// Invariant: The API description names exactly the layouts of views that the code accepts.
    #[test]
    fn layouts_of_views_match_the_pattern_exactly() {
        let document = filled();
        assert!(!document.to_string().contains(GRIDS));
        let pattern = document["components"]["parameters"]["layout"]["schema"]["anyOf"][1]["pattern"].clone();
        let pattern = regex::Regex::new(pattern.as_str().unwrap()).unwrap();
        for columns in 0..=130 {
            for name in [format!("views-{columns}"), format!("lenses-{columns}")] {
                assert_eq!(pattern.is_match(&name), name.parse::<Layout>().is_ok(), "{name}");
            }
            for rows in 0..=130 {
                let name = format!("views-{columns}x{rows}");
                assert_eq!(pattern.is_match(&name), name.parse::<Layout>().is_ok(), "{name}");
            }
        }
        // Counts whose square does not fit into 32 bits.
        assert!("views-1742693347".parse::<Layout>().is_err());
    }

    #[test]
    fn every_route_but_those_of_the_pages_files_is_described() {
        // axum keeps no list of its routes; the calls that add them are one.
        let sources =
            [include_str!("lib.rs"), include_str!("annotations/mod.rs"), include_str!("identity/sign_in.rs")];
        let routes = sources.iter().flat_map(|source| source.split(".route(\"").skip(1));
        let routed: BTreeSet<&str> = routes.filter_map(|rest| rest.split('"').next()).collect();
        let document = filled();
        let listed: BTreeSet<&str> =
            document["paths"].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(routed, listed);
    }

    #[test]
    fn every_parameter_of_a_scene_is_described() {
        let document = filled();
        let own: BTreeSet<&str> = parameter_names().collect();
        for operation in ["frame", "views", "depth", "slice", "pick"] {
            let parameters =
                &document["paths"][format!("/v1/volumes/{{id}}/{operation}")]["get"]["parameters"];
            let references = parameters.as_array().unwrap().iter().map(|p| p["$ref"].as_str().unwrap());
            let listed: BTreeSet<&str> =
                references.map(|r| r.strip_prefix("#/components/parameters/").unwrap()).collect();
            assert_eq!(own, listed, "{operation}");
        }
        for (name, parameter) in document["components"]["parameters"].as_object().unwrap() {
            assert_eq!(parameter["name"], name.as_str());
        }
    }

    /// The defaults that the description states are those of the code.
    #[test]
    fn defaults_are_those_of_the_code() {
        let document = filled();
        let (orbit, display, light) = (Orbit::default(), DisplaySettings::default(), PathTrace::default());
        let stated = |name: &str| document["components"]["parameters"][name]["schema"]["default"].clone();
        for (name, default) in [
            ("mode", json!(Mode::Composite.name())),
            ("classification", json!(Classification::default().name())),
            ("cut", json!(CutFaces::default().name())),
            ("quality", json!(Quality::default().name())),
            ("depth_filter", json!(display.depth_filter.name())),
            ("azimuth_deg", json!(orbit.azimuth_deg)),
            ("elevation_deg", json!(orbit.elevation_deg)),
            ("zoom", json!(orbit.zoom)),
            ("passes", json!(light.passes)),
            ("seed", json!(light.seed)),
            ("scatterings", json!(light.scatterings)),
            ("denoise", json!(light.denoise)),
            ("plane", json!(NamedPlane::Axial.name())),
            ("slab_blend", json!(SlabBlend::Mean.name())),
        ] {
            let found = stated(name);
            let equal =
                found == default || found.as_f64().is_some_and(|found| Some(found) == default.as_f64());
            assert!(equal, "{name}: {found} is described, {default} is the code's");
        }
    }
}
