//! Every mode is where users look for it.

use relief_render::Mode;

fn text(path: &str) -> String {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(root.join(path)).unwrap()
}

/// Invariant: Every mode is on the page, in the help and in the documents.
#[test]
fn every_mode_is_on_the_page_in_the_help_and_in_the_documents() {
    let (page, table) = (text("src/server/page/index.html"), text("docs/RENDERING.md"));
    let help = std::process::Command::new(env!("CARGO_BIN_EXE_relief")).args(["render", "--help"]).output();
    let help = String::from_utf8(help.unwrap().stdout).unwrap();
    for name in Mode::ALL.map(Mode::name) {
        assert!(table.contains(&format!("| `{name}` |")), "{name} is not in the table of docs/RENDERING.md");
        assert!(help.contains(name), "{name} is not in the help of --mode");
    }
    for name in Mode::RAYS.map(Mode::name) {
        assert!(page.contains(&format!("<option value=\"{name}\">")), "{name} is not in the page's menu");
    }
}
