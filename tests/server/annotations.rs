//! Annotations over HTTP: the whole table, two editors in conflict, blinded sets, and refusals.

use axum::body::Body;
use axum::http::{Method, Request};
use relief_server::Config;
use relief_session::QueueConfig;
use serde_json::{Value, json};

use crate::server::stage::{Answer, FRAME, Stage};

impl Stage {
    /// Asks for a part of the annotations as this author.
    pub(crate) async fn annotate(&self, method: Method, part: &str, author: &str, body: Value) -> Answer {
        self.annotate_with(method, part, &[("relief-author", author)], body).await
    }

    pub(crate) async fn annotate_with(
        &self,
        method: Method,
        part: &str,
        headers: &[(&str, &str)],
        body: Value,
    ) -> Answer {
        let mut request = Request::builder().method(method).uri(self.path(&format!("annotations{part}")));
        for (name, value) in headers.iter().filter(|(_, value)| !value.is_empty()) {
            request = request.header(*name, *value);
        }
        let body = if body.is_null() { Body::empty() } else { Body::from(body.to_string()) };
        let answer = self.ask(request.header("content-type", "application/json").body(body).unwrap()).await;
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        assert!(!text.contains(FRAME), "a UID in an answer: {text}");
        answer
    }

    /// Creates items, and gives their ids.
    pub(crate) async fn create(&self, author: &str, items: Value) -> Vec<String> {
        let changes: Vec<Value> = items
            .as_array()
            .unwrap()
            .iter()
            .map(|item| json!({ "change": "create", "item": item }))
            .collect();
        let made = self.annotate(Method::POST, "", author, json!({ "changes": changes })).await;
        assert_eq!(made.status, 201, "{}", made.text());
        let events = made.json()["events"].as_array().unwrap().clone();
        events.iter().map(|event| event["id"].as_str().unwrap().to_owned()).collect()
    }

    pub(crate) async fn names(&self, author: &str, query: &str) -> Vec<String> {
        let list = self.annotate(Method::GET, query, author, Value::Null).await.json();
        let items = list["items"].as_array().unwrap().clone();
        items.iter().map(|known| known["item"]["name"].as_str().unwrap().to_owned()).collect()
    }
}

pub(crate) fn point(name: &str, at_mm: [f64; 3]) -> Value {
    json!({ "name": name, "geometry": { "kind": "point", "at_mm": at_mm } })
}

#[tokio::test]
async fn a_server_without_a_log_refuses_annotations_with_the_reason() {
    let stage = Stage::new();
    let problem = stage.get(&stage.path("annotations")).await.problem(404);
    assert_eq!(problem["type"], "urn:relief:problem:annotations-off");
    let problem = stage.get(&stage.path("frame?annotations=true&layout=color")).await.problem(404);
    assert_eq!(problem["type"], "urn:relief:problem:annotations-off");
    assert_eq!(stage.get(&stage.path("frame?annotations=false&layout=color")).await.status, 200);
}

#[tokio::test]
async fn items_are_made_listed_changed_deleted_undone_and_logged() {
    let stage = Stage::annotated().await;
    let line = json!({ "name": "width", "set": "s", "order": 1, "frame_of_reference": "9.9.9",
        "geometry": { "kind": "line", "ends_mm": [[0, 0, 0], [3, 4, 0]] } });
    let first = json!({ "name": "nasion", "set": "s", "geometry": { "kind": "point", "at_mm": [1, 2, 3] } });
    let ids = stage.create("Ren%C3%A9e", json!([line, first])).await;
    let list = stage.annotate(Method::GET, "", "", Value::Null).await;
    let tag = list.header("etag").to_owned();
    let found = list.json();
    assert_eq!(found["seq"], 2);
    assert_eq!(found["items"][0]["item"]["name"], "nasion", "in their order");
    assert_eq!(found["items"][1]["measures"], json!([{ "name": "length", "value": 5.0, "unit": "mm" }]));
    assert_eq!(found["items"][0]["item"]["author"], "Renée");
    assert_eq!(found["complete"]["s"], json!({ "defined": 2, "missing": 0, "skipped": 0 }));
    assert_eq!(found["sets"][0]["name"], "s");
    assert_eq!(stage.names("", "?set=other").await, Vec::<String>::new());
    let again = stage.annotate_with(Method::GET, "", &[("if-none-match", &tag)], Value::Null).await;
    assert_eq!(again.status, 304);

    let path = format!("/{}", ids[1]);
    let shown = stage.annotate(Method::GET, &path, "", Value::Null).await;
    assert_eq!((shown.header("etag"), &shown.json()["version"]), ("\"1\"", &json!(1)));
    let mut item = shown.json()["item"].clone();
    item["geometry"]["at_mm"] = json!([1, 2, 4]);
    let put = |condition: &'static str, item: Value| {
        let headers = [("relief-author", "ben"), ("if-match", condition)];
        let (stage, path) = (&stage, path.clone());
        async move { stage.annotate_with(Method::PUT, &path, &headers, item).await }
    };
    assert_eq!(put("", item.clone()).await.problem(428)["type"], "urn:relief:problem:no-version");
    let changed = put("\"1\"", item.clone()).await;
    assert_eq!((changed.status.as_u16(), changed.header("etag")), (200, "\"2\""), "{}", changed.text());
    let changed = changed.json();
    assert_eq!(changed["item"]["geometry"]["at_mm"], json!([1.0, 2.0, 4.0]));
    assert_eq!(
        (&changed["item"]["author"], &changed["events"][0]["author"]),
        (&json!("Renée"), &json!("ben"))
    );

    // Taken back and made again, author by author.
    let undone = stage.annotate(Method::POST, "/undo", "ben", json!({ "reason": "slipped" })).await.json();
    assert_eq!(
        (&undone["events"][0]["kind"], &undone["events"][0]["reason"]),
        (&json!("undo"), &json!("slipped"))
    );
    assert_eq!(undone["events"][0]["item"]["geometry"]["at_mm"], json!([1.0, 2.0, 3.0]));
    let nothing = stage.annotate(Method::POST, "/undo", "ben", Value::Null).await.problem(409);
    assert_eq!(nothing["type"], "urn:relief:problem:nothing-to-undo");
    let redone = stage.annotate(Method::POST, "/redo", "ben", Value::Null).await.json();
    assert_eq!(redone["events"][0]["version"], 4);

    let headers = [("relief-author", "ben"), ("if-match", "\"4\"")];
    let deleted = stage.annotate_with(Method::DELETE, &path, &headers, Value::Null).await;
    assert_eq!(deleted.status, 200);
    let event = &deleted.json()["events"][0];
    assert_eq!((&event["item"], &event["set"]), (&Value::Null, &json!("s")));
    stage.annotate(Method::GET, &path, "", Value::Null).await.problem(404);
    assert_eq!(stage.names("", "").await, ["width"]);

    let log = stage.annotate(Method::GET, "/log", "", Value::Null).await.json();
    let kinds: Vec<_> = log["events"].as_array().unwrap().iter().map(|event| event["kind"].clone()).collect();
    assert_eq!(kinds, ["do", "do", "do", "undo", "redo", "do"]);
    let rest = stage.annotate(Method::GET, "/log?after=3&limit=2", "", Value::Null).await.json();
    assert_eq!(
        (rest["events"].as_array().unwrap().len(), &rest["next"], &rest["seq"]),
        (2, &json!(5), &json!(6))
    );
}

/// Invariant: Concurrent editors never overwrite each other silently; a blinded reader sees one
/// set, and other readers do not see it; no answer contains a UID.
#[tokio::test]
async fn two_editors_never_overwrite_silently() {
    let stage = Stage::annotated().await;
    let id = stage.create("anna", json!([point("gonion", [0.0, 0.0, 0.0])])).await.remove(0);
    let seen =
        stage.annotate(Method::GET, &format!("/{id}"), "ben", Value::Null).await.json()["item"].clone();
    let moved = |x: f64| {
        let mut item = seen.clone();
        item["geometry"]["at_mm"][0] = x.into();
        item
    };
    let edit = |author: &'static str, x: f64| {
        let change = json!({ "change": "update", "version": 1, "item": moved(x) });
        let stage = &stage;
        async move { stage.annotate(Method::POST, "", author, json!({ "changes": [change] })).await }
    };
    assert_eq!(edit("anna", 1.0).await.status, 201);
    let conflict = edit("ben", 2.0).await.problem(409);
    assert_eq!(conflict["type"], "urn:relief:problem:conflict");
    assert_eq!((&conflict["id"], &conflict["expected"]), (&json!(id), &json!(1)));
    assert_eq!(conflict["current"]["version"], 2);
    assert_eq!(conflict["current"]["item"]["geometry"]["at_mm"][0], 1.0);
    assert_eq!(conflict["yours"]["geometry"]["at_mm"][0], 2.0);
    let headers = [("relief-author", "ben"), ("if-match", "\"1\"")];
    let path = format!("/{id}");
    let refused = stage.annotate_with(Method::DELETE, &path, &headers, Value::Null).await.problem(409);
    assert_eq!((&refused["yours"], &refused["current"]["version"]), (&Value::Null, &json!(2)));
    // Undoing a change that another author has changed since is a conflict, too.
    let change = json!({ "change": "update", "version": 2, "item": moved(3.0) });
    assert_eq!(stage.annotate(Method::POST, "", "ben", json!({ "changes": [change] })).await.status, 201);
    let conflict = stage.annotate(Method::POST, "/undo", "anna", Value::Null).await.problem(409);
    assert_eq!(conflict["current"]["item"]["geometry"]["at_mm"][0], 3.0);
    // Of an edit all is made or nothing.
    let changes = json!([
        { "change": "create", "item": point("new", [0.0; 3]) },
        { "change": "update", "version": 1, "item": moved(4.0) },
    ]);
    stage.annotate(Method::POST, "", "ben", json!({ "changes": changes })).await.problem(409);
    assert_eq!(stage.names("", "").await, ["gonion"]);
    // A locked item changes in nothing but its lock.
    let mut locked = moved(3.0);
    locked["locked"] = true.into();
    let lock = json!({ "changes": [{ "change": "update", "version": 3, "item": locked }] });
    assert_eq!(stage.annotate(Method::POST, "", "ben", lock).await.status, 201);
    let headers = [("relief-author", "ben"), ("if-match", "*")];
    let problem = stage.annotate_with(Method::PUT, &path, &headers, moved(5.0)).await.problem(423);
    assert_eq!(problem["type"], "urn:relief:problem:locked");
}

/// Invariant: Concurrent editors never overwrite each other silently; a blinded reader sees one
/// set, and other readers do not see it; no answer contains a UID.
#[tokio::test]
async fn blinded_readers_see_only_their_own_set_and_others_do_not() {
    let stage = Stage::annotated().await;
    for (set, reader) in [("a", "anna"), ("b", "ben")] {
        let body = json!({ "reader": reader, "blinded": true });
        let put = stage.annotate(Method::PUT, &format!("/sets/{set}"), "chief", body).await;
        assert_eq!(put.status, 200, "{}", put.text());
    }
    let of = |set: &str, name: &str| {
        let mut item = point(name, [0.0; 3]);
        item["set"] = set.into();
        json!([item])
    };
    let own = stage.create("anna", of("a", "hers")).await.remove(0);
    stage.create("ben", of("b", "his")).await;
    stage.create("chief", of("open", "everybody's")).await;
    assert_eq!(stage.names("anna", "").await, ["hers"]);
    assert_eq!(stage.names("ben", "").await, ["his"]);
    assert_eq!(stage.names("chief", "").await, ["everybody's"]);
    assert_eq!(stage.names("", "?set=a,b").await, Vec::<String>::new());
    assert_eq!(stage.names("", "?author=anna").await, ["hers"], "for those who can set no header");
    let path = format!("/{own}");
    assert_eq!(stage.annotate(Method::GET, &path, "anna", Value::Null).await.status, 200);
    for other in ["ben", "chief", ""] {
        stage.annotate(Method::GET, &path, other, Value::Null).await.problem(404);
    }
    let headers = [("relief-author", "ben"), ("if-match", "\"1\"")];
    stage.annotate_with(Method::DELETE, &path, &headers, Value::Null).await.problem(404);
    for set in ["a", "open"] {
        let changes = json!({ "changes": [{ "change": "create", "item": of(set, "x")[0] }] });
        let problem = stage.annotate(Method::POST, "", "ben", changes).await.problem(403);
        assert_eq!(problem["type"], "urn:relief:problem:not-your-set");
    }
    let events = |author: &'static str| {
        let stage = &stage;
        async move {
            let log = stage.annotate(Method::GET, "/log", author, Value::Null).await.json();
            log["events"].as_array().unwrap().len()
        }
    };
    // Deleted items of blinded sets stay hidden, too.
    let headers = [("relief-author", "anna"), ("if-match", "\"1\"")];
    assert_eq!(stage.annotate_with(Method::DELETE, &path, &headers, Value::Null).await.status, 200);
    assert_eq!((events("anna").await, events("ben").await, events("chief").await), (2, 1, 1));
    // Opened again.
    stage.annotate(Method::PUT, "/sets/b", "chief", json!({ "reader": "ben" })).await;
    assert_eq!(stage.names("chief", "").await, ["his", "everybody's"]);
    let shown = stage.annotate(Method::GET, "/sets/b", "", Value::Null).await;
    assert_eq!(shown.json(), json!({ "name": "b", "reader": "ben", "blinded": false }));
}

/// Invariant: A set or template that was changed since it was read is not replaced.
#[tokio::test]
async fn sets_and_templates_are_replaced_by_their_tags() {
    let stage = Stage::annotated().await;
    let put = async |path: &str, condition: (&str, &str), body: Value| {
        stage.annotate_with(Method::PUT, path, &[("relief-author", "anna"), condition], body).await
    };
    let template = |name: &str| json!({ "items": [{ "name": name }] });
    for (path, first, second) in [
        ("/sets/b", json!({ "reader": "ben" }), json!({ "reader": "anna" })),
        ("/templates/skull", template("nasion"), template("menton")),
    ] {
        let made = put(path, ("if-none-match", "*"), first.clone()).await;
        assert_eq!(made.status, 200, "{}", made.text());
        put(path, ("if-none-match", "*"), second.clone()).await.problem(412);
        let tag = stage.annotate(Method::GET, path, "", Value::Null).await.header("etag").to_owned();
        assert_eq!(made.header("etag"), tag);
        assert_eq!(put(path, ("if-match", &tag), second.clone()).await.status, 200);
        put(path, ("if-match", &tag), first.clone()).await.problem(412);
        assert_eq!(put(path, ("if-match", "*"), first).await.status, 200);
    }
    // A set that items name exists without a description.
    let tag = stage.annotate(Method::GET, "/sets/default", "", Value::Null).await.header("etag").to_owned();
    assert_eq!(put("/sets/default", ("if-match", &tag), json!({ "reader": "ben" })).await.status, 200);
}

#[tokio::test]
async fn templates_say_what_is_missing() {
    let stage = Stage::annotated().await;
    let template =
        json!({ "items": [{ "name": "nasion" }, { "name": "width", "kind": "line" }, { "name": "menton" }] });
    let put = stage.annotate(Method::PUT, "/templates/skull", "anna", template.clone()).await;
    assert_eq!(put.status, 200, "{}", put.text());
    let shown = stage.annotate(Method::GET, "/templates/skull", "", Value::Null).await.json();
    assert_eq!((&shown["name"], &shown["items"][1]["kind"]), (&json!("skull"), &json!("line")));
    stage.annotate(Method::GET, "/templates/none", "", Value::Null).await.problem(404);
    let bad =
        stage.annotate(Method::PUT, "/templates/bad", "anna", json!({ "items": [{ "nam": "x" }] })).await;
    assert_eq!(bad.problem(400)["path"], "items[0].nam");
    stage.annotate(Method::PUT, "/sets/s", "anna", json!({ "template": "skull" })).await;
    let applied = stage.annotate(Method::POST, "/templates/skull/apply?set=s", "anna", Value::Null).await;
    assert_eq!((applied.status.as_u16(), applied.json()["events"].as_array().unwrap().len()), (201, 3));
    let again = stage.annotate(Method::POST, "/templates/skull/apply?set=s", "anna", Value::Null).await;
    assert_eq!((again.status.as_u16(), again.json()), (200, json!({ "events": [] })));
    let list = stage.annotate(Method::GET, "", "", Value::Null).await.json();
    let expected = json!({ "defined": 0, "missing": 3, "skipped": 0, "template": "skull", "next": "nasion" });
    assert_eq!(list["complete"]["s"], expected);
    assert_eq!(list["items"][0]["item"]["state"], "missing");
}

#[tokio::test]
async fn invalid_fields_are_named() {
    let stage = Stage::annotated().await;
    let create = |item: Value| json!({ "changes": [{ "change": "create", "item": item }] });
    let far = point("far", [0.0, 2e6, 0.0]);
    for (body, author, status, path) in [
        (create(point("a", [0.0; 3])), "", 422, "author"),
        (create(point("", [0.0; 3])), "anna", 422, "changes[0].item.name"),
        (create(far), "anna", 422, "changes[0].item.geometry.at_mm"),
        (create(json!({ "name": "a", "colour": 1 })), "anna", 400, "changes[0]"),
        (json!({ "changes": [] }), "anna", 422, "changes"),
        (json!({ "changes": [], "when": 1 }), "anna", 400, "when"),
        (json!([1]), "anna", 400, "."),
        (create(point("a", [0.0; 3])), "a%0Ab", 400, "author"),
        (create(point("a", [0.0; 3])), "%zz", 400, "Relief-Author"),
    ] {
        let problem = stage.annotate(Method::POST, "", author, body.clone()).await.problem(status);
        assert_eq!(problem["path"], path, "{body}: {problem}");
    }
    let by_body =
        json!({ "author": "anna", "changes": [{ "change": "create", "item": point("a", [0.0; 3]) }] });
    assert_eq!(stage.annotate(Method::POST, "", "", by_body).await.status, 201);
    for path in ["/x", "/00000000-0000-4000-8000-000000000000"] {
        stage.annotate(Method::GET, path, "", Value::Null).await.problem(404);
    }
    for (query, status) in
        [("?set=a%20b", 400), ("?sets=a", 400), ("/log?limit=0", 422), ("/log?limit=1001", 422)]
    {
        stage.annotate(Method::GET, query, "", Value::Null).await.problem(status);
    }
    let headers = [("relief-author", "anna"), ("if-match", "one")];
    let path = format!("/{}", stage.create("anna", json!([point("b", [0.0; 3])])).await[0]);
    stage.annotate_with(Method::PUT, &path, &headers, point("b", [0.0; 3])).await.problem(400);
    stage.annotate(Method::GET, "/contents/abc", "", Value::Null).await.problem(404);
    stage.annotate(Method::PUT, "/sets/a%20b", "anna", json!({})).await.problem(422);
    let other = stage.post(&stage.path("annotations"), "text/plain", "{}").await.problem(415);
    assert_eq!(other["allowed"], "application/json");
    let large = format!("{{\"x\":\"{}\"}}", "a".repeat(17 << 20));
    let large = stage.post(&stage.path("annotations"), "application/json", large).await;
    assert_eq!(large.problem(413)["type"], "urn:relief:problem:too-large");
}

#[tokio::test]
async fn pages_of_other_sites_change_nothing() {
    let stage = Stage::annotated().await;
    for (method, part) in [
        (Method::POST, ""),
        (Method::POST, "/undo"),
        (Method::POST, "/templates/a/apply"),
        (Method::PUT, "/sets/a"),
        (Method::PUT, "/templates/a"),
        (Method::PUT, "/00000000-0000-4000-8000-000000000000"),
        (Method::DELETE, "/00000000-0000-4000-8000-000000000000"),
    ] {
        let headers = [("origin", "http://evil.example"), ("host", "localhost"), ("relief-author", "anna")];
        let refused = stage.annotate_with(method, part, &headers, json!({})).await;
        assert_eq!(refused.problem(403)["type"], "urn:relief:problem:cross-site", "{part}");
    }
}

#[tokio::test]
async fn two_thousand_items_are_listed_at_once() {
    let stage = Stage::annotated().await;
    let many: Vec<Value> = (0..2_000u16).map(|i| point(&format!("p{i}"), [f64::from(i), 0.0, 0.0])).collect();
    stage.create("anna", many.into()).await;
    let list = stage.annotate_with(Method::GET, "", &[], Value::Null).await;
    assert_eq!(list.json()["items"].as_array().unwrap().len(), 2_000);
}

#[tokio::test]
async fn other_servers_of_the_same_kind_have_none() {
    let stage = Stage::with(Config::default(), QueueConfig::default());
    stage.annotate(Method::POST, "", "anna", json!({})).await.problem(404);
}

/// Invariant: Importing a file twice creates no copies unless requested, and reports the items that
/// were there.
#[tokio::test]
async fn files_of_other_tools_come_and_go() {
    let stage = Stage::annotated().await;
    let mut width =
        json!({ "name": "width", "geometry": { "kind": "line", "ends_mm": [[0, 0, 0], [3, 4, 0]] } });
    width["set"] = "s".into();
    let mut nasion = point("nasion", [1.5, -2.0, 3.25]);
    nasion["set"] = "s".into();
    nasion["description"] = "where both bones meet".into();
    stage.create("anna", json!([nasion, width])).await;
    let file = stage.get(&stage.path("annotations/export?format=fcsv&set=s")).await;
    assert_eq!(file.status, 200, "{}", file.text());
    assert_eq!(file.header("content-disposition"), "attachment; filename=\"annotations.fcsv\"");
    assert!(file.text().contains("nasion"), "{}", file.text());
    let report = stage.get(&stage.path("annotations/export?format=fcsv&set=s&report=true")).await.json();
    let left_out = report["left_out"].as_array().unwrap();
    assert_eq!(file.header("relief-left-out"), left_out.len().to_string());
    let what: Vec<_> = left_out.iter().map(|lost| lost["what"].as_str().unwrap()).collect();
    assert_eq!(what, ["lines", "ids, authors, times and ways of placing"], "{report}");

    let octets = "application/octet-stream";
    let import = |query: &str, body: Vec<u8>| {
        let request = Request::post(stage.path(&format!("annotations/import?{query}")));
        let request = request.header("relief-author", "ben").header("content-type", octets);
        stage.ask(request.body(Body::from(body)).unwrap())
    };
    // A repeated import adds no duplicates.
    let there = import("name=back.fcsv&set=back", file.body.clone()).await;
    assert_eq!((there.status.as_u16(), &there.json()["events"]), (200, &json!([])), "{}", there.text());
    assert_eq!(there.json()["there"], json!({ "unchanged": 1, "skipped": 0 }));
    assert!(there.json()["warnings"].to_string().contains("1 items are there already"), "{}", there.text());
    let moved = file.text().replace("3.25", "3.5");
    let skipped = import("name=back.fcsv", moved.clone().into()).await;
    assert_eq!(skipped.json()["there"], json!({ "unchanged": 0, "skipped": 1 }), "{}", skipped.text());
    let dry = import("name=back.fcsv&update=true&dry_run=true", moved.clone().into()).await;
    assert_eq!((dry.status.as_u16(), &dry.json()["events"]), (200, &json!([])), "{}", dry.text());
    let updated = import("name=back.fcsv&update=true", moved.into()).await;
    assert_eq!(updated.json()["events"][0]["item"]["geometry"]["at_mm"], json!([1.5, -2.0, 3.5]));
    assert_eq!(updated.json()["events"][0]["version"], 2);
    import("name=back.fcsv&update=true&duplicate=true", file.body.clone()).await.problem(422);
    let made = import("name=back.fcsv&set=back&duplicate=true", file.body.clone()).await;
    assert_eq!(made.status, 201, "{}", made.text());
    let item = made.json()["events"][0]["item"].clone();
    assert_eq!(
        (&item["name"], &item["set"], &item["author"]),
        (&json!("nasion"), &json!("back"), &json!("ben"))
    );
    assert_eq!(item["geometry"]["at_mm"], json!([1.5, -2.0, 3.25]));
    let before = stage.annotate(Method::GET, "", "", Value::Null).await.json()["seq"].clone();
    for (query, body, status) in [
        ("name=x.fcsv", "# Markups fiducial file version = 4.11\nnot a point", 422),
        ("format=mrk.json", "{\"markups\":7}", 422),
        ("name=unknown.bin", "\x01\x02", 422),
        ("format=doc", "", 400),
        ("formats=fcsv", "", 400),
    ] {
        import(query, body.into()).await.problem(status);
    }
    let after = stage.annotate(Method::GET, "", "", Value::Null).await.json()["seq"].clone();
    assert_eq!(before, after, "bad files change nothing");
    stage.get(&stage.path("annotations/export?format=fcsv&set=none")).await.problem(422);
    // Blinded sets stay out of files.
    stage.annotate(Method::PUT, "/sets/s", "chief", json!({ "reader": "anna", "blinded": true })).await;
    let open = stage.get(&stage.path("annotations/export?format=mrk.json")).await;
    assert_eq!(open.json()["markups"].as_array().unwrap().len(), 1, "{}", open.text());
}

#[tokio::test]
async fn places_snap_to_what_the_volume_has() {
    let stage = Stage::annotated().await;
    // The cube's values rise by 1 along x, 4 along y and 16 along z, each 10 mm: each HU is a
    // plane. Surfaces are 1/64 HU off theirs.
    let body = json!({ "at_mm": [1.0, 2.0, 0.0], "to": "surface", "hu": 32.5, "radius_mm": 10 });
    let found = stage.annotate(Method::POST, "/snap", "", body.clone()).await;
    assert_eq!(found.status, 200, "{}", found.text());
    let found = found.json();
    let at =
        |key: &str| found[key].as_array().unwrap().iter().map(|mm| mm.as_f64().unwrap()).collect::<Vec<_>>();
    let value = 31.5 + at("at_mm")[0] / 10.0 + at("at_mm")[1] * 0.4 + at("at_mm")[2] * 1.6;
    assert!(
        (value - 32.5 - 1.0 / 64.0).abs() < 0.01 && (found["hu"].as_f64().unwrap() - value).abs() < 1e-9,
        "{found}"
    );
    let length = at("shift_mm").iter().map(|mm| mm * mm).sum::<f64>().sqrt();
    assert!((length - found["distance_mm"].as_f64().unwrap()).abs() < 1e-9 && length > 0.0, "{found}");
    // 0.1 HU are missing, and 1/64 by which surfaces are off whole HU: along a line of sight that
    // is y, 0.289 mm.
    let mut along = body.clone();
    along["ray"] = json!([0.0, -3.0, 0.0]);
    let met = stage.annotate(Method::POST, "/snap", "", along).await;
    assert_eq!(met.status, 200, "{}", met.text());
    let met = met.json();
    let shift: Vec<f64> = met["shift_mm"].as_array().unwrap().iter().map(|mm| mm.as_f64().unwrap()).collect();
    assert!(shift[0] == 0.0 && (shift[1] - 0.2890625).abs() < 1e-6 && shift[2] == 0.0, "{met}");
    assert!(at("shift_mm")[2].abs() > 0.02, "without a line of sight the nearest place: {found}");
    let seen = json!({ "pixel": [32, 32], "scene": { "size_px": [64, 64], "display": { "layout": "color" } },
        "to": "surface", "hu": 30.0, "radius_mm": 20 });
    let seen = stage.annotate(Method::POST, "/snap", "", seen).await;
    assert_eq!(seen.status, 200, "{}", seen.text());
    for (key, value, path) in [
        ("to", json!("bone"), "to"),
        ("hu", Value::Null, "hu"),
        ("radius_mm", json!(99), "radius_mm"),
        ("pixel", json!([1, 1]), "at_mm"),
        ("ray", json!([0, 0, 0]), "ray"),
    ] {
        let mut wrong = body.clone();
        wrong[key] = value;
        let problem = stage.annotate(Method::POST, "/snap", "", wrong).await.problem(422);
        assert_eq!(problem["path"], path, "{problem}");
    }
    let nothing = json!({ "at_mm": [0.0, 0.0, 0.0], "to": "surface", "hu": 3000.0 });
    let problem = stage.annotate(Method::POST, "/snap", "", nothing).await.problem(422);
    assert_eq!(problem["type"], "urn:relief:problem:nothing-to-snap-to");
}
