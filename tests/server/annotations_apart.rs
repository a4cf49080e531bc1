//! Several volumes of one log, and sets of several readers: a request about one does not affect
//! another. Authors that requests name.

use axum::body::Body;
use axum::http::{Method, Request};
use relief_annotation::{Change, Edit, FrameOfReference, Geometry, Item};
use relief_base::Point;
use relief_store::{Filter, Store};
use serde_json::{Value, json};

use crate::server::annotations::point;
use crate::server::stage::{FRAME, Stage};

/// A server of two volumes: the first of them is asked, the second is the id that comes with it.
async fn two_volumes() -> (Stage, String) {
    let stage = Stage::annotated().await;
    let zip = crate::server::uploads::series_zip(9);
    let uploaded = stage.post("/v1/volumes", "application/zip", zip).await.json();
    (stage, uploaded["id"].as_str().unwrap().to_owned())
}

/// The same server, asked for another volume.
fn turned(stage: Stage, to: String) -> (Stage, String) {
    let from = stage.id.clone();
    (Stage { id: to, ..stage }, from)
}

/// The log of the server.
async fn log(stage: &Stage) -> Store {
    let folder = stage._folder.as_ref().unwrap();
    Store::open_existing(folder.path().join("log.db").to_str().unwrap()).await.unwrap()
}

async fn listed(stage: &Stage) -> Value {
    stage.annotate(Method::GET, "", "anna", Value::Null).await.json()
}

/// Two volumes of one log: each shows its own items, and an undo never reaches the other.
#[tokio::test]
async fn volumes_of_one_log_are_apart() {
    let (stage, other) = two_volumes().await;
    let (other, here) = turned(stage, other);
    let first = other.path("annotations");
    let id = other.create("anna", json!([point("there", [0.0; 3])])).await.remove(0);
    assert_eq!(other.names("", "").await, ["there"]);
    let (here, _) = turned(other, here);
    assert_ne!(first, here.path("annotations"));
    assert_eq!(here.names("", "").await, Vec::<String>::new());
    here.annotate(Method::GET, &format!("/{id}"), "", Value::Null).await.problem(404);
    let elsewhere = here.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(409);
    assert!(elsewhere["detail"].as_str().unwrap().contains("another volume"), "{elsewhere}");
    let log = here.annotate(Method::GET, "/log", "", Value::Null).await.json();
    assert_eq!((&log["events"], &log["next"]), (&json!([]), &json!(1)));
}

/// Invariant: Requests about one volume, or about another author's set, change nothing else.
///
/// Every way to change an item, asked of a volume that it is not of: it is not there, and stays as
/// it is where it is.
#[tokio::test]
async fn items_of_another_volume_are_not_changed_from_here() {
    let (stage, other) = two_volumes().await;
    let (there, here) = turned(stage, other);
    let id = there.create("anna", json!([point("there", [1.0, 2.0, 3.0])])).await.remove(0);
    let paint = json!({ "center_mm": [4, 4, 4], "radius_mm": 3, "mode": "add", "name": "region" });
    let painted = there.annotate(Method::POST, "/paint", "anna", paint.clone()).await;
    assert_eq!(painted.status, 201, "{}", painted.text());
    let region = painted.json()["events"][0]["id"].clone();
    let curve = json!({ "name": "curve", "geometry": { "kind": "curve", "closed": true, "smooth": false,
        "points_mm": [[0, 0, 0], [9, 0, 0], [0, 9, 0]] } });
    let curve = there.create("anna", json!([curve])).await.remove(0);
    let before = listed(&there).await;
    let (here, there) = turned(there, here);

    let nowhere = "urn:relief:problem:no-such-item";
    let mut item = point("mine now", [0.0; 3]);
    item["id"] = id.as_str().into();
    for change in [
        json!({ "change": "update", "version": 1, "item": item }),
        json!({ "change": "delete", "version": 1, "id": id }),
    ] {
        let beside = json!({ "change": "create", "item": point("beside", [0.0; 3]) });
        for changes in [json!([change]), json!([beside, change])] {
            let refused = here.annotate(Method::POST, "", "anna", json!({ "changes": changes })).await;
            assert_eq!(refused.problem(404)["type"], nowhere, "{changes}");
        }
    }
    for (method, body) in [(Method::PUT, item.clone()), (Method::DELETE, Value::Null)] {
        for version in ["\"1\"", "*"] {
            let headers = [("relief-author", "anna"), ("if-match", version)];
            let refused = here.annotate_with(method.clone(), &format!("/{id}"), &headers, body.clone()).await;
            assert_eq!(refused.problem(404)["type"], nowhere, "{method} {version}");
        }
    }
    let mut paint = paint;
    paint["region"] = region.clone();
    for (part, body) in
        [("/paint", paint), ("/mesh", json!({ "region": region })), ("/fill", json!({ "curves": [curve] }))]
    {
        let refused = here.annotate(Method::POST, part, "anna", body).await;
        assert_eq!(refused.problem(404)["type"], nowhere, "{part}");
    }
    let step = here.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(409);
    assert_eq!(step["type"], "urn:relief:problem:nothing-to-undo");
    assert_eq!(listed(&here).await["items"], json!([]));
    let (there, here) = turned(here, there);
    assert_eq!(listed(&there).await, before, "nothing has changed there");

    // Taken back there, it cannot be made again from here.
    there.annotate(Method::POST, "/undo", "anna", Value::Null).await;
    let undone = listed(&there).await;
    let (here, there) = turned(there, here);
    let step = here.annotate(Method::POST, "/redo", "anna", Value::Null).await.problem(409);
    assert_eq!(step["type"], "urn:relief:problem:nothing-to-redo");
    // Of a deleted item of another volume, a client learns only that the id is in use.
    let gone =
        json!({ "change": "update", "version": 1, "item": { "id": curve, "name": "x", "state": "missing" } });
    let gone = here.annotate(Method::POST, "", "anna", json!({ "changes": [gone] })).await.problem(409);
    assert_eq!((&gone["current"], &gone["yours"]["name"]), (&Value::Null, &json!("x")));
    let mut same = point("same id", [0.0; 3]);
    same["id"] = id.as_str().into();
    let same = json!({ "changes": [{ "change": "create", "item": same }] });
    here.annotate(Method::POST, "", "anna", same).await.problem(409);
    let (there, _) = turned(here, there);
    assert_eq!(listed(&there).await, undone);
}

/// Invariant: Requests about one volume, or about another author's set, change nothing else.
///
/// An edit that another program made of items of two volumes is taken back from neither.
#[tokio::test]
async fn an_edit_of_two_volumes_is_taken_back_from_neither() {
    let (stage, other) = two_volumes().await;
    let (there, here) = turned(stage, other);
    there.create("chief", json!([point("there", [0.0; 3])])).await;
    let log = log(&there).await;
    let known = log.list(&Filter::default()).await.unwrap().items.remove(0);
    let frames = [Some(FrameOfReference(FRAME.to_owned())), known.item.frame_of_reference];
    let changes = frames.into_iter().map(|frame_of_reference| {
        let geometry = Geometry::Point { at_mm: Point::new(1.0, 2.0, 3.0) };
        let item = Item::new("both", "anna", Some(geometry)).unwrap();
        Change::Create { item: Box::new(Item { frame_of_reference, ..item }) }
    });
    let edit = Edit { author: "anna".to_owned(), reason: String::new(), changes: changes.collect() };
    log.apply(&edit).await.unwrap();
    let mut stage = turned(there, here);
    for _ in 0..2 {
        assert!(stage.0.names("", "").await.contains(&"both".to_owned()));
        let refused = stage.0.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(409);
        assert!(refused["detail"].as_str().unwrap().contains("another volume"), "{refused}");
        stage = turned(stage.0, stage.1);
    }
    assert_eq!(log.seq().await.unwrap(), 3);
    log.undo("anna", "").await.unwrap();
    assert_eq!(stage.0.names("", "").await, Vec::<String>::new());
}

/// Invariant: Requests about one volume, or about another author's set, change nothing else.
///
/// Items that belong to another reader by now are neither undone nor shown by a step.
#[tokio::test]
async fn undo_leaves_sets_of_other_readers_alone() {
    let stage = Stage::annotated().await;
    let id = stage.create("anna", json!([point("hers", [0.0; 3])])).await.remove(0);
    stage.annotate(Method::PUT, "/sets/default", "chief", json!({ "reader": "ben", "blinded": true })).await;
    let refused = stage.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(403);
    assert_eq!(refused["type"], "urn:relief:problem:not-your-set");
    // The same holds for items that were changed there, which a conflict would show.
    let mut item = point("his", [5.0, 0.0, 0.0]);
    item["id"] = id.as_str().into();
    let changes = json!({ "changes": [{ "change": "update", "version": 1, "item": item }] });
    assert_eq!(stage.annotate(Method::POST, "", "ben", changes).await.status, 201);
    let refused = stage.annotate(Method::POST, "/undo", "anna", Value::Null).await;
    assert!(!refused.text().contains("his"), "{}", refused.text());
    refused.problem(403);
    assert_eq!(stage.names("ben", "").await, ["his"]);
    stage.annotate(Method::PUT, "/sets/default", "chief", json!({})).await;
    let conflict = stage.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(409);
    assert_eq!(conflict["current"]["item"]["name"], "his");
}

/// An imported file stays separate from items with the same ids elsewhere.
#[tokio::test]
async fn a_file_of_another_volume_comes_in_beside_it() {
    let (stage, other) = two_volumes().await;
    let (there, here) = turned(stage, other);
    there.create("anna", json!([point("there", [1.0, 2.0, 3.0])])).await;
    let before = listed(&there).await;
    let file = there.get(&there.path("annotations/export?format=mrk.json")).await;
    let (here, there) = turned(there, here);
    let path = here.path("annotations/import?format=mrk.json&update=true");
    let request = Request::post(path).header("relief-author", "anna");
    let request = request.header("content-type", "application/octet-stream").body(Body::from(file.body));
    let made = here.ask(request.unwrap()).await;
    assert_eq!(made.status, 201, "{}", made.text());
    assert_eq!(here.names("", "").await, ["there"]);
    let (there, _) = turned(here, there);
    assert_eq!(listed(&there).await["items"], before["items"]);
}

#[tokio::test]
async fn an_author_that_is_no_text_is_refused_and_not_ignored() {
    let stage = Stage::annotated().await;
    let item = point("nasion", [1.0, 2.0, 3.0]);
    let create =
        |author: Value| json!({ "author": author, "changes": [{ "change": "create", "item": item }] });
    let refused = stage.annotate(Method::POST, "", "ben", create(json!(7))).await.problem(400);
    assert_eq!(refused["type"], "urn:relief:problem:malformed-author");
    let made = stage.annotate(Method::POST, "", "ben", create(Value::Null)).await;
    assert_eq!((made.status.as_u16(), &made.json()["events"][0]["author"]), (201, &json!("ben")));
}

#[tokio::test]
async fn templates_come_with_the_program_until_the_log_has_others() {
    let stage = Stage::annotated().await;
    let template = json!({ "items": [{ "name": "nasion" }] });
    let names = stage.annotate(Method::GET, "/templates", "", Value::Null).await.json();
    let ready = json!(["aortic-root", "cephalometry", "pelvis", "spine"]);
    assert_eq!((&names["templates"], &names["ready"]), (&json!([]), &ready));
    let applied =
        stage.annotate(Method::POST, "/templates/aortic-root/apply?set=t", "anna", Value::Null).await;
    assert_eq!((applied.status.as_u16(), applied.json()["events"].as_array().unwrap().len()), (201, 11));
    stage.annotate(Method::PUT, "/templates/spine", "anna", template).await;
    let shown = stage.annotate(Method::GET, "/templates/spine", "", Value::Null).await.json();
    assert_eq!(shown["items"][0]["name"], "nasion");
}
