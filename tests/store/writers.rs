//! Many writers at once: nothing is lost, nothing is mixed.

use std::collections::BTreeSet;

use relief_annotation::{Geometry, Item};
use relief_base::Point;
use relief_store::{LogFilter, Store, StoreError};

use crate::scenarios;
use crate::store::made::{Made, create, edit, point, update};

const WRITERS: usize = 8;
const ROUNDS: usize = 12;

scenarios! {
    no_update_is_lost_among_eight_writers,
    edits_of_many_changes_stay_together,
}

/// Adds one to the x of an item, again and again where others are faster, as two people with a page
/// open would.
async fn count_up(store: Store, id: relief_annotation::ItemId, author: String) -> usize {
    let mut conflicts = 0;
    for _ in 0..ROUNDS {
        loop {
            let seen = store.item(id).await.unwrap();
            let at_mm = seen.item.point().unwrap();
            let next = Point::new(at_mm.xyz.x + 1.0, at_mm.xyz.y, at_mm.xyz.z);
            let item = Item { geometry: Some(Geometry::Point { at_mm: next }), ..seen.item };
            match store.apply(&edit(&author, vec![update(&item, seen.version)])).await {
                Ok(_) => break,
                Err(StoreError::Conflict { current: Some(current), .. }) => {
                    assert!(current.version > seen.version);
                    conflicts += 1;
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
    conflicts
}

async fn no_update_is_lost_among_eight_writers(store: &Store) {
    let counter = point("counter", 0.0);
    store.apply(&edit("anna", vec![create(&counter)])).await.unwrap();
    let writers: Vec<_> = (0..WRITERS)
        .map(|writer| tokio::spawn(count_up(store.clone(), counter.id, format!("writer {writer}"))))
        .collect();
    let mut conflicts = 0;
    for writer in writers {
        conflicts += writer.await.unwrap();
    }
    let end = store.item(counter.id).await.unwrap();
    assert_eq!(end.item.point().unwrap().xyz.x, (WRITERS * ROUNDS) as f64);
    assert_eq!(end.version, (WRITERS * ROUNDS + 1) as u64);
    // They did get into each other's way.
    assert!(conflicts > 0);
    store.check().await.unwrap();
}

async fn edits_of_many_changes_stay_together(store: &Store) {
    let write = async |store: Store, author: String| {
        for round in 0..ROUNDS {
            let items: Vec<_> = (0..=round).map(|i| point(&format!("{author} {i}"), i as f64)).collect();
            let events = store.apply(&edit(&author, items.iter().map(create).collect())).await.unwrap();
            assert_eq!(events.len(), items.len());
            if round % 3 == 2 {
                store.undo(&author, "").await.unwrap();
            }
        }
    };
    let writers = (0..WRITERS).map(|writer| write(store.clone(), format!("writer {writer}")));
    futures(writers.collect()).await;
    let log = store.log(&LogFilter::default()).await.unwrap();
    assert!(log.iter().map(|event| event.seq).eq(1..=log.len() as u64));
    let edits: BTreeSet<_> = log.iter().map(|event| event.edit).collect();
    assert_eq!(edits.len(), WRITERS * (ROUNDS + ROUNDS / 3));
    for part in log.chunk_by(|a, b| a.edit == b.edit) {
        assert!(part.iter().all(|event| event.author == part[0].author && event.edit == part[0].seq));
    }
    store.check().await.unwrap();
}

/// Waits for all, side by side.
async fn futures(all: Vec<impl Future<Output = ()>>) {
    let mut all: Vec<_> = all.into_iter().map(Box::pin).collect();
    std::future::poll_fn(|context| {
        all.retain_mut(|one| one.as_mut().poll(context).is_pending());
        if all.is_empty() { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
    })
    .await;
}

/// Invariant: An author cannot overwrite a change of an annotation that they have not seen.
///
/// Logs of one file that were opened one by one: as processes would have it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn writers_of_other_connections_wait_for_their_turn() {
    let made = Made::new().await;
    let counter = point("counter", 0.0);
    made.store.apply(&edit("anna", vec![create(&counter)])).await.unwrap();
    let mut writers = Vec::new();
    for writer in 0..WRITERS {
        let store = Store::open(made.place()).await.unwrap();
        writers.push(tokio::spawn(count_up(store, counter.id, format!("writer {writer}"))));
    }
    for writer in writers {
        writer.await.unwrap();
    }
    let end = made.store.item(counter.id).await.unwrap();
    assert_eq!(end.item.point().unwrap().xyz.x, (WRITERS * ROUNDS) as f64);
    made.store.check().await.unwrap();
}

/// All of them find no file and make one.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn a_log_is_made_once_however_many_open_it() {
    for _ in 0..5 {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("new.db").to_str().unwrap().to_owned();
        let open = |writer: usize| {
            let place = place.clone();
            tokio::spawn(async move {
                let store = Store::open(&place).await.unwrap();
                store.apply(&edit(&format!("{writer}"), vec![create(&point("a", 0.0))])).await.unwrap();
            })
        };
        let opened: Vec<_> = (0..WRITERS).map(open).collect();
        for opened in opened {
            opened.await.unwrap();
        }
        assert_eq!(Store::open(&place).await.unwrap().check().await.unwrap().events, WRITERS as u64);
    }
}
