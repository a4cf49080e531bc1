//! How well the built-in network orders the depths of pictures of volumes that it was not trained on.

use super::*;
use crate::common::unpacked;

/// Spearman's rank correlation, with mean ranks for ties.
fn rank_correlation(found: &[f64], truth: &[f64]) -> f64 {
    let [found, truth] = [found, truth].map(ranks);
    let mean = (found.len() + 1) as f64 / 2.0;
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    sum(&found, &truth) / (sum(&found, &found) * sum(&truth, &truth)).sqrt()
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let tied = order[start..].iter().take_while(|index| values[**index] == values[order[start]]).count();
        let mean = start as f64 + (tied + 1) as f64 / 2.0;
        order[start..start + tied].iter().for_each(|index| ranks[*index] = mean);
        start += tied;
    }
    ranks
}

/// Root mean square of what remains of `truth` after the best line through `found`.
fn residual(found: &[f64], truth: &[f64]) -> f64 {
    let count = found.len() as f64;
    let [mean_found, mean_truth] = [found, truth].map(|values| values.iter().sum::<f64>() / count);
    let sum = |a: &[f64], ma: f64, b: &[f64], mb: f64| {
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>()
    };
    let square = sum(found, mean_found, found, mean_found);
    let slope = if square > 0.0 { sum(found, mean_found, truth, mean_truth) / square } else { 0.0 };
    let rest = |(found, truth): (&f64, &f64)| (truth - mean_truth - slope * (found - mean_found)).powi(2);
    (found.iter().zip(truth).map(rest).sum::<f64>() / count).sqrt()
}

/// Renders views of a series and measures each: rank correlation, and residuals of the estimate, of
/// a flat picture, and of a ramp from top to bottom.
fn measured(series: &Path, presets: &[&str], azimuths: &[i32]) -> Vec<(String, f64, [f64; 3])> {
    let folder = tempfile::tempdir().unwrap();
    let (table, views, jobs, out) = (
        folder.path().join("series.csv"),
        folder.path().join("views.json"),
        folder.path().join("jobs.jsonl"),
        folder.path().join("out"),
    );
    std::fs::write(&table, format!("path,name\n{},s\n", text(&std::path::absolute(series).unwrap())))
        .unwrap();
    let list: Vec<_> = azimuths
        .iter()
        .enumerate()
        .map(|(number, azimuth)| {
            let preset = presets[number % presets.len()];
            serde_json::json!({ "name": format!("{preset}-{number}"), "azimuth_deg": azimuth, "elevation_deg": 10,
                "scene": { "transfer": preset, "size_px": [480, 270] } })
        })
        .collect();
    std::fs::write(&views, serde_json::to_vec(&list).unwrap()).unwrap();
    let plan =
        ["batch", "plan", "--table", text(&table), "--views", text(&views), "--products", "color,depth-png"];
    ok(&relief(&[&plan[..], &["--out", text(&jobs)]].concat()));
    ok(&relief(&["batch", "run", "--manifest", text(&jobs), "--out", text(&out)]));
    let rendered = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.is_dir())
        .unwrap();
    let measure = |view: &serde_json::Value| {
        let name = view["name"].as_str().unwrap();
        let z = folder.path().join("z.png");
        let color = rendered.join(format!("{name}.color.png"));
        let depth16 = ["--layout", "depth16", "--out", text(&z)];
        ok(&relief(&[&["convert", text(&color), "--estimate-depth"][..], &depth16].concat()));
        let found = values(&z);
        let depth = values(&rendered.join(format!("{name}.depth.png")));
        let (near, far) = limits(&depth);
        let truth: Vec<f64> =
            depth
                .iter()
                .map(|depth| {
                    if *depth == 0.0 {
                        0.0
                    } else {
                        0.1 + 0.9 * ((far - depth) / (far - near)).clamp(0.0, 1.0)
                    }
                })
                .collect();
        let flat = vec![1.0; truth.len()];
        let ramp: Vec<f64> = (0..truth.len()).map(|index| (index / 480) as f64).collect();
        (
            name.to_owned(),
            rank_correlation(&found, &truth),
            [&found, &flat, &ramp].map(|guess| residual(guess, &truth)),
        )
    };
    list.iter().map(measure).collect()
}

fn values(path: &Path) -> Vec<f64> {
    image::open(path).unwrap().into_luma16().pixels().map(|pixel| f64::from(pixel.0[0])).collect()
}

/// The 1st and the 99th percentile of the depths of pixels that show something.
fn limits(depth: &[f64]) -> (f64, f64) {
    let mut seen: Vec<f64> = depth.iter().copied().filter(|depth| *depth > 0.0).collect();
    seen.sort_by(f64::total_cmp);
    let at = |share: f64| seen[((seen.len() - 1) as f64 * share) as usize];
    (at(0.01), at(0.99))
}

fn check(views: &[(String, f64, [f64; 3])]) {
    for (name, correlation, [own, flat, ramp]) in views {
        eprintln!(
            "{name}: rank correlation {correlation:.3}, residual {own:.3}, flat {flat:.3}, ramp {ramp:.3}"
        );
    }
    let mean = views.iter().map(|(_, correlation, _)| correlation).sum::<f64>() / views.len() as f64;
    eprintln!("{} views: mean rank correlation {mean:.3}", views.len());
    assert!(mean >= 0.9, "the mean rank correlation is {mean}");
    for (name, _, [own, flat, ramp]) in views {
        assert!(own < flat && own < ramp, "{name}: {own} is no better than flat {flat} and ramp {ramp}");
    }
}

/// Measures views of real series from these azimuths. None of the series is among those of training.
fn check_series(azimuths: [&[i32]; 3]) {
    let names = ["head-ge-varspacing-tilt", "crlm-ct-1004", "sts-001-thigh"];
    let mut views = Vec::new();
    for (name, azimuths) in names.into_iter().zip(azimuths) {
        let Some(series) = unpacked("estimated depth of real series", name, &[]) else { return };
        views.extend(measured(&series, &["skin", "bone", "muscle"], azimuths));
    }
    assert_eq!(views.len(), azimuths.iter().map(|azimuths| azimuths.len()).sum::<usize>());
    check(&views);
}

#[test]
fn views_of_unseen_series_are_ordered_in_depth() {
    check_series([&[0, 80, 200], &[50, 170, 290], &[60, 180, 300]]);
}

#[test]
#[ignore = "takes half a minute: twice as many views, in scripts/test --all"]
fn twenty_views_of_unseen_series_are_ordered_in_depth() {
    check_series([
        &[0, 35, 80, 140, 200, 260, 310],
        &[0, 50, 110, 170, 230, 290, 340],
        &[0, 60, 120, 180, 240, 300],
    ]);
}

/// A head whose seed training does not use.
#[test]
fn views_of_an_unseen_procedural_head_are_ordered_in_depth() {
    let folder = tempfile::tempdir().unwrap();
    let head = folder.path().join("head");
    ok(&relief(&["phantom", "--kind", "head", "--size", "128", "--seed", "777", "--out", text(&head)]));
    check(&measured(&head, &["skin", "bone"], &[0, 70, 140, 210]));
}
