//! Every mode is where users look for it.

use relief_render::Mode;

fn text(path: &str) -> String {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(root.join(path)).unwrap()
}

/// Invariant: Every mode is on the page, in the API description and in the documents.
#[test]
fn every_mode_is_on_the_page_in_the_api_and_in_the_documents() {
    let api: serde_json::Value = serde_json::from_str(&text("src/server/openapi.json")).unwrap();
    let names = serde_json::json!(Mode::ALL.map(Mode::name));
    assert_eq!(api["components"]["parameters"]["mode"]["schema"]["enum"], names, "the query");
    let bodies = &api["components"]["schemas"]["Scene"]["properties"];
    assert_eq!(bodies["mode"]["enum"], names, "the body");
    let (page, table) = (text("src/server/page/index.html"), text("docs/RENDERING.md"));
    let cli = text("src/cli/scene.rs");
    for name in Mode::ALL.map(Mode::name) {
        assert!(table.contains(&format!("| `{name}` |")), "{name} is not in the table of docs/RENDERING.md");
        assert!(cli.contains(name), "{name} is not in the help of --mode");
    }
    for name in Mode::RAYS.map(Mode::name) {
        assert!(page.contains(&format!("<option value=\"{name}\">")), "{name} is not in the page's menu");
    }
}
