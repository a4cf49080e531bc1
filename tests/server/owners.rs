//! Ownership of sets and templates, and blinded sets in live views, on a server that knows its callers.

use axum::body::Body;
use axum::http::{Method, Request};
use relief_server::{Admission, Config, NewToken, Scope, Tokens, add_token};
use serde_json::{Value, json};

use crate::server::annotations::point;
use crate::server::live_stage::{Came, Client, Running, orbit};
use crate::server::stage::{Answer, Stage};

/// Tokens of anna and ben, who may annotate, and of root, an administrator.
pub(super) struct Known {
    _folder: tempfile::TempDir,
    admission: Admission,
    tokens: [String; 3],
}

pub(super) const ANNA: usize = 0;
pub(super) const BEN: usize = 1;
const ROOT: usize = 2;

pub(super) fn known() -> Known {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tokens");
    let tokens =
        [("anna", Scope::Annotate), ("ben", Scope::Annotate), ("root", Scope::Admin)].map(|(name, scope)| {
            add_token(&file, NewToken { name: name.to_owned(), scope, expires: None }).unwrap()
        });
    let admission = Admission { tokens: Some(Tokens::open(file).unwrap().into()), ..Admission::default() };
    Known { _folder: folder, admission, tokens }
}

impl Known {
    pub(super) fn config(&self) -> Config {
        Config { admission: self.admission.clone(), ..Config::default() }
    }

    /// What a caller sends as `Authorization`.
    pub(super) fn bearer(&self, who: usize) -> String {
        format!("Bearer {}", self.tokens[who])
    }

    /// A request about annotations.
    async fn ask(
        &self,
        stage: &Stage,
        who: usize,
        method: Method,
        path: &str,
        seen: &str,
        body: &Value,
    ) -> Answer {
        let mut request = Request::builder()
            .method(method.clone())
            .uri(stage.path(&format!("annotations{path}")))
            .header("authorization", self.bearer(who));
        if method != Method::GET {
            request = request.header("content-type", "application/json");
        }
        if let Some((name, value)) = seen.split_once(' ') {
            request = request.header(name, value);
        }
        stage.ask(request.body(Body::from(body.to_string())).unwrap()).await
    }

    /// A session of a caller.
    pub(super) async fn hello(&self, running: &Running, who: usize, hello: Value) -> (Client, Value) {
        running.hello_as(&[("authorization", self.bearer(who).as_str())], hello).await
    }
}

fn create(name: &str, set: &str) -> Value {
    let mut item = point(name, [0.0; 3]);
    item["set"] = set.into();
    json!({ "changes": [{ "change": "create", "item": item }] })
}

/// Invariant: Annotators cannot take over the set of another, the default set, or another's template.
/// Administrators can.
#[tokio::test]
async fn sets_and_templates_stay_their_owners() {
    let known = known();
    let stage = Stage::annotated_with(known.config()).await;
    let ask =
        async |who, method, path, seen, body: &Value| known.ask(&stage, who, method, path, seen, body).await;
    let new = "if-none-match *";
    assert_eq!(ask(ANNA, Method::PUT, "/sets/a", new, &json!({ "reader": "anna" })).await.status, 200);
    assert_eq!(ask(ANNA, Method::POST, "", "", &create("hers", "a")).await.status, 201);
    let tag = ask(BEN, Method::GET, "/sets/a", "", &Value::Null).await.header("etag").to_owned();
    let seen = format!("if-match {tag}");
    for body in
        [json!({ "reader": "ben", "blinded": true }), json!({}), json!({ "reader": "anna", "blinded": true })]
    {
        let problem = ask(BEN, Method::PUT, "/sets/a", &seen, &body).await.problem(403);
        assert_eq!(problem["type"], "urn:relief:problem:not-owner");
    }
    // A set without a description, with items of Anna.
    assert_eq!(ask(ANNA, Method::POST, "", "", &create("hers too", "unnamed")).await.status, 201);
    ask(BEN, Method::PUT, "/sets/unnamed", new, &json!({ "reader": "ben" })).await.problem(403);
    ask(BEN, Method::PUT, "/sets/default", new, &json!({ "reader": "ben", "blinded": true }))
        .await
        .problem(403);
    assert_eq!(ask(ANNA, Method::POST, "", "", &create("d", "default")).await.status, 201);
    assert_eq!(ask(ROOT, Method::PUT, "/sets/unnamed", new, &json!({ "reader": "ben" })).await.status, 200);
    let template = json!({ "items": [{ "name": "nasion", "kind": "point" }] });
    let made = ask(ANNA, Method::PUT, "/templates/skull", new, &template).await;
    assert_eq!(made.status, 200, "{}", made.text());
    let seen = format!("if-match {}", made.header("etag"));
    ask(BEN, Method::PUT, "/templates/skull", &seen, &template).await.problem(403);
    assert_eq!(ask(ROOT, Method::PUT, "/templates/skull", &seen, &template).await.status, 200);
}

/// Invariant: Texts of templates and sets count against the limit of the log's contents.
#[tokio::test]
async fn templates_have_a_limit() {
    let stage = Stage::annotated_with(Config { content_bytes: 20_000, ..Config::default() }).await;
    let items: Vec<Value> = (0..100).map(|n| json!({ "name": format!("n{n}"), "kind": "point" })).collect();
    let mut statuses = Vec::new();
    for number in 0..20 {
        let path = format!("/templates/t{number}");
        let headers = [("relief-author", "anna"), ("if-none-match", "*")];
        let answer = stage.annotate_with(Method::PUT, &path, &headers, json!({ "items": items })).await;
        statuses.push(answer.status.as_u16());
    }
    let kept = statuses.iter().filter(|status| **status == 200).count();
    assert!((2..10).contains(&kept) && statuses.ends_with(&[507, 507]), "{statuses:?}");
}

/// Invariant: A live view does not draw or mention a blinded set while one of its viewers may not see it.
#[tokio::test]
async fn live_views_show_blinded_sets_to_their_readers_alone() {
    let known = known();
    let running = Running::annotated_with(known.config()).await;
    let stage = &running.stage;
    let set = json!({ "reader": "anna", "blinded": true });
    assert_eq!(known.ask(stage, ANNA, Method::PUT, "/sets/a", "if-none-match *", &set).await.status, 200);
    assert_eq!(known.ask(stage, ANNA, Method::POST, "", "", &create("annas point", "a")).await.status, 201);
    let mut missing = create("annas next", "a");
    let item = &mut missing["changes"][0]["item"];
    (item["geometry"], item["state"], item["list"]) = (Value::Null, "missing".into(), "l".into());
    assert_eq!(known.ask(stage, ANNA, Method::POST, "", "", &missing).await.status, 201);

    let drawing = |view: &str| json!({ "view": view, "settings": { "annotations": ["a"] } });
    let (mut anna, _) = known.hello(&running, ANNA, drawing("main")).await;
    anna.send(&orbit(1, 5.0)).await;
    anna.still(1).await;
    assert_eq!(stage.gate.labels(), ["annas point"]);
    // Ben watches her view, presents in it, and asks for her set in a view of his own.
    for (view, hello) in [
        ("main", json!({ "view": "main", "role": "watcher" })),
        ("main", json!({ "view": "main" })),
        ("bens", drawing("bens")),
    ] {
        let (mut ben, welcome) = known.hello(&running, BEN, hello).await;
        assert!(!welcome.to_string().contains("annas point"), "{welcome}");
        // The texts that Ben receives with his next two frames.
        let mut texts = Vec::new();
        let mut frames = 0;
        while frames < 2 {
            match ben.next().await {
                Came::Text(text) => texts.push(text.to_string()),
                Came::Frame(frame) => {
                    ben.ack(&frame).await;
                    assert_eq!(stage.gate.labels(), Vec::<String>::new(), "{view}");
                    frames += 1;
                    if view == "main" {
                        anna.send(&orbit(1 + frames, 5.0)).await;
                    }
                    ben.send(&orbit(frames, 3.0)).await;
                }
                Came::Closed(code) => panic!("closed with {code:?}"),
            }
        }
        assert!(
            texts.iter().all(|text| !text.contains("annas point") && !text.contains("annas next")),
            "{texts:?}"
        );
        drop(ben);
    }
    // After he has left, her set is drawn again.
    for seq in 10.. {
        anna.send(&orbit(seq, 2.0)).await;
        anna.still(seq).await;
        if stage.gate.labels() == ["annas point"] {
            break;
        }
        assert!(seq < 1000, "the drawings stay away");
    }
}
