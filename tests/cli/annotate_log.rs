//! `relief annotate list`, `log`, `undo`, `redo`, `sets` and `check`, as people and programs see
//! them.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::process::{Command, Output};

use relief_annotation::{Change, Edit, Geometry, Item};
use relief_base::Point;
use relief_store::Store;
use serde_json::Value;

fn relief(db: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.env_remove("RELIEF_AUTHOR").env_remove("RELIEF_ANNOTATIONS");
    command.arg("annotate").arg("--db").arg(db).args(arguments).output().unwrap()
}

fn said(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

fn reported(db: &Path, arguments: &[&str]) -> String {
    let (status, out, error) = said(&relief(db, arguments));
    assert_eq!((status, error.as_str()), (0, ""), "{arguments:?}");
    out
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Anna's line and point; ben has moved the point.
fn seeded(db: &Path) {
    let at = |x| Point::new(x, 2.0, -3.5);
    let item = |name: &str, geometry| Item::new(name, "anna", Some(geometry)).unwrap();
    let point = item("nasion", Geometry::Point { at_mm: at(1.0) });
    let line =
        Item { order: 1, locked: true, ..item("width", Geometry::Line { ends_mm: [at(0.0), at(12.0)] }) };
    let create = |item: &Item| Change::Create { item: Box::new(item.clone()) };
    let edit = |author: &str, reason: &str, changes| Edit {
        author: author.to_owned(),
        reason: reason.to_owned(),
        changes,
    };
    let moved = Item { geometry: Some(Geometry::Point { at_mm: at(4.0) }), ..point.clone() };
    let edits = [
        edit("anna", "first reading", vec![create(&point), create(&line)]),
        edit("ben", "bone is here", vec![Change::Update { item: Box::new(moved), version: 1 }]),
    ];
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let store = Store::open(db.to_str().unwrap()).await.unwrap();
        for edit in edits {
            store.apply(&edit).await.unwrap();
        }
        store.close().await;
    });
}

#[test]
fn list_and_log_print_items_and_changes() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("ann.db");
    seeded(&db);
    let list = reported(&db, &["list"]);
    assert!(list.contains("nasion  point  (4.00, 2.00, -3.50)  anna    2"), "{list}");
    assert!(list.contains("width   line   12.00 mm") && list.contains("locked"), "{list}");
    assert!(reported(&db, &["list", "--set", "ben"]).contains("no items"));
    let listed = json(&relief(&db, &["list", "--json"]));
    assert_eq!((listed["seq"].as_u64(), listed["items"].as_array().unwrap().len()), (Some(3), 2));
    assert_eq!(listed["items"][1]["measures"][0]["value"], 12.0);
    let log = reported(&db, &["log"]);
    assert_eq!(log.lines().count(), 4, "{log}");
    assert!(log.contains("first reading") && log.lines().last().unwrap().ends_with("bone is here"), "{log}");
    let events = json(&relief(&db, &["log", "--by", "ben", "--json"]));
    assert_eq!(events["events"][0]["seq"], 3);
    assert_eq!(
        json(&relief(&db, &["check", "--json"])),
        serde_json::json!({"events":3,"items":2,"contents":0})
    );
}

#[test]
fn edits_are_taken_back_and_conflicts_shown() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("ann.db");
    seeded(&db);
    let (status, out, error) = said(&relief(&db, &["undo", "--author", "anna"]));
    assert_eq!(status, 1);
    assert!(
        out.contains("as it is") && out.contains("(4.00, 2.00, -3.50)") && out.contains("(gone)"),
        "{out}"
    );
    assert!(error.contains("has version 2 by now; you saw 1"), "{error}");
    let refused = relief(&db, &["undo", "--author", "anna", "--json"]);
    let shown = json(&refused);
    assert_eq!((refused.status.code(), shown["conflict"]["current"]["version"].as_u64()), (Some(1), Some(2)));
    assert_eq!(shown["conflict"]["yours"], Value::Null);

    let undone = reported(&db, &["undo", "--author", "ben", "--reason", "a mistake"]);
    assert!(undone.contains("changed, taking back 3") && undone.contains("nasion"), "{undone}");
    reported(&db, &["undo", "--author", "anna"]);
    assert!(reported(&db, &["list"]).contains("no items"));
    let redone = json(&relief(&db, &["redo", "--author", "anna", "--times", "9", "--json"]));
    assert_eq!(redone["events"].as_array().unwrap().len(), 2);
    let (status, _, error) = said(&relief(&db, &["redo", "--author", "anna"]));
    assert!(status == 1 && error.contains("this author has no edit to redo"), "{error}");
}

#[test]
fn sets_are_made_and_their_history_told() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("ann.db");
    let (status, _, error) = said(&relief(&db, &["list"]));
    assert!(status == 1 && error.contains("there is no log"), "{error}");
    assert!(!db.exists(), "a question makes no log");
    reported(&db, &["sets", "put", "anna", "--reader", "anna", "--blinded", "--author", "chief"]);
    let sets = json(&relief(&db, &["sets", "--json"]));
    assert_eq!(sets["sets"][0]["set"]["blinded"], true);
    assert!(reported(&db, &["sets", "--history"]).contains("chief"));
    let (status, _, error) = said(&relief(&db, &["sets", "put", "a b", "--author", "chief"]));
    assert!(status == 1 && error.contains("letters, digits"), "{error}");
    let help = said(&relief(&db, &["--help"])).1;
    for command in ["list", "log", "undo", "redo", "sets", "check"] {
        assert!(help.contains(&format!("\n  {command} ")), "{command}");
    }
    let mut without = Command::new(env!("CARGO_BIN_EXE_relief"));
    let without = without.args(["annotate", "list"]).env_remove("RELIEF_ANNOTATIONS").output();
    let without = said(&without.unwrap());
    assert!(without.0 == 2 && without.2.contains("--db"), "{without:?}");
    std::fs::write(&db, "no database").unwrap();
    let (status, _, error) = said(&relief(&db, &["check"]));
    assert!(status == 1 && error.contains("not a log of Relief"), "{error}");
}
