//! Files that are no logs, damaged logs, logs of other versions, and disks that refuse.

use std::path::Path;

use relief_annotation::{Change, ItemId};
use relief_store::{Filter, LogFilter, Store, StoreError};
use sqlx::{Connection, Executor, Row};

use crate::store::made::{Made, create, edit, names, point};

#[tokio::test]
async fn a_log_is_the_same_after_it_was_closed() {
    let made = Made::new().await;
    let store = &made.store;
    let items: Vec<_> = (0..20).map(|i| point(&format!("p{i}"), f64::from(i) / 7.0)).collect();
    let changes: Vec<Change> = items.iter().map(create).collect();
    store.apply(&edit("anna", changes)).await.unwrap();
    store.undo("anna", "").await.unwrap();
    store.redo("anna", "").await.unwrap();
    let before = store.list(&Filter::default()).await.unwrap();
    store.close().await;
    assert!(!made.file.with_extension("db-wal").exists(), "one file again");
    let again = Store::open_existing(made.place()).await.unwrap();
    assert_eq!(again.list(&Filter::default()).await.unwrap(), before);
    assert_eq!(before.seq, 60);
    again.undo("anna", "the day after").await.unwrap();
    assert!(names(&again).await.is_empty());
    let nowhere = Store::open_existing("nowhere.db").await.unwrap_err();
    assert!(matches!(nowhere, StoreError::Unreachable(_)), "{nowhere}");
    assert!(matches!(again.item(ItemId::from_number(7)).await, Err(StoreError::NotFound { .. })));
}

/// A log with something in it, closed: one file.
async fn closed() -> Made {
    let made = Made::new().await;
    let changes = (0..200).map(|i| create(&point(&format!("landmark {i}"), f64::from(i)))).collect();
    made.store.apply(&edit("anna", changes)).await.unwrap();
    made.store.put_content("text/plain", &[7; 50_000]).await.unwrap();
    made.store.close().await;
    made
}

async fn raw(file: &Path) -> sqlx::SqliteConnection {
    sqlx::SqliteConnection::connect(&format!("sqlite://{}", file.display())).await.unwrap()
}

/// Opens it and performs every operation. No panic, and an error states the fault.
async fn use_all(place: &str) -> Result<(), StoreError> {
    let store = Store::open(place).await?;
    let used = async {
        store.list(&Filter::default()).await?;
        store.log(&LogFilter::default()).await?;
        store.sets().await?;
        store.audit().await?;
        store.apply(&edit("ben", vec![create(&point("new", 0.0))])).await?;
        store.undo("ben", "").await?;
        store.check().await.map(|_| ())
    };
    let used = used.await;
    store.close().await;
    used
}

#[tokio::test]
async fn other_files_are_no_logs() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [
        ("text.db", b"name,x,y,z\nnasion,1,2,3\n".repeat(100)),
        ("zeros.db", vec![0; 8192]),
        ("short.db", b"SQLite format 3\0".to_vec()),
        ("head.db", [b"SQLite format 3\0".to_vec(), vec![0xff; 4096]].concat()),
    ] {
        let file = folder.path().join(name);
        std::fs::write(&file, &bytes).unwrap();
        let refused = Store::open(file.to_str().unwrap()).await.unwrap_err();
        assert!(matches!(refused, StoreError::Foreign(_) | StoreError::Damaged(_)), "{name}: {refused:?}");
        assert_eq!(std::fs::read(&file).unwrap(), bytes, "{name} is as it was");
    }
    let file = folder.path().join("other.db");
    std::fs::write(&file, b"").unwrap();
    let mut other = raw(&file).await;
    other.execute("CREATE TABLE invoices (n INTEGER)").await.unwrap();
    other.close().await.unwrap();
    let refused = Store::open(file.to_str().unwrap()).await.unwrap_err();
    assert!(refused.to_string().contains("belongs to another program"), "{refused}");
    let refused = Store::open(folder.path().to_str().unwrap()).await.unwrap_err();
    assert!(matches!(refused, StoreError::Unreachable(_)), "a folder: {refused:?}");
    let refused = Store::open(folder.path().join("no/such/folder.db").to_str().unwrap()).await.unwrap_err();
    assert!(matches!(refused, StoreError::Unreachable(_)), "{refused:?}");
}

#[tokio::test]
async fn a_newer_schema_is_refused_and_left_alone() {
    let made = closed().await;
    let mut newer = raw(&made.file).await;
    newer.execute("UPDATE meta SET value = '2' WHERE key = 'schema'").await.unwrap();
    newer.close().await.unwrap();
    let before = std::fs::read(&made.file).unwrap();
    let refused = Store::open(made.place()).await.unwrap_err();
    assert!(matches!(refused, StoreError::Schema { found: 2, known: 1 }), "{refused}");
    assert!(refused.to_string().contains("use a newer one"), "{refused}");
    assert!(std::fs::read(&made.file).unwrap() == before);
    let mut odd = raw(&made.file).await;
    odd.execute("UPDATE meta SET value = 'x' WHERE key = 'schema'").await.unwrap();
    odd.close().await.unwrap();
    assert!(matches!(Store::open(made.place()).await, Err(StoreError::Damaged(_))));
}

/// Invariant: Events never change, and the items equal the fold of the events.
#[tokio::test]
async fn lines_of_the_log_are_never_altered() {
    let made = closed().await;
    let mut other = raw(&made.file).await;
    for statement in [
        "UPDATE events SET author = 'ben' WHERE seq = 3",
        "DELETE FROM events",
        "DELETE FROM contents",
        "UPDATE contents SET bytes = x'00'",
        "DELETE FROM audit WHERE seq > 0",
        "INSERT INTO events SELECT seq + 500, edit, kind, target, id, version + 1, author, reason, time, item, content \
            FROM events WHERE seq = 1",
        "INSERT INTO events SELECT 201, 201, kind, target, id, version, author, reason, time, item, content \
            FROM events WHERE seq = 1",
        "INSERT OR REPLACE INTO events SELECT seq, edit, kind, target, id, version, 'ben', reason, time, item, content \
            FROM events WHERE seq = 1",
    ] {
        let refused = other.execute(statement).await;
        let done = refused.as_ref().is_ok_and(|done| done.rows_affected() > 0);
        assert!(!done, "{statement}");
        assert!(refused.is_err() || statement.contains("audit"), "{statement}");
    }
    other.close().await.unwrap();
    made_is_whole(&made).await;
}

async fn made_is_whole(made: &Made) {
    let store = Store::open(made.place()).await.unwrap();
    assert_eq!(store.check().await.unwrap().events, 200);
    store.close().await;
}

/// Invariant: Events never change, and the items equal the fold of the events.
#[tokio::test]
async fn check_finds_what_was_changed_behind_the_logs_back() {
    for (statement, says) in [
        ("UPDATE items SET version = 9 WHERE seq = 5", "event 5"),
        ("UPDATE items SET set_name = 'ben' WHERE seq = 5", "event 5"),
        ("DELETE FROM items WHERE seq = 5", "items missing: 1"),
        ("UPDATE edits SET state = 'undone'", "edit 1"),
        (
            "DROP TRIGGER events_never_delete; DELETE FROM items WHERE seq = 200; DELETE FROM events WHERE seq = 200; \
            DELETE FROM events WHERE seq = 100",
            "event 101",
        ),
        (
            "DROP TRIGGER events_never_update; UPDATE events SET item = '{}' WHERE seq = 7",
            "item cannot be read",
        ),
        ("DROP TRIGGER events_never_update; UPDATE events SET author = 'ben' WHERE seq = 7", "event 7"),
        ("DROP TRIGGER contents_never_update; UPDATE contents SET bytes = x'00'", "other bytes"),
    ] {
        let made = closed().await;
        let mut other = raw(&made.file).await;
        other.execute("PRAGMA foreign_keys = OFF").await.unwrap();
        sqlx::raw_sql(statement).execute(&mut other).await.unwrap();
        other.close().await.unwrap();
        let found = Store::open(made.place()).await.unwrap().check().await.unwrap_err().to_string();
        assert!(found.contains("damaged") && found.contains(says), "{statement}: {found}");
        assert!(!found.contains("landmark"), "no names: {found}");
    }
}

/// Cut or changed at any place: an error, or complete data; never a panic.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn damaged_files_are_errors() {
    let made = closed().await;
    let whole = std::fs::read(&made.file).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("damaged.db");
    let attempt = async |bytes: &[u8]| {
        for journal in ["damaged.db-wal", "damaged.db-shm"] {
            let _ = std::fs::remove_file(folder.path().join(journal));
        }
        std::fs::write(&file, bytes).unwrap();
        use_all(file.to_str().unwrap()).await
    };
    attempt(&whole).await.unwrap();
    let mut refused = 0;
    for part in 1..12 {
        let length = whole.len() * part / 12;
        let error = attempt(&whole[..length]).await.expect_err("a part of a log is no log");
        let reported = matches!(error, StoreError::Damaged(_) | StoreError::Foreign(_));
        assert!(reported, "{length} bytes: {error:?}");
        refused += 1;
    }
    // Whole pages, where they hurt most: the tables' roots come first.
    for page in (0..whole.len() / 4096).step_by(7) {
        for fill in [0x00, 0xff, 0x5a] {
            let mut bytes = whole.clone();
            bytes[page * 4096..(page + 1) * 4096].fill(fill);
            refused += usize::from(attempt(&bytes).await.is_err());
        }
    }
    for at in (16..whole.len()).step_by(whole.len() / 60) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0xff;
        refused += usize::from(attempt(&bytes).await.is_err());
    }
    assert!(refused > 20, "{refused}");
}

#[tokio::test]
async fn a_log_that_may_only_be_read_is_read() {
    let made = closed().await;
    for ending in ["?mode=ro", "?immutable=1"] {
        let store = Store::open(&format!("sqlite:{}{ending}", made.place())).await.unwrap();
        assert_eq!(names(&store).await.len(), 200);
        store.check().await.unwrap();
        let refused = store.apply(&edit("ben", vec![create(&point("new", 0.0))])).await.unwrap_err();
        assert!(matches!(refused, StoreError::ReadOnly), "{refused:?}");
        assert!(matches!(store.undo("anna", "").await, Err(StoreError::ReadOnly)));
        assert!(matches!(store.put_content("text/plain", b"x").await, Err(StoreError::ReadOnly)));
        store.close().await;
    }
    let empty = made.file.with_file_name("empty.db");
    std::fs::write(&empty, b"").unwrap();
    let refused = Store::open(&format!("sqlite:{}?mode=ro", empty.display())).await.unwrap_err();
    assert!(matches!(refused, StoreError::Foreign(_)), "{refused:?}");
}

/// A disk that gets full is played by SQLite's own limit of pages; the edit that did not fit leaves
/// nothing behind.
#[tokio::test]
async fn an_edit_that_finds_no_room_leaves_nothing() {
    let made = closed().await;
    let large: Vec<Change> = (0..3000).map(|i| create(&point(&format!("large {i}"), f64::from(i)))).collect();
    // The limit is a connection's own; a file system that refuses is in `killed`.
    let mut other = raw(&made.file).await;
    let pages: i64 = other.fetch_one("PRAGMA page_count").await.unwrap().get(0);
    other.execute(sqlx::AssertSqlSafe(format!("PRAGMA max_page_count = {pages}"))).await.unwrap();
    let refused =
        other.execute("INSERT INTO contents VALUES ('x', 'y', zeroblob(100000))").await.unwrap_err();
    assert!(matches!(StoreError::from(refused), StoreError::Full));
    other.close().await.unwrap();
    made_is_whole(&made).await;
    let store = Store::open(made.place()).await.unwrap();
    store.apply(&edit("anna", large)).await.unwrap();
    assert_eq!(store.check().await.unwrap().items, 3200);
}

/// Invariant: A log whose file was moved, removed or replaced acknowledges no changes until the file is
/// back at its path.
#[tokio::test]
async fn a_file_that_is_gone_takes_no_edits() {
    let folder = tempfile::tempdir().unwrap();
    let [place, away, other] = ["log.db", "away.db", "other.db"].map(|name| folder.path().join(name));
    let store = Store::open(place.to_str().unwrap()).await.unwrap();
    store.apply(&edit("anna", vec![create(&point("a", 0.0))])).await.unwrap();
    std::fs::rename(&place, &away).unwrap();
    let gone = store.apply(&edit("anna", vec![create(&point("b", 0.0))])).await;
    assert!(matches!(gone, Err(StoreError::FileGone)), "{gone:?}");
    assert!(!place.exists(), "no empty log takes its place");
    // A different file is put at the path.
    Store::open(other.to_str().unwrap()).await.unwrap().close().await;
    std::fs::rename(&other, &place).unwrap();
    let replaced = store.put_template("t", "{}", "anna").await;
    assert!(matches!(replaced, Err(StoreError::FileGone)), "{replaced:?}");
    std::fs::rename(&away, &place).unwrap();
    store.apply(&edit("anna", vec![create(&point("c", 0.0))])).await.unwrap();
    store.close().await;
    let again = Store::open(place.to_str().unwrap()).await.unwrap();
    assert_eq!(again.check().await.unwrap().items, 2);
}

/// Invariant: Only the owner can read a new log and the files beside it. An existing log keeps its
/// permissions.
#[cfg(unix)]
#[tokio::test]
async fn a_new_log_is_private() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("log.db");
    let modes = || {
        let files = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap());
        files.map(|file| file.metadata().unwrap().permissions().mode() & 0o777).collect::<Vec<_>>()
    };
    let store = Store::open(place.to_str().unwrap()).await.unwrap();
    store.apply(&edit("anna", vec![create(&point("a", 0.0))])).await.unwrap();
    assert_eq!(modes(), [0o600; 3], "the log, its -wal and its -shm");
    store.close().await;
    std::fs::set_permissions(&place, std::fs::Permissions::from_mode(0o640)).unwrap();
    let store = Store::open(place.to_str().unwrap()).await.unwrap();
    store.apply(&edit("anna", vec![create(&point("b", 0.0))])).await.unwrap();
    assert_eq!(modes(), [0o640; 3]);
    drop(store);
}
