//! Two servers of one log: an edit at one is pushed, listed and drawn at the other. With SQLite,
//! and with PostgreSQL.

use std::time::{Duration, Instant};

use axum::http::Method;
use serde_json::{Value, json};
#[cfg(feature = "full")]
use sqlx::{AssertSqlSafe, Executor, Row};
use tokio::time::timeout;

#[cfg(feature = "full")]
use crate::postgres_server::Server as Postgres;
use crate::server::annotations::point;
use crate::server::live_stage::{Client, PATIENCE, Running, intent};
use crate::server::stage::Stage;

/// The next message with events.
async fn reported(client: &mut Client) -> Value {
    loop {
        let message = client.event("annotations").await;
        if message["events"].as_array().is_some_and(|events| !events.is_empty()) {
            return message;
        }
    }
}

/// The entity tag of a picture with annotations.
async fn tag(stage: &Stage) -> String {
    stage.get(&stage.path("frame?layout=color&annotations=true")).await.header("etag").to_owned()
}

/// Waits until something is so.
async fn until(what: &str, mut is_so: impl AsyncFnMut() -> bool) {
    let since = Instant::now();
    while !is_so().await {
        assert!(since.elapsed() < PATIENCE, "{what}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Two servers of one log.
async fn pair(place: &str) -> [Running; 2] {
    [Running::following(place).await, Running::following(place).await]
}

async fn edits_on_one_server_appear_on_the_other(place: &str) {
    let [a, b] = pair(place).await;
    let (mut anna, _) =
        a.hello(json!({ "view": "theatre", "author": "anna", "settings": { "annotations": true } })).await;
    let (mut ben, _) = b.hello(json!({ "author": "ben", "settings": { "annotations": true } })).await;
    anna.still(0).await;
    // Made there, and drawn here in a picture of its own.
    let ids = b.stage.create("ben", json!([point("nasion", [1.0, 2.0, 3.0])])).await;
    let messages = [reported(&mut anna).await, reported(&mut ben).await];
    assert_eq!(messages[0]["events"], messages[1]["events"]);
    let event = &messages[0]["events"][0];
    assert_eq!((&event["author"], &event["set"]), (&json!("ben"), &json!("default")));
    assert!(event["item"].get("frame_of_reference").is_none(), "{event}");
    until("the live picture has the new landmark", async || {
        a.stage.gate.labels().contains(&"nasion".to_owned())
    })
    .await;
    // The other way, by hand.
    anna.send(&intent(1, json!({ "intent": "cursor", "point_mm": [4.0, 0.0, 0.0] }))).await;
    anna.send(&intent(2, json!({ "intent": "place", "phase": "preview" }))).await;
    anna.send(&intent(3, json!({ "intent": "place", "phase": "commit" }))).await;
    assert_eq!(reported(&mut ben).await["events"][0]["author"], "anna");
    reported(&mut anna).await;
    // Frames by request: tags agree, change with the other server's edits, and give 304 at both.
    let before = tag(&a.stage).await;
    assert_eq!(before, tag(&b.stage).await);
    let version = json!({ "changes": [{ "change": "delete", "id": ids[0], "version": 1 }] });
    b.stage.annotate(Method::POST, "", "ben", version).await;
    let after = tag(&a.stage).await;
    assert_ne!(before, after);
    for stage in [&a.stage, &b.stage] {
        let path = stage.path("frame?layout=color&annotations=true");
        assert_eq!(stage.get_with(&path, &[("if-none-match", &after)]).await.status, 304);
        assert_eq!(stage.get_with(&path, &[("if-none-match", &before)]).await.status, 200);
    }
    let gone = reported(&mut anna).await["events"][0].clone();
    assert_eq!((&gone["kind"], &gone["item"], &gone["set"]), (&json!("do"), &Value::Null, &json!("default")));
    b.stage.annotate(Method::POST, "/undo", "ben", json!({})).await;
    let undone = reported(&mut anna).await["events"][0].clone();
    assert_eq!((&undone["kind"], &undone["item"]["name"]), (&json!("undo"), &json!("nasion")));
    assert_eq!(tag(&a.stage).await, before, "the very picture from before");
    // A set that becomes blinded there is blinded here.
    let blinded = json!({ "reader": "ben", "blinded": true });
    b.stage.annotate(Method::PUT, "/sets/default", "ben", blinded).await;
    until("the set is hidden", async || {
        let list = a.stage.annotate(Method::GET, "", "cleo", Value::Null).await.json();
        list["items"].as_array().unwrap().iter().all(|known| known["item"]["name"] != "nasion")
    })
    .await;
    until("the live picture lets go of it", async || !a.stage.gate.labels().contains(&"nasion".to_owned()))
        .await;
}

/// The sequence numbers of the next events, `count` of them.
async fn numbers(client: &mut Client, count: u64) -> Vec<u64> {
    let mut seen = Vec::new();
    while (seen.len() as u64) < count {
        let message = reported(client).await;
        assert_ne!(message["more"], true, "nothing is left out");
        let events = message["events"].as_array().unwrap();
        seen.extend(events.iter().map(|event| event["seq"].as_u64().unwrap()));
    }
    seen
}

async fn edits_of_two_servers_are_told_everywhere_once_and_in_the_order_of_the_log(place: &str) {
    const EACH: u64 = 25;
    let pair = pair(place).await;
    let hello = json!({ "author": "cleo", "settings": { "annotations": true } });
    let (mut first, _) = pair[0].hello(hello.clone()).await;
    let (mut second, _) = pair[1].hello(hello).await;
    let write = |running: usize| {
        let stage = &pair[running].stage;
        async move {
            for i in 0..EACH {
                stage.create("anna", json!([point(&format!("{running}-{i}"), [0.0; 3])])).await;
            }
        }
    };
    // Read meanwhile: a server closes connections that answer no ping.
    let (by_first, by_second) = (numbers(&mut first, 2 * EACH), numbers(&mut second, 2 * EACH));
    let ((), (), by_first, by_second) = tokio::join!(write(0), write(1), by_first, by_second);
    let expected: Vec<u64> = (1..=2 * EACH).collect();
    assert_eq!(by_first, expected);
    assert_eq!(by_second, expected);
    // Both servers know the same items: each adds the other's to its own.
    let [a, b] = &pair;
    let items =
        async |running: &Running| running.stage.annotate(Method::GET, "", "", Value::Null).await.json();
    let known = items(a).await;
    assert_eq!(known["items"].as_array().unwrap().len(), 2 * EACH as usize);
    assert_eq!(known, items(b).await);
}

/// A request may see first that a set was blinded at the other server, before the notification
/// arrives; the picture then no longer shows it.
async fn a_set_that_a_request_sees_first_is_drawn_as_it_is(place: &str) {
    let [a, b] = pair(place).await;
    let (mut anna, _) = a.hello(json!({ "author": "anna", "settings": { "annotations": true } })).await;
    a.stage.create("anna", json!([point("nasion", [0.0; 3])])).await;
    for is_blinded in [true, false] {
        // The cached sets are stale by then. The next request reads them again, and then draws the
        // set.
        while let Ok(frame) = timeout(Duration::from_millis(1100), anna.frame()).await {
            anna.ack(&frame).await;
        }
        let set = json!({ "reader": "ben", "blinded": is_blinded });
        b.stage.annotate(Method::PUT, "/sets/default", "ben", set).await;
        // Where the sets were just read for something else, they are a second old.
        let began = Instant::now();
        loop {
            let list = a.stage.annotate(Method::GET, "", "cleo", Value::Null).await.json();
            if list["items"].as_array().unwrap().is_empty() == is_blinded {
                break;
            }
            assert!(began.elapsed() < PATIENCE, "blinded: {is_blinded}");
        }
        let frame = timeout(PATIENCE, anna.frame()).await.expect("another picture");
        anna.ack(&frame).await;
    }
}

/// An edit that is longer than one read of the log is pushed as one message.
async fn an_edit_of_many_items_is_told_as_one(place: &str) {
    let [a, b] = pair(place).await;
    let (mut anna, _) = a.hello(json!({ "author": "anna", "settings": { "annotations": true } })).await;
    let many: Vec<_> = (0..5500).map(|i| point(&format!("p{i}"), [0.0; 3])).collect();
    let reported = async {
        loop {
            let message = anna.event("annotations").await;
            if message["next"].is_null() {
                return message;
            }
        }
    };
    // Read meanwhile: a server closes connections that answer no ping.
    let (_, reported) = tokio::join!(b.stage.create("ben", many.into()), reported);
    assert_eq!(reported, json!({ "type": "annotations", "seq": 5500, "events": [], "more": true }));
    let list = a.stage.annotate(Method::GET, "", "", Value::Null).await.json();
    assert_eq!(list["items"].as_array().unwrap().len(), 5500);
}

/// The listening connections are cut, then the whole server; edits written meanwhile are pushed all
/// the same.
#[cfg(feature = "full")]
async fn events_written_during_an_outage_are_published_afterwards(postgres: &mut Postgres, name: &str) {
    let [a, b] = pair(&postgres.url(name)).await;
    let (mut anna, _) = a.hello(json!({ "author": "anna", "settings": { "annotations": true } })).await;
    let listening = "FROM pg_stat_activity WHERE datname = current_database() AND query LIKE 'LISTEN%'";
    let count = format!("SELECT count(DISTINCT pid) {listening}");
    let cut = format!("SELECT pg_terminate_backend(pid) {listening}");
    let mut admin = postgres.admin(name).await;
    until("both servers listen", async || {
        let row = admin.fetch_one(AssertSqlSafe(count.as_str())).await.unwrap();
        row.get::<i64, _>(0) == 2
    })
    .await;
    assert_eq!(admin.execute(AssertSqlSafe(cut)).await.unwrap().rows_affected(), 2);
    b.stage.create("ben", json!([point("while deaf", [0.0; 3])])).await;
    assert_eq!(reported(&mut anna).await["events"][0]["item"]["name"], "while deaf");
    drop(admin);
    postgres.crash().await;
    // Right after the crash a connection of the pool may still be one to the server that is gone.
    let created = json!({ "changes": [{ "change": "create", "item": point("after the crash", [0.0; 3]) }] });
    until("the log can be written again", async || {
        b.stage.annotate(Method::POST, "", "ben", created.clone()).await.status == 201
    })
    .await;
    assert_eq!(reported(&mut anna).await["events"][0]["item"]["name"], "after the crash");
}

/// Invariant: Live viewers are notified of every edit in the order of the log, from any server of
/// the log; a server that loses its connection catches up.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_server_of_a_file_sees_and_tells_what_the_first_one_does() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    edits_on_one_server_appear_on_the_other(&place("seen.db")).await;
    edits_of_two_servers_are_told_everywhere_once_and_in_the_order_of_the_log(&place("order.db")).await;
    a_set_that_a_request_sees_first_is_drawn_as_it_is(&place("sets.db")).await;
    an_edit_of_many_items_is_told_as_one(&place("many.db")).await;
}

/// Invariant: Live viewers are notified of every edit in the order of the log, from any server of
/// the log; a server that loses its connection catches up.
#[cfg(feature = "full")]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_second_server_of_a_database_sees_and_tells_what_the_first_one_does() {
    let Some(mut postgres) = Postgres::start("events of two servers of one PostgreSQL database").await else {
        return;
    };
    for name in ["seen", "order", "sets", "deaf"] {
        postgres.database(name).await;
    }
    edits_on_one_server_appear_on_the_other(&postgres.url("seen")).await;
    edits_of_two_servers_are_told_everywhere_once_and_in_the_order_of_the_log(&postgres.url("order")).await;
    a_set_that_a_request_sees_first_is_drawn_as_it_is(&postgres.url("sets")).await;
    events_written_during_an_outage_are_published_afterwards(&mut postgres, "deaf").await;
}
