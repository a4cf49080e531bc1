//! `relief bench --capacity`: its sums follow from its measurements.

use serde_json::Value;

use crate::cluster::stage::{phantom, relief, root};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

#[test]
fn a_capacity_follows_from_what_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path(), "sphere");
    let series = series.to_str().unwrap();
    let arguments =
        ["bench", "--capacity", "--series", series, "--size", "96x64", "--layout", "color", "--frames", "10"];
    let run = |more: &[&str]| {
        let run = relief(&[&arguments[..], more].concat()).output().unwrap();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8(run.stdout).unwrap()
    };
    let report: Value =
        serde_json::from_str(&run(&["--json", "--viewer-fps", "2", "--moving-share", "0.2"])).unwrap();
    let (measured, habits, carried) = (&report["measured"], &report["habits"], &report["carried"]);
    assert_eq!((number(&habits["viewer_fps"]), number(&habits["moving_share"])), (2.0, 0.2));
    for kind in ["moving", "still", "view"] {
        let frames = &measured[kind];
        assert!(number(&frames["per_s"]) > 0.0 && number(&frames["bytes"]) > 100.0, "{kind}: {frames}");
        assert!(number(&frames["render_ms"]) > 0.0 && number(&frames["encode_ms"]) > 0.0, "{kind}: {frames}");
    }
    assert_eq!(measured["still"]["size_px"], serde_json::json!([96, 64]));
    assert!((number(&measured["voxels_mib"]) - 2.0 * 32f64.powi(3) / f64::from(1 << 20)).abs() < 1e-9);
    assert!(number(&measured["adapter_mib"]) >= number(&measured["voxels_mib"]));
    let viewers = number(&carried["viewers"]);
    let stills = 0.2 / number(&habits["stretch_s"]);
    let load = viewers
        * (0.2 * 2.0 / number(&measured["moving"]["per_s"]) + stills / number(&measured["still"]["per_s"]));
    assert!(viewers >= 1.0 && (number(&carried["load"]) - load).abs() < 1e-6, "{carried}");
    assert!((number(&carried["views_per_hour"]) / number(&measured["view"]["per_s"]) - 3600.0).abs() < 1e-6);
    let groups = report["needed"].as_array().unwrap();
    assert_eq!(groups.iter().map(|group| number(&group["viewers"])).sum::<f64>(), 11_111.0);
    let largest = groups.last().unwrap();
    assert_eq!(number(&largest["servers"]), (10_000.0 / viewers).ceil() + 1.0);

    // The page in the repository has the tables that the command prints.
    let page = std::fs::read_to_string(root().join("docs/CAPACITY.md")).unwrap();
    let printed = run(&["--markdown"]);
    let rows: Vec<&str> = printed.lines().filter(|line| line.starts_with('|')).collect();
    assert!(rows.len() > 15, "{printed}");
    for line in rows {
        let head = line.split('|').nth(1).unwrap();
        // Figures depend on the machine; their names and the page's own viewer rate do not.
        assert!(page.contains(&format!("|{head}|")), "docs/CAPACITY.md lacks {head:?}");
    }
    for (arguments, why) in [
        (&["bench"][..], "--series"),
        (&["bench", "--series", series, "--markdown"], "--capacity"),
        (&["bench", "--capacity", "--moving-share", "2"], "0.001 to 1"),
    ] {
        let refused = relief(arguments).output().unwrap();
        assert_eq!(refused.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&refused.stderr).contains(why), "{arguments:?}");
    }
}
