//! Edits, listings, the log, locks, contents, sets and templates: what holds of both databases.

use relief_annotation::{ContentId, EventKind, FrameOfReference, Geometry, Item, RegionSummary, Set};
use relief_store::{Checked, Filter, LogFilter, NamedState, Permission, Store, StoreError};

use crate::store::made::{create, delete, edit, named, names, point, seqs, update};

use crate::scenarios;

scenarios! {
    an_edit_is_made_whole_or_not_at_all,
    a_stale_change_is_told_with_both_versions,
    a_locked_item_changes_in_nothing_but_its_lock,
    edits_are_taken_back_and_made_again_author_by_author,
    taking_back_stops_where_another_author_has_been,
    listings_and_logs_are_filtered_and_in_order,
    contents_are_kept_once_and_are_there_before_items_that_name_them,
    sets_and_templates_are_kept_with_who_made_them,
}

async fn an_edit_is_made_whole_or_not_at_all(store: &Store) {
    let [a, b] = [point("a", 1.0), point("b", 1e-17)];
    let events = store.apply(&edit("anna", vec![create(&a), create(&b)])).await.unwrap();
    assert_eq!(seqs(&events), [1, 2]);
    assert!(events.iter().all(|event| (event.edit, event.kind, event.version) == (1, EventKind::Do, 1)));
    assert_eq!(store.item(b.id).await.unwrap().item, b, "to the last bit");

    let stale = edit("ben", vec![update(&named(&a, "A"), 1), delete(b.id, 7)]);
    assert!(matches!(store.apply(&stale).await, Err(StoreError::Conflict { expected: 7, .. })));
    assert_eq!((names(store).await, store.seq().await.unwrap()), (vec!["a".to_owned(), "b".to_owned()], 2));
    let bad = Item { name: String::new(), ..a.clone() };
    let refused = store.apply(&edit("anna", vec![update(&a, 1), update(&bad, 1)])).await;
    assert!(matches!(refused, Err(StoreError::Invalid(_))));

    let events = store.apply(&edit("ben", vec![update(&named(&a, "A"), 1), delete(b.id, 1)])).await.unwrap();
    assert_eq!((seqs(&events), events[1].edit, events[1].version), (vec![3, 4], 3, 2));
    assert_eq!(names(store).await, ["A"]);
    assert!(matches!(store.item(b.id).await, Err(StoreError::NotFound { id }) if id == b.id));
    assert_eq!(store.check().await.unwrap(), Checked { events: 4, items: 1, contents: 0 });
}

/// Invariant: An author cannot overwrite a change of an annotation that they have not seen.
async fn a_stale_change_is_told_with_both_versions(store: &Store) {
    let a = point("a", 1.0);
    store.apply(&edit("anna", vec![create(&a)])).await.unwrap();
    store.apply(&edit("ben", vec![update(&named(&a, "ben's"), 1)])).await.unwrap();
    let mine = named(&a, "mine");
    match store.apply(&edit("anna", vec![update(&mine, 1)])).await.unwrap_err() {
        StoreError::Conflict { id, expected, current: Some(current), yours: Some(yours) } => {
            assert_eq!((id, expected, current.version), (a.id, 1, 2));
            assert_eq!((current.item.name.as_str(), *yours), ("ben's", mine.clone()));
        }
        other => panic!("{other}"),
    }
    store.apply(&edit("ben", vec![delete(a.id, 2)])).await.unwrap();
    let gone = store.apply(&edit("anna", vec![update(&mine, 2)])).await.unwrap_err();
    assert!(gone.to_string().contains("is gone"), "{gone}");
    assert!(matches!(gone, StoreError::Conflict { current: None, yours: Some(_), .. }));
    // An id is used once, and what never was cannot change.
    let again = store.apply(&edit("anna", vec![create(&a)])).await;
    assert!(matches!(again, Err(StoreError::Exists { .. })));
    let never = store.apply(&edit("anna", vec![delete(point("x", 0.0).id, 1)])).await;
    assert!(matches!(never, Err(StoreError::NotFound { .. })));
}

async fn a_locked_item_changes_in_nothing_but_its_lock(store: &Store) {
    let open = point("a", 1.0);
    let locked = Item { locked: true, ..open.clone() };
    store.apply(&edit("anna", vec![create(&locked)])).await.unwrap();
    for change in [
        delete(open.id, 1),
        update(&named(&open, "other"), 1),
        update(&named(&locked, "other"), 1),
        update(&locked, 1),
    ] {
        let refused = store.apply(&edit("ben", vec![change])).await;
        assert!(matches!(refused, Err(StoreError::Locked { id }) if id == open.id));
    }
    store.apply(&edit("ben", vec![update(&open, 1)])).await.unwrap();
    store.apply(&edit("ben", vec![delete(open.id, 2)])).await.unwrap();
    assert!(names(store).await.is_empty());
}

async fn edits_are_taken_back_and_made_again_author_by_author(store: &Store) {
    let [a, b] = [point("a", 1.0), point("b", 2.0)];
    store.apply(&edit("anna", vec![create(&a)])).await.unwrap();
    store.apply(&edit("ben", vec![create(&b)])).await.unwrap();
    store.apply(&edit("anna", vec![update(&named(&a, "A"), 1)])).await.unwrap();
    // Ben's newest edit is older than anna's, and is the one that goes.
    let undone = store.undo("ben", "no").await.unwrap();
    assert_eq!((undone[0].kind, undone[0].target, undone[0].version), (EventKind::Undo, Some(2), 2));
    assert_eq!((undone[0].item.as_ref(), undone[0].reason.as_str()), (None, "no"));
    assert!(matches!(store.undo("ben", "").await, Err(StoreError::NothingToUndo)));
    store.undo("anna", "").await.unwrap();
    assert_eq!(names(store).await, ["a"]);
    store.undo("anna", "").await.unwrap();
    assert!(names(store).await.is_empty());
    assert!(matches!(store.undo("anna", "").await, Err(StoreError::NothingToUndo)));
    let redone = store.redo("anna", "").await.unwrap();
    assert_eq!(
        (redone[0].kind, redone[0].target, redone[0].item.as_ref()),
        (EventKind::Redo, Some(1), Some(&a))
    );
    // A new edit clears the redo list of its own author only.
    store.apply(&edit("anna", vec![update(&named(&a, "new"), 5)])).await.unwrap();
    assert!(matches!(store.redo("anna", "").await, Err(StoreError::NothingToRedo)));
    store.redo("ben", "").await.unwrap();
    assert_eq!(names(store).await, ["new", "b"]);
    store.check().await.unwrap();
}

/// Invariant: An author cannot overwrite a change of an annotation that they have not seen.
async fn taking_back_stops_where_another_author_has_been(store: &Store) {
    let [a, b] = [point("a", 1.0), point("b", 2.0)];
    store.apply(&edit("anna", vec![create(&a), create(&b)])).await.unwrap();
    store.apply(&edit("anna", vec![update(&named(&a, "A"), 1), update(&named(&b, "B"), 1)])).await.unwrap();
    store.apply(&edit("ben", vec![update(&named(&b, "ben's"), 2)])).await.unwrap();
    match store.undo("anna", "").await.unwrap_err() {
        StoreError::Conflict { id, expected, current: Some(current), yours: Some(yours) } => {
            assert_eq!((id, expected, current.version), (b.id, 2, 3));
            assert_eq!((current.item.name.as_str(), yours.name.as_str()), ("ben's", "b"));
        }
        other => panic!("{other}"),
    }
    assert_eq!(names(store).await, ["A", "ben's"], "nothing of it happened");
    // When ben takes it back, anna can.
    store.undo("ben", "").await.unwrap();
    store.undo("anna", "").await.unwrap();
    assert_eq!(names(store).await, ["a", "b"]);
    // The same the other way round.
    store.apply(&edit("ben", vec![delete(a.id, 3)])).await.unwrap();
    let refused = store.redo("anna", "").await.unwrap_err();
    assert!(matches!(refused, StoreError::Conflict { current: None, yours: Some(_), .. }), "{refused}");
    store.check().await.unwrap();
}

async fn listings_and_logs_are_filtered_and_in_order(store: &Store) {
    let item = |name: &str, set: &str, list: &str, order, frame: Option<&str>| Item {
        set: set.to_owned(),
        list: list.to_owned(),
        order,
        frame_of_reference: frame.map(|frame| FrameOfReference(frame.to_owned())),
        ..point(name, 0.0)
    };
    let items = [
        item("4", "b", "", 0, None),
        item("3", "a", "l", 1, Some("1.2")),
        item("2", "a", "l", 0, Some("1.2")),
        item("1", "a", "", 9, Some("1.3")),
    ];
    for item in &items {
        store.apply(&edit("anna", vec![create(item)])).await.unwrap();
    }
    store.undo("anna", "").await.unwrap();
    store.redo("anna", "").await.unwrap();
    assert_eq!(names(store).await, ["1", "2", "3", "4"]);
    let list = async |filter: Filter| {
        let items = store.list(&filter).await.unwrap().items;
        items.into_iter().map(|found| found.item.name).collect::<String>()
    };
    let frame = Some(FrameOfReference("1.2".to_owned()));
    assert_eq!(list(Filter { sets: Some(vec!["b".to_owned()]), ..Filter::default() }).await, "4");
    assert_eq!(list(Filter { frame_of_reference: frame.clone(), ..Filter::default() }).await, "23");
    assert_eq!(list(Filter { after_seq: 2, frame_of_reference: frame, ..Filter::default() }).await, "2");
    assert_eq!(list(Filter { sets: Some(Vec::new()), ..Filter::default() }).await, "");
    let log = async |filter: LogFilter| seqs(&store.log(&filter).await.unwrap());
    assert_eq!(log(LogFilter::default()).await, [1, 2, 3, 4, 5, 6]);
    assert_eq!(log(LogFilter { after: 2, limit: Some(2), ..LogFilter::default() }).await, [3, 4]);
    assert_eq!(log(LogFilter { item: Some(items[3].id), ..LogFilter::default() }).await, [4, 5, 6]);
    assert_eq!(log(LogFilter { author: Some("ben".to_owned()), ..LogFilter::default() }).await, [0; 0]);
}

async fn contents_are_kept_once_and_are_there_before_items_that_name_them(store: &Store) {
    let bytes: Vec<u8> = (0..200_000_u32).flat_map(u32::to_le_bytes).collect();
    let region = |content| Item {
        geometry: Some(Geometry::Region(RegionSummary { content, label: 1, voxels: 2, volume_ml: 0.5 })),
        ..point("liver", 0.0)
    };
    let item = region(ContentId::of(&bytes));
    let refused = store.apply(&edit("anna", vec![create(&item)])).await;
    assert!(matches!(refused, Err(StoreError::Content { id }) if id == ContentId::of(&bytes)));
    for media_type in ["application/x-nrrd", "text/plain"] {
        assert_eq!(store.put_content(media_type, &bytes).await.unwrap(), ContentId::of(&bytes));
    }
    store.apply(&edit("anna", vec![create(&item)])).await.unwrap();
    let (media_type, found) = store.content(&ContentId::of(&bytes)).await.unwrap();
    assert!(media_type == "application/x-nrrd" && found == bytes);
    assert!(matches!(store.content(&ContentId::of(b"x")).await, Err(StoreError::Content { .. })));
    assert!(matches!(store.put_content("", b"x").await, Err(StoreError::Invalid(_))));
    assert_eq!(store.check().await.unwrap(), Checked { events: 1, items: 1, contents: 1 });
}

async fn sets_and_templates_are_kept_with_who_made_them(store: &Store) {
    let set = |name: &str, reader: Option<&str>| Set {
        name: name.to_owned(),
        reader: reader.map(str::to_owned),
        blinded: reader.is_some(),
        template: None,
    };
    store.apply(&edit("anna", vec![create(&point("a", 0.0))])).await.unwrap();
    store.put_set(&set("anna", None), "chief").await.unwrap();
    store.put_set(&set("anna", Some("anna")), "chief").await.unwrap();
    assert_eq!(store.sets().await.unwrap(), [set("anna", Some("anna")), set("default", None)]);
    assert!(matches!(store.put_set(&set("a b", None), "chief").await, Err(StoreError::Invalid(_))));
    assert!(matches!(store.put_set(&set("b", None), "").await, Err(StoreError::Invalid(_))));
    let refused = store
        .put_set_if(&set("anna", None), "eve", |known| {
            assert_eq!((known.creator.as_deref(), known.has_items_of_others), (Some("chief"), false));
            assert!(
                known.text.as_ref().is_some_and(|text| text.contains("\"reader\":\"anna\"")),
                "{known:?}"
            );
            Permission::Replaced
        })
        .await;
    assert!(matches!(refused, Err(StoreError::Replaced { name }) if name == "anna"));
    // The only item of the default set is anna's.
    for (author, has_items_of_others) in [("anna", false), ("eve", true)] {
        let own = |known: &NamedState| {
            assert_eq!((&known.creator, known.has_items_of_others), (&None, has_items_of_others), "{author}");
            Permission::NotOwner
        };
        let refused = store.put_set_if(&set("default", None), author, own).await;
        assert!(matches!(refused, Err(StoreError::NotOwner { name }) if name == "default"));
    }
    assert!(matches!(store.template("skull").await, Err(StoreError::NoTemplate { .. })));
    store.put_template("skull", "{\"a\":1}", "chief").await.unwrap();
    store.put_template("skull", "{}", "anna").await.unwrap();
    assert_eq!(store.template("skull").await.unwrap(), "{}");
    assert_eq!(store.templates().await.unwrap(), ["skull"]);
    assert!(store.put_template("x y", "{}", "anna").await.is_err());
    let audit = store.audit().await.unwrap();
    let reported: Vec<_> =
        audit.iter().map(|line| (line.seq, line.name.as_str(), line.author.as_str())).collect();
    assert_eq!(
        reported,
        [(1, "anna", "chief"), (2, "anna", "chief"), (3, "skull", "chief"), (4, "skull", "anna")]
    );
    assert_eq!(audit[2].body, "{\"a\":1}");
}
