//! The files of a first case, for a project that has none.

use std::path::Path;

/// The files of a first case, by name: a head phantom, or a series at a path from the case's folder.
#[must_use]
pub fn starter_case(series: Option<&Path>) -> [(&'static str, String); 2] {
    let (purpose, volume) = match series {
        Some(path) => {
            // Strings of JSON are basic strings of TOML.
            let quoted = serde_json::Value::from(path.display().to_string());
            ("The series in bone, from the front.", format!("series = {quoted}"))
        }
        None => ("A head in bone, from the front.", "phantom = \"head\"\nsize = 64".to_owned()),
    };
    let case = format!(
        "purpose = \"{purpose}\"\n# exact: every byte; strict: rounding of another processor passes\ntolerance = \"strict\"\n\
         # color, depth (in mm) and frame (as a display takes it)\ncompare = [\"color\", \"depth\"]\n\n[volume]\n{volume}\n"
    );
    let scene =
        "{ \"transfer\": \"bone\", \"size_px\": [160, 90], \"display\": { \"layout\": \"color\" } }\n"
            .to_owned();
    [("case.toml", case), ("scene.json", scene)]
}
