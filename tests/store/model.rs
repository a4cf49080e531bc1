//! Random edits, undos and redos of several authors, against a model that keeps whole histories in
//! memory.
#![expect(
    clippy::type_complexity,
    clippy::large_enum_variant,
    clippy::result_large_err,
    reason = "a model, compared by value"
)]

use std::collections::BTreeMap;

use proptest::prelude::*;
use relief_annotation::{Change, Event, EventKind, Item, ItemId};
use relief_store::{Filter, LogFilter, Store, StoreError};

use crate::scenarios;
use crate::store::made::{Made, create, delete, edit, point, update};

const AUTHORS: [&str; 3] = ["anna", "ben", "çelik"];
const STEPS: usize = 40;

/// An operation of the model.
#[derive(Clone, Debug)]
enum Step {
    /// Item, what to do with it, and whether its version is a stale one.
    Edit(usize, BTreeMap<u8, (Operation, bool)>),
    Undo(usize),
    Redo(usize),
}

#[derive(Clone, Copy, Debug)]
enum Operation {
    Make,
    Move,
    Toggle,
    Remove,
}

/// An author's edit: each item before and after.
type OneEdit = (u64, Vec<(ItemId, Option<Item>, Option<Item>)>);

#[derive(Default)]
struct Model {
    items: BTreeMap<ItemId, (u64, Option<Item>)>,
    seq: u64,
    done: [Vec<OneEdit>; 3],
    undone: [Vec<OneEdit>; 3],
    log: Vec<(u64, u64, EventKind, Option<u64>, ItemId, u64, Option<Item>)>,
}

#[derive(Debug, PartialEq)]
enum Refused {
    Conflict(ItemId, Option<(u64, Item)>, Option<Item>),
    Locked,
    NotFound,
    Exists,
    Nothing,
}

impl Model {
    fn edit(&mut self, author: usize, changes: &[Change]) -> Result<(), Refused> {
        let mut made = Vec::new();
        for change in changes {
            let now = self.items.get(&change.id()).cloned();
            let after = match (change, now.clone()) {
                (Change::Create { item }, None) => Some(item.as_ref().clone()),
                (Change::Create { .. }, Some(_)) => return Err(Refused::Exists),
                (_, None) => return Err(Refused::NotFound),
                (Change::Update { item, version }, Some((is, Some(now)))) if is == *version => {
                    let mut unlocked = now.clone();
                    unlocked.locked = false;
                    if now.locked && **item != unlocked {
                        return Err(Refused::Locked);
                    }
                    Some(item.as_ref().clone())
                }
                (Change::Delete { version, .. }, Some((is, Some(now)))) if is == *version => {
                    if now.locked {
                        return Err(Refused::Locked);
                    }
                    None
                }
                (change, Some((is, now))) => {
                    let yours = match change {
                        Change::Update { item, .. } => Some(item.as_ref().clone()),
                        _ => None,
                    };
                    return Err(Refused::Conflict(change.id(), now.map(|now| (is, now)), yours));
                }
            };
            made.push((change.id(), now.and_then(|(_, now)| now), after));
        }
        self.undone[author].clear();
        self.write(EventKind::Do, None, made.iter().map(|(id, _, after)| (*id, after.clone())).collect());
        let number = self.log.last().unwrap().1;
        self.done[author].push((number, made));
        Ok(())
    }

    fn step(&mut self, author: usize, kind: EventKind) -> Result<(), Refused> {
        let stack = if kind == EventKind::Undo { &self.done } else { &self.undone };
        let (number, made) = stack[author].last().cloned().ok_or(Refused::Nothing)?;
        let mut moves: Vec<_> = made
            .iter()
            .cloned()
            .map(
                |(id, before, after)| {
                    if kind == EventKind::Undo { (id, after, before) } else { (id, before, after) }
                },
            )
            .collect();
        if kind == EventKind::Undo {
            moves.reverse();
        }
        for (id, from, to) in &moves {
            let (version, now) = self.items[id].clone();
            if now != *from {
                return Err(Refused::Conflict(*id, now.map(|now| (version, now)), to.clone()));
            }
        }
        self.write(kind, Some(number), moves.into_iter().map(|(id, _, to)| (id, to)).collect());
        let [done, undone] = [&mut self.done[author], &mut self.undone[author]];
        let (from, to) = if kind == EventKind::Undo { (done, undone) } else { (undone, done) };
        to.extend(from.pop());
        Ok(())
    }

    fn write(&mut self, kind: EventKind, target: Option<u64>, states: Vec<(ItemId, Option<Item>)>) {
        let number = self.seq + 1;
        for (id, item) in states {
            self.seq += 1;
            let version = self.items.get(&id).map_or(0, |(version, _)| *version) + 1;
            self.items.insert(id, (version, item.clone()));
            self.log.push((self.seq, number, kind, target, id, version, item));
        }
    }
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let operation = prop_oneof![
        3 => Just(Operation::Make),
        4 => Just(Operation::Move),
        2 => Just(Operation::Toggle), // its lock
        2 => Just(Operation::Remove),
    ];
    let stale = prop_oneof![6 => Just(false), 1 => Just(true)];
    let author = 0..AUTHORS.len();
    let changes = prop::collection::btree_map(0..12_u8, (operation, stale), 1..4);
    let step = prop_oneof![
        4 => (author.clone(), changes).prop_map(|(author, changes)| Step::Edit(author, changes)),
        3 => author.clone().prop_map(Step::Undo),
        2 => author.prop_map(Step::Redo),
    ];
    prop::collection::vec(step, STEPS)
}

/// The changes of a step, as an author who sees the model would make them.
fn changes(model: &Model, operations: &BTreeMap<u8, (Operation, bool)>, count: usize) -> Vec<Change> {
    let change = |(index, (operation, stale)): (&u8, &(Operation, bool))| {
        let id = ItemId::from_number(u128::from(*index) + 1);
        let fresh = Item { id, ..point(&format!("{index} at {count}"), count as f64 / 3.0) };
        let (version, now) = model.items.get(&id).cloned().unwrap_or((1, None));
        let version = version - u64::from(*stale && version > 0);
        match operation {
            Operation::Make => create(&fresh),
            Operation::Move => update(&fresh, version),
            Operation::Toggle => {
                let now = now.unwrap_or(fresh);
                update(&Item { locked: !now.locked, ..now }, version)
            }
            Operation::Remove => delete(id, version),
        }
    };
    operations.iter().map(change).collect()
}

fn refused(error: StoreError) -> Refused {
    match error {
        StoreError::Conflict { id, current, yours, .. } => {
            let current = current.map(|current| (current.version, current.item));
            Refused::Conflict(id, current, yours.map(|yours| *yours))
        }
        StoreError::Locked { .. } => Refused::Locked,
        StoreError::NotFound { .. } => Refused::NotFound,
        StoreError::Exists { .. } => Refused::Exists,
        StoreError::NothingToUndo | StoreError::NothingToRedo => Refused::Nothing,
        other => panic!("{other}"),
    }
}

async fn follow(store: &Store, steps: &[Step]) {
    let mut model = Model::default();
    for (count, step) in steps.iter().enumerate() {
        let (expected, found) = match step {
            Step::Edit(author, operations) => {
                let changes = changes(&model, operations, count);
                let expected = model.edit(*author, &changes);
                (expected, store.apply(&edit(AUTHORS[*author], changes)).await)
            }
            Step::Undo(author) => {
                (model.step(*author, EventKind::Undo), store.undo(AUTHORS[*author], "").await)
            }
            Step::Redo(author) => {
                (model.step(*author, EventKind::Redo), store.redo(AUTHORS[*author], "").await)
            }
        };
        let found = found.map(|events| {
            // The answer agrees with the log.
            assert!(
                events.iter().map(reported).eq(model.log[model.log.len() - events.len()..].iter().cloned())
            );
        });
        assert_eq!(found.map_err(refused), expected, "step {count}: {step:?}");
    }
    let log = store.log(&LogFilter::default()).await.unwrap();
    assert!(log.iter().map(reported).eq(model.log.iter().cloned()));
    let listing = store.list(&Filter::default()).await.unwrap();
    let listed: BTreeMap<_, _> =
        listing.items.into_iter().map(|found| (found.item.id, (found.version, Some(found.item)))).collect();
    model.items.retain(|_, (_, item)| item.is_some());
    assert_eq!((listing.seq, listed), (model.seq, model.items));
    store.check().await.unwrap();
}

fn reported(event: &Event) -> (u64, u64, EventKind, Option<u64>, ItemId, u64, Option<Item>) {
    let Event { seq, edit, kind, target, id, version, item, .. } = event.clone();
    (seq, edit, kind, target, id, version, item)
}

/// A few random lines on another database: enough to see that it does the same.
#[cfg(feature = "full")]
pub(crate) async fn random_steps(server: &crate::store::postgres::Server) {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    for case in 0..6 {
        let steps = steps().new_tree(&mut runner).unwrap().current();
        let store = server.store(&format!("random {case}")).await;
        follow(&store, &steps).await;
        store.close().await;
    }
}

fn random(cases: u32, run: impl Fn(&[Step])) {
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(steps in steps())| run(&steps));
}

/// Invariant: Events never change, and the items equal the fold of the events.
#[test]
fn the_log_does_what_a_model_of_it_does() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    random(24, |steps| {
        runtime.block_on(async {
            let made = Made::new().await;
            follow(&made.store, steps).await;
            made.store.close().await;
        });
    });
}

scenarios! {
    a_line_of_edits_goes_back_and_forth,
}

/// One long line, by hand: to its beginning, to its end, and half way.
async fn a_line_of_edits_goes_back_and_forth(store: &Store) {
    let make = |index: u8| Step::Edit(0, [(index, (Operation::Make, false))].into());
    let change = |index: u8| Step::Edit(0, [(index, (Operation::Move, false))].into());
    let lock = |index: u8| Step::Edit(1, [(index, (Operation::Toggle, false))].into());
    let mut steps = vec![make(0), make(1), change(0), change(1), lock(0), change(0), Step::Undo(0)];
    steps.extend([Step::Undo(0), Step::Undo(1), Step::Undo(0), Step::Undo(0), Step::Undo(0), Step::Undo(0)]);
    steps.extend(std::iter::repeat_n(Step::Redo(0), 5));
    steps.extend([Step::Undo(0), change(0), Step::Redo(0), Step::Undo(0), Step::Undo(0), Step::Redo(1)]);
    follow(store, &steps).await;
}
