//! The same log in PostgreSQL: a server of our own on loopback, in a folder that goes with it.
//!
//! Needs PostgreSQL's programs: those of `scripts/setup-postgres` (`RELIEF_POSTGRES`), Debian's, or
//! those on the path.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use relief_store::{Store, StoreError};
use sqlx::{Executor, Row};

pub(crate) use crate::postgres_server::Server;
use crate::store::made::{create, edit, names, point};
use crate::store::{basics, model, writers};

/// Invariant: An acknowledged edit is durable, and no edit is stored partially, whenever the
/// process is killed.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn postgres_keeps_the_same_log() {
    let Some(mut server) = Server::start("the log in PostgreSQL").await else { return };
    // First, for it syncs every file of every database when it comes back.
    acknowledged_edits_survive_a_crash(&mut server).await;
    basics::all(&server).await;
    model::all(&server).await;
    model::random_steps(&server).await;
    writers::all(&server).await;
    many_make_one(&server).await;
    lines_of_the_log_are_never_altered(&server).await;
    other_schemas_are_refused(&server).await;
    let refused = Store::open(&server.url("nowhere")).await.unwrap_err();
    assert!(refused.to_string().contains("does not exist"), "{refused}");
    let url = server.url("postgres");
    drop(server);
    assert!(matches!(Store::open(&url).await, Err(StoreError::Unreachable(_))));
}

async fn many_make_one(server: &Server) {
    server.database("many").await;
    let opened: Vec<_> = (0..8)
        .map(|_| {
            let url = server.url("many");
            tokio::spawn(async move { Store::open(&url).await.unwrap().seq().await.unwrap() })
        })
        .collect();
    for opened in opened {
        assert_eq!(opened.await.unwrap(), 0);
    }
}

async fn lines_of_the_log_are_never_altered(server: &Server) {
    let store = server.store("altered").await;
    store.apply(&edit("anna", vec![create(&point("a", 0.0))])).await.unwrap();
    store.put_content("text/plain", b"x").await.unwrap();
    let mut admin = server.admin("altered").await;
    admin.execute("SET search_path TO relief").await.unwrap();
    for statement in [
        "UPDATE events SET author = 'ben'",
        "DELETE FROM events",
        "TRUNCATE events CASCADE",
        "DELETE FROM contents",
        "UPDATE audit SET author = 'ben'",
        "INSERT INTO events SELECT 3, 3, kind, target, id, 2, author, reason, time, item, content FROM events",
        "INSERT INTO events SELECT 2, 2, kind, target, id, 7, author, reason, time, item, content FROM events",
    ] {
        assert!(admin.execute(statement).await.is_err(), "{statement}");
    }
    let durable = admin.fetch_one("SELECT current_setting('synchronous_commit')").await.unwrap();
    assert_eq!(durable.get::<String, _>(0), "on");
    store.check().await.unwrap();
    store.close().await;
}

async fn other_schemas_are_refused(server: &Server) {
    let store = server.store("newer").await;
    store.close().await;
    server.admin("newer").await.execute("UPDATE relief.meta SET value = '2'").await.unwrap();
    let refused = Store::open(&server.url("newer")).await.unwrap_err();
    assert!(matches!(refused, StoreError::Schema { found: 2, known: 1 }), "{refused}");
    server.database("foreign").await;
    server.admin("foreign").await.execute("CREATE SCHEMA relief").await.unwrap();
    let refused = Store::open(&server.url("foreign")).await.unwrap_err();
    assert!(matches!(refused, StoreError::Foreign(_)), "{refused}");
}

/// The server is killed while others write; afterwards all acknowledged changes are there, and the
/// same store continues.
async fn acknowledged_edits_survive_a_crash(server: &mut Server) {
    let store = server.store("crash").await;
    for round in 0..3 {
        let (writing, is_over) = (store.clone(), Arc::new(AtomicBool::new(false)));
        let (over, written) = (Arc::clone(&is_over), Arc::new(AtomicUsize::new(0)));
        let count = Arc::clone(&written);
        let writer = tokio::spawn(async move {
            let mut acknowledged = Vec::new();
            // Between two edits a crash may pass unnoticed: the next one waits for the new server.
            while !over.load(Ordering::Relaxed) {
                let item = point(&format!("p{round}"), 0.0);
                match writing.apply(&edit("anna", vec![create(&item)])).await {
                    Ok(_) => acknowledged.push(item.id),
                    Err(_) => break,
                }
                count.fetch_add(1, Ordering::Relaxed);
            }
            acknowledged
        });
        while written.load(Ordering::Relaxed) < 10 && !writer.is_finished() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        server.crash().await;
        is_over.store(true, Ordering::Relaxed);
        let acknowledged = writer.await.unwrap();
        assert!(acknowledged.len() >= 10, "{} edits before the crash", acknowledged.len());
        for id in acknowledged {
            store.item(id).await.unwrap();
        }
        store.check().await.unwrap();
    }
    assert!(!names(&store).await.is_empty());
    store.close().await;
}
