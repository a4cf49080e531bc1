//! Annotations over frames: which are drawn for whom, in which pictures, and when a client has to
//! fetch one again.

use axum::http::Method;
use serde_json::{Value, json};

use crate::server::annotations::point;
use crate::server::stage::{Answer, Stage};

async fn frame(stage: &Stage, query: &str, author: &str) -> Answer {
    let headers = [("relief-author", author)];
    let headers = if author.is_empty() { &[][..] } else { &headers[..] };
    let answer = stage.get_with(&stage.path(&format!("frame?layout=color&{query}")), headers).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer
}

#[tokio::test]
async fn frames_follow_their_parameters() {
    let stage = Stage::annotated().await;
    let mut hidden = point("hidden", [0.0; 3]);
    hidden["visible"] = false.into();
    let mut of_b = point("of b", [5.0, 0.0, 0.0]);
    of_b["set"] = "b".into();
    let missing = json!({ "name": "missing", "state": "missing" });
    let ids = stage.create("anna", json!([point("nasion", [0.0; 3]), hidden, of_b, missing])).await;
    let plain = frame(&stage, "", "").await;
    assert!(stage.gate.labels().is_empty() && plain.headers.get("relief-annotations").is_none());
    let all = frame(&stage, "annotations=true", "").await;
    assert_eq!(stage.gate.labels(), ["of b", "nasion"], "by set");
    assert_eq!(all.header("relief-annotations"), "drawn=2, left_out=0");
    assert_eq!(all.header("vary"), "Accept, Relief-Author");
    frame(&stage, "annotations=b,none", "").await;
    assert_eq!(stage.gate.labels(), ["of b"]);
    let tag = all.header("etag").to_owned();
    assert_ne!(tag, plain.header("etag"));
    let path = stage.path("frame?layout=color&annotations=true");
    assert_eq!(stage.get_with(&path, &[("if-none-match", &tag)]).await.status, 304);

    // By body the same, and in the depth and the pick of it.
    let body = json!({ "annotations": ["b"], "display": { "layout": "color" } }).to_string();
    for (zoom, part) in ["frame", "depth", "pick?u=5&v=5"].into_iter().enumerate() {
        frame(&stage, &format!("zoom=1.{}", zoom + 1), "").await;
        assert!(stage.gate.labels().is_empty());
        let answer = stage
            .post(&stage.path(part), "application/json", body.replace("}}", "},\"size_px\":[64,64]}"))
            .await;
        assert_eq!(answer.status, 200, "{}", answer.text());
    }
    let pick = stage.path("pick?layout=color&u=5&v=5&annotations=true&zoom=3");
    assert_eq!(stage.get(&pick).await.status, 200);
    assert_eq!(stage.gate.labels(), ["of b", "nasion"]);

    // Every edit that shows makes another frame.
    let mut item = point("nasion", [1.0, 0.0, 0.0]);
    item["id"] = json!(ids[0]);
    let edit = json!({ "changes": [{ "change": "update", "version": 1, "item": item }] });
    assert_eq!(stage.annotate(Method::POST, "", "anna", edit).await.status, 201);
    let moved = stage.get_with(&path, &[("if-none-match", &tag)]).await;
    assert_eq!(moved.status, 200);
    stage.annotate(Method::POST, "/undo", "anna", Value::Null).await;
    assert_eq!(stage.get_with(&path, &[("if-none-match", &tag)]).await.status, 304, "as it was");

    let problem = stage.get(&stage.path("frame?annotations=a%20b")).await.problem(400);
    assert_eq!(problem["path"], "annotations");
    let body = r#"{"annotations":7}"#;
    let problem = stage.post(&stage.path("frame"), "application/json", body).await.problem(400);
    assert!(problem["path"].as_str().unwrap().starts_with("annotations"), "{problem}");
}

#[tokio::test]
async fn blinded_sets_are_drawn_for_their_reader_alone() {
    let stage = Stage::annotated().await;
    stage.annotate(Method::PUT, "/sets/a", "chief", json!({ "reader": "anna", "blinded": true })).await;
    let mut hers = point("hers", [0.0; 3]);
    hers["set"] = "a".into();
    stage.create("anna", json!([hers])).await;
    stage.create("chief", json!([point("open", [5.0, 0.0, 0.0])])).await;
    let mut tags = Vec::new();
    for (author, query, labels) in [
        ("anna", "true", &["hers"][..]),
        ("ben", "true", &["open"]),
        ("", "true", &["open"]),
        ("", "a", &[]),
        ("anna", "a", &["hers"]),
        ("anna", "default", &[]),
    ] {
        frame(&stage, "zoom=2", "").await; // another picture between
        let query = format!("annotations={query}&zoom=1.{}", tags.len() + 1);
        tags.push(frame(&stage, &query, author).await.header("etag").to_owned());
        assert_eq!(stage.gate.labels(), labels, "{author}: {query}");
    }
}

#[tokio::test]
async fn a_slice_draws_what_lies_in_it() {
    let stage = Stage::annotated().await;
    stage.create("anna", json!([point("in", [0.0, 0.0, 1.0]), point("off", [0.0, 0.0, 12.0])])).await;
    let answer = stage.get(&stage.path("slice?plane=axial&offset_mm=0&annotations=true")).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(stage.gate.labels(), ["in"]);
    stage.get(&stage.path("slice?plane=axial&offset_mm=11&annotations=true")).await;
    assert_eq!(stage.gate.labels(), ["off"]);
}
